"""Figure 2: Delta L against distance at each boundary, with theory and the quoted model.

Symbols are lift over the fitted L_inf, named effects taken out, so that they belong to the line
that is drawn and to the number that is quoted. With ``[report] reference = "farthest"`` they are
the cells of lift.parquet, whose L_inf is the farthest station (or free air), and the line is the
base model's; curves are the models' own L / L_inf - 1, whose reference is infinitely far, and the
caption gives the difference.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary, FloatArray
from nearlift.report import curves, relative_lift
from nearlift.report.evidence import Columns, Evidence, select, stack
from nearlift.rounding import fixed
from nearlift.stages.reduce import LIFT

POINTS = 240
#: The PQuad's rotor radius is published (120 mm), its rotor spacing is not: adjacent axes are
#: assumed this many radii apart.
PQUAD_SPACING_HAT = 3.0
#: The kind of a least-squares curve beside a posterior's.
LEAST_SQUARES = "least squares"
#: A trial or visit is marked if a coefficient without it would be so many of its standard
#: uncertainties away.
INFLUENTIAL = 0.5
COLUMNS = (
    *("panel", "kind", "label", "throttle_fraction", "z_hat"),
    *("delta_L_percent", "u_delta_L_percent", "lo90_percent", "hi90_percent"),
)
SHORT = {"cheeseman_bennett": "C-B", "sanchez_cuevas": "S-C", "hsiao_chirarattananon": "H-C"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A curve of the literature, drawn beside the data."""

    model: str
    label: str
    arguments: Mapping[str, float]


def pquad(spacing_hat: float = PQUAD_SPACING_HAT) -> dict[str, float]:
    """Arguments of the Sanchez-Cuevas model for the PQuad with an assumed rotor spacing; its rotors
    form a square.
    """
    return {"K_b": 2.0, "spacing_hat": spacing_hat, "diagonal_hat": math.sqrt(2) * spacing_hat}


REFERENCES = (
    Reference(model="cheeseman_bennett", label="C-B (theory)", arguments={"k": 1.0}),
    Reference(model="sanchez_cuevas", label="S-C (PQuad)", arguments=pquad()),
    Reference(model="hsiao_chirarattananon", label="H-C (theory)", arguments={"alpha": 0.125}),
)


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `panel` (boundary), `kind` (data, model, band, least
    squares, overlay; L_inf, whose label says what Delta L is from; without, whose label names an
    effect that is taken out of the symbols; influence, a cell with a trial or visit that a
    coefficient hangs on), `label`, `throttle_fraction` (data only), `z_hat`, `delta_L_percent`,
    `u_delta_L_percent` (one standard uncertainty), `lo90_percent`, `hi90_percent` (band only).
    """
    table = stack(
        [
            {"panel": boundary, **part}
            for boundary in evidence.boundaries
            for part in _panel(evidence, boundary)
        ],
        COLUMNS,
    )
    return select(table, np.isfinite(table["delta_L_percent"]) & (table["z_hat"] > 0))


def _panel(evidence: Evidence, boundary: Boundary) -> list[dict[str, object]]:
    if boundary not in evidence.table(LIFT)["boundary"]:
        return []
    over = relative_lift.relative_lift(evidence, boundary)
    reference = "the fit's" if relative_lift.by_fit(evidence) else "the farthest"
    # what says something of the whole panel stands at its farthest distance
    whole = {"z_hat": over.z_hat.max(), "delta_L_percent": 0.0}
    level = {"kind": "L_inf", "label": reference, "u_delta_L_percent": 100 * over.u_L_inf}
    parts: list[dict[str, object]] = [{**level, **whole}]
    parts += [
        {"kind": "without", "label": titled(effect), **whole}
        for effect in relative_lift.named(evidence, boundary)
    ]
    parts += _influence(evidence, boundary, over)
    parts.append(
        {
            "kind": "data",
            "label": [f"{100 * t:.3g} %" for t in over.throttle],
            "throttle_fraction": over.throttle,
            "z_hat": over.z_hat,
            "delta_L_percent": 100 * over.delta_L,
            "u_delta_L_percent": 100 * over.u,
        }
    )
    parts += [
        {
            "kind": "overlay",
            "label": overlay.label,
            "z_hat": points["z_hat"],
            "delta_L_percent": 100 * points["delta_L"],
            "u_delta_L_percent": 100 * points["u"],
        }
        for overlay, points in evidence.overlays
        if overlay.boundary == boundary
    ]
    positive = over.z_hat[over.z_hat > 0]
    grid = np.geomspace(positive.min(), positive.max(), POINTS)
    for theory in references(evidence, boundary):
        change = 100 * (curves.ratio(catalogue.model(theory.model), grid, theory.arguments) - 1)
        drawn = {"z_hat": grid, "delta_L_percent": change}
        parts.append({"kind": "model", "label": theory.label, **drawn})
    span = float(np.nanmax(over.delta_L) - np.nanmin(over.delta_L))
    return parts + _fit(evidence, boundary, grid, span)


def references(evidence: Evidence, boundary: Boundary) -> list[Reference]:
    """The curves of the literature that belong beside this vehicle's data."""
    several = evidence.campaign.vehicle.rotors > 1
    known = ((r, catalogue.model(r.model)) for r in REFERENCES)
    # a model that needs how rotors stand says nothing of one alone
    return [r for r, model in known if model.boundary == boundary and (several or not model.needs)]


