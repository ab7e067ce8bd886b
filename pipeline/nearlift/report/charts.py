"""Charts that a reader can point at and switch, as Vega-Lite by altair.

Colours are properties of the page's style sheet, so that a chart follows the reader's scheme.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from nearlift import nomenclature
from nearlift.declare import Boundary
from nearlift.errors import UsageError
from nearlift.nomenclature import VERDICTS, letter
from nearlift.reduction.quality import rejected
from nearlift.report.evidence import Evidence, pick, where
from nearlift.report.figures.fig2 import force_unit
from nearlift.report.figures.fig2 import table as fig2_table
from nearlift.report.figures.forest import interval
from nearlift.report.figures.residuals import residuals as trial_residuals
from nearlift.report.figures.residuals import table as residual_table
from nearlift.rounding import plain, plus_minus
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

Spec = dict[str, Any]
#: Significant digits of what is drawn.
DIGITS = 6
#: More residuals than this are drawn in part, evenly in run order.
MOST_DOTS = 1000
#: More throttles than this share a ramp of colours, and have no legend.
MOST_COLOURS = 6
SHAPES = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross")
TEXT, SOFT, PAPER, RULE = "var(--text)", "var(--soft)", "var(--paper)", "var(--rule)"
WORDS = {
    "throttle_percent": "throttle (%)",
    "run_order": "run order",
    "z_hat": "distance ẑ",
}


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


def _altair() -> Any:
    import altair

    altair.data_transformers.disable_max_rows()
    return altair


def _rounded(table: pd.DataFrame) -> pd.DataFrame:
    return table.map(
        lambda v: float(f"{v:.{DIGITS}g}") if isinstance(v, float) and math.isfinite(v) else v
    )


def _finished(chart: Any, description: str, height: int) -> Spec:
    """The specification, as wide as its place, in the page's colours."""
    axis = {
        "labelColor": TEXT,
        "titleColor": TEXT,
        "domainColor": RULE,
        "tickColor": RULE,
        "gridColor": RULE,
        "gridOpacity": 0.35,
        "labelFontSize": 12,
        "titleFontSize": 13,
        "titleFontWeight": "normal",
        "tickCount": 6,
    }
    legend = {"labelColor": TEXT, "titleColor": TEXT, "labelFontSize": 12, "labelLimit": 260}
    chart = (
        chart.properties(width="container", height=height, description=description, padding=4)
        .configure(font="system-ui, sans-serif", background="transparent")
        .configure_axis(**axis)
        .configure_legend(orient="bottom", symbolSize=70, padding=2, title=None, **legend)
        .configure_view(stroke=RULE)
    )
    spec: Spec = chart.to_dict(validate=False)
    del spec["$schema"]  # an address, which the page has no use for
    spec["config"]["legend"]["layout"] = {"bottom": {"direction": "vertical", "anchor": "start"}}
    return {**spec, "autosize": {"type": "fit-x", "contains": "padding"}}


def _ramp(n: int) -> list[str]:
    if n <= MOST_COLOURS:
        return [f"var(--s{i})" for i in range(n)]
    shares = (100 * i / (n - 1) for i in range(n))
    return [f"color-mix(in oklab, var(--ramp0), var(--ramp1) {s:.0f}%)" for s in shares]


# Figure 2


def fig2(evidence: Evidence) -> Chart:
    """A view for each boundary; the legend shows and hides throttles."""
    table = fig2_table(evidence)
    views: dict[str, Spec] = {
        b: _fig2_view(table[table["panel"] == b], cells(evidence, b), b)
        for b in evidence.boundaries
        if ((table["panel"] == b) & (table["kind"] == "data")).any()
    }
    return Chart(name="fig2", label="Lift change against distance", views=views, mark="cell")


