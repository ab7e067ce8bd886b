"""One effect: its signature before and after the model has absorbed what it can, its power, and
what it is taken for; drawn, and as text for the console.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from nearlift.report.evidence import Columns, Rows, distinct, select, stack, where
from nearlift.report.figures.design import SHOWN, size_text, wrap
from nearlift.report.figures.style import (
    BAND,
    FITTED,
    SERIES,
    Style,
    effects,
    plain_log,
    quantity,
    words_alone,
)
from nearlift.results.explanation import (
    EffectAccount,
    EffectAtBoundary,
    EffectCurves,
    EffectSize,
    EffectVerdict,
    EffectWithinTrial,
    NoCandidate,
)

#: Rivals drawn.
MOST = 8
LOOKS = {
    "seen": (FITTED, "-", "structure seen"),
    "within": (SERIES[0][0], "--", "named or a rival"),
    "alone": (SERIES[1][0], ":", "named alone"),
}


def rows(curves: EffectCurves) -> Columns:
    """The figure's rows for one size at one boundary.

    `panel` is signature, power or confused; a signature's `y` is per cent of lift against the
    effect's own covariate `x`, a power's a chance against size, a confusion's the share of energy
    that `series` takes over, with the chance of being a rival as `x`. `noise` is the scatter of one
    trial about any curve, rms over trials.
    """
    data, effect, at_size = curves.data, curves.effect, curves.size
    boundary, raw, left = data.boundary, curves.raw, curves.left
    noise, false_alarm_rate = curves.noise, curves.false_alarm_rate
    name = effect.varies_with
    recorded = {"z_hat": data.z_hat, "throttle": 100 * data.throttle, "session": data.session + 1.0}
    x = np.asarray({**data.covariates, **recorded}[name], dtype=float)
    finite = np.isfinite(x)
    parts: list[dict[str, object]] = [
        {"panel": "signature", "series": "raw", "x": x[finite], "y": 100 * raw[finite]},
        {"panel": "signature", "series": "left", "x": x[finite], "y": 100 * left[finite]},
        {"panel": "signature", "series": "noise", "y": 100 * noise},
    ]
    power = at_size.power
    unit, factor = SHOWN.get(at_size.unit, (at_size.unit, 1.0))
    if power is not None:
        x = factor * power.size
        parts += [
            {"panel": "power", "series": key, "x": x, "y": getattr(power, key)} for key in LOOKS
        ]
        parts.append({"panel": "power", "series": "false alarm", "y": false_alarm_rate})
    if at_size.detection_limit is not None:
        limit = factor * at_size.detection_limit
        parts.append({"panel": "power", "series": "limit", "x": limit, "y": 0.8})
    for c in at_size.confused_with[:MOST]:
        chances = {"x": c.rival_chance, "y": c.energy_absorbed}
        parts.append({"panel": "confused", "series": c.effect, **chances})
    shared = {
        "boundary": boundary,
        "effect": effect.title,
        "parameter": at_size.parameter,
        "unit": unit,
        "size": factor * at_size.shown_size,
        "covariate": name,
    }
    return stack([{**shared, **part} for part in parts], (*shared, "panel", "series", "x", "y"))


def text(explanation: EffectAccount) -> str:
    """The explanation in words."""
    source = explanation.source
    equation = source.equation and f"equation {source.equation}"
    cited = "; ".join(filter(None, (source.citation, equation, source.doi)))
    lines = [
        f"{explanation.effect}: {explanation.title}",
        "",
        *wrap(f"Mechanism: {explanation.mechanism} (acts on {explanation.acts_on})."),
        "",
        *explanation.notes_of_declaration.strip().splitlines(),
        "",
        *wrap(f"Source: {cited}."),
    ]
    lines += [line for doubt in source.doubts for line in wrap(f"Doubt: {doubt}")]
    for boundary, at in explanation.boundaries.items():
        lines += ["", f"In {explanation.campaign}, {boundary}", ""]
        lines += _boundary(at)
    lines += [line for note in explanation.notes for line in ("", *wrap(f"Not looked at: {note}"))]
    if explanation.files:
        lines += ["", *explanation.files]
    return "\n".join(lines) + "\n"


def _boundary(at: EffectAtBoundary) -> list[str]:
    if isinstance(at, NoCandidate):
        if at.reason:
            return wrap(f"Not a candidate here: {at.reason}.")
        return wrap(
            f"Untestable: {', '.join(at.needs)} {'are' if len(at.needs) > 1 else 'is'}"
            " unknown, or did not vary. Log next time:"
            f" {', '.join(at.log_next_time) or 'more of the same'}, and let it vary."
        )
    noise = at.noise
    lines = wrap(
        f"{at.trials} trials about {at.base_model}; noise {100 * noise.relative:.2g} % of"
        f" lift, {1e3 * noise.force_N:.2g} mN, {1e3 * noise.height_m:.2g} mm per visit;"
        f" false-alarm rate {at.false_alarm_rate:g}, for all tests together."
    )
    lines += wrap(_here(at.in_this_campaign))
    if isinstance(at, EffectWithinTrial):
        seen = "Records are unknown here."
        if w := at.within_trial:
            seen = (
                f"A mean change of {100 * w.limit:.2g} % of lift over a record would be seen with"
                " 80 % chance."
            )
        return lines + wrap(f"It acts within a record and leaves no mark on trial means. {seen}")
    for size in at.sizes:
        lines += ["", *_size(size, at.few_visits)]
    return lines


def _here(verdict: EffectVerdict | None) -> str:
    """Result of the loop on the effect in this campaign."""
    if verdict is None:
        return (
            "The loop has not run on this campaign (`nearlift diagnose CAMPAIGN`); the noise is"
            " that of its own trials."
        )
    rivals, rival_of = ", ".join(verdict.rivals), ", ".join(verdict.rival_of)
    if verdict.named:
        beside = f"with the rivals {rivals}" if rivals else "without a rival"
        return f"The loop named it here, {beside}."
    if rival_of:
        return f"The loop lists it here as a rival of {rival_of}."
    said, tried = "had no need of it here", verdict.tried
    if tried and not tried.accepted:
        covariate = tried.left_in
        left = f"leaves structure in {covariate}" if covariate else "earns too little"
        said = f"tried it here and did not accept it: it {left}"
    return f"The loop {said}. Verdict: {verdict.verdict}."


def _size(s: EffectSize, few_visits: bool) -> list[str]:
    unit = s.unit
    shape = ", ".join(f"{k} = {v:g}" for k, v in s.shape.items())
    head = f"{s.parameter}{f' (with {shape})' if shape else ''}: {s.meaning}."
    lines = wrap(head)
    if s.power is None:
        lines += wrap(
            "Silent: the model's coefficients and L_inf absorb it wholly. No number of trials of"
            " this kind can show it."
        )
    elif s.detection_limit is None:
        lines += wrap(
            f"Even the largest possible size, {size_text(s.largest_size, unit)}, is not seen"
            f" with 80 % chance (seen with {100 * s.power.seen[-1]:.0f} %)."
        )
    else:
        ratio = s.detection_limit / s.plausible_size
        per = " rms over sessions" if s.per == "session" else ""
        lines += wrap(
            f"Detection limit (80 % power): {size_text(s.detection_limit, unit)}{per}, which is"
            f" {ratio:.2g} times its plausible size of {size_text(s.plausible_size, unit)}."
        )
        chances = "Before held-out visits have their say, which lowers the chances of weak effects."
        if few_visits:
            chances = (
                "With so few visits the loop decides by what it predicts of a visit left out, so"
                " take the chances to be named as upper ends."
            )
        within, alone = (
            "beyond any size looked at" if limit is None else size_text(limit, unit)
            for limit in (s.limit_within_set, s.limit_named_alone)
        )
        lines += wrap(
            f"Among the names or their rivals with 80 % chance from {within}; named alone from"
            f" {alone}. ({chances})"
        )
    sig = s.signature
    lines += wrap(
        f"At {size_text(s.shown_size, unit)} it changes lift by {100 * sig.rms:.2g} % (rms"
        f" over trials), of which {100 * sig.rms_left:.2g} % are left when the coefficients and"
        f" L_inf have absorbed what they can (at most {100 * sig.largest_left:.2g} % in one"
        " trial)."
    )
    for name, b in s.bias.items():
        lines += wrap(
            f"Unnoticed at that size it shifts {name} = {b.value:.3g} by {b.shift:+.2g},"
            f" {abs(b.in_u):.2g} of its standard uncertainty."
        )
    rivals = [c for c in s.confused_with if c.rival_chance >= 0.05 or c.energy_absorbed >= 0.5][:8]
    if rivals:
        lines.append(
            "Confused with (correlation after theta and L_inf; energy it takes over; chance to be"
            " named or a rival at that size):"
        )
        lines += [
            f"  {c.effect:<22} r = {c.correlation:.3f}   {100 * c.energy_absorbed:3.0f} % "
            f"  {100 * c.rival_chance:3.0f} %"
            for c in rivals
        ]
    elif s.power:
        lines += ["Confused with nothing in the library."]
    return lines


def draw(rows: Rows, look: Style) -> Figure:
    """A line of three panels for each boundary and each of the effect's sizes."""
    keys = distinct(rows["boundary"], rows["parameter"])
    figure = Figure(figsize=(look.double_in, 0.35 + 2.15 * len(keys)), layout="constrained")
    grid = figure.subplots(len(keys), 3, squeeze=False, width_ratios=(1.25, 1.1, 1))
    for line, (boundary, parameter) in zip(grid, keys, strict=True):
        mine = where(rows, boundary=boundary, parameter=parameter)
        size, unit = f"{float(mine['size'][0]):.3g}", str(mine["unit"][0])
        axis = word = parameter.removesuffix("_m").removesuffix("_N").replace("_", " ")
        if unit != "1":
            size, axis = f"{size} {unit}", f"{word} ({unit})"
        signature, power, confused = (
            where(mine, panel=panel) for panel in ("signature", "power", "confused")
        )
        _signature(line[0], signature, f"{boundary}: {word} of {size}")
        _power(line[1], power, axis)
        if len(power["x"]):
            _confused(line[2], confused)
        else:
            line[2].set_axis_off()
    return figure