def _fit(
    evidence: Evidence, boundary: Boundary, grid: FloatArray, span: float
) -> list[dict[str, object]]:
    """The model's curve and band, and least squares beside it where the two can be told apart."""
    model, _ = evidence.base(boundary)
    short = SHORT.get(model.name, model.title)
    curve = relative_lift.line(evidence, boundary, grid)
    parts: list[dict[str, object]] = [
        {
            "kind": "band",
            "label": "fitted",
            "delta_L_percent": 100 * curve.middle,
            "lo90_percent": 100 * curve.low,
            "hi90_percent": 100 * curve.high,
        }
    ]
    if curve.parts(span):
        change = 100 * curve.least_squares
        parts.append({"kind": LEAST_SQUARES, "label": LEAST_SQUARES, "delta_L_percent": change})
    return [{**part, "z_hat": grid, "label": f"{short}, {part['label']}"} for part in parts]


def influential(evidence: Evidence, boundary: Boundary) -> list[tuple[str, str, str, float]]:
    """Coefficient, ``trial`` or ``visit``, its name, and the shift without it in standard
    uncertainties: the trial and the visit that move each coefficient most.
    """
    return [
        (name, kind, omitted.id, omitted.shift / c.u)
        for name, c in evidence.quoted(boundary).coefficients.items()
        for kind, omitted in (("trial", c.influence.trial), ("visit", c.influence.visit))
        if omitted is not None and 0 < c.u < math.inf
    ]


def _influence(
    evidence: Evidence, boundary: Boundary, over: relative_lift.RelativeLift
) -> list[dict[str, object]]:
    """The cells of what moves a coefficient by at least `INFLUENTIAL`."""
    data = evidence.observations[boundary]
    parts = []
    for name, kind, which, shift in influential(evidence, boundary):
        if abs(shift) < INFLUENTIAL:
            continue
        mine = (data.trial if kind == "trial" else data.visit.astype(str)) == which
        throttle = data.levels[data.level][mine]
        places = set(zip(throttle.tolist(), data.z_hat[mine].tolist(), strict=True))
        at = np.array([p in places for p in zip(over.throttle, over.z_hat, strict=True)])
        parts.append(
            {
                "kind": "influence",
                "label": f"{kind} {which}: {name} by {fixed(shift, 1)} u",
                "z_hat": over.z_hat[at],
                "delta_L_percent": 100 * over.delta_L[at],
            }
        )
    return parts
