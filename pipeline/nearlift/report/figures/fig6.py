"""Figure 6: sample flights above, crash rates and energy beneath, ground on the left, ceiling on
the right, as the paper has them and with a converged time step.
"""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift import catalogue, nomenclature
from nearlift.declare import Boundary
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, Style, grid, plain_text
from nearlift.stages.simulate import CRASH_RATES, FLIGHTS, SAFETY

SIDES: tuple[Boundary, ...] = ("ground", "ceiling")
ROWS = ("histories", "paper", "converged")
#: Of a sample flight so much is shown before and after the crash that it is about, s.
BEFORE_S, AFTER_S = 20.0, 10.0
COLUMNS = ("row", "panel", "kind", "label", "exponent", "flight", "x", "y", "lo90", "hi90")
NONE = "#000000"
COST = {"cost_paper": (0, (4, 1.5)), "cost": (0, (1, 1.2))}
COST_COLOUR = SERIES[1][0]
TITLES = {"histories": "sample flights", "paper": "as printed", "converged": "converged step"}


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `row` (histories, paper, converged), `panel`
    (boundary), `kind` (flight, crash, cost_paper, cost), `label` (model), `exponent` of the ratio,
    `flight`, `x` (time in s or set-point), `y` (z_hat, crash rate or relative cost), `lo90` and
    `hi90` of a crash rate. A flight that crashed ends at z_hat = 0, on the line through its last
    two heights.
    """
    parts = []
    for side in SIDES:
        parts += [{"row": "histories", "panel": side, **part} for part in _sample(evidence, side)]
        for preset in ROWS[1:]:
            shared = {"row": preset, "panel": side}
            parts += [{**shared, **part} for part in _curves(evidence, side, preset)]
    return stack(parts, COLUMNS)


def _sample(evidence: Evidence, side: str) -> list[dict[str, object]]:
    """The first flight near a boundary, by each model."""
    flights = where(evidence.table(FLIGHTS), boundary=side)
    models = distinct(flights["model"])
    parts = []
    for flight in flights["flight"][:1].tolist():
        first = where(flights, flight=flight)
        end = min(where(first, model=model)["t_s"].max() for model in distinct(first["model"]))
        near = select(first, (first["t_s"] >= end - BEFORE_S) & (first["t_s"] <= end + AFTER_S))
        for model in ("none", *(m for m in models if m != "none")):
            flown = where(near, model=model)
            t_s, z_hat = touching(flown["t_s"], flown["z_hat"])
            label = "none" if model == "none" else catalogue.model(model).title
            parts.append({"kind": "flight", "label": label, "flight": flight, "x": t_s, "y": z_hat})
    return parts


def _curves(evidence: Evidence, side: str, preset: str) -> list[dict[str, object]]:
    """Crash rates of a preset at each power of the ratio, and costs of the model itself."""
    rates = where(evidence.table(CRASH_RATES), preset=preset, boundary=side)
    parts = []
    for exponent in distinct(rates["exponent"]):
        curve = where(rates, exponent=exponent)
        shared = {"label": str(curve["model"][0]), "exponent": exponent, "x": curve["target_z_hat"]}
        ends = {"lo90": curve["lo90"], "hi90": curve["hi90"]}
        parts.append({"kind": "crash", **shared, "y": curve["rate"], **ends})
        if exponent == 1.0:
            parts += [{"kind": kind, **shared, "y": curve[kind]} for kind in COST]
    return parts


def touching(t_s: Any, z_hat: Any) -> tuple[Any, Any]:
    """A flight up to where it touched: a last height below zero, a step after the touch, becomes
    the touch.
    """
    if len(z_hat) < 2 or z_hat[-1] > 0:
        return t_s, z_hat
    share = z_hat[-2] / (z_hat[-2] - z_hat[-1])
    return np.append(t_s[:-1], t_s[-2] + share * (t_s[-1] - t_s[-2])), np.append(z_hat[:-1], 0.0)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, with the limits of validity."""
    presets = evidence.safety.presets
    flights = {flown.flights for p in presets.values() for flown in p.boundaries.values()}
    counts = " or ".join(str(f) for f in sorted(flights))
    text = (
        "Flights of the paper's vehicle (27 g, spacing 90 mm) with its models and controller. First"
        " row: the seconds around a crash (cross) in the first flight that the model decides. Both"
        " curves have the same gusts. Below: share of flights that touch the boundary against"
        " set-point, without a model and with powers of the model's ratio;"
        f" {counts} flights a point. Shade: 90 % binomial interval. Right axis: relative power to"
        " hover, (L/L∞)^(−3/2) as in the paper (dashed) and L∞/L as in its theories (dotted)."
    )
    parts = [text]
    for name, preset in presets.items():
        tests = [flown.convergence for flown in preset.boundaries.values()]
        worst = max(test.worst for test in tests)
        verdict = "its rates depend on the time step"
        if all(test.converged for test in tests):
            verdict = "no rate leaves its interval"
        parts.append(
            f"{name.capitalize()}: {preset.meaning}. Halving the step changes a crash rate by up"
            f" to {worst:.2g}: {verdict}."
        )
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers."""
    parts = []
    for name, preset in evidence.safety.presets.items():
        for side, flown in preset.boundaries.items():
            half = {e.exponent: e.value for e in flown.levels if e.risk == 0.5}
            if half:
                parts.append(
                    f"{name}, {side}: half of the flights crash at z_hat {half[0.0]:.2f} without"
                    f" and {half[1.0]:.2f} with the model"
                )
    return "Crash rates against set-point. " + "; ".join(parts) + "."


def draw(table: Rows, look: Style) -> Figure:
    """A row of panels for the flights and one for each preset that was flown."""
    rows = [r for r in ROWS if (table["row"] == r).any()]
    sides = distinct(table["panel"])
    height = min(look.double_in * 0.33 * len(rows) + 0.25, look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    axes = figure.subplots(len(rows), len(sides), squeeze=False)
    for letter, ax, row, side in grid(axes, rows, sides):
        panel = where(table, row=row, panel=side)
        if row == "histories":
            _histories(ax, panel, side)
        else:
            _rates(ax, panel, last=side == sides[-1])
        ax.set_title(f"{letter}) {side}, {TITLES[row]}")
    exponents = sorted(distinct(where(table, kind="crash")["exponent"]))
    handles = [Line2D([], [], color=colour(e, exponents), linewidth=1.3) for e in exponents]
    special = {0.0: "no model ($L = L_\\infty$)", 1.0: "model, $L/L_\\infty$"}
    names = [special.get(e, f"$(L/L_\\infty)^{{{e:g}}}$") for e in exponents]
    handles += [Line2D([], [], color=COST_COLOUR, linestyle=s) for s in COST.values()]
    names += ["power $(L/L_\\infty)^{-3/2}$", "power $(L/L_\\infty)^{-1}$"]
    figure.legend(handles, names, loc="outside lower center", ncols=-(-len(names) // 2))
    return figure


def colour(exponent: float, exponents: list[float]) -> Any:
    """Black without a model, blue for the model, else from dark to light with the power."""
    if exponent == 0:
        return NONE
    if exponent == 1:
        return SERIES[0][0]
    powers = [e for e in exponents if e not in (0, 1)]
    share = powers.index(exponent) / max(len(powers) - 1, 1)
    return matplotlib.colormaps["plasma"](0.1 + 0.75 * share)


def _histories(ax: Axes, rows: Rows, side: str) -> None:
    for label in distinct(rows["label"]):
        mine = where(rows, label=label)
        x, y = mine["x"], mine["y"]
        shade = NONE if label == "none" else SERIES[0][0]
        ax.plot(x, y, color=shade, linewidth=0.8)
        if len(y) and y[-1] <= 0:
            ax.plot(
                x[-1:], y[-1:], marker="x", color=shade, markersize=5, markeredgewidth=1.2, zorder=5
            )
    ax.set_xlim(rows["x"].min(), rows["x"].max())
    ax.axhline(0, color="0.45", linewidth=1.6, zorder=0)
    # room for the legend beyond the flights, and for the boundary with its crosses on this side of
    # the frame
    top = 1.22 * float(rows["y"].max())
    ax.set_ylim(-0.09 * top, top)
    ax.set_xlabel("time (s)")
    ax.set_ylabel(f"distance {nomenclature.label('z_hat')}")
    if side == "ceiling":
        # as one sees it: the ceiling above
        ax.invert_yaxis()
    model = next((name for name in rows["label"] if name != "none"), "model")
    handles = [Line2D([], [], color=NONE), Line2D([], [], color=SERIES[0][0])]
    names = ["no model", f"with {plain_text(model)}"]
    ax.legend(handles, names, loc="lower right" if side == "ceiling" else "upper right", ncols=2)


def _rates(ax: Axes, rows: Rows, last: bool) -> None:
    crash = where(rows, kind="crash")
    exponents = sorted(distinct(crash["exponent"]))
    for e in exponents:
        mine = where(crash, exponent=e)
        shade, width = colour(e, exponents), 0.8
        if e in (0, 1):
            width, low, high = 1.3, 100 * mine["lo90"], 100 * mine["hi90"]
            ax.fill_between(mine["x"], low, high, color=shade, alpha=0.25, linewidth=0)
        ax.plot(mine["x"], 100 * mine["y"], color=shade, linewidth=width)
    ax.set_ylim(-2, 102)
    ax.set_xlabel(f"set-point {nomenclature.label('target_z_hat')}")
    ax.set_ylabel("crash rate (%)")
    right: Any = ax.twinx()
    for kind, dashes in COST.items():
        mine = where(rows, kind=kind)
        right.plot(mine["x"], mine["y"], color=COST_COLOUR, linestyle=dashes)
    right.set_ylim(0.5, 1.02)
    right.tick_params(axis="y", colors=COST_COLOUR)
    ax.tick_params(axis="y", right=False)
    if last:
        right.set_ylabel("relative power to hover", color=COST_COLOUR)


FIGURE = FigureSpec(
    name="fig6",
    title="Crash rates and energy, as the paper has them",
    needs=(CRASH_RATES, FLIGHTS, SAFETY),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
