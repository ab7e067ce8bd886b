"""The fitted models in flight: crash rate and power against set-point with the model's uncertainty,
and power against risk.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from nearlift.report.evidence import Evidence, Part, frame, pick, records
from nearlift.report.figures import style
from nearlift.report.figures.fig6 import COST_COLOUR, SIDES, rate_axes
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import BAND, FITTED, REFERENCES, SERIES, plain_text
from nearlift.stages.simulate import CRASH_RATES, SAFETY

if TYPE_CHECKING:
    from nearlift.flight.fitted import FittedFlights

#: A rate of zero is drawn at half a crash, since the axis is logarithmic.
FLOOR = 0.5
COLUMNS = ("row", "panel", "kind", "label", "x", "y", "lo90", "hi90")
TOUCHED = "#D9D9D9"
PAPER: Part = {"color": "#5C2400", "linestyle": (0, (4, 1.5))}
NO_EFFECT: Part = {"color": REFERENCES[0][0], "linestyle": REFERENCES[0][1]}


def table(evidence: Evidence) -> pd.DataFrame:
    """Everything that is drawn, a row each.

    In `row` crash, x is the set-point. There y is a crash rate (`kind` none, model, held below the
    nearest station) or a relative power (cost, cost_paper). Contact is the height of contact. In
    front, x is the relative power and y the crash rate. Advised are the lowest set-points for the
    stated risks, at the rate of other flights. They are without x where none is advised.
    """
    rates, fitted = evidence.frame(CRASH_RATES, preset="fitted"), evidence.safety.fitted
    parts = []
    for side in SIDES:
        flown = pick(rates, boundary=side)
        if side in fitted and len(flown):
            parts += [{"panel": side, **part} for part in _curves(flown, fitted[side])]
    return frame(parts, COLUMNS)


def _curves(rates: pd.DataFrame, fitted: FittedFlights) -> list[Part]:
    none = pick(rates, exponent=0)
    best, held = (pick(rates, member=-1, below_nearest=reading) for reading in ("form", "held"))
    # 90 % over model and flights: each draw's rate widened by its own binomial interval, and never
    # within that of the fitted model
    draws = rates[rates["member"] >= 0].groupby("target_z_hat")
    x, label, floor = best["target_z_hat"], fitted.title, FLOOR / fitted.flights
    low, high = draws["lo90"].quantile(0.05), draws["hi90"].quantile(0.95)
    band = {
        "lo90": np.minimum(low.reindex(x).to_numpy(), best["lo90"]),
        "hi90": np.maximum(high.reindex(x).to_numpy(), best["hi90"]),
    }
    costs = {"lo90": best["cost_lo"], "hi90": best["cost_hi"]}
    alone = {"label": "no boundary effect", "x": none["target_z_hat"], "y": none["rate"]}
    crash: list[Part] = [
        {"kind": "none", **alone, "lo90": none["lo90"], "hi90": none["hi90"]},
        {"kind": "model", "label": label, "x": x, "y": best["rate"], **band},
        {"kind": "held", "label": label, "x": x, "y": held["rate"]},
        {"kind": "contact", "label": "touches", "x": fitted.contact_z_hat, "y": 0.0},
        {"kind": "cost", "label": fitted.held, "x": x, "y": best["cost"], **costs},
        {"kind": "cost_paper", "label": "paper", "x": x, "y": best["cost_paper"]},
    ]
    risk = {name: np.maximum(rate, floor) for name, rate in ({"y": best["rate"]} | band).items()}
    front: list[Part] = [{"kind": "model", "label": label, "x": best["cost"], **risk}]
    for level in fitted.levels:
        part: Part = {"kind": "advised", "label": f"{100 * level.risk:g}: none"}
        if level.advised:
            part["label"] = f"{100 * level.risk:g}: z_hat {level.value:.2f}"
            part |= {"x": level.relative_power, "y": max(level.crashes / fitted.flights, floor)}
            part |= {"lo90": max(level.rate_lo90, floor), "hi90": level.rate_hi90}
        front.append(part)
    return [
        {"row": row, **part}
        for row, parts in (("crash", crash), ("front", front))
        for part in parts
    ]


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, by boundary."""
    parts = [
        (
            "Simulated flights with the fitted models. Controller and gusts are the paper's,"
            " scaled to this vehicle, unless the manifest gives its own. Above: crash rate"
            " against set-point with the 90 % band of model and flights. Dotted: L/L∞ constant"
            " below the nearest station. Line and shade: contact. Right axis: relative power to"
            " hover, for the held quantity (with its uncertainty) and as in the paper (dashed)."
            " Supply sag acts with and without a boundary. Below: power against risk; a rate of"
            " zero is drawn at half a crash. Symbols: lowest set-points for the stated risks,"
            " with 90 % intervals of the crash rate."
        )
    ]
    for side, fit in evidence.safety.fitted.items():
        parts.append(
            f"{side.capitalize()}: {fit.title}, {fit.draws} draws from {fit.draws_from},"
            f" {fit.flights} flights a point ({fit.draw_flights} by each draw). Crash:"
            f" ẑ ≤ {fit.contact_z_hat:.3g}"
            f" ({1e3 * fit.contact_m:.3g} mm from the rotor plane). Nearest measurement:"
            f" ẑ = {fit.measured_z_hat[0]:.3g}. Halving the step changes a rate by up to"
            f" {fit.convergence.worst:.2g}."
        )
        parted = [f"{100 * e.risk:g} %" for e in fit.levels if not e.advised]
        if parted:
            parts.append(
                f"No set-point is advised for a risk of {', '.join(parted)}: none flown is safe"
                " enough, or it depends on lift nearer than measured."
            )
    return " ".join(parts)


