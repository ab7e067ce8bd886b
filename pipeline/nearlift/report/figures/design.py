"""A design's outlook: the detection limit of each effect, and what it would be confused with."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nearlift.report.documents.text import size_text
from nearlift.report.evidence import Part, frame, pick, records
from nearlift.report.figures import style
from nearlift.report.figures.style import SERIES, SMALL_PT, Style
from nearlift.results.design import DesignOutlook

COLUMNS = ("boundary", "panel", "effect", "series", "x", "note")
LOOKS = {
    "named": SERIES[2],
    "seen, seldom named": SERIES[4],
    "detectable, confounded": SERIES[0],
    "too small to see": SERIES[1],
    "silent": ("0.5", "x"),
}
#: Chances below this are left blank.
MIN_CHANCE_SHOWN = 0.05


def table(outlook: DesignOutlook) -> pd.DataFrame:
    """The figure's rows. `panel` limits: `x` the detection limit over the plausible size (nan if
    never detected); confused: `x` the chance.
    """
    parts: list[Part] = []
    for boundary, at in outlook.boundaries.items():
        for row in at.effects:
            limit = row.detection_limit
            about = {"boundary": boundary, "effect": row.label}
            size: Part = {"x": np.nan, "note": "never"}
            if limit is not None:
                size = {"x": limit / row.plausible_size, "note": size_text(limit, row.unit)}
            parts.append({"panel": "limits", **about, "series": row.verdict, **size})
            # an effect that would not be detected has only its limit
            named = {} if row.hidden else {row.effect: row.within, **row.rivals}
            parts += [
                {"panel": "confused", **about, "series": name, "x": x}
                for name, x in named.items()
                if x >= MIN_CHANCE_SHOWN
            ]
    return frame(parts, COLUMNS)


def draw(table: pd.DataFrame, look: Style) -> Figure:
    """A line of two panels for each boundary."""
    sides = list(table["boundary"].unique())
    limits = [pick(table, boundary=side, panel="limits") for side in sides]
    heights = [1.55 + 0.155 * len(part) for part in limits]
    figure, axes = style.canvas(
        look, len(sides), 2, sum(heights), width_ratios=(1, 1.25), height_ratios=heights
    )
    for (left, right), side, part in zip(axes, sides, limits, strict=True):
        _limits(left, part)
        left.set_title(f"{side}: detection limits")
        _confused(right, pick(table, boundary=side, panel="confused"))
    return figure


def _limits(ax: Axes, rows: pd.DataFrame) -> None:
    place = np.arange(len(rows))[::-1]
    known = rows["x"].dropna()
    low, high = (known.min(), known.max()) if len(known) else (0.1, 10.0)
    # never detected: a cross at the edge
    edge = 3.0 * max(high, 1.0)
    ax.axvspan(1.0, 30 * edge, color="0.93", linewidth=0, zorder=0)
    for kind, (colour, marker) in LOOKS.items():
        mine = (rows["series"] == kind).to_numpy()
        for never, mark in ((False, marker), (True, "x")):
            use = mine & (rows["x"].isna().to_numpy() == never)
            label = kind if mine.any() and not never else ""
            x = rows["x"].fillna(edge)[use]
            ax.plot(x, place[use], mark, color=colour, markersize=4, zorder=3, label=label)
    for x, y, text in zip(rows["x"].fillna(edge), place, rows["note"], strict=True):
        style.note(ax, str(text).replace("^2", "²"), (x, y), (5, -2.4), color="0.25")
    ax.set_xscale("log")
    ax.set_xlim(0.5 * min(low, 0.5), 12 * edge)
    style.plain_log(ax.xaxis)
    ax.set_yticks(place, [_label(n) for n in rows["effect"]])
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(-0.8, len(rows) - 0.2)
    ax.set_xlabel("detection limit over plausible size")
    ax.legend(
        loc="upper center", bbox_to_anchor=(0.4, -1.6 / (3 + len(rows))), ncols=2,
        columnspacing=0.8, handlelength=1.0,
    )  # fmt: skip


def _label(effect: object) -> str:
    """Title of an effect; of its parts, such as tilt_first, the words."""
    return style.effects(str(effect)).replace("_", " ")


def _confused(ax: Axes, rows: pd.DataFrame) -> None:
    if not len(rows):
        ax.set_axis_off()
        return
    truth, said = (list(rows[name].unique()) for name in ("effect", "series"))
    said.sort(key=lambda name: truth.index(name) if name in truth else len(truth))
    chances = 100 * rows.pivot(index="effect", columns="series", values="x").loc[truth, said]
    ax.imshow(chances, cmap="Blues", vmin=0, vmax=130, aspect="auto")
    for row in records(rows):
        ax.text(
            said.index(row.series), truth.index(row.effect), f"{100 * row.x:.0f}",
            fontweight="bold" if row.effect == row.series else "normal",
            color="white" if row.x > 0.7 else "black", ha="center", va="center",
            # "100" stays within its cell
            fontsize=min(SMALL_PT, 105 / len(said)),
        )  # fmt: skip
    ax.set_xticks(np.arange(len(said)), [_label(t) for t in said], rotation=90)
    ax.set_yticks(np.arange(len(truth)), [_label(t) for t in truth])
    ax.tick_params(length=0)
    ax.set_title("if this acts, this is named or a rival (%)")