def _fig2_view(table: pd.DataFrame, points: pd.DataFrame, boundary: str) -> Spec:
    alt = _altair()
    throttles = points.sort_values("throttle")["label"].unique().tolist()
    few = len(throttles) <= MOST_COLOURS
    shown = alt.selection_point(name="throttles", fields=["label"], bind="legend")
    x = alt.X("z_hat:Q", title="ẑ = distance / rotor radius").scale(type="log", nice=False)
    x = x.axis(format="~g", labelOverlap=True)
    y = alt.Y("delta_L_percent:Q", title="ΔL (%)")
    legend = alt.Legend(columns=4, title="throttle", symbolStrokeWidth=2) if few else None
    scale = alt.Scale(domain=throttles, range=_ramp(len(throttles)))
    stroke = alt.Stroke("label:N", scale=scale, legend=legend)
    shapes = [*SHAPES][: len(throttles)] if few else ["circle"]
    lines = table[table["kind"].isin(("band", "least squares", "model"))]
    lines = lines.sort_values("kind", key=lambda k: k != "band", kind="stable")
    names = lines["label"].unique().tolist()
    dashes = [[1, 0], [6, 3], [2, 2], [8, 3, 2, 3], [4, 4]]
    span = points["delta_L_percent"]
    room = 0.05 * float(span.max() - span.min() or 1)
    y = y.scale(domain=[float(span.min()) - room, float(span.max()) + room], nice=False)
    dash = alt.StrokeDash(
        "label:N",
        scale=alt.Scale(domain=names, range=dashes[: len(names)]),
        legend=alt.Legend(columns=1, symbolType="stroke", symbolStrokeColor=TEXT, symbolSize=400),
    )
    curve = alt.Chart(_rounded(lines))
    band = _rounded(table[(table["kind"] == "band") & table["lo90_percent"].notna()])
    overlays = _rounded(table[table["kind"] == "overlay"])
    dots = alt.Chart(_rounded(points)).transform_filter(shown)
    layers = [
        alt.Chart(band)
        .mark_area(opacity=0.3, color=SOFT, clip=True, aria=False)
        .encode(x=x, y=alt.Y("lo90_percent:Q"), y2="hi90_percent:Q"),
        curve.mark_line(clip=True, aria=False, strokeWidth=1.5, color=TEXT).encode(
            x=x, y=y, strokeDash=dash
        ),
        dots.transform_calculate(
            low="datum.delta_L_percent - datum.u", high="datum.delta_L_percent + datum.u"
        )
        .mark_rule(clip=True, aria=False)
        .encode(x=x, y=alt.Y("low:Q"), y2="high:Q", stroke=stroke),
        *(
            [
                alt.Chart(overlays)
                .mark_point(shape="cross", color=SOFT, clip=True)
                .encode(x=x, y=y, tooltip=["label", "z_hat", "delta_L_percent"])
            ]
            if len(overlays)
            else []
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
            tooltip=[alt.Tooltip(f"{n}:N", title=t) for n, t in TOOLTIP.items()],
        )
        .add_params(shown),
    ]
    chart = alt.layer(*layers).resolve_scale(strokeDash="independent", stroke="shared")
    return _finished(chart, f"Lift change near the {boundary} against distance", 240)


TOOLTIP = {
    "label": "throttle",
    "at": "ẑ",
    "delta": "ΔL",
    "force": "lift",
    "trials": "trials",
    "quality": "quality",
}


