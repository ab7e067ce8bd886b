"""Figure 2 to be pointed at: every cell with its trials; throttles, models, bands,
quantity and axis to be switched.
"""

from __future__ import annotations

import numpy as np

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary, FloatArray
from nearlift.report import curves, relative_lift
from nearlift.report.evidence import Columns, Evidence, distinct, levels_N, select, stack
from nearlift.report.figures.fig2 import table as fig2
from nearlift.report.figures.fig2.layers import layers
from nearlift.report.figures.fig2.points import force_unit, points, throttle_key
from nearlift.report.page.chart import (
    AREAS,
    DASHES,
    SERIES,
    SHAPES,
    Chart,
    Choice,
    Control,
    View,
    column,
    frame,
    one_of,
    shade,
)
from nearlift.results.fit import ModelFit

GRID = 90
#: Of curves beside the quoted one, which dashes tell apart.
GREY = "var(--soft)"
HEIGHT = 300
#: More throttles than this are shaded instead of each having its own colour, and are chosen behind
#: a summary.
APART = len(SERIES)
#: What lift is shown in, per newton.
UNITS_PER_N = {"N": 1.0, "mN": 1e3, "gf": 1e3 / 9.80665}


def chart(evidence: Evidence) -> Chart:
    """A view for each boundary; what is chosen of throttles, quantity and axis holds for all."""
    cells = {b: points(evidence, b) for b in evidence.boundaries}
    cells = {b: p for b, p in cells.items() if p}
    pairs = {pair for p in cells.values() for pair in distinct(p["throttle"], p["label"])}
    throttles = dict(sorted(pairs, key=lambda pair: float(pair[0])))
    looks = {key: _look(i, len(throttles)) for i, key in enumerate(throttles)}
    views = tuple(_view(evidence, b, p, looks) for b, p in cells.items())
    chosen = tuple(
        Choice(value=key, label=label, colour=looks[key][0], shape=looks[key][1])
        for key, label in throttles.items()
    )
    controls = (
        Control(signal="throttles", legend="Throttle", choices=chosen, folded=len(chosen) > APART),
        one_of("quantity", "Show", {"delta": "ΔL"} | {u: f"lift in {u}" for u in UNITS_PER_N}),
        one_of("distance", "Distance", {"radii": "ẑ", "mm": "mm"}),
        one_of("x_scale", "Scale", {"log": "logarithmic", "linear": "linear"}),
        Control(
            signal="bands",
            legend="Band",
            kind="switch",
            choices=(Choice(value="bands", label="90 %"),),
        ),
    )
    return Chart(
        name="fig2",
        label="Lift change against distance, to be pointed at",
        views=views,
        controls=controls,
    )


def _look(i: int, n: int) -> tuple[str, str, int]:
    if n <= APART:
        return SERIES[i], SHAPES[i], AREAS[i]
    return shade(i, n), "circle", 34


def _view(
    evidence: Evidence,
    boundary: Boundary,
    cells: Columns,
    looks: dict[str, tuple[str, str, int]],
) -> View:
    for i, name in enumerate(("colour", "shape", "area")):
        cells[name] = column([looks[str(t)][i] for t in cells["throttle"]])
    span = [float(cells["z_hat"].min()), float(cells["z_hat"].max())]
    height = float(np.nanmax(cells["delta"]) - np.nanmin(cells["delta"])) / 100
    drawn, choices, levels = _models(
        evidence, boundary, np.geomspace(span[0], span[1], GRID), height
    )
    data = {"cells": cells, "curves": drawn}
    beside = _overlays(evidence, boundary)
    if beside:
        data["overlays"] = beside
    on, off = ([c for c in choices if c.on is chosen] for chosen in (True, False))
    made = layers(span, len(relative_lift.named(evidence, boundary)))
    spec = frame(
        f"Lift change near the {boundary} against distance over rotor radius",
        height=HEIGHT,
        layers=[layer for layer in made if layer["data"].get("name", "cells") in data],
        throttles=list(looks),
        models=[c.value for c in on],
        quantity="delta",
        field="delta",
        per=1,
        distance="radii",
        reach=1,
        bands=True,
        levels=levels,
        low=0,
        high=1,
    )
    return View(
        name=boundary,
        title=boundary.capitalize(),
        spec=spec,
        data=data,
        follows={
            "quantity": {"delta": {"field": "delta", "per": 1}}
            | {
                unit: {"field": "force", "per": per / force_unit(evidence)[0]}
                for unit, per in UNITS_PER_N.items()
            },
            "distance": {
                "radii": {"reach": 1},
                "mm": {"reach": 1e3 * evidence.campaign.vehicle.rotor_radius},
            },
        },
        controls=(
            Control(signal="models", legend="Models", choices=tuple(on)),
            Control(signal="models", legend="Others fitted", choices=tuple(off), folded=True),
        ),
    )


