"""Ground, any layout: the sum of all rotors' images; also tilted, and ending at an edge.

    s_i = (1/4) sum_j w_ij (z_i + z_j) / (h_ij^2 + (z_i + z_j)^2)^(3/2)
    L / L_inf = mean over i of 1 / (1 - s_i)

with z_i the distance of rotor i from the boundary and h_ij the distance of rotors i and j along it,
both over rotor radius. w_ij is the share of the image that exists: 1 without an edge. Nothing is
free.

Convention: `layout_hat` has a row (x, y) per rotor, in the rotor plane. A positive tilt lifts the
rotors at positive x; the distance z_hat is then from the layout's origin, along the boundary's
normal.

Shapes: z_hat and tilt broadcast; functions "per rotor" add a last axis of rotors.

Approximation: potential flow, point sources, equal rotors of equal lift far away, no fountain.
Inflow is counted along the boundary's normal, as in the published per-rotor form. Along the rotor
axis the sum over rotors differs by the square of the tilt.

Refusal: nan for a rotor at or behind the boundary, and where nothing of the inflow is left.

One rotor gives Cheeseman and Bennett; four in a square give Sanchez-Cuevas with K_b = 0. Tilt 0
gives the flat boundary, an edge far away the whole one.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from nearlift.declare import Check, FloatArray, LiftModel, Source
from nearlift.models.inflow import clear_of_boundary, gain, image, tabulated


def cancelled_per_rotor(
    z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any = 0.0, edge_hat: Any = math.inf
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
    edge_hat : float
        The boundary fills x <= edge_hat.
    """
    layout = np.asarray(layout_hat, dtype=float)
    x, y = layout[:, 0], layout[:, 1]
    tilt = np.asarray(tilt_rad, dtype=float)[..., None]
    z = clear_of_boundary(np.asarray(z_hat, dtype=float)[..., None] + x * np.sin(tilt))
    along = np.subtract.outer(x, x) * np.cos(tilt)[..., None]
    separation = np.hypot(along, np.subtract.outer(y, y))
    height = z[..., :, None] + z[..., None, :]
    edge = edge_hat - 0.5 * np.add.outer(x, x) * np.cos(tilt)[..., None]
    result: FloatArray = (image(height, separation) * share(edge, height, separation)).sum(axis=-1)
    return result


def share(edge_hat: Any, height_hat: Any, separation_hat: Any) -> Any:
    """Share of an image in a boundary that ends at a straight edge. Shapes broadcast.

    The distance of the edge is from the point midway between rotor and source. An image represents
    sources spread over the boundary. Their part in a rotor's inflow, counted up to the edge, is
    1/2 + 3/4 t - t^3 / 4. t is the sine of the angle between the boundary's normal and the edge:
    1/2 with the edge beneath. The share is exact for a rotor's own image; between two rotors
    sources count by their distance from the midpoint.
    """
    sine = np.sin(np.arctan2(edge_hat, 0.5 * np.hypot(height_hat, separation_hat)))
    return 0.5 + sine * (0.75 - 0.25 * np.square(sine))


def gain_per_rotor(
    z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any = 0.0, edge_hat: Any = math.inf
) -> FloatArray:
    """Lift of each rotor over its lift far away, shape (..., rotors); arguments as
    `cancelled_per_rotor`.
    """
    return gain(
        cancelled_per_rotor(z_hat, layout_hat=layout_hat, tilt_rad=tilt_rad, edge_hat=edge_hat)
    )


def each_level(z_hat: Any, /, *, layout_hat: Any) -> Any:
    """L / L_inf of each rotor over a boundary without end, parallel to the vehicle."""
    return gain_per_rotor(z_hat, layout_hat=layout_hat)


def evaluate(z_hat: Any, /, *, layout_hat: Any) -> Any:
    """L / L_inf of the whole vehicle over a boundary without end, parallel to it. Shapes
    broadcast.
    """
    return each_level(z_hat, layout_hat=layout_hat).mean(axis=-1)


def downwash(z_hat: Any, /, *, layout_hat: Any) -> Any:
    """Induced velocity at the disks over its value far away, mean over the rotors."""
    return 1.0 - cancelled_per_rotor(z_hat, layout_hat=layout_hat).mean(axis=-1)