def cells(evidence: Evidence, boundary: Boundary) -> pd.DataFrame:
    """Points of Figure 2 at one boundary, with their trials and quality in words."""
    lift, trials = (where(evidence.table(p), boundary=boundary) for p in (LIFT, TRIALS))
    scale, unit = force_unit(evidence)
    table = pick(fig2_table(evidence), panel=boundary, kind="data")
    cell = {(t, z): i for i, (t, z) in enumerate(zip(lift["throttle"], lift["z_hat"], strict=True))}
    data, throttles = evidence.observations[boundary], np.asarray(trials["throttle"], dtype=float)
    if data.curve is not None:
        known = np.array(data.curve.shown)
        throttles = known[data.curve.nearest(throttles)]
    levels, out = np.unique(table["throttle_fraction"]).tolist(), rejected(trials["quality"])
    rows = []
    for i, (throttle, z) in enumerate(
        zip(table["throttle_fraction"].tolist(), table["z_hat"].tolist(), strict=True)
    ):
        mine = (trials["z_hat"] == z) & (throttles == throttle)
        codes = Counter(" ".join(trials["quality"][mine].tolist()).split())
        names = trials["trial"][mine & ~out].tolist()
        lost = int((mine & out).sum())
        at = cell.get((throttle, z))
        u = float(table["u_delta_L_percent"][i])
        delta = float(table["delta_L_percent"][i])
        lift_N, u_lift_N = (
            (math.nan, math.nan) if at is None else (lift["lift_N"][at], lift["u_lift_N"][at])
        )
        row: dict[str, Any] = {
            "throttle": throttle,
            "label": str(table["label"][i]),
            "z_hat": z,
            "delta_L_percent": delta,
            "u": u if math.isfinite(u) else 0.0,
            "area": max(90 - 15 * levels.index(throttle), 34),
            "at": f"{plain(z)} ({plain(1e3 * z * data.radius_m, 3)} mm)",
            "delta": f"{plus_minus(delta, u)} %"
            if u > 0
            else "0, by construction: L∞ is taken here",
            "force": f"{plus_minus(scale * lift_N, scale * u_lift_N)} {unit}",
            "trials": f"{len(names)} averaged: {', '.join(names[:6])}"
            + f" and {len(names) - 6} more" * (len(names) > 6)
            + f"; {lost} rejected" * (lost > 0),
            "quality": ", ".join(f"{c} {n}" for c, n in sorted(codes.items())) or "good",
        }
        row["words"] = f"{boundary}, " + "; ".join(f"{t} {row[n]}" for n, t in TOOLTIP.items())
        rows.append(row)
    return pd.DataFrame(rows)


# residuals