def _models(
    evidence: Evidence, boundary: Boundary, grid: FloatArray, span: float
) -> tuple[Columns, list[Choice], dict[str, dict[str, float]]]:
    """Curves of all fitted models and of the literature's, what chooses them, and L_inf of each
    model and throttle.
    """
    scale = force_unit(evidence)[0]
    base, fitted = evidence.base(boundary)
    curve = relative_lift.line(evidence, boundary, grid)
    rows: list[dict[str, object]] = []
    choices: list[Choice] = []
    levels: dict[str, dict[str, float]] = {}

    def add(
        name: str, label: str, ratio: FloatArray, fit: ModelFit = fitted, **band: FloatArray
    ) -> None:
        i = len(choices) - 1
        # colours are the throttles'
        colour, dash = (GREY, DASHES[i % len(DASHES)]) if choices else ("var(--text)", None)
        on = fit is fitted
        choices.append(Choice(value=name, label=label, on=on, colour=colour, dash=dash))
        of_fit = levels_N(fit, drawn=on and curve.sampled)
        levels[name] = {throttle_key(t): scale * level for t, level in of_fit.items()}
        keep = np.isfinite(ratio)
        over_grid = {"z_hat": grid, "ratio": ratio, **band}
        said = {"model": name, "label": label, "colour": colour}
        rows.append({**said, **{key: values[keep] for key, values in over_grid.items()}})

    apart = curve.parts(span)
    label = f"{fitted.title}, {_source(evidence, boundary, curve, apart)}"
    add(base.name, label, curve.middle + 1, lo=curve.low + 1, hi=curve.high + 1)
    if apart:
        quoted = "" if evidence.diagnosed(boundary) else ", as quoted"
        label = f"{fitted.title}, least squares{quoted}"
        add("least squares", label, curve.least_squares + 1)
    for reference in fig2.references(evidence, boundary):
        model = catalogue.model(reference.model)
        label = f"{model.title.partition(',')[0]} ({reference.label.partition('(')[2]}"
        ratio = curves.ratio(model, grid, reference.arguments)
        add(f"reference:{reference.label}", label, ratio)
    for name, fit in evidence.fits.boundaries[boundary].items():
        if name != base.name:
            ratio = curves.fitted(evidence, boundary, name, grid)
            add(name, f"{fit.title}, least squares", ratio, fit)
    table = stack(rows, ("z_hat", "ratio", "lo", "hi", "model", "label", "colour"))
    dashes = {c.value: list(c.dash or (1, 0)) for c in choices}
    table["dash"] = column([dashes[name] for name in table["model"]])
    return table, choices, levels


def _source(evidence: Evidence, boundary: Boundary, curve: curves.Curve, apart: bool) -> str:
    """Label of the line; `apart`: it differs visibly from least squares."""
    if effects := relative_lift.named(evidence, boundary):
        return f"as quoted, with {' and '.join(map(titled, effects))}"
    if relative_lift.as_quoted(evidence, boundary):
        return "as quoted, with what is unexplained"
    if not curve.sampled:
        return "least squares"
    return "posterior median" if apart else "as quoted"


def _overlays(evidence: Evidence, boundary: Boundary) -> Columns:
    beside = [
        (overlay.label, select(table, table["z_hat"] > 0))
        for overlay, table in evidence.overlays
        if overlay.boundary == boundary
    ]
    return stack(
        [
            {
                "z_hat": rows["z_hat"],
                "delta": 100 * rows["delta_L"],
                "u_delta": 100 * rows["u"],
                "label": label,
            }
            for label, rows in beside
            if len(rows["z_hat"])
        ]
    )
