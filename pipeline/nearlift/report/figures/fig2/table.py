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
from nearlift.products import LIFT, POSTERIOR
from nearlift.report import curves, relative_lift
from nearlift.report.evidence import Columns, Evidence, distinct, select, stack, text_column
from nearlift.rounding import fixed, plain, plus_minus

POINTS = 240
#: A departure of this much at the farthest station can be seen in the figure, and is explained.
VISIBLE = 0.002
#: The PQuad's rotor radius is published (120 mm), its rotor spacing is not: adjacent axes are
#: assumed this many radii apart.
PQUAD_SPACING_HAT = 3.0
#: What other spacings would be plausible, for the caption.
PQUAD_RANGE = (2.5, 4.0)
#: How a curve's label says where it comes from; the latter is also the kind of a least-squares
#: curve beside a posterior's.
POSTERIOR_LABEL, LEAST_SQUARES, QUOTED = "posterior", "least squares", "as quoted"
#: Up to so many visits of the station that gives L_inf are said to move all symbols of a panel
#: together.
FEW_FAR = 6
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
        `panel` (boundary), `kind` (data, model, band, least squares or overlay), `label`,
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
        if by_fit(evidence)
        else curves.band(evidence, boundary, model, z_hat)
    )


def named(evidence: Evidence, boundary: Boundary) -> tuple[str, ...]:
    """The effects that are taken out of the symbols."""
    return relative_lift.named(evidence, boundary) if by_fit(evidence) else ()


def references(evidence: Evidence, boundary: Boundary) -> list[Reference]:
    """The curves of the literature that belong beside this vehicle's data."""
    several = evidence.campaign.vehicle.rotors > 1
    return [r for r in REFERENCES if r.boundary == boundary and (several or not r.several_only)]


def _fit(evidence: Evidence, boundary: Boundary, grid: FloatArray, span: float) -> list[Columns]:
    """The model's curve and band, and least squares beside it where the two can be told apart."""
    model, _ = evidence.base(boundary)
    short = SHORT.get(model.name, model.title)
    curve = line(evidence, boundary, grid)
    sampled = POSTERIOR_LABEL if curve.sampled else LEAST_SQUARES
    label = f"{short} ({QUOTED if named(evidence, boundary) else sampled})"
    rows = [
        _rows(
            boundary,
            "band",
            label,
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
                f"{short} ({LEAST_SQUARES})",
                grid,
                100 * curve.least_squares,
            )
        )
    return rows


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


def caption(evidence: Evidence, table: Columns) -> str:
    """What the reader must know to read the figure, numbers included."""
    parts = ["Relative change of lift, ΔL = (L − L∞)/L∞, against distance over rotor radius."]
    parts.append(
        "Symbols: cell means over the fit's L∞; bars: ± 1 standard uncertainty from the scatter of"
        " trials and visits, without L∞'s own, which moves a throttle's symbols together."
        if by_fit(evidence)
        else (
            "Symbols: cell means; bars: ± 1 standard uncertainty from the scatter of trials, which"
            " a throttle's cells share through L∞."
        )
    )
    parts.append(_line_note(evidence, table))
    drawn = {r.label for b in evidence.boundaries for r in references(evidence, b)}
    if "C-B (theory)" in drawn:
        parts.append("C-B: Cheeseman and Bennett, one rotor.")
    if "S-C (PQuad)" in drawn:
        model, near = catalogue.model("sanchez_cuevas"), np.array([1.0])
        ratios = [float(curves.ratio(model, near, pquad(d))[0]) for d in PQUAD_RANGE]
        ends = [f"{100 * (ratio - 1):.1f} %" for ratio in ratios]
        parts.append(
            "S-C (PQuad): Sanchez-Cuevas et al. with r = 120 mm and K_b = 2; its rotor spacing is"
            f" not published, drawn for adjacent axes {PQUAD_SPACING_HAT:g} r ="
            f" {PQUAD_SPACING_HAT * 120:.0f} mm apart (assumed; from {PQUAD_RANGE[0]:g} r to"
            f" {PQUAD_RANGE[1]:g} r the curve at ẑ = 1 goes from {ends[0]} to {ends[1]})."
        )
    if "H-C (theory)" in drawn:
        parts.append("H-C: Hsiao and Chirarattananon with α = 0.125.")
    for boundary in evidence.boundaries:
        parts.append(_reference_note(evidence, boundary, table))
    return " ".join(p for p in parts if p)


def _line_note(evidence: Evidence, table: Columns) -> str:
    """What line and shade are, and where least squares would be another line."""
    if not evidence.has(POSTERIOR):
        return (
            "Solid line and shade: base model by least squares, with the pointwise 90 % band that"
            " the covariance of its parameters implies."
        )
    apart = distinct(table["panel"][table["kind"] == LEAST_SQUARES])
    beside = (
        f"thin line: least squares, which parts from it visibly ({', '.join(apart)}), as where a"
        " prior still has a say"
        if apart
        else "least squares falls on the same line"
    )
    plainly = [b for b in evidence.boundaries if named(evidence, b)]
    beside += (
        f"; {', '.join(plainly)}: the quoted coefficients', with the band of their uncertainties"
        if plainly
        else ""
    )
    endless = [b for b in evidence.boundaries if curves.endless(evidence.base(b)[1])]
    none = (
        f" No band ({', '.join(endless)}): the intervals of the coefficients have no end."
        if endless
        else ""
    )
    return (
        "Solid line and shade: base model, its posterior's pointwise median and central 90 %;"
        f" {beside}.{none}"
    )