def _signature(ax: Axes, rows: Rows, title: str) -> None:
    noise = float(where(rows, series="noise")["y"][0])
    ax.axhspan(-noise, noise, color=BAND, alpha=0.5, linewidth=0, zorder=0)
    ax.axhline(0, color="0.3", linewidth=0.6, zorder=1)
    handles = []
    for series, size, marker, face, edge, label in (
        ("raw", 4.0, "o", "none", "0.35", "as it acts"),
        ("left", 1.8, "s", SERIES[1][0], SERIES[1][0], "what the model leaves"),
    ):
        look: Any = {"marker": marker, "markerfacecolor": face, "markeredgecolor": edge}
        handles.append(Line2D([], [], linestyle="none", markersize=3, label=label, **look))
        mine = where(rows, series=series)
        ax.plot(
            mine["x"],
            mine["y"],
            linestyle="none",
            markersize=size,
            markeredgewidth=0.5,
            zorder=3,
            rasterized=True,
            **look,
        )
    handles.append(Line2D([], [], color=BAND, linewidth=5, alpha=0.6, label="noise of one trial"))
    covariate = str(rows["covariate"][0])
    if covariate == "z_hat":
        ax.set_xscale("log")
        plain_log(ax.xaxis)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5, integer=covariate == "session"))
    ax.margins(x=0.05)
    ax.set_xlabel(r"throttle (%)" if covariate == "throttle" else quantity(covariate), labelpad=1)
    ax.set_ylabel("change of lift (%)")
    ax.set_title(title)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.42 * (high - low))
    ax.legend(handles=handles, loc="upper left", handlelength=1.2)


