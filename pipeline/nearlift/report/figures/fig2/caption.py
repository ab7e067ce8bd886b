"""Caption and alternative text of Figure 2, from the table that is drawn."""

from __future__ import annotations

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary
from nearlift.nomenclature import letter
from nearlift.report import curves, relative_lift
from nearlift.report.evidence import Columns, Evidence, distinct, where
from nearlift.report.figures.fig2 import table as fig2
from nearlift.report.phrases import coverage, listed
from nearlift.results.fit import ModelFit
from nearlift.results.quotation import BoundaryResult
from nearlift.rounding import fixed, plain
from nearlift.stages.fit import POSTERIOR

#: A departure of this much at the farthest station can be seen in the figure, and is explained.
VISIBLE = 0.002
#: Up to so many visits of the station that gives L_inf are said to move all symbols of a panel
#: together.
FEW_FAR = 6
#: What other spacings would be plausible, for the caption.
PQUAD_RANGE = (2.5, 4.0)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption of the figure, numbers included."""
    symbols = (
        "Symbols: cell means over the fitted L∞. Bars: 1 standard uncertainty from scatter."
        " Blue band: uncertainty of L∞, common to all points of a throttle."
        if relative_lift.by_fit(evidence)
        else "Symbols: cell means. Bars: 1 standard uncertainty from scatter, correlated at a"
        " throttle through L∞."
    )
    parts = [
        "Relative change of lift, ΔL = (L − L∞)/L∞, against distance over rotor radius."
        + (" Simulated records, not measured." if evidence.campaign.simulated else ""),
        symbols,
        _line_note(evidence, table),
    ]
    drawn = {r.label for b in evidence.boundaries for r in fig2.references(evidence, b)}
    if "C-B (theory)" in drawn:
        parts.append("C-B: Cheeseman and Bennett, one rotor.")
    if "S-C (PQuad)" in drawn:
        model, near = catalogue.model("sanchez_cuevas"), np.array([1.0])
        ratios = [float(curves.ratio(model, near, fig2.pquad(d))[0]) for d in PQUAD_RANGE]
        ends = [f"{100 * (ratio - 1):.1f} %" for ratio in ratios]
        parts.append(
            "S-C (PQuad): Sanchez-Cuevas et al. with r = 120 mm and K_b = 2. Its unpublished rotor"
            f" spacing is taken as {fig2.PQUAD_SPACING_HAT:g} r ="
            f" {fig2.PQUAD_SPACING_HAT * 120:.0f} mm. From {PQUAD_RANGE[0]:g} r to"
            f" {PQUAD_RANGE[1]:g} r the curve at ẑ = 1 runs from {ends[0]} to {ends[1]}."
        )
    if "H-C (theory)" in drawn:
        parts.append("H-C: Hsiao and Chirarattananon with α = 0.125.")
    note = _fit_note if relative_lift.by_fit(evidence) else _reference_note
    parts += [note(evidence, boundary) for boundary in evidence.boundaries]
    return " ".join(p for p in parts if p)


def _line_note(evidence: Evidence, table: Columns) -> str:
    """Note on line and shade, and on where least squares differs."""
    if not evidence.has(POSTERIOR):
        return (
            "Solid line and shade: base model by least squares, with the pointwise 90 % band of"
            " its parameters."
        )
    apart = distinct(where(table, kind=fig2.LEAST_SQUARES)["panel"])
    also = (
        f" Thin line ({', '.join(apart)}): least squares, which differs visibly."
        if apart
        else " Least squares gives the same line."
    )
    if plainly := [b for b in evidence.boundaries if relative_lift.as_quoted(evidence, b)]:
        also += f" {listed(plainly).capitalize()}: the quoted coefficients and their 90 % band."
    said = f"Solid line and shade: pointwise median and central 90 % of the posterior.{also}"
    if endless := [b for b in evidence.boundaries if curves.endless(evidence.base(b)[1])]:
        said += f" No band ({', '.join(endless)}): the coefficients have unbounded intervals."
    return said


def _fit_note(evidence: Evidence, boundary: Boundary) -> str:
    """Note on a panel: model, coefficients, corrections and u(L_inf)."""
    model, entry = evidence.base(boundary)
    coefficients = _coefficients(evidence.quoted(boundary))
    quoted = f" ({coefficients})" if coefficients else ""
    effects = relative_lift.named(evidence, boundary)
    out, moved = "", _moved(entry)
    if effects:
        out, moved = f" Points and line are corrected for {' and '.join(effects)}.", ""
    u = 100 * relative_lift.relative_lift(evidence, boundary).u_L_inf
    return (
        f"{boundary.capitalize()}: {model.title}{quoted}.{out} u(L∞) = {plain(u, 2)} % from"
        f" scatter.{moved}{_influence_note(evidence, boundary)}"
    )


def _moved(fit: ModelFit) -> str:
    """Note on a line that is drawn at the fitted height."""
    offset_m = curves.height_found_m(fit)
    if not offset_m:
        return ""
    side = f"{abs(1e3 * offset_m):.2g} mm {'farther' if offset_m > 0 else 'nearer'}"
    return f" The line is drawn at the fitted height, {side} than recorded."


def _coefficients(quoted: BoundaryResult) -> str:
    """Quoted coefficients, and the meaning of ±."""
    parts = [quoted.stated(n) for n in quoted.coefficients]
    parts += [coverage(quoted.headline)] if any("±" in t for t in parts) else []
    return ", ".join(parts)


def _influence_note(evidence: Evidence, boundary: Boundary) -> str:
    """Note on rings, or on the largest influence where there is none."""
    shifts = fig2.influential(evidence, boundary)
    marked = [
        f"{kind} {which} ({letter(name)} by {fixed(shift, 1)} u)"
        for name, kind, which, shift in shifts
        if abs(shift) >= fig2.INFLUENTIAL
    ]
    if marked:
        return f" Rings: {', '.join(marked)} if left out."
    if not shifts:
        return ""
    most = max(abs(shift) for *_, shift in shifts)
    return f" No single trial or visit moves a coefficient by more than {fixed(most, 1)} u."


def _reference_note(evidence: Evidence, boundary: Boundary) -> str:
    model, entry = evidence.base(boundary)
    quoted = evidence.quoted(boundary)
    coefficients = _coefficients(quoted)
    if coefficients and quoted.effects:
        effects = " and ".join(quoted.effects)
        coefficients += f", corrected for {effects}; the line is not"
    bracket = f" ({coefficients})" if coefficients else ""
    over = relative_lift.relative_lift(evidence, boundary)
    known = np.isfinite(over.delta_L)
    if not (known & (over.z_hat > 0)).any():
        return ""
    head = f"{boundary.capitalize()}: {model.title}{bracket};"
    if np.isinf(evidence.observations[boundary].z_hat).any():
        return f"{head} L∞ of the data from trials in free air.{_moved(entry)}"
    far = float(over.z_hat[known].max())
    lacking = ", ".join(f"{100 * t:.3g} %" for t in np.unique(over.throttle[~known]))
    without = f" No trial far away at {lacking} throttle, hence no ΔL." if lacking else ""
    there = float(curves.band(evidence, boundary, np.array([far])).middle[0])
    apart = " The data are offset from the curve by that." if abs(there) > VISIBLE else ""
    return (
        f"{head} L∞ of the data from the farthest station, ẑ = {plain(far, 3)}. There ΔL is 0 by"
        f" construction, and the fit is {fixed(100 * there, 2)} %.{apart}"
        f"{_shared_far(evidence, boundary)}{without}{_moved(entry)}"
    )


def _shared_far(evidence: Evidence, boundary: Boundary) -> str:
    """Note on throttles that share few visits of the far station."""
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
        " station, whose error is common to all symbols of the panel."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """Description of the picture for screen readers."""
    parts = []
    for boundary in distinct(table["panel"]):
        mine = where(table, panel=boundary, kind="data")
        z, delta = mine["z_hat"], mine["delta_L_percent"]
        if not len(z):
            continue
        top, levels = int(np.argmax(np.abs(delta))), len(distinct(mine["label"]))
        parts.append(
            f"Near the {boundary}, {levels} throttle{'s' if levels > 1 else ''}, ẑ from"
            f" {plain(float(z.min()), 3)} to {plain(float(z.max()), 3)}: ΔL runs from"
            f" {plain(float(delta.min()), 3)} % to {plain(float(delta.max()), 3)} %, strongest at ẑ"
            f" = {plain(float(z[top]), 3)}."
        )
    beside = np.isin(table["kind"], ["model", "band", fig2.LEAST_SQUARES, "overlay"])
    lines = distinct(table["label"][beside])
    panels = f"{len(parts)} panel{'s' if len(parts) != 1 else ''}"
    return (
        f"Lift change against distance, {panels}. {' '.join(parts)} Also drawn: {'; '.join(lines)}."
    )
