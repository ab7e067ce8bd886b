"""Counter-based random numbers: the n-th normal is a function of key, flight and n alone.

splitmix64 (Steele, Lea and Flood 2014) scrambles ``start + n * golden``. The ziggurat of 256 layers
(Marsaglia and Tsang 2000, with Doornik's separate bits for layer and position) makes an exact
normal of it. A rejected word, one in eighty, starts a chain of its own, so no normal depends on how
many words another took. A flight thus meets the same gusts in any order, block or thread. They are
also the same at every set-point, with every model (common random numbers) and any step.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from nearlift.compiler import compiled
from nearlift.declare import FloatArray

U = np.uint64
#: Increment and multipliers of splitmix64.
GOLDEN, MIX_1, MIX_2 = U(0x9E3779B97F4A7C15), U(0xBF58476D1CE4E5B9), U(0x94D049BB133111EB)
THIRTY, TWENTY_SEVEN, THIRTY_ONE, ELEVEN, ONE, LAYER = U(30), U(27), U(31), U(11), U(1), U(255)
#: Spacing of uniform numbers of 53 bits; an offset of half of it keeps their logarithm finite.
STEP = 2.0**-53
#: Where the tail of the 256-layer ziggurat begins.
TAIL = 3.6541528853610088


def _layers() -> tuple[FloatArray, FloatArray]:
    """Right ends of the 256 layers of equal area under exp(-x^2 / 2), with a last zero.

    Also the share of each layer that is wholly under the curve.
    """
    area = TAIL * math.exp(-0.5 * TAIL**2) + math.sqrt(math.pi / 2) * math.erfc(TAIL / math.sqrt(2))
    x = np.zeros(257)
    x[0], x[1] = area / math.exp(-0.5 * TAIL**2), TAIL
    for i in range(2, 256):
        x[i] = math.sqrt(-2 * math.log(area / x[i - 1] + math.exp(-0.5 * x[i - 1] ** 2)))
    return x, x[1:] / x[:-1]


EDGE, SURE = _layers()


@partial(compiled, inline="always")
def mix(x: Any) -> Any:
    """splitmix64's finaliser, a bijection of 64 bits."""
    x = (x ^ (x >> THIRTY)) * MIX_1
    x = (x ^ (x >> TWENTY_SEVEN)) * MIX_2
    return x ^ (x >> THIRTY_ONE)


@compiled
def begin(key: Any, flight: Any) -> Any:
    """Address of the first normal of a flight."""
    return mix(U(key) + mix(U(flight) * GOLDEN + ONE))


@compiled
def late(word: Any, layer: Any, u: Any) -> Any:
    """Normal of a word that its layer did not accept at once."""
    while True:
        word = mix(word + GOLDEN)
        chance = (float(word >> ELEVEN) + 0.5) * STEP
        if layer == 0:
            # beyond the last layer: Marsaglia's exact tail
            x = -math.log(chance) / TAIL
            word = mix(word + GOLDEN)
            if -2.0 * math.log((float(word >> ELEVEN) + 0.5) * STEP) > x * x:
                return TAIL + x if u > 0.0 else -TAIL - x
            continue
        x = u * EDGE[layer]
        inner = math.exp(-0.5 * (EDGE[layer] * EDGE[layer] - x * x))
        outer = math.exp(-0.5 * (EDGE[layer + 1] * EDGE[layer + 1] - x * x))
        if inner + chance * (outer - inner) < 1.0:
            return x
        word = mix(word + GOLDEN)
        layer = np.int64(word & LAYER)
        u = float(np.int64(word) >> 11) * (2.0 * STEP)
        if abs(u) < SURE[layer]:
            return u * EDGE[layer]


@compiled
def normal(at: Any) -> Any:
    """Standard normal at an address."""
    word = mix(at)
    layer = np.int64(word & LAYER)
    # the signed upper 53 bits: position within the layer, in [-1, 1)
    u = float(np.int64(word) >> 11) * (2.0 * STEP)
    if abs(u) < SURE[layer]:
        return u * EDGE[layer]
    return late(word, layer, u)


@compiled
def fill(start: Any, out: Any) -> None:
    """Standard normals 0, 1, ... from a flight's first address."""
    for i in range(out.size):
        out[i] = normal(start + U(i) * GOLDEN)
