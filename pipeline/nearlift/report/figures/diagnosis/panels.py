"""The loop's panels: above, a residual against the covariate that betrays it; beneath, candidates,
held-out errors, coefficients.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.textpath import TextPath
from matplotlib.ticker import FuncFormatter, MaxNLocator

from nearlift import nomenclature
from nearlift.report.evidence import Rows, distinct, select, where
from nearlift.report.figures.residuals import drawing as residuals
from nearlift.report.figures.style import (
    FITTED,
    SERIES,
    Style,
    dots,
    effects,
    note,
    plain_log,
    plain_text,
)
from nearlift.results.diagnosis import RIVAL_MAX_2LNB

CLOUD = SERIES[0][0]
#: Before and after, in colour and in symbol.
LOOKS = {"before": SERIES[1], "after": SERIES[2]}
FLOOR = "0.88"
DISCRETE = 6
LABELS = {
    "previous_throttle_percent": "previous throttle (%)",
    "order_in_visit": "order within a visit",
}
#: Where the axis of evidence turns logarithmic.
LINEAR = 10.0
#: No axis of evidence need go farther for its words' sake.
FARTHEST = 1e6
#: What a candidate is called that was not rejected.
MEANT = {"named": "named", "rival": "rival", "worse": "accepted"}
#: A word's distance from its symbol in points, and the panel's width as a part of the figure's.
BESIDE, PANEL = 4.5, 0.29
#: So many times the others' width, and an interval is cut off.
CLIPPED = 5.0
#: A floor lower than this part of its axis has its number above it.
BENEATH = 1 / 6
#: Behind numbers that stand on a line.
PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 0.2}


def residual(ax: Axes, rows: Rows, look: Style, first: bool) -> None:
    """Cloud, means over bins with their standard error, the noise floor as a shade; trials beyond
    the axis as ticks at its edge.
    """
    cloud, far, means, line = (
        where(rows, kind=kind) for kind in ("trial", "beyond", "bin", "curve")
    )
    floor, reach = (float(where(rows, kind=kind)["value"][0]) for kind in ("floor", "reach"))
    covariate, when = str(rows["covariate"][0]), str(rows["when"][0])
    if np.isfinite(floor):
        ax.axhspan(-floor, floor, color=FLOOR, linewidth=0, zorder=0)
    names = distinct(means["series"])
    lone = len(names) == 1
    colour = CLOUD if lone else "0.55"
    dots(ax, cloud["x"], cloud["value"], colour)
    edge = 0.965 * reach * np.sign(far["value"])
    ax.plot(far["x"], edge, "|", color=colour, markersize=3.5, markeredgewidth=0.5, zorder=1)
    ax.axhline(0, color="0.3", linewidth=0.6, zorder=2)
    for x in where(rows, kind="session")["x"]:
        ax.axvline(x, color="0.6", linewidth=0.5, linestyle=(0, (2, 2)), zorder=0.5)
    for i, name in enumerate(names):
        mine = where(means, series=name)
        colour, marker = LOOKS[when] if lone else SERIES[i % len(SERIES)]
        ax.errorbar(
            mine["x"],
            mine["value"],
            mine["u"],
            fmt=marker,
            color=colour,
            markersize=3.4 if lone else 2.8,
            elinewidth=0.8,
            markeredgecolor="white",
            markeredgewidth=0.3,
            linestyle="none" if lone else "-",
            linewidth=0.6,
            zorder=4,
            label=plain_text(name),
        )
    ax.plot(line["x"], line["value"], color=FITTED, linewidth=1.0, zorder=3)
    ax.set_ylim(-reach, reach)
    _abscissa(ax, covariate, np.unique(means["x"]), look)
    if len(names) > 1:
        _legend(ax, names, str(rows["note"][0]), look)
    if first:
        ax.set_ylabel("relative residual (%)")


def _legend(ax: Axes, names: list[str], levels_of: str, look: Style) -> None:
    """Series in one line, headed by what they are levels of."""
    handles = [
        Line2D([], [], color=c, marker=m, markersize=2.8)
        for (c, m), _ in zip(SERIES, names, strict=False)
    ]
    words = [plain_text(n) for n in names]
    if levels_of != "approach":
        head = residuals.label(levels_of, look).partition(" $")[0].partition(" (")[0]
        handles, words = [Line2D([], [], linestyle="none"), *handles], [f"{head}:", *words]
    ax.legend(
        handles,
        words,
        ncols=len(words),
        columnspacing=0.7,
        handlelength=1.1,
        handletextpad=0.3,
        borderaxespad=0.2,
        loc="best",
    )


def _abscissa(ax: Axes, covariate: str, means: Any, look: Style) -> None:
    if covariate in residuals.DISTANCES:
        ax.set_xscale("log")
        plain_log(ax.xaxis)
    elif len(means) <= DISCRETE:
        ax.set_xticks(means, [f"{x:.3g}".replace("-", "−") for x in means])
        ax.margins(x=0.12)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.margins(x=0.03)
    ax.set_xlabel(LABELS.get(covariate) or residuals.label(covariate, look), labelpad=1)


def candidates(ax: Axes, rows: Rows) -> None:
    """How far each trails the best, on an axis linear to ten and logarithmic beyond; rejected ones
    are hollow, with what they leave.
    """
    behind = rows["value"]
    y = np.arange(len(behind))[::-1]
    accepted = bool((rows["kind"] != "rejected").any())
    words = [
        MEANT.get(str(kind), plain_text(str(note)))
        for kind, note in zip(rows["kind"], rows["note"], strict=True)
    ]
    ax.set_xscale("symlog", linthresh=LINEAR, linscale=1.0)
    low, far = min(1.4 * float(behind.min()), -1.2), max(float(behind.max()) * 2.2, 40.0)
    ax.set_xlim(low, far)
    while (sides := _sides(ax, behind, words)) is None and far < FARTHEST:
        far *= 1.5
        ax.set_xlim(low, far)
    if accepted:
        ax.axvspan(0, RIVAL_MAX_2LNB, color=FLOOR, linewidth=0, zorder=0)
    ax.axvline(0, color="0.3", linewidth=0.6, zorder=1)
    sides = sides or [1] * len(y)
    for kind, word, at, x, side in zip(rows["kind"], words, y, behind, sides, strict=True):
        colour, marker = LOOKS["after"] if kind in ("named", "rival") else (CLOUD, "o")
        ax.plot([0, x], [at, at], color="0.55", linewidth=0.6, zorder=2)
        ax.plot(
            [x],
            [at],
            marker=marker,
            color=colour,
            markerfacecolor="white" if kind == "rejected" else colour,
            markersize=4,
            markeredgewidth=0.9,
            zorder=3,
        )
        start, slant = (max(x, 0.0), "left") if side > 0 else (x, "right")
        paper = {**PAPER, "pad": 0.6} if side < 0 else {"alpha": 0, "pad": 0}
        note(
            ax,
            word,
            (start, at),
            (BESIDE * side, 0),
            ha=slant,
            va="center",
            color="0.25",
            bbox=paper,
            zorder=4,
        )
    ax.set_yticks(y, [effects(str(name)) for name in rows["label"]], linespacing=0.9)
    ax.tick_params(axis="y", length=0)
    ax.tick_params(axis="x", which="minor", length=0)
    ax.set_ylim(-0.7, len(y) - 0.3)
    ticks = [
        t
        for t in (-100, -10, 0, 5, 10, 100, 1000, 10000, 100000)
        if float(behind.min()) <= t <= far and (t != 5 or far < 2000)
    ]
    ax.set_xticks(ticks, [f"{t:,}".replace(",", "\u2009").replace("-", "−") for t in ticks])
    ax.set_xlabel(r"$2 \,\ln B$, best over candidate", labelpad=1)


def _sides(ax: Axes, behind: Any, words: list[str]) -> list[int] | None:
    """On which side of its symbol each word has room, right (1) or left (-1) where it covers no
    more than the stem; None where one has none.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    width = 72 * PANEL * figure.get_figwidth()
    to_axes: Any = ax.transScale + ax.transLimits
    zero, *places = to_axes.transform([(x, 0.0) for x in (0.0, *behind)])[:, 0]
    sides = []
    for at, word in zip(places, words, strict=True):
        size = rcParams["legend.fontsize"]
        reach = (BESIDE + 2 + TextPath((0, 0), word, size=size).get_extents().width) / width
        if max(at, zero) + reach <= 1:
            sides.append(1)
        elif at - reach >= zero:
            sides.append(-1)
        else:
            return None
    return sides


