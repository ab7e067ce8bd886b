"""From how far a boundary shows in lift, against averaging time, and what a reading says of the
distance; a column per boundary.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.figure import Figure

from nearlift import nomenclature
from nearlift.declare import BOUNDARIES
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import BAND, FITTED, SERIES, Style, grid, plain_log, words_alone
from nearlift.rounding import plain
from nearlift.stages.detect import DETECTION, PROXIMITY

COLUMNS = (
    *("row", "panel", "case", "payload_percent", "voltage_percent"),
    *("x", "y", "lo90", "hi90"),
)


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `row` (range, located, reading), `panel` (boundary),
    `case` (what weight and supply are known to, in words), `payload_percent`, `voltage_percent`,
    `x`, `y`, `lo90`, `hi90`. In `range`, x is the averaging time in s and y the range in z_hat
    (nan: none); in `located`, x is the true z_hat and y the posterior's median; in `reading`, y is
    what one of the manifest's readings says.
    """
    content = evidence.document(PROXIMITY)
    parts = []
    for side in (b for b in BOUNDARIES if b in content["boundaries"]):
        table = where(evidence.table(DETECTION), boundary=side)
        least = (table["voltage"].min(), table["payload"].min())
        for voltage, payload in sorted(distinct(table["voltage"], table["payload"])):
            if voltage != least[0] and payload != least[1]:
                # each alone shows what it costs; both together are in the product
                continue
            curve = where(table, payload=payload, voltage=voltage)
            parts.append(
                {
                    "row": "range",
                    "panel": side,
                    "case": case(payload, voltage),
                    "payload_percent": 100 * payload,
                    "voltage_percent": 100 * voltage,
                    "x": curve["averaging_s"],
                    "y": curve["range_z_hat"],
                    "lo90": curve["lo90"],
                    "hi90": curve["hi90"],
                }
            )
        parts += [
            {"row": "located", "panel": side, "x": located["z_hat"], **_median(located)}
            for located in content["boundaries"][side].get("located", [])
        ]
        parts += [
            {"row": "reading", "panel": side, **_median(read["z_hat"])}
            for read in content["readings"]
            if read["boundary"] == side and "refused" not in read
        ]
    return stack(parts, COLUMNS)


def _median(estimate: dict[str, float]) -> dict[str, float]:
    return {"y": estimate["median"], "lo90": estimate["lo90"], "hi90": estimate["hi90"]}


def case(payload: float, voltage: float) -> str:
    """Standard uncertainties of weight and supply voltage (fractions), in words."""
    known = [
        f"{name} ±{plain(100 * u, 2)} %"
        for name, u in (("weight", payload), ("supply voltage", voltage))
        if u > 0
    ]
    return ", ".join(known) if known else "weight and supply known exactly"


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, with rates and sensor."""
    content = evidence.document(PROXIMITY)
    across = "; shaded across: the manifest's readings" if "reading" in table["row"] else ""
    drawn = (
        "Above: the farthest distance at which a boundary is detected with"
        f" {100 * content['false_alarm_rate']:g} % false alarms and"
        f" {100 * content['miss_rate']:g} % misses, against averaging time. Lines: standard"
        " uncertainty of weight or supply voltage. Bands: 90 % over the model's uncertainty."
        " Alarms are one-sided: more lift near ground and ceiling, less near a wall. One decision"
        f" every {content['averaging_s']:g} s gives"
        f" {3600 * content['false_alarm_rate'] / content['averaging_s']:g} false alarms an hour."
        " No curve: not detected at any measured distance. Below: distance from a reading averaged"
        f" over {content['averaging_s']:g} s (median and 90 %, weight and supply known"
        f" best){across}."
    )
    parts = [drawn]
    for side, detected in content["boundaries"].items():
        largest, noise, floor = (
            100 * detected[k] for k in ("largest_change", "short_per_sqrt_Hz", "floor")
        )
        plus = "+" if largest > 0 else ""
        parts.append(
            f"{side.capitalize()}, {detected['title']}: largest change of lift measured"
            f" {plus}{plain(largest, 2)} %, noise {plain(noise, 2)} %/√Hz, floor"
            f" {plain(floor, 2)} %."
            f" Lift is assumed to scale as voltage^{detected['lift_per_voltage']:.2g}."
        )
        if "refused" in detected:
            parts.append(f"Not inverted: {detected['refused']}.")
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers."""
    rows = evidence.table(DETECTION)
    parts = []
    for side in distinct(rows["boundary"]):
        ranges = where(rows, boundary=side)["range_z_hat"]
        known = ranges[np.isfinite(ranges)]
        parts.append(
            f"{side}: noticed from z_hat {known.min():.2g} to {known.max():.2g} away"
            if len(known)
            else f"{side}: never noticed"
        )
    return "Detection range against averaging time. " + "; ".join(parts) + "."


