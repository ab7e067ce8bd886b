"""From how far a boundary shows in lift, against averaging time, and the distance that a reading
implies; a column per boundary.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nearlift import nomenclature
from nearlift.declare import BOUNDARIES
from nearlift.report.evidence import Evidence, Part, frame, pick, records
from nearlift.report.figures import style
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import FITTED, SERIES, SMALL_PT, Style
from nearlift.rounding import plain
from nearlift.stages.detect import DETECTION, PROXIMITY

COLUMNS = (
    *("row", "panel", "case", "payload_percent", "voltage_percent"),
    *("x", "y", "lo90", "hi90"),
)


def table(evidence: Evidence) -> pd.DataFrame:
    """Everything that is drawn, a row each.

    In `row` range, x is the averaging time in s and y the range in z_hat (nan: none). `case` is the
    knowledge of weight and supply in words. Row floor is the words at the end of the best curve. In
    located, x is the true z_hat and y the posterior's median. In reading, y is the distance by one
    of the manifest's readings.
    """
    content = evidence.document(PROXIMITY)
    parts: list[Part] = []
    for side in (b for b in BOUNDARIES if b in content["boundaries"]):
        detected, every = content["boundaries"][side], evidence.frame(DETECTION, boundary=side)
        # each alone shows what it costs; both together are in the product
        alone = (every[["voltage", "payload"]] == every[["voltage", "payload"]].min()).any(axis=1)
        for i, (_, curve) in enumerate(every[alone].groupby(["voltage", "payload"])):
            voltage, payload = (100 * float(curve[u].iloc[0]) for u in ("voltage", "payload"))
            about = {"panel": side, "payload_percent": payload, "voltage_percent": voltage}
            values = {"y": curve["range_z_hat"], "lo90": curve["lo90"], "hi90": curve["hi90"]}
            named = {"case": _case(payload, voltage), "x": curve["averaging_s"]}
            parts.append({"row": "range", **about, **named, **values})
            last = curve.iloc[-1]
            if i == 0 and np.isfinite(last["range_z_hat"]):
                words = {"case": f"noise floor {plain(100 * detected['floor'], 2)} %"}
                end = {"x": last["averaging_s"], "y": last["range_z_hat"]}
                parts.append({"row": "floor", "panel": side, **words, **end})
        parts += [
            {"row": "located", "panel": side, "x": located["z_hat"], **_median(located)}
            for located in detected.get("located", [])
        ]
        parts += [
            {"row": "reading", "panel": side, **_median(read["z_hat"])}
            for read in content["readings"]
            if read["boundary"] == side and "refused" not in read
        ]
    return frame(parts, COLUMNS)


def _median(estimate: dict[str, float]) -> dict[str, float]:
    return {"y": estimate["median"], "lo90": estimate["lo90"], "hi90": estimate["hi90"]}


def _case(payload_percent: float, voltage_percent: float) -> str:
    """Standard uncertainties of weight and supply voltage in words."""
    stated = {"weight": payload_percent, "supply voltage": voltage_percent}
    known = [f"{name} ±{plain(u, 2)} %" for name, u in stated.items() if u > 0]
    return ", ".join(known) or "weight and supply known exactly"


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, with rates and sensor."""
    content = evidence.document(PROXIMITY)
    across = "; shaded across: the manifest's readings" if (table["row"] == "reading").any() else ""
    parts = [
        (
            "Above: the farthest distance at which a boundary is detected with"
            f" {100 * content['false_alarm_rate']:g} % false alarms and"
            f" {100 * content['miss_rate']:g} % misses, against averaging time. Lines: standard"
            " uncertainty of weight or supply voltage. Bands: 90 % over the model's"
            " uncertainty. Averaging does not lower the noise floor. Alarms are one-sided: more"
            " lift near ground and ceiling, less near a wall. One decision every"
            f" {content['averaging_s']:g} s gives"
            f" {3600 * content['false_alarm_rate'] / content['averaging_s']:g} false alarms an"
            " hour. No curve: not detected at any measured distance. Below: distance from a"
            f" reading averaged over {content['averaging_s']:g} s (median and 90 %, weight and"
            f" supply known best){across}."
        )
    ]
    for side, detected in content["boundaries"].items():
        largest, noise, floor = (
            plain(100 * detected[k], 2) for k in ("largest_change", "short_per_sqrt_Hz", "floor")
        )
        plus = "+" if detected["largest_change"] > 0 else ""
        known = "was found" if "supply_sag" in detected["effects"] else "is assumed"
        parts.append(
            f"{side.capitalize()}, {detected['title']}: largest change of lift measured"
            f" {plus}{largest} %, noise {noise} %/√Hz, floor {floor} %."
            f" Lift {known} to scale as voltage^{detected['lift_per_voltage']:.3g}."
        )
        if "refused" in detected:
            parts.append(f"Not inverted: {detected['refused']}.")
    return " ".join(parts)