def _power(ax: Axes, rows: Rows, label: str) -> None:
    if not len(rows["x"]):
        ax.set_axis_off()
        words_alone(ax, "silent: the model absorbs it\nat any size")
        return
    false_alarm = float(where(rows, series="false alarm")["y"][0])
    ax.axhline(100 * false_alarm, color="0.6", linewidth=0.6, linestyle=(0, (2, 2)))
    for name, (colour, dash, text) in LOOKS.items():
        mine = where(rows, series=name)
        ax.plot(mine["x"], 100 * mine["y"], color=colour, linestyle=dash, label=text)
    limit = where(rows, series="limit")
    for x, y in zip(limit["x"], limit["y"], strict=True):
        ax.plot([x, x, 0], [0, 100 * y, 100 * y], color="0.6", linewidth=0.6)
        ax.plot([x], [100 * y], "o", color=FITTED, markersize=3)
    ax.set_ylim(0, 104)
    ax.set_xlim(left=0)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.set_xlabel(label, labelpad=1)
    ax.set_ylabel("chance (%)")
    ax.legend(loc="best")


def _confused(ax: Axes, rows: Rows) -> None:
    rows = select(rows, (rows["x"] >= 0.02) | (rows["y"] >= 0.1))
    n = len(rows["x"])
    if not n:
        ax.set_axis_off()
        words_alone(ax, "confused with nothing\nin the library")
        return
    place = np.arange(n)[::-1]
    for up, column, colour, label in (
        (0.2, "y", "0.75", "energy it takes over"),
        (-0.2, "x", SERIES[0][0], "chance to be a rival"),
    ):
        ax.barh(place + up, 100 * rows[column], height=0.36, color=colour, label=label)
    ax.set_yticks(place, [effects(str(name)) for name in rows["series"]])
    ax.tick_params(axis="y", length=0)
    ax.set_xlim(0, 100)
    ax.set_ylim(-0.6, n - 0.4 + 0.28 * n)
    ax.set_xlabel("%", labelpad=1)
    ax.legend(loc="upper right")
