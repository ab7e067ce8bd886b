"""Figure 6: sample flights above, crash rates and energy beneath.

Ground is on the left, ceiling on the right, as the paper has them and with a converged time step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift import catalogue, nomenclature
from nearlift.declare import Boundary
from nearlift.report.evidence import Evidence, Part, frame, pick
from nearlift.report.figures import style
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, plain_text
from nearlift.stages.simulate import CRASH_RATES, FLIGHTS, SAFETY

SIDES: tuple[Boundary, ...] = ("ground", "ceiling")
TITLES = {"histories": "sample flights", "paper": "as printed", "converged": "converged step"}
#: Of a sample flight so much is shown before and after the crash that it is about, s.
BEFORE_S, AFTER_S = 20.0, 10.0
COLUMNS = (
    *("row", "panel", "kind", "label", "exponent", "flights"),
    *("x", "y", "lo90", "hi90"),
)
COST = {"cost_paper": (0, (4, 1.5)), "cost": (0, (1, 1.2))}
COST_COLOUR = SERIES[1][0]
#: Without a model, with it, and with other powers of its ratio, weak to strong.
NONE, MODEL = "#000000", SERIES[0][0]
POWERS = (SERIES[2][0], SERIES[3][0], SERIES[4][0], "#7F3B08")


def table(evidence: Evidence) -> pd.DataFrame:
    """Everything that is drawn, a row each.

    `kind` is flight (x the time in s, y z_hat), crash (x the set-point, y a crash rate) or
    cost_paper, cost (a relative power). `exponent` is that of the model's ratio, 0 without a model.
    `flights` is their number at each set-point. A flight that crashed ends at z_hat = 0.
    """
    rates = evidence.frame(CRASH_RATES)
    parts: list[Part] = []
    for side in SIDES:
        parts += [{"row": "histories", "panel": side, **part} for part in _sample(evidence, side)]
        for preset in ("paper", "converged"):
            flown = pick(rates, preset=preset, boundary=side)
            for exponent in flown["exponent"].unique():
                curve = pick(flown, exponent=exponent)
                shared = {"row": preset, "panel": side, "exponent": exponent}
                shared |= {"label": curve["model"].iloc[0], "x": curve["target_z_hat"]}
                ends = {"y": curve["rate"], "lo90": curve["lo90"], "hi90": curve["hi90"]}
                parts.append({**shared, "kind": "crash", "flights": curve["flights"], **ends})
                if exponent == 1:
                    parts += [{**shared, "kind": kind, "y": curve[kind]} for kind in COST]
    return frame(parts, COLUMNS)


def _sample(evidence: Evidence, side: str) -> list[Part]:
    """The first flight near a boundary, by each model."""
    flights = evidence.frame(FLIGHTS, boundary=side)
    first = pick(flights, flight=flights["flight"].min())
    end = first.groupby("model")["t_s"].max().min() if len(first) else 0.0
    near = first[first["t_s"].between(end - BEFORE_S, end + AFTER_S)]
    parts = []
    for model in sorted(near["model"].unique(), key=lambda name: name != "none"):
        flown = pick(near, model=model)
        t_s, z_hat = touching(flown["t_s"].to_numpy(), flown["z_hat"].to_numpy())
        label = "none" if model == "none" else catalogue.model(model).title
        parts.append({"kind": "flight", "label": label, "x": t_s, "y": z_hat})
    return parts


def touching(t_s: Any, z_hat: Any) -> tuple[Any, Any]:
    """A flight up to where it touched.

    A last height below zero is a step after the touch. It becomes the touch, on the line through
    the last two heights.
    """
    if len(z_hat) < 2 or z_hat[-1] > 0:
        return t_s, z_hat
    share = z_hat[-2] / (z_hat[-2] - z_hat[-1])
    return np.append(t_s[:-1], t_s[-2] + share * (t_s[-1] - t_s[-2])), np.append(z_hat[:-1], 0.0)


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, with the limits of validity."""
    counts = " or ".join(f"{n:.0f}" for n in sorted(table["flights"].dropna().unique()))
    parts = [
        (
            "Flights of the paper's vehicle (27 g, spacing 90 mm) with its models and"
            " controller. First row: the seconds around a crash (cross) in the first flight"
            " that the model decides. Both curves have the same gusts. Below: share of flights"
            " that touch the boundary against set-point, without a model and with powers of the"
            f" model's ratio. {counts} flights a point; the paper flew 1000. Shade: 90 %"
            " binomial interval. Right axis: relative power to hover, (L/L∞)^(−3/2) as in the"
            " paper (dashed) and L∞/L as in its theories (dotted)."
        )
    ]
    for name, preset in evidence.safety.presets.items():
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