def draw(table: pd.DataFrame, look: Style) -> Figure:
    """Two panels for each boundary."""
    sides = list(table["panel"].unique())
    several = len(sides) > 1
    width = look.double_in if several else 1.2 * look.single_in
    figure, axes = style.canvas(look, 2, len(sides), 0.68 * look.double_in, width)
    style.title(axes.flat, [*sides, *sides])
    for side, upper, lower in zip(sides, *axes, strict=True):
        mine = pick(table, panel=side)
        _range(upper, pick(mine, row="range"), pick(mine, row="floor"))
        _located(lower, pick(mine, row="located"), pick(mine, row="reading"))
    axes[0, 0].set_ylabel("detection range " + nomenclature.label("z_hat"))
    axes[1, 0].set_ylabel("located " + nomenclature.label("z_hat"))
    handles, names = axes[0, 0].get_legend_handles_labels()
    columns = min(len(names), 4 if several else 2)
    figure.legend(handles, names, loc="outside upper center", ncols=columns)
    return figure


def _range(ax: Axes, rows: pd.DataFrame, floor: pd.DataFrame) -> None:
    ax.set_xscale("log")
    missed = []
    for (shade, marker), name in zip(SERIES, rows["case"].unique(), strict=False):
        curve = pick(rows, case=name)
        worse = curve["voltage_percent"].iloc[0] > rows["voltage_percent"].min()
        dashes: Any = (0, (4, 1.5)) if worse else "-"
        ax.plot(
            curve.x, curve.y, color=shade, linestyle=dashes, label=name, marker=marker,
            markerfacecolor="white", zorder=3,
        )  # fmt: skip
        style.band(ax, curve.x, curve.lo90, curve.hi90, shade, alpha=0.2)
        missed += [] if curve["y"].notna().any() else [name]
    ax.set_ylim(bottom=0)
    if len(missed) == rows["case"].nunique():
        ax.set_ylim(0, 1)
        style.words_alone(ax, "not detected")
    elif missed:
        words = "\n".join(["not detected with", *missed])
        ax.text(
            0.96, 0.04, words, transform=ax.transAxes, ha="right", va="bottom", color="0.35",
            fontsize=SMALL_PT,
        )  # fmt: skip
    for row in records(floor):
        ax.set_ylim(top=1.12 * ax.get_ylim()[1])
        style.note(ax, row.case, (row.x, row.y), (0, 4), ha="right", color="0.35", zorder=4)
    ax.set_xlim(rows["x"].min() / 1.5, rows["x"].max() * 1.5)
    ax.set_xlabel("averaging time (s)")
    style.plain_log(ax.xaxis)


def _located(ax: Axes, rows: pd.DataFrame, read: pd.DataFrame) -> None:
    ax.set_xlabel("true " + nomenclature.label("z_hat"))
    if not len(rows):
        style.words_alone(ax, "not inverted: the model folds")
        return
    ax.set(xscale="log", yscale="log")
    style.band(ax, rows.x, rows.lo90, rows.hi90)
    ax.plot(rows.x, rows.y, color=FITTED)
    ax.plot(rows.x, rows.x, color="0.45", linestyle=(0, (1, 1.2)))
    for (shade, _), row in zip(SERIES, records(read), strict=False):
        ax.axhspan(row.lo90, row.hi90, color=shade, alpha=0.25, linewidth=0)
        ax.axhline(row.y, color=shade, linewidth=0.8)
    for axis in (ax.xaxis, ax.yaxis):
        style.plain_log(axis)


FIGURE = FigureSpec(
    "detection", "How far away a boundary shows", (DETECTION, PROXIMITY), table, caption, draw,
    "y", ("row", "panel"),
)  # fmt: skip
