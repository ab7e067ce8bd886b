"""The forest plot to be pointed at: a line for each campaign, in the order given or by value, with and without what the loop found."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.nomenclature import VERDICTS
from nearlift.pages.charts.chart import Chart, Choice, Control, Spec, View, column, frame, params
from nearlift.rounding import letter
from nearlift.summaries.evidence import Columns
from nearlift.summaries.forest import interval, select

LINE = 30
SHAPES = {"effect": "square"}
TOOLTIP = (("label", "campaign"), ("vehicle", "vehicle"), ("told", "value, 90 %"), ("judged", "verdict"), ("earlier", "before the loop"))


def chart(table: Columns) -> Chart:
    """A view for each boundary and coefficient of `summaries.forest`."""
    keys = dict.fromkeys(zip(table["panel"].tolist(), table["coefficient"].tolist(), strict=True))
    views = tuple(_view(b, c, select(table, b, c)) for b, c in keys)
    moved = bool(np.any(_moved(table)))
    controls = (
        Control(
            signal="order",
            legend="Order",
            kind="one",
            choices=(Choice(value="given", label="as given"), Choice(value="value", label="by value", on=False)),
        ),
        Control(signal="before", legend="Before the loop", kind="switch", choices=(Choice(value="before", label="shown"),) if moved else ()),
    )
    return Chart(
        name="forest",
        label="Coefficients of many campaigns, to be pointed at",
        views=views,
        controls=controls,
        across="line",
        among="line",
        down=True,
    )


def _moved(rows: Columns) -> Any:
    return (rows["kind"] == "campaign") & (rows["before"] != rows["value"])


def _view(boundary: str, coefficient: str, rows: Columns) -> View:
    unit = "" if rows["unit"][0] == "1" else f" ({rows['unit'][0]})"
    told = [interval(rows, i) for i in range(len(rows["value"]))]
    judged = [VERDICTS[v] if k == "campaign" else "" for v, k in zip(rows["verdict"], rows["kind"], strict=True)]
    moved = _moved(rows)
    earlier = [interval(rows, i, "before") if moved[i] else "the same" if rows["kind"][i] == "campaign" else "" for i in range(len(told))]
    lines = {
        "label": rows["label"],
        "kind": rows["kind"],
        "vehicle": rows["vehicle"],
        **{name: rows[name] for name in ("value", "lo90", "hi90")},
        **{name: np.where(moved, rows[name], np.nan) for name in ("before", "before_lo90", "before_hi90")},
        "told": column(told),
        "judged": column(judged),
        "earlier": column(earlier),
        "shape": column([SHAPES.get(v, "circle") for v in rows["verdict"]]),
        "fill": column(["var(--paper)" if v == "unexplained" else "var(--s0)" for v in rows["verdict"]]),
        "words": column(
            [
                f"{name}: {letter(coefficient)} = {t}" + (f"; {j}; before the loop {e}" if j else "")
                for name, t, j, e in zip(rows["label"], told, judged, earlier, strict=True)
            ]
        ),
    }
    own = rows["kind"] == "campaign"
    given = rows["label"].tolist()
    sorted_by = np.concatenate([np.argsort(rows["value"][own], kind="stable"), np.flatnonzero(~own)])
    spec = frame(
        f"{letter(coefficient)} near the {boundary}, campaign by campaign",
        height=LINE * len(given) + 10,
        parameters=params(before=True),
        layers=_layers(f"{letter(coefficient)}{unit}"),
    )
    return View(
        name=f"{boundary}-{coefficient}",
        title=f"{boundary.capitalize()}: {letter(coefficient)}",
        spec=spec,
        data={"lines": lines},
        follows={"order": {"given": {"places": given}, "value": {"places": [given[i] for i in sorted_by]}}},
    )


def _layers(title: str) -> list[Spec]:
    """From back to front: the population's band, the fits before the loop, intervals, values."""
    x: Spec = {"type": "quantitative", "scale": {"zero": False}, "axis": {"title": title}}
    y: Spec = {"field": "label", "type": "nominal", "scale": {"domain": "$places"}, "axis": {"title": None, "labelLimit": 220}}
    raw: Spec = {"type": "nominal", "scale": None}
    data: Spec = {"name": "lines"}

    def only(*kinds: str) -> list[Spec]:
        return [{"filter": " || ".join(f"datum.kind == '{k}'" for k in kinds)}]

    earlier: list[Spec] = [{"filter": "before && isValid(datum.before)"}]
    span: Spec = {"x": {**x, "field": "lo90"}, "x2": {"field": "hi90"}}
    rule: Spec = {"type": "rule", "aria": False, "strokeWidth": 2}
    return [
        {
            "data": data,
            "transform": only("population"),
            "mark": {"type": "rect", "aria": False, "color": "var(--soft)", "opacity": 0.2},
            "encoding": span,
        },
        {
            "data": data,
            "transform": earlier,
            "mark": {**rule, "color": "var(--soft)", "strokeWidth": 1.3, "yOffset": -8},
            "encoding": {"x": {**x, "field": "before_lo90"}, "x2": {"field": "before_hi90"}, "y": y},
        },
        {
            "data": data,
            "transform": earlier,
            "mark": {"type": "point", "shape": "stroke", "angle": 90, "size": 60, "color": "var(--soft)", "yOffset": -8, "aria": False},
            "encoding": {"x": {**x, "field": "before"}, "y": y},
        },
        {"data": data, "transform": only("campaign"), "mark": {**rule, "color": "var(--s0)"}, "encoding": {**span, "y": y}},
        {"data": data, "transform": only("population"), "mark": {**rule, "color": "var(--s1)", "strokeWidth": 3}, "encoding": {**span, "y": y}},
        {"data": data, "transform": only("next"), "mark": {**rule, "color": "var(--s1)", "strokeDash": [5, 3]}, "encoding": {**span, "y": y}},
        {
            "data": data,
            "transform": [
                {"calculate": "datum.kind == 'campaign' ? datum.fill : 'var(--s1)'", "as": "inside"},
                {"calculate": "datum.kind == 'campaign' ? 'var(--s0)' : 'var(--s1)'", "as": "edge"},
                {"calculate": "datum.kind == 'campaign' ? datum.shape : 'diamond'", "as": "form"},
            ],
            "mark": {"type": "point", "filled": True, "size": 80, "opacity": 1, "strokeWidth": 1.8, "ariaRoleDescription": "line"},
            "encoding": {
                "x": {**x, "field": "value"}, "y": y,
                "fill": {**raw, "field": "inside"}, "stroke": {**raw, "field": "edge"}, "shape": {**raw, "field": "form"},
                "tooltip": [{"field": f, "type": "nominal", "title": t} for f, t in TOOLTIP],
                "description": {"field": "words", "type": "nominal"},
            },
        },
    ]  # fmt: skip
