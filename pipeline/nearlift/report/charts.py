"""Charts that a reader can point at and switch, as Vega-Lite by altair.

Colours are properties of the page's style sheet, so that a chart follows the reader's scheme; axes
and legends are those of the page's script.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from nearlift import nomenclature
from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.report.evidence import Evidence, pick, records
from nearlift.report.figures.fig2 import force_unit
from nearlift.report.figures.fig2 import table as fig2_table
from nearlift.report.figures.residuals import table as residual_table
from nearlift.rounding import plain, plus_minus
from nearlift.stages.reduce import LIFT

Spec = dict[str, Any]
#: Significant digits of what is drawn.
DIGITS = 6
#: More residuals than this are drawn in part, evenly in run order.
MOST_DOTS = 1000
#: More throttles than this share a ramp of colours, and have no legend.
MOST_COLOURS = 6
SHAPES = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross")
DASHES = ([1, 0], [6, 3], [2, 2], [8, 3, 2, 3], [4, 4])
TEXT, SOFT, PAPER = "var(--text)", "var(--soft)", "var(--paper)"
WORDS = {"throttle_percent": "throttle (%)", "run_order": "run order", "z_hat": "distance ẑ"}
#: Columns of a cell that its tooltip shows.
CELL = ("throttle", "ẑ", "ΔL", "lift", "trials")


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Interactive form of the figure of the same name: a specification for each view. Arrow keys go
    along the marks that are called `mark`.
    """

    name: str
    label: str
    views: Mapping[str, Spec]
    mark: str


def embedded(charts: Sequence[Chart]) -> str:
    """All specifications as JSON for a page: nothing in it ends a script or begins a comment."""
    content = {c.name: dict(c.views) for c in charts}
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _data(alt: Any, table: pd.DataFrame) -> Any:
    """A chart of these rows, rounded."""
    return alt.Chart(
        table.map(
            lambda v: float(f"{v:.{DIGITS}g}") if isinstance(v, float) and math.isfinite(v) else v
        )
    )


def _finished(chart: Any, description: str, height: int) -> Spec:
    """The specification, as wide as its place."""
    sized = chart.properties(width="container", height=height, description=description, padding=4)
    spec: Spec = sized.to_dict(validate=False)
    # an address, which the page has no use for; and colours of altair's own
    del spec["$schema"], spec["config"]
    return {**spec, "autosize": {"type": "fit-x", "contains": "padding"}}


def _altair() -> Any:
    import altair

    altair.data_transformers.disable_max_rows()
    return altair


def _ramp(n: int) -> list[str]:
    if n <= MOST_COLOURS:
        return [f"var(--s{i})" for i in range(n)]
    shares = (100 * i / (n - 1) for i in range(n))
    return [f"color-mix(in oklab, var(--ramp0), var(--ramp1) {s:.0f}%)" for s in shares]


def fig2(evidence: Evidence) -> Chart:
    """A view for each boundary; the legend shows and hides throttles."""
    table = fig2_table(evidence)
    views: dict[str, Spec] = {
        b: _fig2_view(pick(table, panel=b), cells(evidence, table, b), b)
        for b in evidence.boundaries
        if len(pick(table, panel=b, kind="data"))
    }
    return Chart(name="fig2", label="Lift change against distance", views=views, mark="cell")


def cells(evidence: Evidence, table: pd.DataFrame, boundary: Boundary) -> pd.DataFrame:
    """Points of Figure 2 at one boundary, with their lift and trials in words."""
    lift = evidence.frame(LIFT, boundary=boundary).rename(columns={"throttle": "throttle_fraction"})
    at = ["throttle_fraction", "z_hat"]
    points = pick(table, panel=boundary, kind="data").merge(
        lift[[*at, "lift_N", "u_lift_N", "n_trials"]], on=at, how="left"
    )
    radius_mm = 1e3 * evidence.observations[boundary].radius_m
    scale, unit = force_unit(evidence)
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
    return points[["label", "throttle_fraction", "z_hat", "delta_L_percent"]].assign(
        u=points["u_delta_L_percent"].where(np.isfinite(points["u_delta_L_percent"]), 0.0),
        area=np.maximum(105 - 15 * rank, 34),
        words=[f"{boundary}, {text}" for text in words],
        **shown,
    )


