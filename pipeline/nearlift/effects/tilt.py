"""Ratio: plane or vehicle is tilted.

    ratio -> (1 + (ratio - 1) (1 + (tilt_first t + tilt_second t^2) z_hat^-tilt_decay))
    (1 - tilt_lean t^2 / 2),   t = tilt_rad + tilt_zero

Mechanism: three of them. Tilted about another point than its centre, the vehicle comes nearer or
goes farther: first order, gain (1 - 2 x_0 t / z). About its centre, rotors on one side come nearer
by x_i t and gain more than the others lose: second order, 3 <x_i^2> t^2 / z^2 of a gain that scales
as z^-2. Where the cell does not tilt, a tilted force acts on it by its cosine, at every distance.

Convention: t > 0 as the schedule has it; tilt_first changes sign with it, tilt_second > 0 gains
lift on either side. tilt_decay is 0 where a tilt acts in proportion to the gain (turned wakes and
wall jets), 2 for the rotors' distances. tilt_lean is 1 where the vehicle tilts and the cell does
not, 0 where the plate tilts. In free air (a blank tilt allowed) nothing changes.

Size on a Crazyflie: 1 degree is 0.8 mm across 90 mm; second order, by the sum over images at z_hat
= 1, 0.03 % of lift at 1.5 degrees and 0.35 % at 5. A centre 10 mm off gives 0.1 % of lift per
degree there; the cosine takes 0.4 % at 5 degrees.

Confounded with height_offset and K_b at a constant tilt, and so by its zero. If the tilt is known
only to a degree, the uncertainty of a coefficient is larger than that of its fit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null, uniform


def evaluate(
    ratio: Any,
    /,
    *,
    z_hat: Any,
    tilt_rad: Any,
    tilt_first: Any,
    tilt_second: Any,
    tilt_decay: Any,
    tilt_zero: Any,
    tilt_lean: Any,
) -> Any:
    """L / L_inf of a tilted vehicle. Shapes broadcast."""
    angle = np.where(np.isinf(z_hat), 0.0, tilt_rad + tilt_zero)
    change = (tilt_first * angle + tilt_second * np.square(angle)) * np.maximum(z_hat, 1e-6) ** (
        -tilt_decay
    )
    return (ratio + (ratio - 1.0) * change) * (1.0 - 0.5 * tilt_lean * np.square(angle))


EFFECT = Effect(
    name="tilt",
    title="Tilt",
    formula=(
        r"\frac{L}{L_\infty} \to \left\{1 + \left(\frac{L}{L_\infty} - 1\right) \left[1 + (t_1 t +"
        r" t_2 t^2) \hat{z}^{-m}\right]\right\}"
        r" \left(1 - \tfrac{c}{2} t^2\right)"
    ),
    evaluate=evaluate,
    acts_on="ratio",
    mechanism="tilt puts rotors, or the whole vehicle, at other distances than recorded",
    varies_with="tilt_rad",
    separated_by="repeats at both signs",
    log_next_time=("tilt",),
    needs=("z_hat", "tilt_rad"),
    parameters=(
        Parameter(
            name="tilt_first",
            unit="1/rad",
            value=0.0,
            bounds=(-10.0, 10.0),
            prior=normal(0.0, 1.5),
            meaning=(
                "relative change of the gain per radian of tilt; positive where positive tilt gains"
                " lift"
            ),
        ),
        Parameter(
            name="tilt_second",
            unit="1/rad^2",
            value=0.0,
            bounds=(-100.0, 100.0),
            prior=normal(0.0, 10.0),
            meaning=(
                "relative change of the gain per square radian of tilt; positive where tilt to"
                " either side gains lift; 3.5 to 5 on a Crazyflie"
            ),
        ),
        Parameter(
            name="tilt_lean",
            unit="1",
            value=0.0,
            bounds=(-4.0, 6.0),
            prior=normal(0.0, 1.0),
            meaning=(
                "share of the cosine's loss of a tilted force that the cell reads, at every"
                " distance: 1 where the cell is fixed"
            ),
        ),
        Parameter(
            name="tilt_decay",
            unit="1",
            value=2.0,
            bounds=(0.0, 4.0),
            prior=uniform(0.0, 4.0),
            meaning=(
                "power of distance with which a tilt's share of the gain falls off: 0 turned wakes,"
                " 2 distances of the rotors"
            ),
            grid=(0.0, 2.0),
        ),
        Parameter(
            name="tilt_zero",
            unit="rad",
            value=0.0,
            bounds=(-0.1, 0.1),
            prior=normal(0.0, 0.02),
            meaning=(
                "true tilt where the log reads 0: an inclinometer on the plate does not measure"
                " the rotors' angle to it"
            ),
            grid=(0.0,),
        ),
    ),
    source=Source(
        citation=(
            "Own expansion of the per-rotor images of Sanchez-Cuevas, Heredia and Ollero 2017"
            " (10.1155/2017/1823056)"
        ),
        bibtex=("sanchezcuevas2017",),
        doubts=(
            (
                "The expansion is for rotors whose heights differ by much less than their"
                " distance; farther apart they gain more."
            ),
            "A tilted fountain and turned vortices have no known form.",
        ),
    ),
    checks=(
        null(1.1, z_hat=1.0, tilt_rad=0.1),
        Check(
            x=1.1,
            expected=1.1025,
            arguments={"z_hat": 2.0, "tilt_rad": 0.1, "tilt_second": 10.0},
            quoted_by="by hand: 0.1 (10 x 0.01) / 4",
        ),
        Check(
            x=1.1,
            expected=1.095,
            arguments={"z_hat": 1.0, "tilt_rad": -0.1, "tilt_first": 0.5, "tilt_decay": 0.0},
            quoted_by="by hand: 0.1 (0.5 x -0.1)",
        ),
        Check(
            x=1.1,
            expected=1.1 * 0.995,
            arguments={"z_hat": 1.0, "tilt_rad": 0.08, "tilt_zero": 0.02, "tilt_lean": 1.0},
            quoted_by="by hand: cosine of 0.1 to second order",
        ),
    ),
    notes=__doc__ or "",
)