def draw(table: pd.DataFrame) -> Figure:
    """Two panels for each boundary."""
    sides = list(table["panel"].unique())
    width = style.DOUBLE_IN if len(sides) > 1 else style.SINGLE_IN * 1.3
    figure, axes = style.canvas(2, len(sides), 0.72 * style.DOUBLE_IN, width)
    models = table[table["kind"] == "model"].drop_duplicates("panel")["label"]
    names = [f"{side}, {plain_text(m)}" for side, m in zip(sides, models, strict=True)]
    style.title(axes.flat, [*names, *names])
    for side, upper, lower in zip(sides, *axes, strict=True):
        _crash(upper, pick(table, row="crash", panel=side))
        _front(lower, pick(table, row="front", panel=side))
    held = plain_text(pick(table, kind="cost")["label"].iloc[0])
    black = Line2D([], [], color=FITTED)
    shade = Patch(color=COST_COLOUR, alpha=0.2, linewidth=0)
    legend: Part = {
        "no boundary effect": Line2D([], [], **NO_EFFECT),
        "fitted model": (Patch(color=BAND), black),
        "held below the nearest station": Line2D([], [], linestyle=":", color=FITTED),
        "the vehicle touches": (Patch(color=TOUCHED, linewidth=0), black),
        f"power, {held} held": (shade, Line2D([], [], color=COST_COLOUR)),
        "power, $(L/L_\\infty)^{-3/2}$": Line2D([], [], **PAPER),
    }
    columns = 3 if len(sides) > 1 else 2
    figure.legend(list(legend.values()), list(legend), loc="outside lower center", ncols=columns)
    return figure


def _crash(ax: Axes, rows: pd.DataFrame) -> None:
    of = {kind: pick(rows, kind=kind) for kind in rows["kind"].unique()}
    for kind, line in (("none", NO_EFFECT), ("model", {"color": FITTED})):
        mine = of[kind]
        style.band(ax, mine.x, 100 * mine.lo90, 100 * mine.hi90)
        ax.plot(mine.x, 100 * mine.y, zorder=3, **line)
    ax.plot(of["held"].x, 100 * of["held"].y, color=FITTED, linestyle=":", zorder=3)
    contact = float(of["contact"]["x"].iloc[0])
    left = max(0.0, contact - 0.1)
    ax.axvspan(left, contact, color=TOUCHED, linewidth=0, zorder=0)
    ax.axvline(contact, color=FITTED, zorder=2)
    ax.set_xlim(left=left)
    right = rate_axes(ax)
    cost, paper = of["cost"], of["cost_paper"]
    style.band(right, cost.x, cost.lo90, cost.hi90, COST_COLOUR, alpha=0.2)
    right.plot(cost.x, cost.y, color=COST_COLOUR)
    right.plot(paper.x, paper.y, **PAPER)
    right.set_ylim(right.get_ylim()[0], 1.02)
    right.set_ylabel("relative power", color=COST_COLOUR)


def _front(ax: Axes, rows: pd.DataFrame) -> None:
    model, advised = pick(rows, kind="model"), pick(rows, kind="advised")
    ax.set_yscale("log")
    ax.set_ylim(0.7 * 100 * model["lo90"].min(), 140)
    style.plain_log(ax.yaxis)
    style.band(ax, model.x, 100 * model.lo90, 100 * model.hi90)
    ax.plot(model.x, 100 * model.y, color=FITTED, zorder=2, marker=".", markersize=2.5)
    for series, row in zip(SERIES, records(advised), strict=False):
        risk, _, station = str(row.label).partition(": ")
        words = "no set-point advised"
        if np.isfinite(row.x):
            words = f"$\\hat{{z}}_0$ = {station.split()[-1]}"
        reach = [[100 * max(row.y - row.lo90, 0)], [100 * max(row.hi90 - row.y, 0)]]
        style.bars(
            ax, [row.x], [100 * row.y], reach, series, label=f"risk of {risk} %: {words}",
            markersize=5, markerfacecolor="white", zorder=4,
        )  # fmt: skip
    ax.set(xlabel="relative power to hover", ylabel="crash rate (%)")
    if advised["x"].notna().any():
        middle = (model["x"].min() + model["x"].max()) / 2
        ax.legend(loc="upper right" if advised["x"].mean() < middle else "lower left")
    else:
        style.words_alone(ax, "no set-point is advised")


FIGURE = FigureSpec(
    "safety", "Crash rates and energy of the fitted models", (CRASH_RATES, SAFETY), table, caption,
    draw, "y", ("row", "panel", "kind"),
)  # fmt: skip