def _fig2_view(table: pd.DataFrame, points: pd.DataFrame, boundary: str) -> Spec:
    alt = _altair()
    throttles = points.sort_values("throttle_fraction")["label"].unique().tolist()
    few = len(throttles) <= MOST_COLOURS
    shown = alt.selection_point(name="throttles", fields=["label"], bind="legend")
    x = alt.X("z_hat:Q", title="ẑ = distance / rotor radius").scale(type="log", nice=False)
    x = x.axis(format="~g", labelOverlap=True)
    span = points["delta_L_percent"]
    room = 0.05 * float(span.max() - span.min() or 1)
    within = [float(span.min()) - room, float(span.max()) + room]
    y = alt.Y("delta_L_percent:Q", title="ΔL (%)").scale(domain=within, nice=False)
    legend = alt.Legend(columns=4, title="throttle", symbolStrokeWidth=2) if few else None
    colours = alt.Scale(domain=throttles, range=_ramp(len(throttles)))
    stroke = alt.Stroke("label:N", scale=colours, legend=legend)
    shapes = [*SHAPES][: len(throttles)] if few else ["circle"]
    lines = table[table["kind"].isin(("band", "least squares", "model"))]
    lines = lines.sort_values("kind", key=lambda k: k != "band", kind="stable")
    names = lines["label"].unique().tolist()
    dash = alt.StrokeDash(
        "label:N",
        scale=alt.Scale(domain=names, range=list(DASHES[: len(names)])),
        legend=alt.Legend(columns=1, symbolType="stroke", symbolStrokeColor=TEXT, symbolSize=400),
    )
    band = table[(table["kind"] == "band") & table["lo90_percent"].notna()]
    dots = _data(alt, points).transform_filter(shown)
    layers = [
        _data(alt, band)
        .mark_area(opacity=0.3, color=SOFT, clip=True, aria=False)
        .encode(x=x, y=alt.Y("lo90_percent:Q"), y2="hi90_percent:Q"),
        _data(alt, lines)
        .mark_line(clip=True, aria=False, strokeWidth=1.5, color=TEXT)
        .encode(x=x, y=y, strokeDash=dash),
        dots.transform_calculate(
            low="datum.delta_L_percent - datum.u", high="datum.delta_L_percent + datum.u"
        )
        .mark_rule(clip=True, aria=False)
        .encode(x=x, y=alt.Y("low:Q"), y2="high:Q", stroke=stroke),
        # Vega warns of a layer without rows
        *(
            _data(alt, overlays)
            .mark_point(shape="cross", color=SOFT, clip=True)
            .encode(x=x, y=y, tooltip=["label", "z_hat", "delta_L_percent"])
            for overlays in [pick(table, kind="overlay")]
            if len(overlays)
        ),
        dots.mark_point(
            fill=PAPER, fillOpacity=1, strokeWidth=1.7, opacity=1, ariaRoleDescription="cell"
        )
        .encode(
            x=x,
            y=y,
            stroke=stroke,
            shape=alt.Shape(
                "label:N", scale=alt.Scale(domain=throttles, range=shapes), legend=legend
            ),
            size=alt.Size("area:Q", scale=None, legend=None),
            description="words:N",
            tooltip=[f"{name}:N" for name in CELL],
        )
        .add_params(shown),
    ]
    chart = alt.layer(*layers).resolve_scale(strokeDash="independent", stroke="shared")
    return _finished(chart, f"Lift change near the {boundary} against distance", 240)


