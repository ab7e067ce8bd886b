"""One effect: its signature before and after the model has absorbed what it can, its power, and the
effects that it is confused with.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift.report.documents.text import SHOWN
from nearlift.report.evidence import Part, frame, groups, pick, records
from nearlift.report.figures import style
from nearlift.report.figures.style import BAND, FITTED, SERIES, Style
from nearlift.results.explanation import EffectCurves

#: Rivals drawn, at most.
MAX_RIVALS = 8
COLUMNS = (
    *("boundary", "effect", "parameter", "unit", "size", "covariate"),
    *("panel", "series", "x", "y"),
)
CHANCES = {
    "seen": (FITTED, "-", "structure seen"),
    "within": (SERIES[0][0], "--", "named or a rival"),
    "alone": (SERIES[1][0], ":", "named alone"),
}


def table(curves: Sequence[EffectCurves]) -> pd.DataFrame:
    """The figure's rows for each size at each boundary.

    `panel` is signature, power or confused. A signature's `y` is per cent of lift against the
    effect's own covariate `x`, a power's a chance against size. A confusion's `y` is the share of
    energy that `series` absorbs, with the chance of being a rival as `x`. `noise` is the scatter of
    one trial about any curve, rms over trials.
    """
    return frame([part for of_size in curves for part in _parts(of_size)], COLUMNS)


def _parts(curves: EffectCurves) -> list[Part]:
    data, at_size, name = curves.data, curves.size, curves.effect.varies_with
    recorded = {"z_hat": data.z_hat, "throttle": 100 * data.throttle, "session": data.session + 1.0}
    x = np.asarray({**data.covariates, **recorded}[name], dtype=float)
    known = np.isfinite(x)
    unit, factor = SHOWN.get(at_size.unit, (at_size.unit, 1.0))
    signature: list[Part] = [
        {"series": "raw", "x": x[known], "y": 100 * curves.raw[known]},
        {"series": "left", "x": x[known], "y": 100 * curves.left[known]},
        {"series": "noise", "y": 100 * curves.noise},
    ]
    power: list[Part] = []
    confused: list[Part] = []
    if at_size.power is not None:
        size = factor * at_size.power.size
        power = [{"series": key, "x": size, "y": getattr(at_size.power, key)} for key in CHANCES]
        power.append({"series": "false alarm", "y": curves.false_alarm_rate})
        confused = [
            {"series": c.effect, "x": c.rival_chance, "y": c.energy_absorbed}
            for c in at_size.confused_with[:MAX_RIVALS]
            if c.rival_chance >= 0.02 or c.energy_absorbed >= 0.1
        ]
    if at_size.detection_limit is not None:
        power.append({"series": "limit", "x": factor * at_size.detection_limit, "y": 0.8})
    shared = {
        "boundary": data.boundary,
        "effect": curves.effect.title,
        "parameter": at_size.parameter,
        "unit": unit,
        "size": factor * at_size.shown_size,
        "covariate": name,
    }
    panels = {"signature": signature, "power": power, "confused": confused}
    return [{**shared, "panel": panel, **p} for panel, parts in panels.items() for p in parts]


def draw(table: pd.DataFrame, look: Style) -> Figure:
    """A line of three panels for each boundary and each of the effect's sizes."""
    keys = groups(table, "boundary", "parameter", "unit", "size", "covariate")
    figure, axes = style.canvas(
        look, len(keys), 3, 0.35 + 2.15 * len(keys), width_ratios=(1.25, 1.1, 1)
    )
    for line, (boundary, parameter, unit, size, covariate) in zip(axes, keys, strict=True):
        mine = pick(table, boundary=boundary, parameter=parameter)
        word = parameter.removesuffix("_m").removesuffix("_N").replace("_", " ")
        shown = "" if unit == "1" else f" {unit}"
        _signature(line[0], pick(mine, panel="signature"), covariate)
        line[0].set_title(f"{boundary}: {word} of {size:.3g}{shown}")
        power = pick(mine, panel="power")
        if len(power):
            _power(line[1], power)
            line[1].set_xlabel(word + (f" ({unit})" if shown else ""))
            _confused(line[2], pick(mine, panel="confused"))
        else:
            line[1].set_axis_off()
            style.words_alone(line[1], "silent: the model absorbs it\nat any size")
            line[2].set_axis_off()
    return figure


def _signature(ax: Axes, rows: pd.DataFrame, covariate: str) -> None:
    noise = float(pick(rows, series="noise")["y"].iloc[0])
    style.zero(ax)
    raw, left = pick(rows, series="raw"), pick(rows, series="left")
    ax.plot(
        raw.x, raw.y, "o", color="0.35", markerfacecolor="none", markeredgewidth=0.5, zorder=3,
        rasterized=True, label="as it acts",
    )  # fmt: skip
    ax.plot(
        left.x, left.y, "s", color=SERIES[1][0], markersize=1.8, markeredgewidth=0.5, zorder=3,
        rasterized=True, label="what the model leaves",
    )  # fmt: skip
    ax.axhspan(
        -noise, noise, color=BAND, alpha=0.5, linewidth=0, zorder=0, label="noise of one trial"
    )
    ax.margins(x=0.05)
    ax.xaxis.set_major_locator(MaxNLocator(5, integer=covariate == "session"))
    label = "throttle (%)" if covariate == "throttle" else style.quantity(covariate)
    if covariate == "z_hat":
        style.log_distance(ax, label)
    low, high = ax.get_ylim()
    ax.set(xlabel=label, ylabel="change of lift (%)", ylim=(low, high + 0.42 * (high - low)))
    ax.legend(loc="upper left", handlelength=1.2)


def _power(ax: Axes, rows: pd.DataFrame) -> None:
    false_alarm = float(pick(rows, series="false alarm")["y"].iloc[0])
    dashes = (0, (2, 2))
    ax.axhline(
        100 * false_alarm, color="0.6", linewidth=0.6, linestyle=dashes, label="false alarms"
    )
    for name, (colour, dash, text) in CHANCES.items():
        mine = pick(rows, series=name)
        ax.plot(mine.x, 100 * mine.y, color=colour, linestyle=dash, label=text)
    for row in records(pick(rows, series="limit")):
        ax.plot([row.x, row.x, 0], [0, 100 * row.y, 100 * row.y], color="0.6", linewidth=0.6)
        ax.plot([row.x], [100 * row.y], "o", color=FITTED, markersize=3)
    ax.set(xlim=(0, None), ylim=(0, 104), ylabel="power (%)")
    ax.legend(loc="center right")


def _confused(ax: Axes, rows: pd.DataFrame) -> None:
    n = len(rows)
    if not n:
        ax.set_axis_off()
        style.words_alone(ax, "confused with nothing\nin the library")
        return
    place, blue = np.arange(n)[::-1], SERIES[0][0]
    ax.barh(place + 0.2, 100 * rows.y, height=0.36, color="0.75", label="of its signal absorbed")
    ax.barh(place - 0.2, 100 * rows.x, height=0.36, color=blue, label="chance to be a rival")
    ax.set_yticks(place, [style.effects(str(name)) for name in rows["series"]])
    ax.tick_params(axis="y", length=0)
    # a lone bar is no wider than one of four
    ax.set(xlim=(0, 100), ylim=(min(-0.6, n - 4.6), n - 0.4 + 0.28 * max(n, 4)), xlabel="%")
    ax.legend(loc="upper right")
