"""Figure 2: Delta L against distance at each boundary, with theory and the quoted model.

Below, Delta L less the curve. Cells and curve are those of `relative_lift`.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
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
from nearlift.report import curves
from nearlift.report.evidence import Evidence, Part, frame, groups, pick
from nearlift.report.figures import style
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import DEFAULT, SERIES, Look, Style, plain_text
from nearlift.report.phrases import coefficient_text, coverage, listed
from nearlift.report.relative_lift import (
    RelativeLift,
    is_base_fit,
    line,
    quoted_model,
    relative_lift,
)
from nearlift.rounding import fixed, plain
from nearlift.stages.fit import FIT, POSTERIOR
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

POINTS = 240
#: Rotor spacing of the PQuad in rotor radii, assumed: it is not published (its radius is, 120 mm).
PQUAD_SPACING_HAT = 3.0
#: Other plausible spacings, for the caption.
PQUAD_RANGE = (2.5, 4.0)
#: A trial or visit is marked if a coefficient without it moves by this many standard uncertainties.
INFLUENTIAL = 0.5
#: A lift above this is printed in newtons, below it in millinewtons.
MILLI_BELOW_N = 2.0
COLUMNS = (
    *("panel", "kind", "label", "corrected_for", "throttle_fraction", "z_hat"),
    *("delta_L_percent", "u_delta_L_percent", "lo90_percent", "hi90_percent", "above_fit_percent"),
)
SHORT = {"cheeseman_bennett": "C-B", "sanchez_cuevas": "S-C", "hsiao_chirarattananon": "H-C"}
#: Letters of a legend's line at most.
WIDEST = 22
#: About zero: how well L_inf is known.
UNSURE = "#CFE3F3"
OVERLAYS = ("x", "+", "1", "2", "*")
#: Size of each series' symbols over the style's: throttles often coincide, and all stay visible.
NESTED = (1.3, 1.15, 1.0, 0.85, 0.7, 0.6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A curve of the literature; the vehicle's own geometry where `arguments` has none."""

    model: str
    label: str
    note: str
    arguments: Mapping[str, float] = field(default_factory=dict)


def pquad(spacing_hat: float = PQUAD_SPACING_HAT) -> dict[str, float]:
    """Arguments of the Sanchez-Cuevas model for the PQuad with an assumed rotor spacing; its rotors
    form a square.
    """
    return {"K_b": 2.0, "spacing_hat": spacing_hat, "diagonal_hat": math.sqrt(2) * spacing_hat}


REFERENCES = (
    Reference(
        model="cheeseman_bennett",
        label="C-B (theory)",
        note="C-B: Cheeseman and Bennett, one rotor.",
        arguments={"k": 1.0},
    ),
    Reference(
        model="sanchez_cuevas",
        label="S-C, K_b = 2",
        note="S-C, K_b = 2: Sanchez-Cuevas et al. for this vehicle's rotor spacing.",
        arguments={"K_b": 2.0},
    ),
    Reference(
        model="sanchez_cuevas",
        label="S-C (PQuad)",
        note="S-C (PQuad): the same for r = 120 mm. Its unpublished rotor spacing is taken as"
        f" {PQUAD_SPACING_HAT:g} r = {PQUAD_SPACING_HAT * 120:.0f} mm.",
        arguments=pquad(),
    ),
    Reference(
        model="hsiao_chirarattananon",
        label="H-C (theory)",
        note="H-C: Hsiao and Chirarattananon with α = 0.125.",
        arguments={"alpha": 0.125},
    ),
)


def force_unit(evidence: Evidence) -> tuple[float, str]:
    """Factor from newtons, and the unit, that the manifest asks for or that suit this vehicle."""
    unit: str = evidence.campaign.report.units.force
    if unit == "auto":
        unit = "N" if float(np.max(evidence.table(LIFT)["lift_N"])) > MILLI_BELOW_N else "mN"
    return 1.0 / units.to_si(unit, "force", "report.units.force")[0], unit


def references(evidence: Evidence, boundary: Boundary) -> list[Reference]:
    """The curves of the literature that suit this vehicle."""
    several = evidence.campaign.vehicle.rotors > 1
    known = ((r, catalogue.model(r.model)) for r in REFERENCES)
    return [r for r, model in known if model.boundary == boundary and (several or not model.needs)]


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


def table(evidence: Evidence) -> pd.DataFrame:
    """Everything that is drawn, a row each.

    `kind` is data, band (the curve with its ends), model, least squares, overlay, influence (a
    ringed cell) or L_inf. Rows of L_inf are the ends of the band of its uncertainty, without a
    Delta L. `above_fit_percent` is Delta L less the curve's; `u_delta_L_percent` one standard
    uncertainty.
    """
    parts = [
        {"panel": boundary, **part}
        for boundary in evidence.boundaries
        if boundary in evidence.table(LIFT)["boundary"]
        for part in _panel(evidence, boundary)
    ]
    rows = frame(parts, COLUMNS)
    kept = np.isfinite(rows["delta_L_percent"]) | (rows["kind"] == "L_inf")
    return pick(rows[kept & (rows["z_hat"] > 0)])