def each_tilted(z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any) -> Any:
    """L / L_inf of each rotor over a tilted boundary."""
    return gain_per_rotor(z_hat, layout_hat=layout_hat, tilt_rad=tilt_rad)


def tilted(z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any) -> Any:
    """L / L_inf of the whole vehicle, force along the rotor axes, over a tilted boundary."""
    return each_tilted(z_hat, layout_hat=layout_hat, tilt_rad=tilt_rad).mean(axis=-1)


def tilted_downwash(z_hat: Any, /, *, layout_hat: Any, tilt_rad: Any) -> Any:
    """Induced velocity at the disks over its value far away, mean over the rotors."""
    cancelled = cancelled_per_rotor(z_hat, layout_hat=layout_hat, tilt_rad=tilt_rad)
    return 1.0 - cancelled.mean(axis=-1)


def each_at_edge(z_hat: Any, /, *, layout_hat: Any, edge_hat: Any) -> Any:
    """L / L_inf of each rotor over a boundary that ends at an edge."""
    return gain_per_rotor(z_hat, layout_hat=layout_hat, edge_hat=edge_hat)


def at_edge(z_hat: Any, /, *, layout_hat: Any, edge_hat: Any) -> Any:
    """L / L_inf of the whole vehicle over a boundary that ends at an edge."""
    return each_at_edge(z_hat, layout_hat=layout_hat, edge_hat=edge_hat).mean(axis=-1)