def draw(table: Rows, look: Style) -> Figure:
    """Two panels for each boundary."""
    sides = distinct(table["panel"])
    width, columns = (look.double_in, 4) if len(sides) > 1 else (1.2 * look.single_in, 2)
    figure = Figure(figsize=(width, 0.68 * look.double_in), layout="constrained")
    axes = figure.subplots(2, len(sides), squeeze=False)
    for letter, ax, row, side in grid(axes, ("range", "located"), sides):
        rows = where(table, row=row, panel=side)
        ax.set_title(f"{letter}) {side}")
        if row == "range":
            _range(ax, rows)
        else:
            _located(ax, rows, where(table, row="reading", panel=side))
    axes[0, 0].set_ylabel("detection range " + nomenclature.label("z_hat"))
    axes[1, 0].set_ylabel("located " + nomenclature.label("z_hat"))
    handles, names = axes[0, 0].get_legend_handles_labels()
    columns = min(len(names), columns)
    figure.legend(handles, names, loc="outside upper center", ncols=columns)
    return figure


def _range(ax: Any, rows: Rows) -> None:
    ax.set_xscale("log")
    for (shade, marker), case in zip(SERIES, distinct(rows["case"]), strict=False):
        curve = where(rows, case=case)
        worse = curve["voltage_percent"][0] > rows["voltage_percent"].min()
        ax.plot(
            curve["x"],
            curve["y"],
            color=shade,
            marker=marker,
            markerfacecolor="white",
            linestyle=(0, (4, 1.5)) if worse else "-",
            label=case,
            zorder=3,
        )
        known = select(curve, np.isfinite(curve["y"]))
        ax.fill_between(
            known["x"], known["lo90"], known["hi90"], color=shade, alpha=0.2, linewidth=0
        )
    ax.set_ylim(bottom=0)
    somewhere = distinct(rows["case"][np.isfinite(rows["y"])])
    undetected = [c for c in distinct(rows["case"]) if c not in somewhere]
    if not somewhere:
        ax.set_ylim(0, 1)
        words_alone(ax, "not detected")
    elif undetected:
        ax.text(
            0.96,
            0.04,
            "\n".join(["not detected with", *undetected]),
            transform=ax.transAxes,
            ha="right",
            va="bottom",
            fontsize=rcParams["legend.fontsize"],
            color="0.35",
        )
    ax.set_xlim(rows["x"].min() / 1.5, rows["x"].max() * 1.5)
    ax.set_xlabel("averaging time (s)")
    plain_log(ax.xaxis)


def _located(ax: Any, rows: Rows, read: Rows) -> None:
    ax.set_xlabel("true " + nomenclature.label("z_hat"))
    if not len(rows["x"]):
        words_alone(ax, "not inverted: the model folds")
        return
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.fill_between(rows["x"], rows["lo90"], rows["hi90"], color=BAND, linewidth=0)
    ax.plot(rows["x"], rows["y"], color=FITTED)
    ax.plot(rows["x"], rows["x"], color="0.45", linestyle=(0, (1, 1.2)))
    ends = (read[end] for end in ("y", "lo90", "hi90"))
    for (shade, _), y, low, high in zip(SERIES, *ends, strict=False):
        ax.axhspan(low, high, color=shade, alpha=0.25, linewidth=0)
        ax.axhline(y, color=shade, linewidth=0.8)
    for axis in (ax.xaxis, ax.yaxis):
        plain_log(axis)


FIGURE = FigureSpec(
    name="detection",
    title="How far away a boundary shows",
    needs=(DETECTION, PROXIMITY),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