def _fit_note(evidence: Evidence, boundary: Boundary) -> str:
    """What the line is of, what was taken out of the symbols, and how well L_inf is known."""
    model, entry = evidence.base(boundary)
    told = ", ".join(
        f"{letter(n)} = {plus_minus(c.value, c.u)}"
        for n, c in evidence.quoted(boundary).coefficients.items()
    )
    effects = named(evidence, boundary)
    out = ""
    if effects:
        out = (
            f"; line and symbols are without {' and '.join(effects)}, whose part at each trial is"
            " taken out of its lift"
        )
    stood = curves.height_found_m(entry)
    side = f"{abs(1e3 * stood):.2g} mm {'farther' if stood > 0 else 'nearer'}"
    moved = (
        f" The fit finds the rotor {side} than recorded; its line is drawn for there."
        if stood and not effects
        else ""
    )
    u = 100 * relative_lift.relative_lift(evidence, boundary).u_L_inf
    return (
        f"{boundary.capitalize()}: {model.title}{f' ({told}, k = 1)' if told else ''}{out}; L∞ is"
        f" known to {plain(u, 2)} %, by the scatter.{moved}"
    )


def _reference_note(evidence: Evidence, boundary: Boundary, table: Columns) -> str:
    if by_fit(evidence):
        return _fit_note(evidence, boundary)
    model, entry = evidence.base(boundary)
    quoted = evidence.quoted(boundary)
    told = ", ".join(
        f"{letter(n)} = {plus_minus(c.value, c.u)}" for n, c in quoted.coefficients.items()
    )
    beyond = (
        f", with {' and '.join(quoted.effects)} in the model, which the line is without"
        if quoted.effects
        else ""
    )
    of = f" ({told}, k = 1{beyond})" if told else ""
    mine = (table["panel"] == boundary) & (table["kind"] == "data")
    if not mine.any():
        return ""
    found = curves.height_found_m(entry)
    stood = f"{abs(1e3 * found):.2g} mm {'farther' if found > 0 else 'nearer'}"
    moved = (
        f" The fit finds the rotor {stood} than recorded; its line is drawn for there."
        if found
        else ""
    )
    if np.isinf(evidence.observations[boundary].z_hat).any():
        return (
            f"{boundary.capitalize()}: {model.title}{of}; L∞ of the data from trials in free"
            f" air.{moved}"
        )
    far = float(table["z_hat"][mine].max())
    cells = evidence.table(LIFT)
    lacking = cells["throttle"][
        (cells["boundary"] == boundary) & np.isnan(np.asarray(cells["delta_L"], dtype=float))
    ]
    without = (
        f" No trial far away at {', '.join(f'{100 * t:.3g} %' for t in np.unique(lacking))}"
        " throttle, hence no ΔL."
        if len(lacking)
        else ""
    )
    there = float(curves.band(evidence, boundary, model, np.array([far])).middle[0])
    apart = ", so the data stand off the curve by about as much" if abs(there) > VISIBLE else ""
    return (
        f"{boundary.capitalize()}: {model.title}{of}; the data take L∞ from their farthest station,"
        f" ẑ = {plain(far, 3)}, where ΔL is 0 by construction and the fit stands at"
        f" {fixed(100 * there, 2)} %{apart}.{_shared_far(evidence, boundary)}{without}{moved}"
    )


def _shared_far(evidence: Evidence, boundary: Boundary) -> str:
    """That the symbols hang on a few visits of one station, where they do."""
    data = evidence.observations[boundary]
    far = data.z_hat == data.z_hat.max()
    visits = len(np.unique(data.visit[far]))
    if (
        visits > FEW_FAR
        or len(data.levels) < 2
        or len(np.unique(data.throttle[far])) < len(data.levels)
    ):
        return ""
    return (
        f" All throttles share {'one visit' if visits == 1 else f'the {visits} visits'} of that"
        " station: what one visit has and others have not moves all symbols of the panel together,"
        " and they stand off the curve as one."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for boundary in distinct(table["panel"]):
        mine = (table["panel"] == boundary) & (table["kind"] == "data")
        z, delta = table["z_hat"][mine], table["delta_L_percent"][mine]
        if not len(z):
            continue
        top, levels = int(np.argmax(np.abs(delta))), len(set(table["label"][mine].tolist()))
        parts.append(
            f"Near the {boundary}, {levels} throttle{'s' if levels > 1 else ''}, ẑ from"
            f" {plain(float(z.min()), 3)} to {plain(float(z.max()), 3)}: ΔL runs from"
            f" {plain(float(delta.min()), 3)} % to {plain(float(delta.max()), 3)} %, strongest at ẑ"
            f" = {plain(float(z[top]), 3)}."
        )
    lines = list(
        dict.fromkeys(
            table["label"][
                np.isin(table["kind"], ["model", "band", LEAST_SQUARES, "overlay"])
            ].tolist()
        )
    )
    panels = f"{len(parts)} panel{'s' if len(parts) != 1 else ''}"
    return (
        f"Lift change against distance, {panels}. {' '.join(parts)} Drawn beside the data:"
        f" {'; '.join(lines)}."
    )