def edge_downwash(z_hat: Any, /, *, layout_hat: Any, edge_hat: Any) -> Any:
    """Induced velocity at the disks over its value far away, mean over the rotors."""
    cancelled = cancelled_per_rotor(z_hat, layout_hat=layout_hat, edge_hat=edge_hat)
    return 1.0 - cancelled.mean(axis=-1)


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
        bibtex=("cheeseman1955", "sanchezcuevas2017"),
        doubts=(
            (
                "The per-rotor form was read in a transcription that cites the equation by number;"
                " that each flat term is one image is an own derivation."
            ),
        ),
    ),
    checks=(
        *tabulated(
            (1.0, 1.0831, {"layout_hat": square(90 / 23)}, "own table, K_b = 0, d = 90 mm"),
            (0.5, 1.3495, {"layout_hat": square(90 / 23)}, "the same table"),
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

TILTED = replace(
    MODEL,
    name="images_tilted",
    title="Images of all rotors, tilted",
    formula=(
        r"\frac{L}{L_\infty} = \frac{1}{n} \sum_i \frac{1}{1 - s_i}, \quad"
        r" s_i = \frac{1}{4} \sum_j \frac{\hat{z}_i + \hat{z}_j}"
        r"{[\hat{h}_{ij}^2 + (\hat{z}_i + \hat{z}_j)^2]^{3/2}}, \quad"
        r" \hat{z}_i = \hat{z} + \hat{x}_i \sin\theta"
    ),
    evaluate=tilted,
    downwash=tilted_downwash,
    per_rotor=each_tilted,
    needs=("layout_hat", "tilt_rad"),
    checks=(
        Check(
            x=1.0,
            expected=1.0831,
            arguments={"layout_hat": square(90 / 23), "tilt_rad": 0.0},
            tolerance=5e-5,
            quoted_by="own table, K_b = 0, d = 90 mm, level",
        ),
        Check(
            x=1.0,
            expected=0.5 / (1 - 1 / 16 / 1.1**2) + 0.5 / (1 - 1 / 16 / 0.9**2),
            arguments={"layout_hat": ((100.0, 0.0), (-100.0, 0.0)), "tilt_rad": math.asin(0.001)},
            tolerance=1e-6,
            quoted_by="two rotors far apart, by hand: Cheeseman and Bennett at 1.1 and 0.9",
        ),
    ),
    notes="""\
Ground, any layout, tilted: each rotor at its own distance.

The formula is that of `images`, with the distance of each tilted rotor from the boundary. theta is
each trial's `tilt`, a column of the schedule or one of `[trials] constants`. At tilt 0 it is
`images`.

Convention: the tilt is about y, positive where rotors at positive x are farther from the boundary;
z_hat is measured to the layout's origin.

Approximation: that of `images`; lift is along the rotor axes, so a cell that does not tilt with the
vehicle reads less by the cosine. Wakes and wall jets that a tilt turns are not in it.

Refusal: nan where a rotor is at or behind the boundary.

Traps: a tilt about another point than the layout's origin is a change of distance, of first order.
The effect `tilt` has it, and has the second order of this model with a free strength. Use one of
the two.
""",
)

EDGE = replace(
    MODEL,
    name="images_edge",
    title="Images of all rotors, partial ground",
    formula=(
        r"\frac{L}{L_\infty} = \frac{1}{n} \sum_i \frac{1}{1 - s_i}, \quad"
        r" s_i = \frac{1}{4} \sum_j \left(\tfrac{1}{2} + \tfrac{3}{4} t_{ij}"
        r" - \tfrac{1}{4} t_{ij}^3\right) \frac{2 \hat{z}}{(\hat{h}_{ij}^2 + 4 \hat{z}^2)^{3/2}},"
        r" \quad t_{ij} = \frac{\hat{e}_{ij}}"
        r"{\sqrt{\hat{e}_{ij}^2 + \hat{z}^2 + \hat{h}_{ij}^2 / 4}}, \quad"
        r" \hat{e}_{ij} = \hat{e} - \frac{\hat{x}_i + \hat{x}_j}{2}"
    ),
    evaluate=at_edge,
    downwash=edge_downwash,
    per_rotor=each_at_edge,
    needs=("layout_hat", "edge_hat"),
    source=Source(
        citation=(
            "Own derivation from the images of Cheeseman and Bennett, per rotor after"
            " Sanchez-Cuevas, Heredia and Ollero 2017 (10.1155/2017/1823056)"
        ),
        bibtex=("cheeseman1955", "sanchezcuevas2017"),
        doubts=(
            (
                "The sources on the boundary are those of a boundary without end. The edge's own"
                " part (diffraction, a jet that separates there) is left out."
            ),
            (
                "Between two rotors the share is that about their midpoint. Compared with the sum"
                " over the boundary, a Crazyflie's lift is off by at most 0.35 % at z_hat 0.5,"
                " 0.18 % at 1 and 0.05 % at 2."
            ),
            (
                "No published form says what the fountain does when part of the vehicle has no"
                " ground beneath it; there is none here."
            ),
        ),
    ),
    checks=(
        Check(
            x=1.0,
            expected=1.0831,
            arguments={"layout_hat": square(90 / 23), "edge_hat": math.inf},
            tolerance=5e-5,
            quoted_by="own table, K_b = 0, d = 90 mm, no edge",
        ),
        Check(
            x=1.0,
            expected=1 / (1 - 1 / 32),
            arguments={"layout_hat": ((0.0, 0.0),), "edge_hat": 0.0},
            quoted_by="by hand: half of one rotor's image, the edge beneath its axis",
        ),
        Check(
            x=3.0,
            expected=1 / (1 - 0.972 / 144),
            arguments={"layout_hat": ((0.0, 0.0),), "edge_hat": 4.0},
            quoted_by="by hand: t = 4/5, a share of 0.5 + 0.6 - 0.128 = 0.972",
        ),
    ),
    notes="""\
Ground, any layout, that ends at a straight edge: a vehicle over the rim of a table.

Each image counts by the share of it that exists, from 1 through 1/2 with the edge beneath to 0. `t`
is the sine of the angle of the edge from a point midway between rotor and source. The nearer the
boundary, the sharper is the step. Far above it an edge matters from as far away as the distance to
the ground. Nothing is free.

Convention: the boundary fills x <= e, e = `[rig] edge` over rotor radius, from the layout's origin.
e is negative where the vehicle's centre is beyond the edge.

Approximation: that of `images`; no fountain, nothing below the edge.

Traps: the effect `plate_edge` is for a plate whose end is not in the manifest; it estimates the
spread of the wake. With the edge known, this is the model, and the effect is a possible remainder.
""",
)
