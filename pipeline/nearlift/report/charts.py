"""Figure 2 to point at and switch: a template of Vega-Lite (vega.github.io/vega-lite/docs) with its
data.

Colours are properties of the page's style sheet, so that the chart follows the reader's scheme;
axes and legends are those of the page's script.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from nearlift.declare import Boundary
from nearlift.report.evidence import Evidence, pick, records
from nearlift.report.figures import fig2 as paper
from nearlift.rounding import plain, plus_minus
from nearlift.stages.reduce import LIFT

Spec = dict[str, Any]
#: Significant digits of what is drawn.
DIGITS = 6
#: More throttles than this share a ramp of colours, and have no legend.
MOST_COLOURS = 6
SHAPES = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross")
DASHES = ([1, 0], [6, 3], [2, 2], [8, 3, 2, 3], [4, 4])
LEGEND = {"columns": 4, "title": "throttle", "symbolStrokeWidth": 2}


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Interactive form of the figure of the same name: a specification for each view."""

    name: str
    label: str
    views: Mapping[str, Spec]


def embedded(chart: Chart | None) -> str:
    """All specifications as JSON for a page: nothing in it ends a script or begins a comment."""
    content = {chart.name: dict(chart.views)} if chart else {}
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _spec(data: Mapping[str, pd.DataFrame], **values: Any) -> Spec:
    """The template, each string "$key" in it replaced by the value of that key."""
    file = resources.files("nearlift.report.page").joinpath("templates", "fig2.json")
    given = {f"${key}": value for key, value in values.items()}
    given["$datasets"] = {key: _rows(table) for key, table in data.items()}

    def filled(part: Any) -> Any:
        if isinstance(part, dict):
            return {key: filled(each) for key, each in part.items()}
        if isinstance(part, list):
            # Vega warns of a layer without rows
            layers = (p for p in part if isinstance(p, dict) and "mark" in p)
            empty = [layer for layer in layers if data[layer["data"]["name"]].empty]
            return [filled(each) for each in part if each not in empty]
        return given.get(part, part) if isinstance(part, str) else part

    spec: Spec = filled(json.loads(file.read_text(encoding="utf-8")))
    return spec


def _rows(table: pd.DataFrame) -> list[dict[Hashable, Any]]:
    """Rows for JSON, rounded; nan is null."""
    floats = table.select_dtypes("float")
    rounded = floats.map(lambda v: float(f"{v:.{DIGITS}g}")).where(np.isfinite(floats))
    cells = table.assign(**rounded).astype(object)
    return cells.where(cells.notna(), None).to_dict("records")


def fig2(evidence: Evidence) -> Chart:
    """A view for each boundary; the legend shows and hides throttles."""
    table = paper.table(evidence)
    views = {str(b): _fig2_view(evidence, table, b) for b in evidence.boundaries}
    drawn = {b: view for b, view in views.items() if view}
    return Chart(name="fig2", label="Lift change against distance", views=drawn)


def _fig2_view(evidence: Evidence, every: pd.DataFrame, boundary: Boundary) -> Spec:
    table, points = pick(every, panel=boundary), cells(evidence, every, boundary)
    if points.empty:
        return {}
    throttles = points.sort_values("throttle_fraction")["label"].unique().tolist()
    n, few = len(throttles), len(throttles) <= MOST_COLOURS
    shares = (100 * i / max(n - 1, 1) for i in range(n))
    ramp = [f"color-mix(in oklab, var(--ramp0), var(--ramp1) {s:.0f}%)" for s in shares]
    span = points["delta_L_percent"]
    room = 0.05 * float(span.max() - span.min() or 1)
    lines = table[table["kind"].isin(("band", "least squares", "model"))]
    lines = lines.sort_values("kind", key=lambda k: k != "band", kind="stable")
    names = lines["label"].unique().tolist()
    at = ["z_hat", "delta_L_percent"]
    data = {
        "points": points,
        "lines": lines[["label", *at]],
        "band": pick(table, kind="band")[["z_hat", "lo90_percent", "hi90_percent"]].dropna(),
    }
    return _spec(
        data,
        description=f"Lift change near the {boundary} against distance",
        within=[float(span.min()) - room, float(span.max()) + room],
        throttles=throttles,
        colours=[f"var(--s{i})" for i in range(n)] if few else ramp,
        shapes=list(SHAPES[:n]) if few else ["circle"],
        legend=LEGEND if few else None,
        lines=names,
        dashes=list(DASHES[: len(names)]),
    )


def cells(evidence: Evidence, table: pd.DataFrame, boundary: Boundary) -> pd.DataFrame:
    """Points of Figure 2 at one boundary, with their lift and trials in words."""
    lift = evidence.frame(LIFT, boundary=boundary).rename(columns={"throttle": "throttle_fraction"})
    at = ["throttle_fraction", "z_hat"]
    points = pick(table, panel=boundary, kind="data").merge(
        lift[[*at, "lift_N", "u_lift_N", "n_trials"]], on=at, how="left"
    )
    radius_mm = 1e3 * evidence.observations[boundary].radius_m
    scale, unit = paper.force_unit(evidence)
    shown = pd.DataFrame(
        {
            "throttle": p.label,
            "ẑ": f"{plain(p.z_hat)} ({plain(radius_mm * p.z_hat, 3)} mm)",
            "ΔL": f"{plus_minus(p.delta_L_percent, p.u_delta_L_percent)} %",
            "lift": f"{plus_minus(scale * p.lift_N, scale * p.u_lift_N)} {unit}",
            "trials": f"{plain(p.n_trials)} averaged",
        }
        for p in records(points)
    )
    words = ["; ".join(f"{n} {v}" for n, v in row.items()) for row in shown.to_dict("records")]
    rank = points["throttle_fraction"].rank(method="dense").astype(int)
    u = points["u_delta_L_percent"]
    return points[["label", "throttle_fraction", "z_hat", "delta_L_percent"]].assign(
        u=u.where(np.isfinite(u), 0.0),
        area=np.maximum(105 - 15 * rank, 34),
        words=[f"{boundary}, {text}" for text in words],
        **shown,
    )
