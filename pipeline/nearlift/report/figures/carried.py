"""Other measured quantities against distance: moments, and the force of a wall."""

from __future__ import annotations

import itertools

import numpy as np
from matplotlib.figure import Figure

from nearlift.campaign.manifest import Campaign
from nearlift.nomenclature import CARRIED, symbol
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, Style, quantity
from nearlift.rounding import plain
from nearlift.stages.reduce import LIFT

NO_MODEL = "no model is fitted to them"


def summarise(evidence: Evidence) -> Columns:
    """A row for each cell: `panel` (boundary), `quantity`, `throttle`, `z_hat`, `value` and
    `u_value` in SI; nothing where only lift was measured.
    """
    cells = evidence.table(LIFT)
    parts = []
    for name, u in CARRIED.items():
        for side in evidence.boundaries if name in cells else ():
            rows = select(cells, (cells["boundary"] == side) & np.isfinite(cells[name]))
            shown = {"throttle": "throttle", "z_hat": "z_hat", "value": name, "u_value": u}
            values = {to: rows[column] for to, column in shown.items()}
            parts.append({"panel": side, "quantity": name, **values})
    return stack(parts)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption."""
    words = [symbol(name).meaning for name in distinct(table["quantity"])]
    known = int(np.isfinite(table["u_value"]).sum())
    bars = (
        f"Bars are standard uncertainties; {len(table['u_value']) - known} cells have none."
        if known < len(table["u_value"])
        else "Bars are standard uncertainties."
    )
    return (
        f"{'; '.join(words).capitalize()}. Means of cells against distance, a series for each"
        f" throttle. {bars} {NO_MODEL[0].upper()}{NO_MODEL[1:]}."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """The largest of each, and where."""
    parts = []
    for name in distinct(table["quantity"]):
        rows, known = where(table, quantity=name), symbol(name)
        i = int(np.argmax(np.abs(rows["value"])))
        value, z_hat = (plain(float(rows[column][i]), 3) for column in ("value", "z_hat"))
        parts.append(
            f"{known.meaning}: largest {value} {known.unit} at {z_hat} radii from the"
            f" {rows['panel'][i]}"
        )
    return f"{'; '.join(parts).capitalize()}; {NO_MODEL}."


def draw(table: Rows, look: Style) -> Figure:
    """A panel for each quantity and boundary."""
    keys = distinct(table["quantity"], table["panel"])
    width = look.single_in if len(keys) == 1 else look.double_in
    figure = Figure(figsize=(width, 0.62 * look.single_in + 0.3), layout="constrained")
    axes = figure.subplots(1, len(keys), squeeze=False)[0]
    throttles = np.unique(table["throttle"])
    for ax, (name, side) in zip(axes, keys, strict=True):
        rows = where(table, quantity=name, panel=side)
        ax.axhline(0, color="0.6", linewidth=0.5, zorder=1)
        for (colour, marker), throttle in zip(itertools.cycle(SERIES), throttles, strict=False):
            series = where(rows, throttle=throttle)
            series = select(series, np.argsort(series["z_hat"]))
            ax.errorbar(
                series["z_hat"],
                series["value"],
                yerr=np.nan_to_num(series["u_value"]),
                color=colour,
                marker=marker,
                markersize=3,
                linewidth=0.6,
                label=f"{100 * throttle:.3g} %",
            )
        ax.set_title(side)
        ax.set_xlabel(quantity("z_hat"))
        words = name.rpartition("_")[0].replace("_", " ")
        ax.set_ylabel(f"{words} ${symbol(name).latex}$ ({symbol(name).unit})")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
    return figure


def asked(campaign: Campaign) -> bool:
    """Whether the manifest names a column of the kind."""
    names = {name.rpartition("_")[0] for name in CARRIED}
    cut = {} if campaign.segments is None else campaign.segments.columns
    return bool(names & {*campaign.trials.units, *cut})


FIGURE = FigureSpec(
    name="carried",
    title="Measured with lift",
    needs=(LIFT,),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
    asked=asked,
)
