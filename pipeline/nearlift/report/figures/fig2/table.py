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
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray
from nearlift.nomenclature import letter
from nearlift.products import LIFT
from nearlift.report import curves, relative_lift
from nearlift.report.evidence import Columns, Evidence, select, stack, text_column
from nearlift.rounding import fixed

POINTS = 240
#: The PQuad's rotor radius is published (120 mm), its rotor spacing is not: adjacent axes are
#: assumed this many radii apart.
PQUAD_SPACING_HAT = 3.0
#: The kind of a least-squares curve beside a posterior's.
LEAST_SQUARES = "least squares"
#: A trial or visit is marked if a coefficient without it would be so many of its standard
#: uncertainties away.
INFLUENTIAL = 0.5
SHORT = {"cheeseman_bennett": "C-B", "sanchez_cuevas": "S-C", "hsiao_chirarattananon": "H-C"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A curve of the literature, drawn beside the data; `rotors` restricts it to vehicles of
    several.
    """

    boundary: Boundary
    model: str
    label: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    several_only: bool = False


def pquad(spacing_hat: float = PQUAD_SPACING_HAT) -> dict[str, float]:
    """Arguments of the Sanchez-Cuevas model for the PQuad with an assumed rotor spacing; its rotors
    form a square.
    """
    return {"K_b": 2.0, "spacing_hat": spacing_hat, "diagonal_hat": math.sqrt(2) * spacing_hat}


REFERENCES = (
    Reference(
        boundary="ground", model="cheeseman_bennett", label="C-B (theory)", arguments={"k": 1.0}
    ),
    Reference(
        boundary="ground",
        model="sanchez_cuevas",
        label="S-C (PQuad)",
        arguments=pquad(),
        several_only=True,
    ),
    Reference(
        boundary="ceiling",
        model="hsiao_chirarattananon",
        label="H-C (theory)",
        arguments={"alpha": 0.125},
    ),
)


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each.

    Returns
    -------
    dict of arrays
        `panel` (boundary), `kind` (data, model, band, least squares, overlay; L_inf, whose label
        says what Delta L is from; without, whose label names an effect that is taken out of the
        symbols; influence, a cell with a trial or visit that a coefficient hangs on), `label`,
        `throttle_fraction` (data only), `z_hat`, `delta_L_percent`, `u_delta_L_percent` (one
        standard uncertainty), `lo90_percent`, `hi90_percent` (band only).
    """
    cells = evidence.table(LIFT)
    rows = []
    for boundary in evidence.boundaries:
        mine = cells["boundary"] == boundary
        if not mine.any():
            continue
        cell = {
            name: np.asarray(values[mine], dtype=float)
            for name, values in cells.items()
            if name != "boundary"
        }
        if by_fit(evidence):
            over = relative_lift.relative_lift(evidence, boundary)
            cell = {
                "throttle": over.throttle,
                "z_hat": over.z_hat,
                "delta_L": over.delta_L,
                "u_delta_L": over.u,
            }
            rows.append(_single(boundary, "L_inf", "the fit's", cell["z_hat"], 100 * over.u_L_inf))
        else:
            rows.append(_single(boundary, "L_inf", "the farthest", cell["z_hat"]))
        rows += [
            _single(boundary, "without", catalogue.titled(name), cell["z_hat"])
            for name in named(evidence, boundary)
        ]
        rows += _influence(evidence, boundary, cell)
        labels = np.array([f"{100 * t:.3g} %" for t in cell["throttle"]], dtype=object)
        rows.append(
            _rows(
                boundary,
                "data",
                labels,
                cell["z_hat"],
                100 * cell["delta_L"],
                throttle=cell["throttle"],
                u=100 * cell["u_delta_L"],
            )
        )
        for overlay, points in evidence.overlays:
            if overlay.boundary == boundary:
                rows.append(
                    _rows(
                        boundary,
                        "overlay",
                        overlay.label,
                        points["z_hat"],
                        100 * points["delta_L"],
                        u=100 * points["u"],
                    )
                )
        positive = cell["z_hat"][cell["z_hat"] > 0]
        grid = np.geomspace(positive.min(), positive.max(), POINTS)
        for reference in references(evidence, boundary):
            curve = curves.ratio(catalogue.model(reference.model), grid, reference.arguments)
            rows.append(_rows(boundary, "model", reference.label, grid, 100 * (curve - 1)))
        rows += _fit(
            evidence, boundary, grid, float(np.nanmax(cell["delta_L"]) - np.nanmin(cell["delta_L"]))
        )
    table = stack(rows)
    keep = np.isfinite(table["delta_L_percent"]) & (table["z_hat"] > 0)
    return select(table, keep)


def by_fit(evidence: Evidence) -> bool:
    """Whether symbols are referred to the fitted L_inf, and not to the farthest station."""
    return evidence.campaign.report.reference == "fit"


def line(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> curves.Curve:
    """The line that belongs to the symbols."""
    model, _ = evidence.base(boundary)
    return (
        relative_lift.line(evidence, boundary, z_hat)
        if by_fit(evidence) or evidence.quoted(boundary).refused
        else curves.band(evidence, boundary, model, z_hat)
    )


def named(evidence: Evidence, boundary: Boundary) -> tuple[str, ...]:
    """The effects that are taken out of the symbols."""
    return relative_lift.named(evidence, boundary) if by_fit(evidence) else ()


def as_quoted(evidence: Evidence, boundary: Boundary) -> bool:
    """Whether the line is that of the quoted coefficients where these are not the base fit's."""
    return by_fit(evidence) and relative_lift.as_quoted(evidence, boundary)


def references(evidence: Evidence, boundary: Boundary) -> list[Reference]:
    """The curves of the literature that belong beside this vehicle's data."""
    several = evidence.campaign.vehicle.rotors > 1
    return [r for r in REFERENCES if r.boundary == boundary and (several or not r.several_only)]


def _fit(evidence: Evidence, boundary: Boundary, grid: FloatArray, span: float) -> list[Columns]:
    """The model's curve and band, and least squares beside it where the two can be told apart."""
    model, _ = evidence.base(boundary)
    short = SHORT.get(model.name, model.title)
    curve = line(evidence, boundary, grid)
    refused = [letter(name) for name in evidence.quoted(boundary).refused]
    rows = [
        _rows(
            boundary,
            "band",
            f"{short}, {LEAST_SQUARES}: {', '.join(refused)} refused"
            if refused
            else f"{short}, fitted",
            grid,
            100 * curve.middle,
            lo90=100 * curve.low,
            hi90=100 * curve.high,
        )
    ]
    if curve.parts(span):
        rows.append(
            _rows(
                boundary,
                LEAST_SQUARES,
                f"{short}, {LEAST_SQUARES}",
                grid,
                100 * curve.least_squares,
            )
        )
    return rows


def influential(evidence: Evidence, boundary: Boundary) -> list[tuple[str, str, str, float]]:
    """Coefficient, ``trial`` or ``visit``, its name, and the shift without it in standard
    uncertainties: the trial and the visit that move each coefficient most.
    """
    return [
        (name, kind, found.id, found.shift / c.u)
        for name, c in evidence.quoted(boundary).coefficients.items()
        for kind, found in (("trial", c.influence.trial), ("visit", c.influence.visit))
        if found is not None and 0 < c.u < math.inf
    ]


def _influence(evidence: Evidence, boundary: Boundary, cell: Columns) -> list[Columns]:
    """The cells of what moves a coefficient by at least `INFLUENTIAL`."""
    data = evidence.observations[boundary]
    rows = []
    for name, kind, which, shift in influential(evidence, boundary):
        if abs(shift) < INFLUENTIAL:
            continue
        mine = (data.trial if kind == "trial" else data.visit.astype(str)) == which
        told = data.levels[data.level][mine]
        places = set(zip(told.tolist(), data.z_hat[mine].tolist(), strict=True))
        at = np.array([p in places for p in zip(cell["throttle"], cell["z_hat"], strict=True)])
        if at.any():
            rows.append(
                _rows(
                    boundary,
                    "influence",
                    f"{kind} {which}: {name} by {fixed(shift, 1)} u",
                    cell["z_hat"][at],
                    100 * cell["delta_L"][at],
                )
            )
    return rows


def _single(
    boundary: str, kind: str, label: str, z_hat: FloatArray, u: float = math.nan
) -> Columns:
    """A row that says something of a whole panel."""
    return _rows(boundary, kind, label, np.array([z_hat.max()]), np.array([0.0]), u=np.array([u]))


def _rows(
    boundary: str, kind: str, label: Any, z_hat: FloatArray, delta: FloatArray, **more: FloatArray
) -> Columns:
    n = len(z_hat)
    empty = np.full(n, np.nan)
    return {
        "panel": text_column(boundary, n),
        "kind": text_column(kind, n),
        "label": label if isinstance(label, np.ndarray) else text_column(label, n),
        "throttle_fraction": more.get("throttle", empty),
        "z_hat": np.asarray(z_hat, dtype=float),
        "delta_L_percent": np.asarray(delta, dtype=float),
        "u_delta_L_percent": more.get("u", empty),
        "lo90_percent": more.get("lo90", empty),
        "hi90_percent": more.get("hi90", empty),
    }