def residuals(evidence: Evidence) -> Chart:
    """A view for each boundary: every trial against the covariate that the reader chooses."""
    table = residual_table(evidence, every=True)
    views: dict[str, Spec] = {
        b: _residual_view(evidence, b, table[table["panel"] == b])
        for b in evidence.boundaries
        if (table["panel"] == b).any()
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


def _residual_view(evidence: Evidence, boundary: Boundary, table: pd.DataFrame) -> Spec:
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
    chosen = alt.Chart(_rounded(table[table["kind"] != "trial"])).transform_filter(
        "datum.covariate == against"
    )
    x = alt.X("x:Q", title=None).scale(zero=False, nice=False, padding=10)
    x = x.axis(labelExpr="against == 'z_hat' ? format(pow(10, datum.value), '.2~g') : datum.label")
    y = alt.Y("residual_percent:Q", title="residual (%)")
    dots = alt.Chart(_rounded(_dots(evidence, boundary, table))).transform_calculate(
        x="datum[against]"
    )
    bars = chosen.transform_filter("datum.kind == 'bin'").transform_calculate(
        low="datum.residual_percent - datum.u_residual_percent",
        high="datum.residual_percent + datum.u_residual_percent",
        words=(
            f"'{boundary}, mean of ' + datum.n_trials + ' trials: residual ' +"
            " format(datum.residual_percent, '.3f') + ' ± ' +"
            " format(datum.u_residual_percent, '.3f') + ' %'"
        ),
    )
    chart = alt.layer(
        chosen.transform_filter("datum.kind == 'noise'")
        .transform_calculate(below="-datum.u_residual_percent")
        .mark_area(interpolate="step", color=SOFT, opacity=0.25, aria=False)
        .encode(x=x, y=alt.Y("below:Q"), y2="u_residual_percent:Q"),
        dots.mark_circle(
            size=26, opacity=0.55, color="var(--s0)", ariaRoleDescription="trial"
        ).encode(
            x=x,
            y=y,
            tooltip=["trial", "throttle", alt.Tooltip("residual_percent:Q", format=".2f")],
        ),
        bars.mark_rule(strokeWidth=1.6, color=TEXT, aria=False).encode(
            x=x, y=alt.Y("low:Q"), y2="high:Q"
        ),
        bars.mark_point(
            fill=PAPER,
            stroke=TEXT,
            fillOpacity=1,
            opacity=1,
            strokeWidth=1.7,
            size=60,
            ariaRoleDescription="mean",
        ).encode(x=x, y=y, description="words:N", tooltip=[alt.Tooltip("words:N", title="mean")]),
    ).add_params(against)
    return _finished(chart, f"Residuals near the {boundary}", 260)


def _dots(evidence: Evidence, boundary: Boundary, table: pd.DataFrame) -> pd.DataFrame:
    """Trials with a column for each covariate."""
    data = trial_residuals(evidence, boundary).data
    rows = table[table["kind"] == "trial"]
    wide = rows.pivot(index="trial", columns="covariate", values="x")
    keep = np.unique(np.linspace(0, data.n - 1, min(data.n, MOST_DOTS)).round().astype(int))
    wide = wide.reindex(data.trial[keep])
    first = rows.drop_duplicates("trial").set_index("trial")["residual_percent"]
    return wide.assign(
        residual_percent=first.reindex(wide.index),
        throttle=[f"{100 * t:.3g} %" for t in data.throttle[keep]],
    ).reset_index(names="trial")


# campaigns compared


def forest(table: pd.DataFrame) -> Chart:
    """A view for each coefficient: a line for each campaign, the population beneath."""
    groups: Any = table.groupby(["panel", "coefficient"], sort=False)
    views = {f"{b}: {letter(c)}": _forest_view(rows, b, c) for (b, c), rows in groups}
    return Chart(name="forest", label="One coefficient over campaigns", views=views, mark="line")


def _forest_view(rows: pd.DataFrame, boundary: str, coefficient: str) -> Spec:
    alt = _altair()
    unit = str(rows["unit"].iloc[0])
    name = letter(coefficient)
    known: Any = rows.to_dict("list")
    judged = [VERDICTS.get(v, "") for v in known["verdict"]]
    ends = (known[end] for end in ("value", "lo90", "hi90"))
    values = [interval(*numbers) for numbers in zip(*ends, strict=True)]
    words = [
        f"{label}: {name} = {value}" + f"; {verdict}" * bool(verdict)
        for label, value, verdict in zip(known["label"], values, judged, strict=True)
    ]
    rows = rows.assign(words=words, text=values, judged=judged)
    title = name if unit in ("", "1") else f"{name} ({unit})"
    x = alt.X("value:Q", title=title).scale(zero=False)
    y = alt.Y("label:N", title=None, sort=None).axis(labelLimit=220)
    colour = alt.condition(
        "datum.kind == 'campaign'", alt.value("var(--s0)"), alt.value("var(--s1)")
    )
    base = alt.Chart(_rounded(rows))
    chart = alt.layer(
        base.transform_filter("datum.kind == 'population'")
        .mark_rect(color=SOFT, opacity=0.2, aria=False)
        .encode(x=alt.X("lo90:Q"), x2="hi90:Q"),
        base.mark_rule(strokeWidth=2, aria=False).encode(
            x=alt.X("lo90:Q"), x2="hi90:Q", y=y, color=colour
        ),
        base.mark_point(filled=True, size=80, opacity=1, ariaRoleDescription="line").encode(
            x=x,
            y=y,
            color=colour,
            description="words:N",
            tooltip=[
                alt.Tooltip(f"{n}:N", title=t)
                for n, t in (
                    ("label", "campaign"),
                    ("vehicle", "vehicle"),
                    ("text", "value, 90 %"),
                    ("judged", "verdict"),
                )
            ],
        ),
    )
    return _finished(
        chart, f"{name} near the {boundary}, campaign by campaign", 30 * len(rows) + 10
    )
