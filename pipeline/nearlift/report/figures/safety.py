"""The fitted models in flight: crash rate and power against set-point with the model's uncertainty,
and power against risk.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from nearlift import nomenclature
from nearlift.flight.fitted import FittedFlights
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select, stack, where
from nearlift.report.figures.fig6 import COLUMNS, SIDES
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import (
    BAND,
    FITTED,
    REFERENCES,
    SERIES,
    Style,
    grid,
    plain_log,
    plain_text,
)
from nearlift.stages.simulate import CRASH_RATES, SAFETY

#: A rate of zero is drawn at half a crash, since the axis is logarithmic.
FLOOR = 0.5
COST = SERIES[1][0]
#: Where the vehicle touches, and nearer.
NEARER, TOUCHED = "#000000", "#D9D9D9"
PAPER = (0, (4, 1.5))
PAPER_COLOUR = "#5C2400"


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `row` (crash, front), `panel` (boundary), `kind` (none,
    model, held, contact, cost, advised), `label`, `x`, `y`, `lo90`, `hi90`. In `crash`, x is the
    set-point and y a crash rate (90 % over model and flights; `held`: with lift held below the
    nearest station) or a relative power (over the uncertainty of the held quantity), and `contact`
    is the height of contact; in `front`, x is the relative power, y the crash rate, and `advised`
    the lowest set-points for the stated risks, at the rate of other flights.
    """
    rates, fitted = evidence.table(CRASH_RATES), evidence.safety.fitted
    parts = []
    for side in SIDES:
        flown = where(rates, preset="fitted", boundary=side)
        if side in fitted and len(flown["rate"]):
            for row, curves in (("crash", _crashes), ("front", _risks)):
                rows = curves(flown, fitted[side])
                parts += [{"row": row, "panel": side, **part} for part in rows]
    return stack(parts, COLUMNS)


def _best(rates: Columns, reading: str = "form") -> Columns:
    """Rows of the fitted coefficients with one `reading` of lift nearer than measured."""
    return where(rates, member=-1, below_nearest=reading)


def _crashes(rates: Columns, fitted: FittedFlights) -> list[dict[str, object]]:
    """Crash rates and relative costs against set-point."""
    none, best = where(rates, exponent=0), _best(rates)
    x, label = best["target_z_hat"], fitted.title
    low, high = _band(rates)
    ends = {"x": none["target_z_hat"], "lo90": none["lo90"], "hi90": none["hi90"]}
    costs = {"lo90": best["cost_lo"], "hi90": best["cost_hi"]}
    return [
        {"kind": "none", "label": "no boundary effect", "y": none["rate"], **ends},
        {"kind": "model", "label": label, "x": x, "y": best["rate"], "lo90": low, "hi90": high},
        {"kind": "held", "label": label, "x": x, "y": _best(rates, "held")["rate"]},
        {"kind": "contact", "label": "touches", "x": fitted.contact_z_hat, "y": 0.0},
        {"kind": "cost", "label": fitted.held, "x": x, "y": best["cost"], **costs},
        {"kind": "cost_paper", "label": "paper", "x": x, "y": best["cost_paper"]},
    ]


def _risks(rates: Columns, fitted: FittedFlights) -> list[dict[str, object]]:
    """Crash rate against relative power, and the lowest set-point for each stated risk."""
    best, floor = _best(rates), FLOOR / fitted.flights
    low, high = _band(rates)
    front = {"y": best["rate"], "lo90": low, "hi90": high}
    shown = {name: np.maximum(rate, floor) for name, rate in front.items()}
    return [
        {"kind": "model", "label": fitted.title, "x": best["cost"], **shown},
        *(
            {
                "kind": "advised",
                "label": f"{100 * level.risk:g}: z_hat {level.value:.2f}",
                "x": level.relative_power,
                "y": max(level.crashes / fitted.flights, floor),
                "lo90": max(level.rate_lo90, floor),
                "hi90": level.rate_hi90,
            }
            for level in fitted.levels
            if level.advised
        ),
    ]


def _band(rates: Columns) -> tuple[Any, Any]:
    """Ends of a 90 % band over model and flights: 5 and 95 % of the draws' rates, each widened by
    its own binomial interval, but never within that of the fitted model's own.
    """
    best, draws = _best(rates), select(rates, rates["member"] >= 0)
    n = len(best["rate"])
    low = np.percentile(draws["lo90"].reshape(-1, n), 5, axis=0)
    high = np.percentile(draws["hi90"].reshape(-1, n), 95, axis=0)
    return np.minimum(low, best["lo90"]), np.maximum(high, best["hi90"])


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, by boundary."""
    text = (
        "Simulated flights with the fitted models. Controller and gusts are the paper's, scaled to"
        " this vehicle, unless the manifest gives its own. Above: crash rate against set-point"
        " with the 90 % band of model and flights. Dotted: L/L∞ constant below the nearest station."
        " Line and shade: contact. Right axis: relative power to hover, for the held quantity (with"
        " its uncertainty) and as in the paper (dashed). Supply sag acts with and without a"
        " boundary. Below: power against risk; a rate of zero is drawn at half a crash. Symbols:"
        " lowest set-points for the stated risks, with 90 % intervals of the crash rate."
    )
    parts = [text]
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


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers."""
    parts = [
        f"{side}, touched at z_hat {fit.contact_z_hat:.2f}: a risk of {e.risk:g} at z_hat"
        f" {e.value:.2f}"
        for side, fit in evidence.safety.fitted.items()
        for e in fit.levels
        if np.isfinite(e.value)
    ]
    return "Crash rate and power against set-point. " + "; ".join(parts) + "."