def _panel(evidence: Evidence, boundary: Boundary) -> list[Part]:
    over, drawn = relative_lift(evidence, boundary), quoted_model(evidence, boundary)
    at = over.z_hat[over.z_hat > 0]
    z_hat = np.geomspace(at.min(), at.max(), POINTS)
    curve = line(evidence, boundary, z_hat)
    base, _ = evidence.base(boundary)
    short = SHORT.get(base.name, base.title)
    name = " with ".join([short, *(titled(e) for e in drawn.in_curve)])
    parts: list[Part] = [
        {
            "kind": "data",
            "label": [f"{100 * t:.3g} %" for t in over.throttle],
            "corrected_for": " + ".join(map(titled, drawn.in_points)),
            "throttle_fraction": over.throttle,
            "z_hat": over.z_hat,
            "delta_L_percent": 100 * over.delta_L,
            "u_delta_L_percent": 100 * over.u,
        },
        {
            "kind": "band",
            "label": f"{name}, fitted",
            "z_hat": z_hat,
            "delta_L_percent": 100 * curve.middle,
            "lo90_percent": 100 * curve.low,
            "hi90_percent": 100 * curve.high,
        },
        *_literature(evidence, boundary, z_hat),
        *_influence(evidence, boundary, over),
    ]
    if curve.parts(float(np.nanmax(over.delta_L) - np.nanmin(over.delta_L))):
        other = {"kind": "least squares", "label": f"{short}, least squares", "z_hat": z_hat}
        parts.append({**other, "delta_L_percent": 100 * curve.least_squares})
    for overlay, points in evidence.overlays:
        if overlay.boundary == boundary:
            shown = {"delta_L_percent": "delta_L", "u_delta_L_percent": "u"}
            values = {column: 100 * points[name] for column, name in shown.items()}
            measured = {"kind": "overlay", "label": overlay.label, "z_hat": points["z_hat"]}
            parts.append({**measured, **values})
    for part in parts:
        places = np.asarray(part["z_hat"], dtype=float)
        fitted = 100 * line(evidence, boundary, places).middle
        part["above_fit_percent"] = part["delta_L_percent"] - fitted
    level = {"label": "uncertainty of L_inf", "u_delta_L_percent": 100 * over.u_L_inf}
    parts.append({"kind": "L_inf", "z_hat": z_hat[[0, -1]], **level})
    return parts


