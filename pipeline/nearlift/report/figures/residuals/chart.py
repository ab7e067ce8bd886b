"""Residuals to be pointed at: against whatever was recorded, trial by trial, with means over bins
of the throttles that are chosen.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Boundary
from nearlift.report.evidence import Columns, Evidence
from nearlift.report.figures.residuals.points import dots, every_covariate, sums, word
from nearlift.report.page.chart import (
    SERIES,
    Chart,
    Choice,
    Control,
    Spec,
    View,
    column,
    frame,
    layer,
    one_of,
    shade,
    tooltip,
)

HEIGHT = 300
#: With more throttles than this, and with as many as a held voltage or power gives, they are
#: neither told apart nor chosen.
APART = 12
#: Up to so many distinct values each has its tick.
DISCRETE = 6
TOOLTIP = (
    ("trial", "trial"),
    ("at", "ẑ"),
    ("label", "throttle"),
    ("residual_text", "residual"),
    ("lift", "lift"),
    ("samples", "samples"),
    ("session", "session"),
    ("quality", "quality"),
)
MEAN_TOOLTIP = (
    ("x_text", "$x_title"),
    ("mean_text", "mean residual"),
    ("n", "trials"),
    ("noise_text", "noise expected"),
)


def chart(evidence: Evidence) -> Chart:
    """A view for each boundary; covariate, throttles and what is shown hold for all."""
    keys = {name: f"c{i}" for i, name in enumerate(every_covariate(evidence))}
    trials = {b: dots(evidence, b) for b in evidence.boundaries}
    trials = {b: drawn for b, drawn in trials.items() if drawn[2]}
    every = {str(key) for drawn, _, _ in trials.values() for key in drawn["throttle"]}
    n = len(every)
    colours = {
        key: shade(i, n) if n > len(SERIES) else SERIES[i]
        for i, key in enumerate(sorted(every, key=float) if 1 < n <= APART else ())
    }
    views = tuple(_view(evidence, b, drawn, keys, colours) for b, drawn in trials.items())
    throttles = tuple(
        Choice(value=key, label=f"{100 * float(key):.3g} %", colour=colour, shape="circle")
        for key, colour in colours.items()
    )
    shown = {"trials": "trials", "means": "means", "noise": "noise expected"}
    controls = (
        one_of("covariate", "Against", {key: word(name) for name, key in keys.items()}),
        Control(signal="throttles", legend="Throttle", choices=throttles),
        Control(
            signal="shown",
            legend="Show",
            choices=tuple(Choice(value=value, label=label) for value, label in shown.items()),
        ),
    )
    return Chart(
        name="residuals",
        label="Residuals of the base model, to be pointed at",
        views=views,
        controls=controls,
        across="mean",
        among="trial",
    )


def _view(
    evidence: Evidence,
    boundary: Boundary,
    drawn: tuple[Columns, Columns, int],
    keys: dict[str, str],
    colours: dict[str, str],
) -> View:
    cloud, here, total = drawn
    binned = sums(evidence, boundary, by_throttle=bool(colours))
    binned["covariate"] = column([keys[name] for name in binned["covariate"]])
    trials = cloud | {keys[name]: x for name, x in here.items()}
    trials["colour"] = column([colours.get(k, SERIES[0]) for k in cloud["throttle"]])
    if not colours:
        trials["throttle"] = column(["all"] * len(cloud["throttle"]))
    low, high = float(cloud["residual"].min()), float(cloud["residual"].max())
    room = 0.05 * (high - low or 1)
    model, _ = evidence.base(boundary)
    spec = frame(
        f"Residuals of {model.title} near the {boundary}",
        height=HEIGHT,
        layers=_layers(boundary, [low - room, high + room]),
        covariate=next(iter(keys.values())),
        throttles=list(colours) or ["all"],
        shown=["trials", "means", "noise"],
        varying=[keys[n] for n in here],
    )
    part = (
        f" ({len(cloud['trial'])} of {total} trials drawn, evenly in run order; means are of all)"
        if len(cloud["trial"]) < total
        else ""
    )
    return View(
        name=boundary,
        title=f"{boundary.capitalize()}{part}",
        spec=spec,
        data={"trials": trials, "sums": binned},
        follows={"covariate": {key: _axis(name, here.get(name)) for name, key in keys.items()}},
    )


def _axis(name: str, x: Any) -> dict[str, object]:
    """Abscissa; one that does not vary here has a place for a note."""
    linear: dict[str, object] = {"x_scale": "linear", "x_zero": False, "x_title": word(name)}
    if x is None:
        return {**linear, "x_domain": [0, 1]}
    values = np.unique(x[np.isfinite(x)])
    look = {"x_scale": "log", "x_title": word(name)} if name == "z_hat" else linear
    ticks = {"x_ticks": values.tolist()} if len(values) <= DISCRETE else {}
    return {**look, "x_domain": [float(values[0]), float(values[-1])], **ticks}


def _layers(boundary: str, domain: list[float]) -> list[Spec]:
    """From back to front: expected noise, zero, trials, bars, means."""
    x: Spec = {
        "field": "x",
        "type": "quantitative",
        "scale": {
            "type": "$x_scale",
            "domain": "$x_domain",
            "zero": "$x_zero",
            "nice": False,
            "padding": 10,
        },
        "axis": {"title": "$x_title", "values": "$x_ticks", "format": "~g", "labelOverlap": True},
    }
    y: Spec = {
        "field": "mean",
        "type": "quantitative",
        "scale": {"domain": domain, "nice": False, "zero": False},
        "axis": {"title": "residual (%)"},
    }
    binned: list[Spec] = [
        {"filter": "datum.covariate == covariate && indexof(throttles, datum.throttle) >= 0"},
        {
            "aggregate": [{"op": "sum", "field": n, "as": n} for n in ("n", "x", "r", "rr", "vv")],
            "groupby": ["bin"],
        },
        {"calculate": "datum.x / datum.n", "as": "x"},
        {"calculate": "datum.r / datum.n", "as": "mean"},
        {
            "calculate": (
                "datum.n > 1 ? sqrt(max(datum.rr - datum.n * datum.mean * datum.mean, 0) / (datum.n"
                " - 1) / datum.n) : 0"
            ),
            "as": "error",
        },
        {"calculate": "datum.mean - datum.error", "as": "lo"},
        {"calculate": "datum.mean + datum.error", "as": "hi"},
        {"calculate": "sqrt(datum.vv / datum.n)", "as": "noise"},
        {"calculate": "-datum.noise", "as": "below"},
    ]
    labels: list[Spec] = [
        {
            "calculate": (
                "'.' + (datum.error > 0 ? clamp(ceil(1 - log(datum.error) / LN10), 0, 6) : 2) + 'f'"
            ),
            "as": "places",
        },
        {
            "calculate": "datum.error > 0 ? ' ± ' + format(datum.error, datum.places) : ''",
            "as": "error_text",
        },
        {
            "calculate": "format(datum.mean, datum.places) + datum.error_text + ' %'",
            "as": "mean_text",
        },
        {"calculate": "'± ' + format(datum.noise, '.2f') + ' % a trial'", "as": "noise_text"},
        {"calculate": "format(datum.x, '.4~g')", "as": "x_text"},
        {
            "calculate": (
                f"'{boundary}, mean of ' + datum.n + ' trials at ' + datum.x_text + ': residual ' +"
                " datum.mean_text"
            ),
            "as": "words",
        },
    ]
    described: Spec = {"field": "words", "type": "nominal"}
    words = (
        "', residual ' + datum.residual_text + '; lift ' + datum.lift + '; samples ' +"
        " datum.samples + '; quality ' + datum.quality"
    )
    shown = "indexof(shown, '{0}') >= 0".format
    return [
        layer(
            "sums",
            [{"filter": shown("noise")}, *binned],
            {
                "type": "area",
                "interpolate": "step",
                "clip": True,
                "aria": False,
                "color": "var(--soft)",
                "opacity": 0.25,
            },
            x=x,
            y={**y, "field": "below"},
            y2={"field": "noise"},
        ),
        {
            "data": {"values": [{"zero": 0}]},
            "mark": {"type": "rule", "color": "var(--soft)", "strokeWidth": 0.7, "aria": False},
            "encoding": {"y": {**y, "field": "zero"}},
        },
        {
            "data": {"values": [{"told": "does not vary here"}]},
            "transform": [{"filter": "indexof(varying, covariate) < 0"}],
            "mark": {
                "type": "text",
                "fontSize": 14,
                "color": "var(--text)",
                "x": {"expr": "width / 2"},
                "y": {"expr": "height / 3"},
            },
            "encoding": {"text": {"field": "told", "type": "nominal"}},
        },
        layer(
            "trials",
            [
                {"filter": f"{shown('trials')} && indexof(throttles, datum.throttle) >= 0"},
                {"calculate": "datum[covariate]", "as": "x"},
                {"filter": "isValid(datum.x)"},
                {
                    "calculate": f"'{boundary}, trial ' + datum.trial + ', ẑ = ' + datum.at"
                    f" + ', throttle ' + datum.label + {words}",
                    "as": "words",
                },
                {"calculate": "format(datum.x, '.4~g')", "as": "x_text"},
            ],
            {
                "type": "circle",
                "size": 26,
                "opacity": 0.55,
                "clip": True,
                "ariaRoleDescription": "trial",
            },
            x=x,
            y={**y, "field": "residual"},
            fill={"type": "nominal", "scale": None, "field": "colour"},
            tooltip=tooltip((*TOOLTIP, ("x_text", "$x_title"))),
            description=described,
        ),
        layer(
            "sums",
            [{"filter": shown("means")}, *binned],
            {
                "type": "rule",
                "clip": True,
                "aria": False,
                "color": "var(--text)",
                "strokeWidth": 1.6,
            },
            x=x,
            y={**y, "field": "lo"},
            y2={"field": "hi"},
        ),
        layer(
            "sums",
            [{"filter": shown("means")}, *binned, *labels],
            {
                "type": "point",
                "filled": True,
                "fill": "var(--paper)",
                "stroke": "var(--text)",
                "fillOpacity": 1,
                "opacity": 1,
                "strokeWidth": 1.7,
                "size": 60,
                "clip": True,
                "ariaRoleDescription": "mean",
            },
            x=x,
            y=y,
            tooltip=tooltip(MEAN_TOOLTIP),
            description=described,
        ),
    ]