def residuals(evidence: Evidence) -> Chart:
    """A view for each boundary: every trial against the covariate that the reader chooses."""
    table = residual_table(evidence, every=True)
    views: dict[str, Spec] = {
        b: _residual_view(pick(table, panel=b), b)
        for b in evidence.boundaries
        if len(pick(table, panel=b))
    }
    return Chart(name="residuals", label="Residuals of every trial", views=views, mark="mean")


def word(covariate: str) -> str:
    """A covariate with its unit, as a screen shows it."""
    if covariate in WORDS:
        return WORDS[covariate]
    try:
        unit = nomenclature.symbol(covariate).unit
    except UsageError:
        return covariate.replace("_", " ")
    name = covariate.split("_")[0]
    return name if unit in ("", "1") else f"{name} ({unit})"


def _residual_view(table: pd.DataFrame, boundary: str) -> Spec:
    alt = _altair()
    names = {c: word(c) for c in table["covariate"].unique()}
    against = alt.param(
        name="against",
        value=next(iter(names)),
        bind=alt.binding_select(options=[*names], labels=[*names.values()], name="Against "),
    )
    # distances are spread evenly by their logarithm, and labelled as they are
    logarithm = table["covariate"] == "z_hat"
    table = table.assign(x=table["x"].mask(logarithm, np.log10(table["x"].where(logarithm))))
    chosen = _data(alt, table[table["kind"] != "trial"]).transform_filter(
        "datum.covariate == against"
    )
    x = alt.X("x:Q", title=None).scale(zero=False, nice=False, padding=10)
    x = x.axis(labelExpr="against == 'z_hat' ? format(pow(10, datum.value), '.2~g') : datum.label")
    y = alt.Y("residual_percent:Q", title="residual (%)")
    dots = _data(alt, _dots(pick(table, kind="trial"))).transform_calculate(x="datum[against]")
    bars = chosen.transform_filter("datum.kind == 'bin'").transform_calculate(
        low="datum.residual_percent - datum.u_residual_percent",
        high="datum.residual_percent + datum.u_residual_percent",
        words=(
            f"'{boundary}, mean of ' + datum.n_trials + ' trials: residual ' +"
            " format(datum.residual_percent, '.3f') + ' ± ' +"
            " format(datum.u_residual_percent, '.3f') + ' %'"
        ),
    )
    tooltip = ["trial", alt.Tooltip("residual_percent:Q", format=".2f")]
    hollow: Any = {"fill": PAPER, "stroke": TEXT, "fillOpacity": 1, "opacity": 1}
    layers = [
        chosen.transform_filter("datum.kind == 'noise'")
        .transform_calculate(below="-datum.u_residual_percent")
        .mark_area(interpolate="step", color=SOFT, opacity=0.25, aria=False)
        .encode(x=x, y=alt.Y("below:Q"), y2="u_residual_percent:Q"),
        dots.mark_circle(
            size=26, opacity=0.55, color="var(--s0)", ariaRoleDescription="trial"
        ).encode(x=x, y=y, tooltip=tooltip),
        bars.mark_rule(strokeWidth=1.6, color=TEXT, aria=False).encode(
            x=x, y=alt.Y("low:Q"), y2="high:Q"
        ),
        bars.mark_point(**hollow, strokeWidth=1.7, size=60, ariaRoleDescription="mean").encode(
            x=x, y=y, description="words:N", tooltip=[alt.Tooltip("words:N", title="mean")]
        ),
    ]
    chart = alt.layer(*layers).add_params(against)
    return _finished(chart, f"Residuals near the {boundary}", 260)


def _dots(trials: pd.DataFrame) -> pd.DataFrame:
    """Trials with a column for each covariate, not more than `MOST_DOTS`."""
    wide = trials.pivot(index="trial", columns="covariate", values="x")
    first = trials.drop_duplicates("trial").set_index("trial")["residual_percent"]
    wide = wide.reindex(first.index).assign(residual_percent=first)
    n = len(wide)
    keep = np.unique(np.linspace(0, n - 1, min(n, MOST_DOTS)).round().astype(int))
    return wide.iloc[keep].reset_index(names="trial")
