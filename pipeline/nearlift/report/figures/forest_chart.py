"""The forest plot to be pointed at: a line for each campaign, in the order given or by value."""

from __future__ import annotations

import numpy as np

from nearlift.nomenclature import VERDICTS, letter
from nearlift.report.evidence import Columns, distinct
from nearlift.report.figures.forest import interval, panel_rows
from nearlift.report.page.chart import Chart, Spec, View, column, frame, one_of, tooltip

LINE = 30
SHAPES = {"effect": "square"}
TOOLTIP = (
    ("label", "campaign"),
    ("vehicle", "vehicle"),
    ("told", "value, 90 %"),
    ("judged", "verdict"),
)


def chart(table: Columns) -> Chart:
    """A view for each boundary and coefficient of `summaries.forest`."""
    keys = distinct(table["panel"], table["coefficient"])
    views = tuple(_view(b, c, panel_rows(table, b, c)) for b, c in keys)
    return Chart(
        name="forest",
        label="Coefficients of many campaigns, to be pointed at",
        views=views,
        controls=(one_of("order", "Order", {"given": "as given", "value": "by value"}),),
        across="line",
        among="line",
        down=True,
    )


def _view(boundary: str, coefficient: str, rows: Columns) -> View:
    unit = "" if rows["unit"][0] == "1" else f" ({rows['unit'][0]})"
    values = [interval(rows, i) for i in range(len(rows["value"]))]
    judged = [
        VERDICTS[v] if k == "campaign" else ""
        for v, k in zip(rows["verdict"], rows["kind"], strict=True)
    ]
    lines = {
        "label": rows["label"],
        "kind": rows["kind"],
        "vehicle": rows["vehicle"],
        **{name: rows[name] for name in ("value", "lo90", "hi90")},
        "told": column(values),
        "judged": column(judged),
        "shape": column([SHAPES.get(v, "circle") for v in rows["verdict"]]),
        "fill": column(
            ["var(--paper)" if v == "unexplained" else "var(--s0)" for v in rows["verdict"]]
        ),
        "words": column(
            [
                f"{name}: {letter(coefficient)} = {t}" + (f"; {j}" if j else "")
                for name, t, j in zip(rows["label"], values, judged, strict=True)
            ]
        ),
    }
    campaigns = rows["kind"] == "campaign"
    given = rows["label"].tolist()
    sorted_by = np.concatenate(
        [np.argsort(rows["value"][campaigns], kind="stable"), np.flatnonzero(~campaigns)]
    )
    spec = frame(
        f"{letter(coefficient)} near the {boundary}, campaign by campaign",
        height=LINE * len(given) + 10,
        layers=_layers(f"{letter(coefficient)}{unit}"),
    )
    return View(
        name=f"{boundary}-{coefficient}",
        title=f"{boundary.capitalize()}: {letter(coefficient)}",
        spec=spec,
        data={"lines": lines},
        follows={
            "order": {
                "given": {"places": given},
                "value": {"places": [given[i] for i in sorted_by]},
            }
        },
    )


def _layers(title: str) -> list[Spec]:
    """From back to front: the population's band, intervals, values."""
    x: Spec = {"type": "quantitative", "scale": {"zero": False}, "axis": {"title": title}}
    y: Spec = {
        "field": "label",
        "type": "nominal",
        "scale": {"domain": "$places"},
        "axis": {"title": None, "labelLimit": 220},
    }
    raw: Spec = {"type": "nominal", "scale": None}
    data: Spec = {"name": "lines"}
    span: Spec = {"x": {**x, "field": "lo90"}, "x2": {"field": "hi90"}}
    band: Spec = {"type": "rect", "aria": False, "color": "var(--soft)", "opacity": 0.2}
    rule: Spec = {"type": "rule", "aria": False, "strokeWidth": 2}
    spans: list[tuple[str, Spec, Spec]] = [
        ("population", band, span),
        ("campaign", {**rule, "color": "var(--s0)"}, {**span, "y": y}),
        ("population", {**rule, "color": "var(--s1)", "strokeWidth": 3}, {**span, "y": y}),
        ("next", {**rule, "color": "var(--s1)", "strokeDash": [5, 3]}, {**span, "y": y}),
    ]
    return [
        *(
            {
                "data": data,
                "transform": [{"filter": f"datum.kind == '{kind}'"}],
                "mark": mark,
                "encoding": encoding,
            }
            for kind, mark, encoding in spans
        ),
        {
            "data": data,
            "transform": [
                {
                    "calculate": "datum.kind == 'campaign' ? datum.fill : 'var(--s1)'",
                    "as": "inside",
                },
                {"calculate": "datum.kind == 'campaign' ? 'var(--s0)' : 'var(--s1)'", "as": "edge"},
                {"calculate": "datum.kind == 'campaign' ? datum.shape : 'diamond'", "as": "form"},
            ],
            "mark": {
                "type": "point",
                "filled": True,
                "size": 80,
                "opacity": 1,
                "strokeWidth": 1.8,
                "ariaRoleDescription": "line",
            },
            "encoding": {
                "x": {**x, "field": "value"},
                "y": y,
                "fill": {**raw, "field": "inside"},
                "stroke": {**raw, "field": "edge"},
                "shape": {**raw, "field": "form"},
                "tooltip": tooltip(TOOLTIP),
                "description": {"field": "words", "type": "nominal"},
            },
        },
    ]
