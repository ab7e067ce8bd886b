"""Figure 2: Delta L against distance at each boundary, with theory and the quoted model; below, the
same less the fitted curve.

Symbols are lift over the fitted L_inf, corrected for identified effects, so that they belong to the
line and to the quoted number. With ``[report] reference = "farthest"`` they are the cells of
lift.parquet, whose L_inf is the farthest station (or free air), and the line is the base model's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift import catalogue, units
from nearlift.catalogue import titled
from nearlift.declare import Boundary, FloatArray
from nearlift.nomenclature import INDEXED, letter
from nearlift.report import curves, relative_lift
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import (
    BAND,
    FITTED,
    NESTED,
    OVERLAYS,
    SEQUENTIAL,
    SERIES,
    Style,
    circles,
    distance,
    headed,
    plain_log,
    plain_text,
)
from nearlift.report.figures.style import REFERENCES as DASHES
from nearlift.report.phrases import coverage, listed, stated
from nearlift.results.fit import ModelFit
from nearlift.results.quotation import BoundaryResult
from nearlift.rounding import fixed, plain
from nearlift.stages.fit import FIT, POSTERIOR
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

POINTS = 240
#: Rotor spacing of the PQuad in rotor radii, assumed: it is not published (its radius is, 120 mm).
PQUAD_SPACING_HAT = 3.0
#: Other plausible spacings, for the caption.
PQUAD_RANGE = (2.5, 4.0)
#: Kind of a least-squares curve where the posterior's differs.
LEAST_SQUARES = "least squares"
#: A trial or visit is marked if a coefficient without it moves by this many standard uncertainties.
INFLUENTIAL = 0.5
#: A departure of this much at the farthest station is visible, and explained.
VISIBLE = 0.002
#: Up to this many visits of the station that gives L_inf, the caption says that they move all
#: symbols of a panel.
FEW_FAR = 6
#: A lift above this is printed in newtons, below it in millinewtons.
MILLI_BELOW_N = 2.0
COLUMNS = (
    *("panel", "kind", "label", "corrected_for", "throttle_fraction", "z_hat"),
    *("delta_L_percent", "u_delta_L_percent", "lo90_percent", "hi90_percent", "above_fit_percent"),
)
SHORT = {"cheeseman_bennett": "C-B", "sanchez_cuevas": "S-C", "hsiao_chirarattananon": "H-C"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A curve of the literature; the vehicle's own geometry where `arguments` has none."""

    model: str
    label: str
    arguments: Mapping[str, float] = field(default_factory=dict)


def pquad(spacing_hat: float = PQUAD_SPACING_HAT) -> dict[str, float]:
    """Arguments of the Sanchez-Cuevas model for the PQuad with an assumed rotor spacing; its rotors
    form a square.
    """
    return {"K_b": 2.0, "spacing_hat": spacing_hat, "diagonal_hat": math.sqrt(2) * spacing_hat}


REFERENCES = (
    Reference(model="cheeseman_bennett", label="C-B (theory)", arguments={"k": 1.0}),
    Reference(model="sanchez_cuevas", label="S-C, K_b = 2", arguments={"K_b": 2.0}),
    Reference(model="sanchez_cuevas", label="S-C (PQuad)", arguments=pquad()),
    Reference(model="hsiao_chirarattananon", label="H-C (theory)", arguments={"alpha": 0.125}),
)