def draw(table: pd.DataFrame) -> Figure:
    """A row of panels for the flights and one for each preset that was flown."""
    rows = [r for r in TITLES if (table["row"] == r).any()]
    sides = list(table["panel"].unique())
    height = style.DOUBLE_IN * 0.33 * len(rows) + 0.25
    figure, axes = style.canvas(len(rows), len(sides), height, style.DOUBLE_IN)
    titles = []
    exponents = sorted(pick(table, kind="crash")["exponent"].unique())
    powers = [e for e in exponents if e not in (0, 1)]
    colours = {0.0: NONE, 1.0: MODEL} | dict(zip(powers, POWERS, strict=False))
    for row, line in zip(rows, axes, strict=True):
        for side, ax in zip(sides, line, strict=True):
            panel = pick(table, row=row, panel=side)
            titles.append(f"{side}, {TITLES[row]}")
            if row == "histories":
                _histories(ax, panel, side)
            else:
                _rates(ax, panel, colours, labelled=side == sides[-1])
                titles[-1] += f", {panel['flights'].max():.0f} flights a point"
    style.title(axes.flat, titles)
    special = {0.0: "no model ($L = L_\\infty$)", 1.0: "model, $L/L_\\infty$"}
    handles = [
        Line2D([], [], color=colours[e], label=special.get(e, f"$(L/L_\\infty)^{{{e:g}}}$"))
        for e in exponents
    ]
    for power, dashes in zip(("-3/2", "-1"), COST.values(), strict=True):
        label = f"power $(L/L_\\infty)^{{{power}}}$"
        handles.append(Line2D([], [], color=COST_COLOUR, linestyle=dashes, label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=-(-len(handles) // 2))
    return figure


def _histories(ax: Axes, rows: pd.DataFrame, side: str) -> None:
    for label in rows["label"].unique():
        mine = pick(rows, label=label)
        shade = NONE if label == "none" else MODEL
        name = "no model" if label == "none" else f"with {plain_text(label)}"
        ax.plot(mine.x, mine.y, color=shade, linewidth=0.8, label=name)
        touched = mine[mine["y"] <= 0]
        ax.plot(touched.x, touched.y, "x", color=shade, markersize=5, markeredgewidth=1.2, zorder=5)
    ax.axhline(0, color="0.45", linewidth=1.6, zorder=0)
    # room for the legend, and for the boundary with its crosses on this side of the frame
    top = 1.22 * float(rows["y"].max())
    ax.set(xlim=(rows["x"].min(), rows["x"].max()), ylim=(-0.09 * top, top))
    ax.set(xlabel="time (s)", ylabel=f"distance {nomenclature.label('z_hat')}")
    if side == "ceiling":
        # as one sees it: the ceiling above
        ax.invert_yaxis()
    ax.legend(loc="lower right" if side == "ceiling" else "upper right", ncols=2)


def _rates(ax: Axes, rows: pd.DataFrame, colours: dict[float, str], labelled: bool) -> None:
    for exponent, shade in colours.items():
        mine = pick(rows, kind="crash", exponent=exponent)
        style.band(ax, mine.x, 100 * mine.lo90, 100 * mine.hi90, shade, alpha=0.14)
        width = 1.3 if exponent in (0, 1) else 0.9
        ax.plot(mine.x, 100 * mine.y, color=shade, linewidth=width)
    right = rate_axes(ax)
    for kind, dashes in COST.items():
        mine = pick(rows, kind=kind)
        right.plot(mine.x, mine.y, color=COST_COLOUR, linestyle=dashes)
    right.set_ylim(0.5, 1.02)
    if labelled:
        right.set_ylabel("relative power to hover", color=COST_COLOUR)


def rate_axes(ax: Axes) -> Axes:
    """Label crash rate against set-point; the axes of power at its right."""
    ax.set(xlabel=f"set-point {nomenclature.label('target_z_hat')}", ylabel="crash rate (%)")
    ax.set_ylim(-2, 102)
    ax.tick_params(axis="y", right=False)
    right = ax.twinx()
    right.tick_params(axis="y", colors=COST_COLOUR)
    return right


FIGURE = FigureSpec(
    "fig6", "Crash rates and energy, as the paper has them", (CRASH_RATES, FLIGHTS, SAFETY),
    table, caption, draw, "y", ("row", "panel"),
)  # fmt: skip
