"""Figure 2: Delta L against distance at each boundary, with theory and the quoted model.

Below, Delta L less the curve. Cells and curve are those of `curves`.
"""

from __future__ import annotations

import functools
import math
import textwrap
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary, FloatArray
from nearlift.nomenclature import INDEXED
from nearlift.report import curves
from nearlift.report.evidence import Evidence, Part, frame, groups, pick
from nearlift.report.figures import style
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import FITTED, SERIES, plain_text
from nearlift.report.phrases import coefficient_text, coverage, listed
from nearlift.rounding import plain
from nearlift.stages.fit import FIT, POSTERIOR
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

POINTS = 240
#: Two curves are drawn as one if they differ by less than this share of the data's range.
VISIBLE = 0.01
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
#: Size in points of each series' symbols: throttles often coincide, and all stay visible.
NESTED_PT = (4.2, 3.7, 3.2, 2.7, 2.2, 1.9)


class Reference(NamedTuple):
    """A curve of the literature; the vehicle's own geometry where `arguments` has none."""

    model: str
    label: str
    arguments: Mapping[str, float]
    note: str


#: Rotor spacing of the PQuad in rotor radii, assumed: it is not published (its radius is, 120 mm).
PQUAD_SPACING_HAT = 3.0
PQUAD = Reference(
    "sanchez_cuevas",
    "S-C (PQuad)",
    {
        "K_b": 2.0,
        "spacing_hat": PQUAD_SPACING_HAT,
        "diagonal_hat": math.sqrt(2) * PQUAD_SPACING_HAT,
    },
    "S-C (PQuad): the same for r = 120 mm. Its unpublished rotor spacing is taken as"
    f" {PQUAD_SPACING_HAT:g} r = {PQUAD_SPACING_HAT * 120:.0f} mm.",
)
CB_NOTE = "C-B: Cheeseman and Bennett, one rotor."
SC_NOTE = "S-C, K_b = 2: Sanchez-Cuevas et al. for this vehicle's rotor spacing."
HC_NOTE = "H-C: Hsiao and Chirarattananon with α = 0.125."
REFERENCES = (
    Reference("cheeseman_bennett", "C-B (theory)", {"k": 1.0}, CB_NOTE),
    Reference("sanchez_cuevas", "S-C, K_b = 2", {"K_b": 2.0}, SC_NOTE),
    PQUAD,
    Reference("hsiao_chirarattananon", "H-C (theory)", {"alpha": 0.125}, HC_NOTE),
)


def force_unit(evidence: Evidence) -> tuple[float, str]:
    """Factor from newtons, and the unit, that suit this vehicle."""
    large = float(np.max(evidence.table(LIFT)["lift_N"])) > MILLI_BELOW_N
    return (1.0, "N") if large else (1e3, "mN")


def references(evidence: Evidence, boundary: Boundary) -> list[Reference]:
    """The curves of the literature that suit this vehicle."""
    several = evidence.campaign.vehicle.rotors > 1
    known = ((r, catalogue.model(r.model)) for r in REFERENCES)
    return [r for r, model in known if model.boundary == boundary and (several or not model.needs)]