def _literature(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> list[Part]:
    geometry, parts = evidence.campaign.geometry(), []
    for theory in references(evidence, boundary):
        model = catalogue.model(theory.model)
        known = {n: geometry[n] for n in model.needs if n not in theory.arguments}
        change = 100 * (curves.ratio(model, z_hat, {**known, **theory.arguments}) - 1)
        named = {"kind": "model", "label": theory.label}
        parts.append({**named, "z_hat": z_hat, "delta_L_percent": change})
    return parts


def _influence(evidence: Evidence, boundary: Boundary, over: RelativeLift) -> list[Part]:
    """The cells of what moves a coefficient by at least `INFLUENTIAL`."""
    data, parts = evidence.observations[boundary], []
    for name, kind, which, shift in influential(evidence, boundary):
        if abs(shift) < INFLUENTIAL:
            continue
        mine = (data.trial if kind == "trial" else data.visit.astype(str)) == which
        throttle = data.levels[data.level][mine]
        places = set(zip(throttle.tolist(), data.z_hat[mine].tolist(), strict=True))
        at = np.array([p in places for p in zip(over.throttle, over.z_hat, strict=True)])
        ring = {"kind": "influence", "label": f"{kind} {which}: {name} by {fixed(shift, 1)} u"}
        parts.append({**ring, "z_hat": over.z_hat[at], "delta_L_percent": 100 * over.delta_L[at]})
    return parts


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption of the figure, numbers included."""
    drawn = {r.label: r for b in evidence.boundaries for r in references(evidence, b)}
    parts = [
        "Relative change of lift, ΔL = (L − L∞)/L∞, against distance over rotor radius.",
        "Lower panels: the same less the curve.",
        "Symbols: cell means over the fitted L∞. Bars: 1 standard uncertainty from scatter.",
        "Blue band: uncertainty of L∞, common to all points of a throttle.",
        _line_note(evidence, table),
        *(r.note for r in drawn.values()),
    ]
    if "S-C (PQuad)" in drawn:
        model, near = catalogue.model("sanchez_cuevas"), np.array([1.0])
        ratios = [float(curves.ratio(model, near, pquad(d))[0]) for d in PQUAD_RANGE]
        ends = [f"{100 * (ratio - 1):.1f} %" for ratio in ratios]
        parts.append(
            f"From {PQUAD_RANGE[0]:g} r to {PQUAD_RANGE[1]:g} r the PQuad's curve at ẑ = 1 runs"
            f" from {ends[0]} to {ends[1]}."
        )
    parts += [fit_note(evidence, boundary) for boundary in evidence.boundaries]
    return " ".join(p for p in parts if p)


def _line_note(evidence: Evidence, table: pd.DataFrame) -> str:
    """Note on line and shade, and on where least squares differs."""
    if not evidence.has(POSTERIOR):
        return (
            "Solid line and shade: base model by least squares, with the pointwise 90 % band of"
            " its parameters."
        )
    apart = table[table["kind"] == "least squares"]["panel"].unique()
    also = (
        f" Thin line ({', '.join(apart)}): least squares, which differs visibly."
        if len(apart)
        else " Least squares gives the same line."
    )
    if other := [b for b in evidence.boundaries if not is_base_fit(evidence, b)]:
        also += f" {listed(other).capitalize()}: the quoted model and its 90 % band."
    said = f"Solid line and shade: pointwise median and central 90 % of the posterior.{also}"
    if endless := [b for b in evidence.boundaries if curves.endless(evidence.base(b)[1])]:
        said += f" No band ({', '.join(endless)}): the coefficients have unbounded intervals."
    return said


def fit_note(evidence: Evidence, boundary: Boundary) -> str:
    """Note on a panel: model, coefficients, corrections and u(L_inf)."""
    model, _ = evidence.base(boundary)
    coefficients, drawn = _coefficients(evidence, boundary), quoted_model(evidence, boundary)
    quoted = f" ({coefficients})" if coefficients else ""
    moved = _moved(evidence, boundary)
    if drawn.effects:
        moved = ""
    if drawn.in_points:
        moved += f" The points are corrected for {listed([titled(e) for e in drawn.in_points])}."
    if drawn.in_curve:
        moved += (
            f" The points are as measured. The line includes"
            f" {listed([titled(e) for e in drawn.in_curve])}, its band the scatter alone."
        )
    u = 100 * relative_lift(evidence, boundary).u_L_inf
    return (
        f"{boundary.capitalize()}: {model.title}{quoted}.{moved} u(L∞) = {plain(u, 2)} % from"
        f" scatter.{influence_note(evidence, boundary)}"
    )


def _moved(evidence: Evidence, boundary: Boundary) -> str:
    """Note on a line that is drawn at the fitted height."""
    offset_m = curves.height_found_m(evidence.base(boundary)[1])
    if not offset_m:
        return ""
    side = f"{abs(1e3 * offset_m):.2g} mm {'farther' if offset_m > 0 else 'nearer'}"
    return f" The line is drawn at the fitted height, {side} than recorded."


def _coefficients(evidence: Evidence, boundary: Boundary) -> str:
    """Quoted coefficients, and the meaning of ±."""
    quoted = evidence.quoted(boundary)
    parts = [coefficient_text(c, name) for name, c in quoted.coefficients.items()]
    parts += [coverage(quoted.headline)] if any("±" in t for t in parts) else []
    return ", ".join(parts)


def influence_note(evidence: Evidence, boundary: Boundary) -> str:
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


def draw(table: pd.DataFrame, look: Style = DEFAULT) -> Figure:
    """A column for each boundary: Delta L above, the same less the curve below."""
    panels = list(table["panel"].unique())
    factor, label = look.distance
    table = table.assign(z_hat=factor * table["z_hat"])
    share = {1: 1.2, 2: 0.66}.get(len(panels), 0.56)
    height = share * (look.single_in if len(panels) == 1 else look.double_in)
    figure, axes = style.canvas(look, 2, len(panels), height, sharex="col", height_ratios=(2.6, 1))
    throttles = np.unique(table[table["kind"] == "data"]["throttle_fraction"])
    shade = None
    if len(throttles) > len(SERIES):
        # many levels of one quantity: even in lightness, also to colour-blind eyes
        shade = ScalarMappable(Normalize(100 * throttles.min(), 100 * throttles.max()), "cividis")
    for title, boundary, (ax, below) in zip(style.lettered(panels), panels, axes.T, strict=True):
        rows = pick(table, panel=boundary)
        handles = _lines(ax, rows, "delta_L_percent", throttles, shade)
        loc: Any = "lower right" if boundary == "sidewall" else "upper right"
        ax.legend(list(handles.values()), list(handles), loc=loc)
        _lines(below, rows, "above_fit_percent", throttles, shade)
        corrected = next((t for t in rows["corrected_for"] if t), "")
        ax.set_title(title + (f", corrected for {plain_text(corrected)}" if corrected else ""))
        style.log_distance(below, f"distance {label}")
    axes[0, 0].set_ylabel(r"$\Delta L$ (%)")
    axes[1, 0].set_ylabel(r"$\Delta L -$ fit (%)")
    if shade is not None:
        figure.colorbar(shade, ax=axes.ravel().tolist(), label="throttle (%)", pad=0.02, aspect=30)
        return figure
    handles = {"throttle:": Line2D([], [], linestyle="none")}
    for (colour, marker), throttle in zip(SERIES, throttles, strict=False):
        mark: Look = {"color": colour, "marker": marker, "markerfacecolor": "white"}
        handles[f"{100 * throttle:.3g} %"] = Line2D([], [], linestyle="none", **mark)
    figure.legend(
        list(handles.values()), list(handles), loc="outside upper center", ncols=len(handles),
        columnspacing=0.8, handletextpad=0.1, handlelength=1.4,
    )  # fmt: skip
    return figure


def _lines(
    ax: Axes, rows: pd.DataFrame, y: str, throttles: FloatArray, shade: ScalarMappable | None
) -> Look:
    """Draw one panel of the column `y`; handles of its legend by name."""
    ax.set_xscale("log")
    zero, size = style.zero(ax), rcParams["lines.markersize"]
    curve, data = pick(rows, kind="band"), pick(rows, kind="data")
    fitted = ax.plot(curve.z_hat, curve[y], color=style.FITTED, linewidth=0.8, zorder=3)[0]
    for i, throttle in enumerate(throttles):
        mine = pick(data, throttle_fraction=throttle)
        series: Any = SERIES[i % len(SERIES)]
        look: Look = {"markerfacecolor": "white"}
        look["markersize"] = NESTED[i % len(NESTED)] * size
        if shade is not None:
            series, look = (shade.to_rgba(100 * throttle), "o"), {"markersize": 2.2, "alpha": 0.7}
        style.bars(ax, mine.z_hat, mine[y], mine.u_delta_L_percent, series, zorder=4, **look)
    handles: Look = {}
    overlays = pick(rows, kind="overlay")
    for mark, label in zip(OVERLAYS, overlays["label"].unique(), strict=False):
        mine = pick(overlays, label=label)
        of = style.bars(ax, mine.z_hat, mine[y], mine.u_delta_L_percent, ("0.25", mark), zorder=2)
        handles[_label(label)] = of
    # theory, and the band of a fit that determines little, may leave the panel
    ax.set(xlim=ax.get_xlim(), ylim=ax.get_ylim())
    shift, name = curve[y] - curve["delta_L_percent"], _label(curve["label"].iloc[0])
    first: Look = {name: fitted}
    if curve["lo90_percent"].notna().any():
        low, high = curve["lo90_percent"] + shift, curve["hi90_percent"] + shift
        first = {f"{name}, 90 %": (style.band(ax, curve.z_hat, low, high), fitted)}
    thin: Look = {"color": style.FITTED, "linewidth": 0.5 * rcParams["lines.linewidth"]}
    for (label,) in groups(pick(rows, kind="least squares"), "label"):
        mine = pick(rows, label=label)
        handles[_label(label)] = ax.plot(mine.z_hat, mine[y], zorder=2.8, **thin)[0]
    theories = pick(rows, kind="model")
    for (colour, dashes), label in zip(style.REFERENCES, theories["label"].unique(), strict=False):
        mine = pick(theories, label=label)
        dashed: Any = {"color": colour, "linestyle": dashes, "zorder": 3.2}
        handles[_label(label)] = ax.plot(mine.z_hat, mine[y], **dashed)[0]
    ring, wide = pick(rows, kind="influence"), 2.6 if shade is None else 1.2
    if len(ring):
        look = {"markersize": wide * size, "markerfacecolor": "none", "color": style.FITTED}
        handles["influential"] = ax.plot(ring.z_hat, ring[y], "o", zorder=5, **look)[0]
    level = pick(rows, kind="L_inf")
    if len(level) and y == "delta_L_percent":
        u = level["u_delta_L_percent"].iloc[0]
        span = ax.axhspan(-u, u, color=UNSURE, linewidth=0, zorder=0)
        handles[r"uncertainty of $L_\infty$"] = (span, zero)
    return first | handles


def _label(text: str) -> str:
    return INDEXED.sub(r"$\1_\2$", "\n".join(textwrap.wrap(plain_text(text), WIDEST)))


FIGURE = FigureSpec(
    name="fig2",
    title="Lift change near each boundary",
    needs=(TRIALS, LIFT, FIT),
    rows=table,
    draw=draw,
    caption=caption,
    shows="delta_L_percent",
)