def error(ax: Axes, rows: Rows) -> None:
    """Root mean square on held-out trials with its 90 % interval, and the noise floor."""
    floor = float(rows["value"][rows["kind"] == "floor"][0])
    shown = rows["kind"] == "rmse"
    whens, values, low, high = (rows[k][shown] for k in ("when", "value", "lo90", "hi90"))
    n = len(values)
    if np.isfinite(floor):
        ax.axhline(floor, color=FITTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
    for i, when in enumerate(whens):
        colour, marker = LOOKS[str(when)]
        reach = np.nan_to_num([[values[i] - low[i]], [high[i] - values[i]]])
        ax.errorbar(
            [i],
            [values[i]],
            reach,
            fmt=marker,
            color=colour,
            markersize=4,
            elinewidth=1.0,
            capsize=2,
            zorder=3,
        )
    top = 1.3 * float(np.nanmax([floor, *values, *high]))
    # numbers stand above what they belong to, the floor's beneath its line if that leaves it room
    numbers, places = [*values, floor], [*np.fmax(values, high), floor]
    for i, (value, at) in enumerate(zip(numbers, places, strict=True)):
        if np.isfinite(value):
            below = i == n and floor > BENEATH * top
            up, va = (-2.5, "top") if below else (2.5, "bottom")
            note(ax, f"{value:#.3g}", (i, at), (0, up), ha="center", va=va, bbox=PAPER, zorder=4)
    ax.set_ylim(0, top)
    ax.set_xlim(-0.6, n + 0.6)
    ax.set_xticks(range(n + 1), [*([str(w) for w in whens] if n > 1 else ["base"]), "floor"])
    ax.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel("RMSE (% of lift)")


def coefficients(ax: Axes, rows: Rows) -> Axes:
    """Each coefficient's intervals, one beside the other; the leftmost axes are handed back."""
    names = distinct(rows["label"])
    figure, place = ax.get_figure(), ax.get_subplotspec()
    axes = [ax]
    if len(names) > 1 and figure is not None and place is not None:
        ax.remove()
        inside = place.subgridspec(1, len(names), wspace=0.08)
        axes = [figure.add_subplot(inside[0, i]) for i in range(len(names))]
        for other in axes[1:]:
            other.tick_params(axis="y", labelleft=False)
    conditions = distinct(where(rows, kind="doubt")["note"])
    for panel, name in zip(axes, names, strict=False):
        _coefficient(panel, where(rows, label=name), name, conditions, lone=len(names) == 1)
    return axes[0]


def _coefficient(ax: Axes, rows: Rows, name: str, conditions: list[str], lone: bool) -> None:
    """One coefficient: as quoted, and beneath it on each of the conditions, which have the same
    places in neighbouring axes.
    """
    ticks, digits = (4, 3) if lone else (2, 2)
    reference, stated = where(rows, kind="reference"), select(rows, rows["kind"] != "reference")
    left, right = _limits(stated, reference["value"])
    ax.set_xlim(left, right)
    for value, source in zip(reference["value"], reference["note"], strict=True):
        ax.axvline(value, color="0.35", linewidth=0.8, linestyle=(0, (5, 2)), zorder=1)
        side = 1 if value < (left + right) / 2 else -1
        note(
            ax,
            plain_text(f"{source} {value:g}"),
            (value, 1),
            (2.5 * side, -4),
            xycoords=("data", "axes fraction"),
            ha="left" if side > 0 else "right",
            va="top",
            color="0.25",
            in_layout=False,
        )
    columns = (stated[name] for name in ("kind", "note", "when", "value", "lo90", "hi90"))
    for kind, condition, when, value, low, high in zip(*columns, strict=True):
        at = len(conditions) - (1 + conditions.index(condition) if kind == "doubt" else 0)
        colour, marker = LOOKS[str(when)]
        ax.plot(
            [low, high],
            [at, at],
            color=colour,
            linewidth=2.2 if kind == "quoted" else 0.9,
            solid_capstyle="butt",
            zorder=2,
        )
        # one that lies outside altogether has one arrow, towards where it is
        ends = [(low, "<"), (high, ">")]
        for end, arrow in ends[:1] if high < left else ends[1:] if low > right else ends:
            outside = end < left or end > right
            inside = (0.02 if lone else 0.05) * (right - left)
            edge = min(max(end, left + inside), right - inside)
            ax.plot(
                [edge if outside else end],
                [at],
                arrow if outside else "|",
                color=colour,
                markersize=4.5 if outside else 7,
                markeredgewidth=1.0,
                zorder=2,
            )
        if low < left or high > right:
            words = f"{low:#.{digits}g} to {high:#.{digits}g}".replace("-", "−")
            note(
                ax,
                words,
                (0.5, at),
                (0, 4),
                xycoords=("axes fraction", "data"),
                ha="center",
                bbox=PAPER,
                in_layout=False,
            )
        if left <= value <= right:
            ax.plot(
                [value], [at], marker, color=colour, markersize=3.6, markeredgewidth=0, zorder=3
            )
    names = ["quoted", *(f"if ({i + 1})" for i in range(len(conditions)))]
    ax.set_yticks(range(len(conditions), -1, -1), names)
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(-0.6, len(conditions) + 1 - (0.15 if len(reference["value"]) else 0.4))
    ax.xaxis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 2.5, 5, 10]))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", "−")))
    ax.set_xlabel(nomenclature.label(name), labelpad=1)


def _limits(rows: Rows, references: Any) -> tuple[float, float]:
    """Ends of the axis: conditions of many times the quoted interval's width run out of it, or
    nothing else could be seen.
    """
    narrow, wide = (
        (float(np.min([*r["lo90"], *references])), float(np.max([*r["hi90"], *references])))
        for r in (where(rows, kind="quoted"), rows)
    )
    low, high = narrow if wide[1] - wide[0] > CLIPPED * (narrow[1] - narrow[0]) else wide
    share = 0.35 if low > wide[0] or high < wide[1] else 0.08
    margin = share * (high - low) or 1e-3 * max(abs(high), 1e-3)
    return low - margin, high + margin
