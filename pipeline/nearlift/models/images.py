"""Ground, any layout: the sum of all rotors' images.

    s_i = (1/4) sum_j w_j (z_i + z_j) / (h_ij^2 + (z_i + z_j)^2)^(3/2)
    L / L_inf = mean over i of 1 / (1 - s_i)

with z_i the distance of rotor i from the boundary, h_ij the distance of rotors i and j along it,
w_j = 1 where rotor j has the boundary beneath it; all over rotor radius. Nothing is free.

Convention: `layout_hat` has a row (x, y) per rotor, in the rotor plane. A positive tilt lifts the
rotors at positive x; the distance z_hat is then from the layout's origin, along the boundary's
normal.

Shapes: z_hat and tilt broadcast; functions "per rotor" add a last axis of rotors.

Approximation: potential flow, point sources, equal rotors of equal lift far away, no fountain.
Inflow is counted along the boundary's normal, as in the published per-rotor form; along the rotor
axis the sum over rotors differs by the square of the tilt. Where a boundary ends, a rotor's image
counts by the share of its disk that the boundary covers: no diffraction at the edge.

Refusal: nan for a rotor at or behind the boundary, and where nothing of the inflow is left.

One rotor gives Cheeseman and Bennett; four in a square give Sanchez-Cuevas with K_b = 0; tilt 0
gives the flat boundary.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift.declare import Check, FloatArray, LiftModel, Source
from nearlift.models.inflow import clear_of_boundary, gain, image


def cancelled_per_rotor(
    z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any = 0.0, covered: Any = 1.0
) -> FloatArray:
    """Fraction of inflow cancelled at each rotor, shape (..., rotors).

    Parameters
    ----------
    z_hat : array_like
        Distance of the layout's origin from the boundary, along its normal.
    layout_hat : array_like, shape (rotors, 2)
        Rotor axes (x, y) in the rotor plane.
    tilt_rad : array_like
        Tilt about y, positive where rotors at positive x are farther from the boundary; broadcasts
        with `z_hat`.
    covered : array_like, shape (rotors,) or scalar
        Share of each rotor's disk that has the boundary beneath it, 0 to 1; see
        `covered_by_half_plane`.
    """
    layout = np.asarray(layout_hat, dtype=float)
    x, y = layout[:, 0], layout[:, 1]
    tilt = np.asarray(tilt_rad, dtype=float)[..., None]
    z = clear_of_boundary(np.asarray(z_hat, dtype=float)[..., None] + x * np.sin(tilt))
    along = np.subtract.outer(x, x) * np.cos(tilt)[..., None]
    separation = np.hypot(along, np.subtract.outer(y, y))
    pairs = image(z[..., :, None] + z[..., None, :], separation)
    result: FloatArray = (pairs * np.broadcast_to(covered, x.shape)).sum(axis=-1)
    return result


def gain_per_rotor(
    z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any = 0.0, covered: Any = 1.0
) -> FloatArray:
    """Lift of each rotor over its lift far away, shape (..., rotors); arguments as
    `cancelled_per_rotor`.
    """
    return gain(
        cancelled_per_rotor(z_hat, layout_hat=layout_hat, tilt_rad=tilt_rad, covered=covered)
    )


def covered_by_half_plane(layout_hat: Any, edge_hat: float) -> FloatArray:
    """Share of each rotor's disk above a boundary that fills x <= edge_hat, shape (rotors,).

    The area of a circle's segment, so that the share goes smoothly from 1 through 1/2 (edge beneath
    the axis) to 0.
    """
    inside = np.clip(edge_hat - np.asarray(layout_hat, dtype=float)[:, 0], -1.0, 1.0)
    result: FloatArray = 0.5 + (inside * np.sqrt(1.0 - inside**2) + np.arcsin(inside)) / math.pi
    return result


def each_level(z_hat: Any, /, *, layout_hat: Any) -> Any:
    """L / L_inf of each rotor over a boundary without end, parallel to the vehicle."""
    return gain_per_rotor(z_hat, layout_hat=layout_hat)


def evaluate(z_hat: Any, /, *, layout_hat: Any) -> Any:
    """L / L_inf of the whole vehicle over a boundary without end, parallel to it. Shapes
    broadcast.
    """
    return each_level(z_hat, layout_hat=layout_hat).mean(axis=-1)


def tilted(z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any) -> Any:
    """L / L_inf of the whole vehicle, force along the rotor axes, over a tilted boundary."""
    return gain_per_rotor(z_hat, layout_hat=layout_hat, tilt_rad=tilt_rad).mean(axis=-1)


def downwash(z_hat: Any, /, *, layout_hat: Any) -> Any:
    """Induced velocity at the disks over its value far away, mean over the rotors."""
    return 1.0 - cancelled_per_rotor(z_hat, layout_hat=layout_hat).mean(axis=-1)


def square(spacing_hat: float) -> tuple[tuple[float, float], ...]:
    """Layout of four rotors in a square of that side."""
    a = 0.5 * spacing_hat
    return ((a, a), (-a, a), (-a, -a), (a, -a))


MODEL = LiftModel(
    name="images",
    title="Images of all rotors",
    formula=(
        r"\frac{L}{L_\infty} = \frac{1}{n} \sum_i \frac{1}{1 - s_i}, \quad"
        r" s_i = \frac{1}{4} \sum_j \frac{2 \hat{z}}{(\hat{h}_{ij}^2 + 4 \hat{z}^2)^{3/2}}"
    ),
    evaluate=evaluate,
    downwash=downwash,
    per_rotor=each_level,
    boundary="ground",
    rotors="several",
    needs=("layout_hat",),
    valid_z_hat=(0.25, float("inf")),
    source=Source(
        citation=(
            "Method of images of Cheeseman and Bennett, per rotor after Sanchez-Cuevas, Heredia and"
            " Ollero 2017 (10.1155/2017/1823056)"
        ),
        equation="(10) and section 2.3, as transcribed",
        bibtex=(
            "cheeseman1955",
            "sanchezcuevas2017",
        ),
        doubts=(
            (
                "The per-rotor form was read in a transcription that cites the equation by number;"
                " that each flat term is one image is an own derivation."
            ),
            (
                "No published form says what the fountain does when part of the vehicle has no"
                " ground beneath it; there is none here."
            ),
            "Weighting an image by the covered share of its disk is an own choice.",
        ),
    ),
    checks=(
        Check(
            x=1.0,
            expected=1.0831,
            arguments={"layout_hat": square(90 / 23)},
            tolerance=5e-5,
            quoted_by="own table, K_b = 0, d = 90 mm",
        ),
        Check(
            x=0.5,
            expected=1.3495,
            arguments={"layout_hat": square(90 / 23)},
            tolerance=5e-5,
            quoted_by="the same table",
        ),
        Check(
            x=1.0,
            expected=1.066667,
            arguments={"layout_hat": ((0.0, 0.0),)},
            quoted_by="Cheeseman and Bennett, one rotor",
        ),
    ),
    notes=__doc__ or "",
)
