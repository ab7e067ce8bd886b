"""Layers of the chart of Figure 2, from back to front, in Vega-Lite."""

from __future__ import annotations

from nearlift.report.page.chart import Spec, layer, tooltip

TOOLTIP = (
    ("label", "throttle"),
    ("at", "ẑ"),
    ("delta_text", "ΔL"),
    ("force_text", "lift"),
    ("trials", "trials"),
    ("names", "averaged"),
    ("quality", "quality"),
)


def layers(span: list[float], without: int) -> list[Spec]:
    """From back to front: zero, bands, curves, bars, points, further data. Only the points decide
    how far the ordinate reaches; Delta L is corrected for so many effects.
    """
    x: Spec = {
        "field": "x",
        "type": "quantitative",
        "scale": {
            "type": "$x_scale",
            "domain": [{"expr": f"{end} * reach"} for end in (0.94 * span[0], 1.06 * span[1])],
            "nice": False,
        },
        "axis": {
            "title": {"expr": "distance == 'mm' ? 'distance (mm)' : 'ẑ = distance / rotor radius'"},
            "format": "~g",
            "labelOverlap": True,
            "labelSeparation": 6,
        },
    }
    out = f", corrected for effect{'s' * (without > 1)}" if without else ""
    title = f"quantity == 'delta' ? 'ΔL{out} (%)' : 'lift (' + quantity + ')'"
    far: Spec = {"calculate": "datum.z_hat * reach", "as": "x"}
    y: Spec = {
        "field": "y",
        "type": "quantitative",
        "scale": {"domain": [{"expr": "low"}, {"expr": "high"}], "nice": False, "zero": False},
        "axis": {"title": {"expr": title}},
    }
    low, high = {**y, "field": "y_lo"}, {"field": "y_hi"}
    curve = (
        "quantity == 'delta' ? 100 * (datum.{0} - 1) : per *"
        " levels[datum.model][datum.throttle] * datum.{0}"
    )
    spread: list[Spec] = [
        far,
        {"filter": "indexof(models, datum.model) >= 0"},
        {"calculate": "quantity == 'delta' ? ['all'] : throttles", "as": "throttle"},
        {"flatten": ["throttle"]},
        *(
            {"calculate": curve.format(ratio), "as": to}
            for ratio, to in (("ratio", "y"), ("lo", "y_lo"), ("hi", "y_hi"))
        ),
        {"filter": "isFinite(datum.y)"},
    ]
    mine: list[Spec] = [
        {"filter": "indexof(throttles, datum.throttle) >= 0"},
        far,
        {"calculate": "per * datum[field]", "as": "y"},
    ]
    bar: list[Spec] = [
        {"calculate": f"per * (datum[field] {sign} datum['u_' + field])", "as": f"y_{end}"}
        for sign, end in (("-", "lo"), ("+", "hi"))
    ]
    raw: Spec = {"type": "nominal", "scale": None}
    colour = {**raw, "field": "colour"}
    each = [{"field": "model"}, {"field": "throttle"}]
    return [
        {
            "data": {"values": [{"zero": 0}]},
            "transform": [{"filter": "quantity == 'delta'"}],
            "mark": {
                "type": "rule",
                "color": "var(--soft)",
                "strokeWidth": 0.7,
                "aria": False,
                "clip": True,
            },
            "encoding": {"y": {**y, "field": "zero"}},
        },
        layer(
            "curves",
            [{"filter": "bands && datum.lo != null"}, *spread],
            {"type": "area", "clip": True, "aria": False, "color": "var(--soft)", "opacity": 0.3},
            x=x,
            y=low,
            y2=high,
            detail=each,
        ),
        layer(
            "curves",
            spread,
            {"type": "line", "clip": True, "aria": False, "strokeWidth": 1.6},
            x=x,
            y=y,
            detail=each,
            stroke=colour,
            strokeDash={**raw, "field": "dash"},
        ),
        layer(
            "cells",
            [*mine, *bar],
            {"type": "rule", "aria": False, "clip": True},
            x=x,
            y=low,
            y2=high,
            stroke=colour,
        ),
        layer(
            "overlays",
            [{"filter": "quantity == 'delta'"}, far, {"calculate": "datum.delta", "as": "y"}],
            {"type": "point", "shape": "cross", "color": "var(--soft)", "clip": True},
            x=x,
            y=y,
            tooltip=tooltip([("label", "beside")]),
        ),
        layer(
            "cells",
            mine,
            {
                "type": "point",
                "filled": True,
                "fill": "var(--paper)",
                "fillOpacity": 1,
                "strokeWidth": 1.7,
                "opacity": 1,
                "ariaRoleDescription": "cell",
            },
            x=x,
            y=y,
            stroke=colour,
            shape={**raw, "field": "shape"},
            size={**raw, "field": "area", "type": "quantitative"},
            tooltip=tooltip(TOOLTIP),
            description={"field": "words", "type": "nominal"},
        ),
    ]
