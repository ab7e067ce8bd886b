"""What the ratio takes for granted: the coefficient per throttle, against the exponent of the held
quantity, and C_L against speed; a row of panels per question, a column per boundary.
"""

from __future__ import annotations

import itertools
import string

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift import nomenclature
from nearlift.declare import Boundary
from nearlift.products import FIT
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import BAND, FITTED, REFERENCES, SERIES, Style, circles
from nearlift.results.assumptions import HeldQuantity, RotorTrend
from nearlift.rounding import plain

NUMBERS = ("x", "value", "lo90", "hi90", "lo90_apart", "hi90_apart")
COLOUR = SERIES[0][0]
#: What the caption says of each part and kind that is drawn.
WORDS = {
    "throttle": (
        "Coefficient of the base fit per throttle (symbols) and for all (line, 90 % band). Thick:"
        " 90 % interval of what parts a throttle from the others; thin: with the errors that all"
        " throttles share."
    ),
    "exponent": (
        "Coefficient of the base fit against the exponent n to which the model's ratio is raised"
        " (line, 90 % band): 1 as published, 2/3 constant power, 0.60 to 0.82 constant rotor speed"
        " (symbols)."
    ),
    "supported": "Shade: what the logged speed or power leaves.",
    "rotor": (
        "Rotor coefficient per throttle against rotor speed, 90 % intervals; line: power law;"
        " dashed: the constant of Carter et al. 2021."
    ),
}


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `panel` (boundary), `part`, `kind`, `label` (the
    coefficient's name), `x`, `value`, `lo90`, `hi90`, `lo90_apart`, `hi90_apart`. Part `throttle`:
    kinds `throttle` (x in per cent; the interval `apart` is without what all throttles share) and
    `common`. Part `exponent`: kinds `curve`, `plausible`, and `supported` (an end of what the logs
    leave). Part `rotor`: kinds `C_L` (x in Hz), `law`, `paper`.
    """
    parts = (("throttle", _throttles), ("exponent", _exponents), ("rotor", _rotor))
    return stack(
        [
            {"panel": boundary, "part": part, **row}
            for boundary in evidence.boundaries
            for part, rows in parts
            for row in rows(evidence, boundary)
        ],
        ("panel", "part", "kind", "label", *NUMBERS),
    )


def _estimate(e: object) -> dict[str, float]:
    return {k: getattr(e, k) for k in ("value", "lo90", "hi90")}


def _throttles(evidence: Evidence, boundary: Boundary) -> list[dict[str, object]]:
    collapse = evidence.fits.throttle_collapse.get(boundary)
    if collapse is None or len(collapse.per_throttle) < 2:
        return []
    name = {"label": collapse.coefficient}
    _, base = evidence.base(boundary)
    rows = [{"kind": "common", **name, **_estimate(base.parameters[collapse.coefficient])}]
    for throttle, e in collapse.per_throttle.items():
        apart = (e.hi90 - e.value) * e.u_apart / e.u
        around = {"lo90_apart": e.value - apart, "hi90_apart": e.value + apart}
        rows.append({"kind": "throttle", **name, "x": 100 * throttle, **_estimate(e), **around})
    return rows


def _exponents(evidence: Evidence, boundary: Boundary) -> list[dict[str, object]]:
    held = evidence.fits.held_quantity.get(boundary)
    if not isinstance(held, HeldQuantity) or not held.curve:
        return []
    rows: list[dict[str, object]] = [
        {"kind": kind, "x": e.n, **_estimate(e)}
        for kind, drawn in (("curve", held.curve), ("plausible", held.plausible))
        for e in drawn
    ]
    rows += [{"kind": "supported", "x": n} for n in held.supported_exponents or ()]
    return [{"label": held.coefficient, **row} for row in rows]


def _rotor(evidence: Evidence, boundary: Boundary) -> list[dict[str, object]]:
    trend = evidence.fits.rotor_coefficient.get(boundary)
    if not isinstance(trend, RotorTrend) or not trend.per_throttle:
        return []
    rows: list[dict[str, object]] = [
        {"kind": "C_L", "x": e.speed_Hz, **_estimate(e)} for e in trend.per_throttle.values()
    ]
    rows.append({"kind": "paper", "value": trend.paper})
    if trend.exponent is not None:
        drawn = [e.speed_Hz for e in trend.per_throttle.values()]
        speeds = np.geomspace(min(drawn), max(drawn), 41)
        law = trend.law.C_L * (speeds / trend.law.speed_Hz) ** trend.exponent.value
        rows.append({"kind": "law", "x": speeds, "value": law})
    return [{"label": "C_L", **row} for row in rows]


def caption(evidence: Evidence, table: Columns) -> str:
    """What each row of panels shows."""
    drawn = {*table["part"].tolist(), *table["kind"].tolist()}
    return " ".join(words for name, words in WORDS.items() if name in drawn)


def alt(evidence: Evidence, table: Columns) -> str:
    """The picture's numbers for those who do not see it."""
    parts = []
    for boundary in distinct(table["panel"]):
        for kind, what, unit in (
            ("throttle", "per throttle", " %"),
            ("plausible", "per exponent", ""),
            ("C_L", "per speed", " Hz"),
        ):
            rows = where(table, panel=boundary, kind=kind)
            if len(rows["x"]):
                each = ", ".join(
                    f"{plain(value, 3)} at {plain(x, 3)}{unit}"
                    for value, x in zip(rows["value"].tolist(), rows["x"].tolist(), strict=True)
                )
                parts.append(f"{boundary.capitalize()}: {rows['label'][0]} {what}: {each}.")
    return " ".join(parts)


def draw(table: Rows, look: Style) -> Figure:
    """The grid; with one boundary its questions stand side by side."""
    panels = distinct(table["panel"])
    parts = [p for p in DRAW if (table["part"] == p).any()]
    lone = len(panels) == 1
    rows, columns = (1, len(parts)) if lone else (len(parts), len(panels))
    width = look.single_in if lone and len(parts) == 1 else look.double_in
    height = 0.36 * look.double_in if rows == 1 else 0.27 * look.double_in * rows
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    letters = iter(string.ascii_lowercase)
    for ax, (part, boundary) in zip(axes.flat, itertools.product(parts, panels), strict=True):
        mine = where(table, panel=boundary, part=part)
        if not len(mine["kind"]):
            ax.set_axis_off()
            continue
        DRAW[part](ax, mine)
        ax.yaxis.set_major_locator(MaxNLocator(4))
        ax.set_ylabel(nomenclature.label(str(mine["label"][0])), labelpad=1)
        ax.set_title(f"{next(letters)}) {boundary}")
    return figure


def _bars(ax: Axes, rows: Rows, low: str, high: str, linewidth: float) -> None:
    ax.vlines(rows["x"], rows[low], rows[high], color=COLOUR, linewidth=linewidth, zorder=3)


def _symbols(ax: Axes, rows: Rows) -> None:
    circles(ax, rows["x"], rows["value"], COLOUR, zorder=4)


def _draw_throttles(ax: Axes, rows: Rows) -> None:
    common, each = where(rows, kind="common"), where(rows, kind="throttle")
    ax.axhspan(common["lo90"][0], common["hi90"][0], color=BAND, linewidth=0, zorder=0)
    ax.axhline(common["value"][0], color=FITTED, zorder=1)
    _bars(ax, each, "lo90", "hi90", 0.7)
    _bars(ax, each, "lo90_apart", "hi90_apart", 2.0)
    _symbols(ax, each)
    if len(each["x"]) <= 8:
        ax.set_xticks(each["x"], [f"{x:.3g}" for x in each["x"]])
    ax.margins(x=0.12)
    ax.set_xlabel("throttle (%)", labelpad=1)


def _draw_exponents(ax: Axes, rows: Rows) -> None:
    curve, marks, supported = (where(rows, kind=k) for k in ("curve", "plausible", "supported"))
    if len(supported["x"]) == 2:
        ax.axvspan(*supported["x"], color=SERIES[5][0], alpha=0.3, linewidth=0, zorder=0)
    ax.fill_between(curve["x"], curve["lo90"], curve["hi90"], color=BAND, linewidth=0, zorder=1)
    ax.plot(curve["x"], curve["value"], color=FITTED, zorder=2)
    _symbols(ax, marks)
    ax.set_xlim(float(np.min(curve["x"])), float(np.max(curve["x"])))
    ax.set_xlabel("exponent $n$ of the ratio", labelpad=1)


def _draw_rotor(ax: Axes, rows: Rows) -> None:
    points, law, paper = (where(rows, kind=kind) for kind in ("C_L", "law", "paper"))
    ax.plot(law["x"], law["value"], color=FITTED, zorder=2)
    ax.axhline(paper["value"][0], color=REFERENCES[0][0], linestyle=REFERENCES[0][1], zorder=1)
    _bars(ax, points, "lo90", "hi90", 1.2)
    _symbols(ax, points)
    ax.margins(x=0.12, y=0.12)
    ax.set_xlabel(f"rotor speed {nomenclature.label('speed_Hz')}", labelpad=1)


DRAW = {"throttle": _draw_throttles, "exponent": _draw_exponents, "rotor": _draw_rotor}


FIGURE = FigureSpec(
    name="assumptions",
    title="Throttle, held quantity, rotor",
    needs=(FIT,),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
