"""Random generators keyed by purpose, so that adding one use never changes another's draws."""

from __future__ import annotations

import zlib

import numpy as np


def generator(seed: int, *purpose: str) -> np.random.Generator:
    """An independent stream for (seed, purpose): ``generator(seed, "posterior", "ground",
    "sanchez_cuevas")``.
    """
    return np.random.default_rng([seed, *(zlib.crc32(p.encode()) for p in purpose)])