@functools.lru_cache(maxsize=1)
def table(evidence: Evidence) -> pd.DataFrame:
    """Everything that is drawn, a row each.

    `kind` is data, band (the curve with its ends), model, least squares or L_inf. Rows of
    L_inf are the ends of the band of its uncertainty, without a Delta L. `above_fit_percent` is
    Delta L less the curve's; `u_delta_L_percent` one standard uncertainty.
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
    cells, drawn = curves.relative_lift(evidence, boundary), curves.quoted_model(evidence, boundary)
    z_hat = np.geomspace(cells.z_hat.min(), cells.z_hat.max(), POINTS)
    curve = curves.line(evidence, boundary, z_hat)
    base, geometry = evidence.base(boundary)[0], evidence.campaign.geometry()
    short = SHORT.get(base.name, base.title)

    def part(kind: str, label: Any, at: FloatArray, delta_L: FloatArray, **more: Any) -> Part:
        fitted = (curve if at is z_hat else curves.line(evidence, boundary, at)).middle
        percent = 100 * delta_L
        values = {"delta_L_percent": percent, "above_fit_percent": percent - 100 * fitted}
        return {"kind": kind, "label": label, "z_hat": at, **values, **more}

    levels = [f"{100 * t:.3g} %" for t in cells.throttle]
    fitted = f"{' with '.join([short, *map(titled, drawn.in_curve)])}, fitted"
    ends = {"lo90_percent": 100 * curve.low, "hi90_percent": 100 * curve.high}
    parts = [
        part("data", levels, cells.z_hat, cells.delta_L, u_delta_L_percent=100 * cells.u)
        | {"throttle_fraction": cells.throttle}
        | {"corrected_for": " + ".join(map(titled, drawn.in_points))},
        part("band", fitted, z_hat, curve.middle, **ends),
    ]
    for theory in references(evidence, boundary):
        model = catalogue.model(theory.model)
        known = {n: geometry[n] for n in model.needs} | {**theory.arguments}
        parts.append(part("model", theory.label, z_hat, curves.ratio(model, z_hat, known) - 1))
    apart = np.nanmax(np.abs(curve.least_squares - curve.middle), initial=0.0)
    if apart > VISIBLE * (np.nanmax(cells.delta_L) - np.nanmin(cells.delta_L)):
        label = f"{short}, least squares"
        parts.append(part("least squares", label, z_hat, curve.least_squares))
    level = {"label": "uncertainty of L_inf", "u_delta_L_percent": 100 * cells.u_L_inf}
    return [*parts, {"kind": "L_inf", "z_hat": z_hat[[0, -1]], **level}]


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
    return " ".join([*parts, *(fit_note(evidence, boundary) for boundary in evidence.boundaries)])


def _line_note(evidence: Evidence, table: pd.DataFrame) -> str:
    """Note on line and shade, and on where least squares differs."""
    if not evidence.has(POSTERIOR):
        return (
            "Solid line and shade: base model by least squares, with the pointwise 90 % band of"
            " its parameters."
        )
    said = "Solid line and shade: pointwise median and central 90 % of the posterior."
    apart = table[table["kind"] == "least squares"]["panel"].unique()
    if len(apart):
        said += f" Thin line ({', '.join(apart)}): least squares, which differs visibly."
    else:
        said += " Least squares gives the same line."
    if other := [b for b in evidence.boundaries if not curves.quoted_model(evidence, b).is_base]:
        said += f" {listed(other).capitalize()}: the quoted model and its 90 % band."
    if open_ended := [
        b for b in evidence.boundaries if curves.has_open_interval(evidence.base(b)[1])
    ]:
        said += f" No band ({', '.join(open_ended)}): the coefficients have unbounded intervals."
    return said


def fit_note(evidence: Evidence, boundary: Boundary) -> str:
    """Note on a panel: model, coefficients, corrections and u(L_inf)."""
    model, fit = evidence.base(boundary)
    quoted, drawn = evidence.quoted(boundary), curves.quoted_model(evidence, boundary)
    said = [coefficient_text(c, name) for name, c in quoted.coefficients.items()]
    said += [coverage(quoted.headline)] if any("±" in text for text in said) else []
    coefficients = f" ({', '.join(said)})" if said else ""
    text = f"{boundary.capitalize()}: {model.title}{coefficients}."
    error = fit.height_error
    if error and abs(error.value) > error.u and not drawn.effects:
        side = f"{abs(1e3 * error.value):.2g} mm {'farther' if error.value > 0 else 'nearer'}"
        text += f" The line is drawn at the fitted height, {side} than recorded."
    if drawn.in_points:
        text += f" The points are corrected for {listed([*map(titled, drawn.in_points)])}."
    if drawn.in_curve:
        text += (
            f" The points are as measured. The line includes"
            f" {listed([*map(titled, drawn.in_curve)])}, its band the scatter alone."
        )
    u = plain(100 * curves.relative_lift(evidence, boundary).u_L_inf, 2)
    return f"{text} u(L∞) = {u} % from scatter."


def draw(table: pd.DataFrame) -> Figure:
    """A column for each boundary: Delta L above, the same less the curve below."""
    panels = list(table["panel"].unique())
    share = {1: 1.2, 2: 0.66}.get(len(panels), 0.56)
    height = share * (style.SINGLE_IN if len(panels) == 1 else style.DOUBLE_IN)
    figure, axes = style.canvas(2, len(panels), height, sharex="col", height_ratios=(2.6, 1))
    throttles = np.unique(table[table["kind"] == "data"]["throttle_fraction"])
    shade = None
    if len(throttles) > len(SERIES):
        # many levels of one quantity: even in lightness, also to colour-blind eyes
        shade = ScalarMappable(Normalize(100 * throttles.min(), 100 * throttles.max()), "cividis")
    titles = []
    for boundary, (ax, below) in zip(panels, axes.T, strict=True):
        rows = pick(table, panel=boundary)
        handles = _lines(ax, rows, "delta_L_percent", throttles, shade)
        place = "lower right" if boundary == "sidewall" else "upper right"
        ax.legend(list(handles.values()), list(handles), loc=place)
        _lines(below, rows, "above_fit_percent", throttles, shade)
        corrected = next((t for t in rows["corrected_for"] if t), "")
        titles.append(boundary + (f", corrected for {plain_text(corrected)}" if corrected else ""))
        style.log_distance(below, f"distance {style.Z_HAT}")
    style.title(axes[0], titles)
    axes[0, 0].set_ylabel(r"$\Delta L$ (%)")
    axes[1, 0].set_ylabel(r"$\Delta L -$ fit (%)")
    if shade is not None:
        figure.colorbar(shade, ax=axes.ravel().tolist(), label="throttle (%)", pad=0.02, aspect=30)
        return figure
    marks = [Line2D([], [], linestyle="none", label="throttle:")] + [
        Line2D(
            [], [], linestyle="none", color=colour, marker=marker, markerfacecolor="white",
            label=f"{100 * throttle:.3g} %",
        )
        for (colour, marker), throttle in zip(SERIES, throttles, strict=False)
    ]  # fmt: skip
    figure.legend(
        handles=marks, loc="outside upper center", ncols=len(marks), columnspacing=0.8,
        handletextpad=0.1, handlelength=1.4,
    )  # fmt: skip
    return figure


def _lines(
    ax: Axes, rows: pd.DataFrame, y: str, throttles: FloatArray, shade: ScalarMappable | None
) -> Part:
    """Draw one panel of the column `y`; handles of its legend by name."""
    ax.set_xscale("log")
    zero = style.zero(ax)
    curve, data, level = (pick(rows, kind=kind) for kind in ("band", "data", "L_inf"))
    fitted = ax.plot(curve.z_hat, curve[y], color=FITTED, linewidth=0.8, zorder=3)[0]
    for i, throttle in enumerate(throttles):
        mine = pick(data, throttle_fraction=throttle)
        series: Any = SERIES[i % len(SERIES)]
        mark: Part = {"markerfacecolor": "white", "markersize": NESTED_PT[i % len(SERIES)]}
        if shade is not None:
            series, mark = (shade.to_rgba(100 * throttle), "o"), {"markersize": 2.2, "alpha": 0.7}
        style.bars(ax, mine.z_hat, mine[y], mine.u_delta_L_percent, series, zorder=4, **mark)
    handles: Part = {}
    # theory, and the band of a fit that determines little, may leave the panel
    ax.set(xlim=ax.get_xlim(), ylim=ax.get_ylim())
    name = _label(curve["label"].iloc[0])
    first: Part = {name: fitted}
    if curve["lo90_percent"].notna().any():
        shift = curve[y] - curve["delta_L_percent"]
        low, high = curve["lo90_percent"] + shift, curve["hi90_percent"] + shift
        first = {f"{name}, 90 %": (style.band(ax, curve.z_hat, low, high), fitted)}
    for label, mine in _labelled(rows, "least squares"):
        thin = ax.plot(mine.z_hat, mine[y], color=FITTED, linewidth=0.5, zorder=2.8)
        handles[label] = thin[0]
    for (grey, dashes), (label, mine) in zip(
        style.REFERENCES, _labelled(rows, "model"), strict=False
    ):
        dashed = ax.plot(mine.z_hat, mine[y], color=grey, linestyle=dashes, zorder=3.2)
        handles[label] = dashed[0]
    if len(level) and y == "delta_L_percent":
        u = level["u_delta_L_percent"].iloc[0]
        span = ax.axhspan(-u, u, color=UNSURE, linewidth=0, zorder=0)
        handles[r"uncertainty of $L_\infty$"] = (span, zero)
    return first | handles


def _labelled(rows: pd.DataFrame, kind: str) -> list[tuple[str, pd.DataFrame]]:
    """Rows of each label of one kind, in the order in which they come."""
    mine = pick(rows, kind=kind)
    return [(_label(label), pick(mine, label=label)) for (label,) in groups(mine, "label")]


def _label(text: str) -> str:
    return INDEXED.sub(r"$\1_\2$", "\n".join(textwrap.wrap(plain_text(text), WIDEST)))


FIGURE = FigureSpec(
    "fig2", "Lift change near each boundary", (TRIALS, LIFT, FIT), table, caption, draw,
    "delta_L_percent",
)  # fmt: skip
