"""Ground and ceiling at once, any layout: the images of both, and the images of those.

    s_i = sum_j I(2 z, h_ij)
          + sum_n kappa^n sum_j [I(2 n g + 2 z, h_ij) + I(2 n g - 2 z, h_ij) - 2 I(2 n g, h_ij)]
    L / L_inf = mean over i of 1 / (1 - s_i),   I(H, h) = (H / 4) / (h^2 + H^2)^(3/2)

with z = z_hat from the ground, g = `[rig] gap` over r from ground to ceiling, h_ij the distance of
rotors i and j. n = 1 has the ceiling's own image (2 g - 2 z), and the image in both planes with the
ground last (2 g + 2 z). It also has the two that are mirrored twice (2 g). They blow as the rotor
does and draw more air through it, whereas a single mirror turns the rotor round.

Convention: kappa is the share of an image that the ceiling gives, and counts once for each
reflection in it. 1 is a mirror, 0 no ceiling. 1/2 is the far limit of Hsiao and Chirarattananon's
theory: gamma = 1 + 1 / (32 z^2), where an image has 1 + 1 / (16 z^2). Trials are counted from the
ground, as `boundary = "ground"`; free air has neither boundary.

Approximation: that of `images`. Near the ceiling radial inflow dominates, which no image has; the
wake that fills a corridor and returns is not in it. Sixteen orders: in a gap of 2 radii or more the
omitted ones cancel less than 1e-5 of the inflow.

Two sidewalls have no model of this kind. The image of a rotor in a wall makes no axial inflow at
it, nor does any image of that (`sidewall_none`). No one has measured a sum of two losses.

Refusal: nan at or behind either boundary, and where nothing of the inflow is left.

A gap without end, or kappa = 0, gives `images`; one rotor between mirrors gives 1 - s with
s = (pi / g)^2 (1 / sin^2(pi z / g) - 1 / 3) / 16.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from nearlift.declare import Check, FloatArray, LiftModel, Parameter, Source, normal
from nearlift.models.images import square
from nearlift.models.inflow import clear_of_boundary, gain, image

REFLECTIONS = 16


def reflected(z_hat: Any, layout_hat: Any, gap_hat: float) -> Iterator[FloatArray]:
    """Inflow cancelled at each rotor by the images of order n, (..., rotors); 0 is the ground."""
    z = np.asarray(z_hat, dtype=float)
    free = np.isposinf(z)
    z = np.where(free, 0.5 * min(gap_hat, 2.0), z)
    z = np.where(np.isnan(clear_of_boundary(gap_hat - z)), np.nan, clear_of_boundary(z))
    z = z[..., None, None]
    x, y = np.asarray(layout_hat, dtype=float).T
    apart = np.hypot(np.subtract.outer(x, x), np.subtract.outer(y, y))
    yield np.where(free[..., None], 0.0, image(2.0 * z, apart).sum(axis=-1))
    for n in range(1, REFLECTIONS + 1):
        far = 2.0 * n * gap_hat
        pairs = image(far + 2.0 * z, apart) + image(far - 2.0 * z, apart) - 2.0 * image(far, apart)
        yield np.where(free[..., None], 0.0, pairs.sum(axis=-1))


def cancelled_per_rotor(z_hat: Any, layout_hat: Any, gap_hat: float, kappa: Any) -> FloatArray:
    """Fraction of inflow cancelled at each rotor, shape (..., rotors)."""
    share = np.asarray(kappa, dtype=float)[..., None]
    orders = reflected(z_hat, layout_hat, gap_hat)
    result: FloatArray = sum((share**n * part for n, part in enumerate(orders)), start=np.zeros(1))
    return result


def each(z_hat: Any, /, *, layout_hat: Any, gap_hat: Any, kappa: Any) -> Any:
    """L / L_inf of each rotor."""
    return gain(cancelled_per_rotor(z_hat, layout_hat, gap_hat, kappa))


def evaluate(z_hat: Any, /, *, layout_hat: Any, gap_hat: Any, kappa: Any) -> Any:
    """L / L_inf of the whole vehicle. Shapes broadcast."""
    return each(z_hat, layout_hat=layout_hat, gap_hat=gap_hat, kappa=kappa).mean(axis=-1)


def downwash(z_hat: Any, /, *, layout_hat: Any, gap_hat: Any, kappa: Any) -> Any:
    """Induced velocity at the disks over its value far away, mean over the rotors."""
    return 1.0 - cancelled_per_rotor(z_hat, layout_hat, gap_hat, kappa).mean(axis=-1)


_ONE = ((0.0, 0.0),)

MODEL = LiftModel(
    name="corridor",
    title="Corridor, images of ground and ceiling",
    formula=(
        r"\frac{L}{L_\infty} = \frac{1}{m} \sum_i \frac{1}{1 - s_i}, \quad"
        r" s_i = \sum_j \left\{I_{ij}(2 \hat{z}) + \sum_{n \geq 1} \kappa^n"
        r" \left[I_{ij}(2 n \hat{g} + 2 \hat{z}) + I_{ij}(2 n \hat{g} - 2 \hat{z})"
        r" - 2 I_{ij}(2 n \hat{g})\right]\right\}, \quad"
        r" I_{ij}(H) = \frac{H / 4}{(\hat{h}_{ij}^2 + H^2)^{3/2}}"
    ),
    evaluate=evaluate,
    downwash=downwash,
    per_rotor=each,
    boundary="ground",
    parameters=(
        Parameter(
            name="kappa",
            unit="1",
            value=0.5,
            bounds=(0.0, 1.0),
            prior=normal(0.5, 0.25),
            meaning="share of an image that the ceiling gives: 1 a mirror, 0 no ceiling",
        ),
    ),
    needs=("layout_hat", "gap_hat"),
    valid_z_hat=(0.25, math.inf),
    source=Source(
        citation=(
            "Own sum of the images of Cheeseman and Bennett in two planes. Per rotor after"
            " Sanchez-Cuevas, Heredia and Ollero 2017 (10.1155/2017/1823056). The ceiling's share"
            " after Hsiao and Chirarattananon 2019 (10.1109/TMECH.2019.2929589)"
        ),
        bibtex=("cheeseman1955", "sanchezcuevas2017", "hsiao2019"),
        doubts=(
            "No measurement of a small rotor between ground and ceiling was at hand.",
            (
                "That an image mirrored twice draws more air through the rotor follows from the"
                " mirror, not from a wake that has met both boundaries."
            ),
            (
                "Rossow 1985 (NASA TM-86754) has both planes by vortex cylinders; read in"
                " abstract alone."
            ),
        ),
    ),
    checks=(
        Check(
            x=1.0,
            expected=1.0831,
            arguments={"layout_hat": square(90 / 23), "gap_hat": math.inf},
            tolerance=5e-5,
            quoted_by="own table of the ground alone, K_b = 0, d = 90 mm",
        ),
        Check(
            x=2.0,
            expected=1 / (1 - (math.pi / 4) ** 2 * (1 - 1 / 3) / 16),
            arguments={"layout_hat": _ONE, "gap_hat": 4.0, "kappa": 1.0},
            tolerance=1e-5,
            quoted_by="sum over all images of one rotor midway between mirrors, own algebra",
        ),
        Check(
            x=1.0,
            expected=1.067623,
            arguments={"layout_hat": _ONE, "gap_hat": 4.0},
            tolerance=5e-6,
            quoted_by=(
                "by hand to second order: (1 + (1/25 + 1/9 - 2/16)/2 + (1/81 + 1/49 - 2/64)/4) / 16"
            ),
        ),
    ),
    notes=__doc__ or "",
)