def force_unit(evidence: Evidence) -> tuple[float, str]:
    """Factor from newtons, and the unit, that the manifest asks for or that suit this vehicle."""
    unit: str = evidence.campaign.report.units.force
    if unit == "auto":
        unit = "N" if float(np.max(evidence.table(LIFT)["lift_N"])) > MILLI_BELOW_N else "mN"
    return 1.0 / units.to_si(unit, "force", "report.units.force")[0], unit


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each.

    `kind` is data, band, model, least squares, overlay, influence (a ringed cell) or L_inf (ends of
    the band of its uncertainty, without a Delta L). `above_fit_percent` is Delta L less the fitted
    curve's, `u_delta_L_percent` one standard uncertainty.
    """
    table = stack(
        [
            {"panel": boundary, **part}
            for boundary in evidence.boundaries
            for part in _panel(evidence, boundary)
        ],
        COLUMNS,
    )
    kept = np.isfinite(table["delta_L_percent"]) | (table["kind"] == "L_inf")
    return select(table, kept & (table["z_hat"] > 0))


def _panel(evidence: Evidence, boundary: Boundary) -> list[dict[str, object]]:
    if boundary not in evidence.table(LIFT)["boundary"]:
        return []
    over = relative_lift.relative_lift(evidence, boundary)
    positive = over.z_hat[over.z_hat > 0]
    ends = np.array([positive.min(), positive.max()])
    grid = np.geomspace(ends[0], ends[1], POINTS)
    parts: list[dict[str, object]] = []
    if np.isfinite(over.u_L_inf):
        level = {"label": "uncertainty of L_inf", "u_delta_L_percent": 100 * over.u_L_inf}
        parts.append({"kind": "L_inf", "z_hat": ends, **level})
    parts += _influence(evidence, boundary, over)
    parts.append(
        {
            "kind": "data",
            "label": [f"{100 * t:.3g} %" for t in over.throttle],
            "corrected_for": " + ".join(map(titled, relative_lift.named(evidence, boundary))),
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
    for theory in references(evidence, boundary):
        model = catalogue.model(theory.model)
        geometry = evidence.campaign.geometry()
        known = {n: geometry[n] for n in model.needs if n not in theory.arguments}
        change = 100 * (curves.ratio(model, grid, {**known, **theory.arguments}) - 1)
        drawn = {"z_hat": grid, "delta_L_percent": change}
        parts.append({"kind": "model", "label": theory.label, **drawn})
    span = float(np.nanmax(over.delta_L) - np.nanmin(over.delta_L))
    parts += _fit(evidence, boundary, grid, span)
    for part in parts:
        drawn_at: Any = part.get("delta_L_percent", ())
        if np.size(drawn_at):
            z_hat = np.atleast_1d(np.asarray(part["z_hat"], dtype=float))
            fitted = 100 * relative_lift.line(evidence, boundary, z_hat).middle
            part["above_fit_percent"] = np.asarray(drawn_at) - fitted
    return parts


def references(evidence: Evidence, boundary: Boundary) -> list[Reference]:
    """The curves of the literature that suit this vehicle."""
    several = evidence.campaign.vehicle.rotors > 1
    known = ((r, catalogue.model(r.model)) for r in REFERENCES)
    return [r for r, model in known if model.boundary == boundary and (several or not model.needs)]


def _fit(
    evidence: Evidence, boundary: Boundary, grid: FloatArray, span: float
) -> list[dict[str, object]]:
    """The model's curve and band, and least squares where that differs visibly."""
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
        "Relative change of lift, ΔL = (L − L∞)/L∞, against distance over rotor radius.",
        "Lower panels: the same less the fitted curve.",
        symbols,
        _line_note(evidence, table),
    ]
    drawn = {r.label for b in evidence.boundaries for r in references(evidence, b)}
    if "C-B (theory)" in drawn:
        parts.append("C-B: Cheeseman and Bennett, one rotor.")
    if "S-C, K_b = 2" in drawn:
        parts.append("S-C, K_b = 2: Sanchez-Cuevas et al. for this vehicle's rotor spacing.")
    if "S-C (PQuad)" in drawn:
        model, near = catalogue.model("sanchez_cuevas"), np.array([1.0])
        ratios = [float(curves.ratio(model, near, pquad(d))[0]) for d in PQUAD_RANGE]
        ends = [f"{100 * (ratio - 1):.1f} %" for ratio in ratios]
        parts.append(
            "S-C (PQuad): the same for r = 120 mm. Its unpublished rotor"
            f" spacing is taken as {PQUAD_SPACING_HAT:g} r ="
            f" {PQUAD_SPACING_HAT * 120:.0f} mm. From {PQUAD_RANGE[0]:g} r to"
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
    apart = distinct(where(table, kind=LEAST_SQUARES)["panel"])
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
    parts = [stated(n, c) for n, c in quoted.coefficients.items()]
    parts += [coverage(quoted.headline)] if any("±" in t for t in parts) else []
    return ", ".join(parts)


def _influence_note(evidence: Evidence, boundary: Boundary) -> str:
    """Note on rings, or on the largest influence where there is none."""
    shifts = influential(evidence, boundary)
    marked = [
        f"{kind} {which} ({letter(name)} by {fixed(shift, 1)} u)"
        for name, kind, which, shift in shifts
        if abs(shift) >= INFLUENTIAL
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
    beside = np.isin(table["kind"], ["model", "band", LEAST_SQUARES, "overlay"])
    lines = distinct(table["label"][beside])
    panels = f"{len(parts)} panel{'s' if len(parts) != 1 else ''}"
    return (
        f"Lift change against distance, {panels}. {' '.join(parts)} Also drawn: {'; '.join(lines)}."
    )


Corner = Literal["upper right", "lower right"]
#: About zero: how well L_inf is known.
UNSURE = "#CFE3F3"


def draw(table: Rows, look: Style) -> Figure:
    """A column for each boundary: Delta L above, the same less the fitted curve below."""
    panels = distinct(table["panel"])
    factor, label = distance(look)
    table = {**table, "z_hat": factor * table["z_hat"]}
    width = look.single_in if len(panels) == 1 else look.double_in
    height = {1: 1.2, 2: 0.66, 3: 0.56}[len(panels)] * width
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(2, len(panels), squeeze=False, sharex="col", height_ratios=(2.6, 1))
    throttles = np.unique(where(table, kind="data")["throttle_fraction"])
    shade = None
    if len(throttles) > len(SERIES):
        ends = Normalize(100 * throttles.min(), 100 * throttles.max())
        shade = ScalarMappable(ends, SEQUENTIAL)
    for title, boundary, (ax, below) in zip(headed(panels), panels, axes.T, strict=True):
        rows = where(table, panel=boundary)
        loc: Corner = "lower right" if boundary == "sidewall" else "upper right"
        ax.legend(*_lines(ax, rows, "delta_L_percent", throttles, shade), loc=loc)
        _lines(below, rows, "above_fit_percent", throttles, shade)
        corrected = next((t for t in rows["corrected_for"] if t), "")
        ax.set_title(title + (f", corrected for {plain_text(corrected)}" if corrected else ""))
        below.set_xlabel(f"distance {label}")
        plain_log(ax.xaxis)
    axes[0, 0].set_ylabel(r"$\Delta L$ (%)")
    axes[1, 0].set_ylabel(r"$\Delta L -$ fit (%)")
    if shade is not None:
        figure.colorbar(shade, ax=axes.ravel().tolist(), label="throttle (%)", pad=0.02, aspect=30)
        return figure
    handles = [Line2D([], [], linestyle="none")]
    handles += [
        Line2D([], [], color=c, marker=m, linestyle="none", markerfacecolor="white")
        for (c, m), _ in zip(SERIES, throttles, strict=False)
    ]
    names = ["throttle:", *(f"{100 * t:.3g} %" for t in throttles)]
    look_of = {"columnspacing": 0.8, "handletextpad": 0.1, "handlelength": 1.4}
    figure.legend(handles, names, loc="outside upper center", ncols=len(names), **look_of)
    return figure


def _lines(
    ax: Axes, rows: Rows, y: str, throttles: Any, shade: ScalarMappable | None
) -> tuple[list[Any], list[str]]:
    """One panel of the column `y`; handles and names of its legend."""
    of = {kind: where(rows, kind=kind) for kind in set(rows["kind"].tolist())}
    none = select(rows, np.zeros(len(rows["kind"]), dtype=bool))
    curve, level = of.get("band", none), of.get("L_inf", none)
    ax.set_xscale("log")
    zero = ax.axhline(0, color="0.6", linewidth=0.5, zorder=0.1)
    line = ax.plot(curve["z_hat"], curve[y], color=FITTED, linewidth=0.8, zorder=3)
    for i, throttle in enumerate(throttles):
        # throttles often coincide: each next symbol is smaller, so that all are visible
        size = NESTED[i] * rcParams["lines.markersize"] if shade is None else 2.2
        colour, marker = SERIES[i] if shade is None else (shade.to_rgba(100 * throttle), "o")
        fill = {"markerfacecolor": "white"} if shade is None else {"alpha": 0.7}
        mine = where(of.get("data", none), throttle_fraction=throttle)
        _bars(ax, mine, y, fmt=marker, color=colour, markersize=size, zorder=4, **fill)
    handles: list[Any] = [line[0]]
    names = [_label(label) for label in distinct(curve["label"])]
    for mark, label in zip(OVERLAYS, distinct(of.get("overlay", none)["label"]), strict=False):
        mine = where(of["overlay"], label=label)
        handles.append(_bars(ax, mine, y, fmt=mark, color="0.25", zorder=2))
        names.append(_label(label))
    # theory, and the band of a fit that determines little, may leave the panel
    ax.set_ylim(ax.get_ylim())
    ax.set_xlim(ax.get_xlim())
    shift = curve[y] - curve["delta_L_percent"]
    low, high = (curve[end] + shift for end in ("lo90_percent", "hi90_percent"))
    if np.isfinite(low).any():
        band = ax.fill_between(curve["z_hat"], low, high, color=BAND, linewidth=0, zorder=1)
        handles[0], names[0] = (band, line[0]), f"{names[0]}, 90 %"
    thin = 0.5 * rcParams["lines.linewidth"]
    fitted, theories = of.get(LEAST_SQUARES, none), of.get("model", none)
    for label in distinct(fitted["label"]):
        handles += ax.plot(fitted["z_hat"], fitted[y], color=FITTED, linewidth=thin, zorder=2.8)
        names.append(_label(label))
    for (colour, dashes), label in zip(DASHES, distinct(theories["label"]), strict=False):
        theory = where(theories, label=label)
        look: dict[str, Any] = {"color": colour, "linestyle": dashes, "zorder": 3.2}
        handles += ax.plot(theory["z_hat"], theory[y], **look)
        names.append(_label(label))
    ring = of.get("influence", none)
    if len(ring["z_hat"]):
        size, width = (2.6, 0.8) if shade is None else (1.2, 0.5)
        look = {"markerfacecolor": "none", "markeredgewidth": width, "zorder": 5}
        size *= rcParams["lines.markersize"]
        handles += circles(ax, ring["z_hat"], ring[y], FITTED, markersize=size, **look)
        names.append("influential")
    if len(level["z_hat"]) and y == "delta_L_percent":
        u = float(level["u_delta_L_percent"][0])
        handles.append((ax.axhspan(-u, u, color=UNSURE, linewidth=0, zorder=0), zero))
        names.append(r"uncertainty of $L_\infty$")
    return handles, names


def _label(text: str) -> str:
    return INDEXED.sub(r"$\1_\2$", plain_text(text))


def _bars(ax: Axes, mine: Rows, y: str, **look: Any) -> Any:
    thin = {"elinewidth": 0.6, "markeredgewidth": 0.8}
    return ax.errorbar(mine["z_hat"], mine[y], mine["u_delta_L_percent"], **thin | look)


FIGURE = FigureSpec(
    name="fig2",
    title="Lift change near each boundary",
    needs=(TRIALS, LIFT, FIT),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
