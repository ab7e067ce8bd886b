"""One effect: its signature before and after the model has absorbed what it can, its power, and the
effects that it is confused with.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from nearlift.report.evidence import Part, frame, groups, pick, records
from nearlift.report.figures import style
from nearlift.report.figures.style import (
    BAND,
    DEFAULT,
    FITTED,
    SERIES,
    Look,
    Style,
    quantity,
    words_alone,
)
from nearlift.report.forecasts import SHOWN
from nearlift.results.explanation import EffectCurves

#: Rivals drawn.
MOST = 8
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
    parts: list[Part] = [
        {"panel": "signature", "series": series, "x": x[known], "y": 100 * y[known]}
        for series, y in (("raw", curves.raw), ("left", curves.left))
    ]
    parts.append({"panel": "signature", "series": "noise", "y": 100 * curves.noise})
    power, limit = at_size.power, at_size.detection_limit
    unit, factor = SHOWN.get(at_size.unit, (at_size.unit, 1.0))
    if power is not None:
        size = factor * power.size
        chances = [(key, getattr(power, key)) for key in CHANCES]
        parts += [{"panel": "power", "series": key, "x": size, "y": y} for key, y in chances]
        parts.append({"panel": "power", "series": "false alarm", "y": curves.false_alarm_rate})
    if limit is not None:
        parts.append({"panel": "power", "series": "limit", "x": factor * limit, "y": 0.8})
    for c in at_size.confused_with[:MOST]:
        if power is not None and (c.rival_chance >= 0.02 or c.energy_absorbed >= 0.1):
            chances_of = {"x": c.rival_chance, "y": c.energy_absorbed}
            parts.append({"panel": "confused", "series": c.effect, **chances_of})
    shared = {
        "boundary": data.boundary,
        "effect": curves.effect.title,
        "parameter": at_size.parameter,
        "unit": unit,
        "size": factor * at_size.shown_size,
        "covariate": name,
    }
    return [{**shared, **part} for part in parts]


def draw(table: pd.DataFrame, look: Style = DEFAULT) -> Figure:
    """A line of three panels for each boundary and each of the effect's sizes."""
    keys = groups(table, "boundary", "parameter", "unit", "size", "covariate")
    widths: Look = {"width_ratios": (1.25, 1.1, 1)}
    figure, axes = style.canvas(look, len(keys), 3, 0.35 + 2.15 * len(keys), **widths)
    for line, (boundary, parameter, unit, size, covariate) in zip(axes, keys, strict=True):
        mine = pick(table, boundary=boundary, parameter=parameter)
        word = parameter.removesuffix("_m").removesuffix("_N").replace("_", " ")
        shown = "" if unit == "1" else f" {unit}"
        _signature(line[0], pick(mine, panel="signature"), covariate)
        line[0].set_title(f"{boundary}: {word} of {size:.3g}{shown}")
        power = pick(mine, panel="power")
        if not len(power):
            line[1].set_axis_off()
            words_alone(line[1], "silent: the model absorbs it\nat any size")
            line[2].set_axis_off()
            continue
        _power(line[1], power)
        line[1].set_xlabel(word + (f" ({unit})" if shown else ""), labelpad=1)
        _confused(line[2], pick(mine, panel="confused"))
    return figure


def _signature(ax: Axes, rows: pd.DataFrame, covariate: str) -> None:
    noise = float(pick(rows, series="noise")["y"].iloc[0])
    ax.axhspan(-noise, noise, color=BAND, alpha=0.5, linewidth=0, zorder=0)
    style.zero(ax)
    orange = SERIES[1][0]
    for series, label, mark in (
        ("raw", "as it acts", {"marker": "o", "markerfacecolor": "none", "color": "0.35"}),
        ("left", "what the model leaves", {"marker": "s", "color": orange, "markersize": 1.8}),
    ):
        mine, of = pick(rows, series=series), {"markeredgewidth": 0.5, "rasterized": True}
        drawn: Look = {"linestyle": "none", "zorder": 3, "label": label} | of | mark
        ax.plot(mine.x, mine.y, **drawn)
    handles, _ = ax.get_legend_handles_labels()
    handles.append(Patch(color=BAND, alpha=0.6, label="noise of one trial"))
    ax.margins(x=0.05)
    ax.xaxis.set_major_locator(MaxNLocator(5, integer=covariate == "session"))
    label = "throttle (%)" if covariate == "throttle" else quantity(covariate)
    if covariate == "z_hat":
        style.log_distance(ax, label)
    ax.set_xlabel(label, labelpad=1)
    ax.set_ylabel("change of lift (%)")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.42 * (high - low))
    ax.legend(handles=handles, loc="upper left", handlelength=1.2)


def _power(ax: Axes, rows: pd.DataFrame) -> None:
    false_alarm = float(pick(rows, series="false alarm")["y"].iloc[0])
    dotted: Look = {"linestyle": (0, (2, 2)), "label": "false alarms"}
    ax.axhline(100 * false_alarm, color="0.6", linewidth=0.6, **dotted)
    for name, (colour, dash, text) in CHANCES.items():
        mine = pick(rows, series=name)
        ax.plot(mine.x, 100 * mine.y, color=colour, linestyle=dash, label=text)
    for row in records(pick(rows, series="limit")):
        ax.plot([row.x, row.x, 0], [0, 100 * row.y, 100 * row.y], color="0.6", linewidth=0.6)
        ax.plot([row.x], [100 * row.y], "o", color=FITTED, markersize=3)
    ax.set_ylim(0, 104)
    ax.set_xlim(left=0)
    ax.set_ylabel("power (%)")
    ax.legend(loc="center right")


def _confused(ax: Axes, rows: pd.DataFrame) -> None:
    n = len(rows)
    if not n:
        ax.set_axis_off()
        words_alone(ax, "confused with nothing\nin the library")
        return
    place = np.arange(n)[::-1]
    for up, column, colour, label in (
        (0.2, "y", "0.75", "of its signal absorbed"),
        (-0.2, "x", SERIES[0][0], "chance to be a rival"),
    ):
        ax.barh(place + up, 100 * rows[column], height=0.36, color=colour, label=label)
    ax.set_yticks(place, [style.effects(str(name)) for name in rows["series"]])
    ax.tick_params(axis="y", length=0)
    ax.set_xlim(0, 100)
    # a lone bar is no wider than one of four
    ax.set_ylim(min(-0.6, n - 4.6), n - 0.4 + 0.28 * max(n, 4))
    ax.set_xlabel("%", labelpad=1)
    ax.legend(loc="upper right")