def draw(table: Rows, look: Style) -> Figure:
    """Two panels for each boundary."""
    sides = distinct(table["panel"])
    width = look.double_in if len(sides) > 1 else look.single_in * 1.3
    figure = Figure(figsize=(width, 0.72 * look.double_in), layout="constrained")
    axes = figure.subplots(2, len(sides), squeeze=False)
    for letter, ax, row, side in grid(axes, ("crash", "front"), sides):
        rows = where(table, row=row, panel=side)
        (_crash if row == "crash" else _front)(ax, rows)
        label = plain_text(where(rows, kind="model")["label"][0])
        ax.set_title(f"{letter}) {side}, {label}")
    held = plain_text(where(table, kind="cost")["label"][0])
    grey, dashes = REFERENCES[0]
    legend: dict[str, Any] = {
        "no boundary effect": _line(grey, dashes),
        "fitted model": (Patch(color=BAND), _line(FITTED)),
        "held below the nearest station": _line(FITTED, ":"),
        "the vehicle touches": (Patch(color=TOUCHED, linewidth=0), _line(NEARER)),
        f"power, {held} held": (Patch(color=COST, alpha=0.2, linewidth=0), _line(COST)),
        "power, $(L/L_\\infty)^{-3/2}$": _line(PAPER_COLOUR, PAPER),
    }
    handles, columns = list(legend.values()), 3 if len(sides) > 1 else 2
    figure.legend(handles, list(legend), loc="outside lower center", ncols=columns)
    return figure


def _line(colour: str, dashes: Any = "-") -> Line2D:
    return Line2D([], [], color=colour, linestyle=dashes)


def _band_of(ax: Axes, rows: Rows) -> None:
    """The 90 % band of a crash rate, in percent."""
    low, high = 100 * rows["lo90"], 100 * rows["hi90"]
    ax.fill_between(rows["x"], low, high, color=BAND, linewidth=0, zorder=1)


def _crash(ax: Axes, rows: Rows) -> None:
    grey, dashes = REFERENCES[0]
    for kind, shade, style in (("none", grey, dashes), ("model", FITTED, "-")):
        mine = where(rows, kind=kind)
        _band_of(ax, mine)
        ax.plot(mine["x"], 100 * mine["y"], color=shade, linestyle=style, zorder=3)
    held, cost, paper = (where(rows, kind=kind) for kind in ("held", "cost", "cost_paper"))
    contact = where(rows, kind="contact")["x"][0]
    ax.plot(held["x"], 100 * held["y"], color=FITTED, linestyle=":", zorder=3)
    left = max(0.0, contact - 0.1)
    ax.axvspan(left, contact, color=TOUCHED, linewidth=0, zorder=0)
    ax.axvline(contact, color=NEARER, zorder=2)
    ax.set_xlim(left=left)
    ax.set_ylim(-2, 102)
    ax.set_xlabel(f"set-point {nomenclature.label('target_z_hat')}")
    ax.set_ylabel("crash rate (%)")
    right: Any = ax.twinx()
    right.fill_between(cost["x"], cost["lo90"], cost["hi90"], color=COST, alpha=0.2, linewidth=0)
    right.plot(cost["x"], cost["y"], color=COST)
    right.plot(paper["x"], paper["y"], color=PAPER_COLOUR, linestyle=PAPER)
    right.set_ylim(right.get_ylim()[0], 1.02)
    right.tick_params(axis="y", colors=COST)
    ax.tick_params(axis="y", right=False)
    right.set_ylabel("relative power", color=COST)


def _front(ax: Axes, rows: Rows) -> None:
    model, advised = (where(rows, kind=kind) for kind in ("model", "advised"))
    ax.set_yscale("log")
    ax.set_ylim(0.7 * 100 * model["lo90"].min(), 140)
    plain_log(ax.yaxis)
    _band_of(ax, model)
    ax.plot(model["x"], 100 * model["y"], color=FITTED, zorder=2, marker=".", markersize=2.5)
    ends = (advised[name] for name in ("x", "y", "lo90", "hi90", "label"))
    for (shade, marker), x, y, low, high, label in zip(SERIES, *ends, strict=False):
        risk, _, station = label.partition(": z_hat ")
        ax.errorbar(
            [x],
            [100 * y],
            yerr=[[100 * (y - min(low, y))], [100 * (max(high, y) - y)]],
            color=shade,
            marker=marker,
            markersize=5,
            markerfacecolor="white",
            linestyle="none",
            zorder=4,
            label=f"risk of {risk} %: $\\hat{{z}}_0$ = {station}",
        )
    ax.set_xlabel("relative power to hover")
    ax.set_ylabel("crash rate (%)")
    if len(advised["x"]):
        middle = (model["x"].min() + model["x"].max()) / 2
        ax.legend(loc="upper right" if advised["x"].mean() < middle else "lower left")
    else:
        ax.text(0.5, 0.5, "no set-point is advised", transform=ax.transAxes, ha="center")


FIGURE = FigureSpec(
    name="safety",
    title="Crash rates and energy of the fitted models",
    needs=(CRASH_RATES, SAFETY),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
