"""Figure 2 to be pointed at: every cell with what stands behind it; throttles, models, bands,
quantity and axis to be switched.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary, FloatArray, LiftModel
from nearlift.nomenclature import letter
from nearlift.report import curves
from nearlift.report.evidence import Columns, Evidence, levels_N, stack
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
#: The table beneath the chart holds so many points.
TABLE = 400
#: What lift is shown in, per newton.
UNITS_PER_N = {"N": 1.0, "mN": 1e3, "gf": 1e3 / 9.80665}
HEADS = ("boundary", "throttle", "ẑ", "ΔL", "lift", "trials", "quality")


def chart(evidence: Evidence) -> Chart:
    """A view for each boundary; what is chosen of throttles, quantity and axis holds for all."""
    cells = {b: points(evidence, b) for b in evidence.boundaries}
    cells = {b: p for b, p in cells.items() if p}
    throttles = sorted(
        {
            (float(t), str(label))
            for p in cells.values()
            for t, label in zip(p["throttle"], p["label"], strict=True)
        }
    )
    keys = [throttle_key(t) for t, _ in throttles]
    looks = {key: _look(i, len(keys)) for i, key in enumerate(keys)}
    views = tuple(_view(evidence, b, p, looks) for b, p in cells.items())
    chosen = tuple(
        Choice(value=key, label=label, colour=looks[key][0], shape=looks[key][1])
        for key, (_, label) in zip(keys, throttles, strict=True)
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
    rows = [
        (b, *(str(x) for x in row))
        for b, p in cells.items()
        for row in zip(
            *(p[n] for n in ("label", "at", "delta_text", "force_text", "trials", "quality")),
            strict=True,
        )
    ]
    return Chart(
        name="fig2",
        label="Lift change against distance, to be pointed at",
        views=views,
        controls=controls,
        heads=HEADS,
        rows=tuple(rows[:TABLE]),
        further=max(len(rows) - TABLE, 0),
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
    grid = np.geomspace(cells["z_hat"].min(), cells["z_hat"].max(), GRID)
    drawn, choices, levels = _models(
        evidence, boundary, grid, float(np.nanmax(cells["delta"]) - np.nanmin(cells["delta"])) / 100
    )
    data = {"cells": cells, "curves": drawn}
    beside = _overlays(evidence, boundary)
    if beside:
        data["overlays"] = beside
    on = [c.value for c in choices if c.on]
    span = [float(cells["z_hat"].min()), float(cells["z_hat"].max())]
    made = layers(span, len(fig2.named(evidence, boundary)))
    spec = frame(
        f"Lift change near the {boundary} against distance over rotor radius",
        height=HEIGHT,
        layers=[layer for layer in made if layer["data"].get("name", "cells") in data],
        throttles=list(looks),
        models=on,
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
            Control(signal="models", legend="Models", choices=tuple(c for c in choices if c.on)),
            Control(
                signal="models",
                legend="Others fitted",
                choices=tuple(c for c in choices if not c.on),
                folded=True,
            ),
        ),
    )


def _models(
    evidence: Evidence, boundary: Boundary, grid: FloatArray, span: float
) -> tuple[Columns, list[Choice], dict[str, dict[str, float]]]:
    """Curves of all fitted models and of the literature's, what chooses them, and L_inf of each
    model and throttle.
    """
    scale = force_unit(evidence)[0]
    fits = evidence.fits.boundaries[boundary]
    base, fitted = evidence.base(boundary)
    rows: list[dict[str, Any]] = []
    choices: list[Choice] = []
    levels: dict[str, dict[str, float]] = {}

    def add(
        name: str,
        label: str,
        ratio: FloatArray,
        fit: ModelFit,
        on: bool,
        drawn: bool = False,
        **band: FloatArray,
    ) -> None:
        i = len(choices) - 1
        # colours are the throttles'
        quoted = name == base.name
        colour, dash = ("var(--text)", None) if quoted else (GREY, DASHES[i % len(DASHES)])
        choices.append(Choice(value=name, label=label, on=on, colour=colour, dash=dash))
        levels[name] = {throttle_key(t): scale * level for t, level in levels_N(fit, drawn).items()}
        keep = np.isfinite(ratio)
        over_grid = {"z_hat": grid, "ratio": ratio, **band}
        said = {"model": name, "label": label, "colour": colour}
        rows.append(said | {key: values[keep] for key, values in over_grid.items()})

    curve = fig2.line(evidence, boundary, grid)
    apart = curve.parts(span)
    add(
        base.name,
        f"{fitted.title}, {_source(evidence, boundary, curve, apart)}",
        curve.middle + 1,
        fitted,
        True,
        curve.sampled,
        lo=curve.low + 1,
        hi=curve.high + 1,
    )
    if apart:
        quoted = "" if evidence.diagnosed(boundary) else ", as quoted"
        label = f"{fitted.title}, least squares{quoted}"
        add("least squares", label, curve.least_squares + 1, fitted, True, curve.sampled)
    for reference in fig2.references(evidence, boundary):
        add(
            f"reference:{reference.label}",
            f"{catalogue.model(reference.model).title.partition(',')[0]}"
            f" ({reference.label.partition('(')[2]}",
            curves.ratio(catalogue.model(reference.model), grid, reference.arguments),
            fitted,
            True,
            curve.sampled,
        )
    for name, fit in fits.items():
        model: LiftModel = catalogue.model(name)
        if name != base.name:
            stood = grid + curves.height_found_m(fit) / evidence.observations[boundary].radius_m
            ratio = curves.ratio(model, stood, {**evidence.known(boundary, model), **fit.values})
            add(name, f"{fit.title}, least squares", ratio, fit, False)
    table = stack(rows, ("z_hat", "ratio", "lo", "hi", "model", "label", "colour"))
    dashes = {c.value: list(c.dash or (1, 0)) for c in choices}
    table["dash"] = column([dashes[name] for name in table["model"]])
    return table, choices, levels


def _source(evidence: Evidence, boundary: Boundary, curve: curves.Curve, apart: bool) -> str:
    """What the line is from; `apart` says that it can be told from least squares."""
    if refused := evidence.quoted(boundary).refused:
        return f"least squares: {', '.join(map(letter, refused))} refused"
    if effects := fig2.named(evidence, boundary):
        return f"as quoted, beside {' and '.join(map(titled, effects))}"
    if fig2.as_quoted(evidence, boundary):
        return "as quoted, with what is unexplained"
    if not curve.sampled:
        return "least squares"
    return "posterior median" if apart else "as quoted"


def _overlays(evidence: Evidence, boundary: Boundary) -> Columns:
    rows = [
        (float(z), 100 * float(d), 100 * float(u), overlay.label)
        for overlay, table in evidence.overlays
        if overlay.boundary == boundary
        for z, d, u in zip(table["z_hat"], table["delta_L"], table["u"], strict=True)
        if z > 0
    ]
    return (
        {
            name: column([row[i] for row in rows])
            for i, name in enumerate(("z_hat", "delta", "u_delta", "label"))
        }
        if rows
        else {}
    )
