"""The loop in pictures: at each boundary the residual before and after, the candidates, the
cross-validated error, the coefficient.

An adequate boundary has no panels for candidates and for the residual after, an unexplained one
none for the latter. L_inf is free at every throttle. So throttle and backlash are drawn against
distance, a series for each level; time is drawn as run order, since sessions may lie days apart.
"""

from __future__ import annotations

import math
import string
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import BOUNDARIES, Boundary
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import lift_ratio, usable
from nearlift.nomenclature import SCHEDULE_WORDS
from nearlift.reduction.stretch import SD_PER_MAD
from nearlift.report.evidence import Evidence, Part, frame, groups, lift_inf_N, pick, records
from nearlift.report.figures import binning, style
from nearlift.report.figures.fig2 import references
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import FITTED, FLOOR, PAGE_IN, SERIES, note, plain_text
from nearlift.report.findings import RankedCandidate, ranked
from nearlift.report.phrases import along
from nearlift.results.diagnosis import FORM_SD, BoundaryDiagnosis
from nearlift.rounding import plain
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS

#: So many covariates, candidates, coefficients, and doubts of each, are drawn.
COVARIATES, CANDIDATES, COEFFICIENTS, DOUBTS = 2, 8, 2, 3
#: Reach of the axis in standard deviations of a trial; trials beyond are ticks at its edge.
REACH = 3.2
COLUMNS = (
    *("panel", "letter", "part", "kind", "when", "covariate", "series", "label", "note", "unit"),
    *("x", "value", "u", "lo90", "hi90", "n_trials"),
)
HEADLINES = {
    "adequate": "no residual structure detected",
    "unexplained": "structure that no candidate explains",
}
#: Before and after, in colour and in symbol.
LOOKS = {"before": SERIES[1], "after": SERIES[2]}
#: A candidate that was not rejected.
MEANT = {"named": "named", "rival": "rival", "worse": "accepted"}
#: Column of a covariate by the schedule's word, and the second covariate whose levels are series.
AXES = {
    "distance": ("z_hat", ""),
    "throttle": ("z_hat", "throttle_percent"),
    "approach": ("z_hat", "approach"),
    "tilt": ("tilt_rad", ""),
    "start": ("run_order", ""),
    "supply": ("supply_V", ""),
    "temperature": ("temperature_K", ""),
    "previous_throttle": ("previous_throttle_percent", ""),
    "previous_distance": ("previous_z_hat", ""),
}


def table(evidence: Evidence) -> pd.DataFrame:
    """Everything that is drawn, a row each.

    `letter` names the panel, `part` is verdict, residual, candidate, error or coefficient, `when`
    before or after; `note` the series' covariate, a candidate's reason or a coefficient's
    condition. Residuals and errors are in percent of lift; a candidate's value is twice the log
    evidence by which it trails the best.
    """
    letters = iter(string.ascii_letters)
    parts: list[Part] = []
    for boundary, diagnosis in ((b, evidence.diagnosed(b)) for b in BOUNDARIES):
        if not diagnosis:
            continue
        verdict = {"part": "verdict", "kind": diagnosis.verdict, "label": _headline(diagnosis)}
        parts.append({"panel": boundary, **verdict})
        panels = [("residual", rows) for rows in _residuals(evidence, boundary, diagnosis)]
        panels.append(("candidate", _candidates(diagnosis)))
        panels.append(("error", _errors(evidence, boundary, diagnosis)))
        panels.append(("coefficient", _coefficients(evidence, boundary, diagnosis)))
        for part, rows in panels:
            if rows:
                shared = {"panel": boundary, "part": part, "letter": next(letters)}
                parts += [{**shared, **row} for row in rows]
    return frame(parts, COLUMNS)


def _headline(diagnosis: BoundaryDiagnosis) -> str:
    named = ((e.name, diagnosis.stand_ins(e)) for e in diagnosis.effects)
    return HEADLINES.get(diagnosis.verdict) or ", and ".join(
        f"{name} (or {', '.join(others)})" if others else name for name, others in named
    )


def _covariates(diagnosis: BoundaryDiagnosis) -> list[str]:
    """Covariates to draw: first that of the most significant structure.

    Where structure stays unexplained, that of the next follows. Time follows where the gain
    wanders, and after two effects the covariate of the other effect.
    """
    structure = diagnosis.structure
    shown = [s for s in structure[1:] if s.significant and diagnosis.verdict == "unexplained"]
    words = [s.covariate for s in (*structure[:1], *shown)] or ["distance"]
    words += ["start"] if diagnosis.random_walk_gain else []
    if len(diagnosis.effects) > 1:
        known = {e.name: e.varies_with for e in catalogue.effects()}
        varying = [known[e.name] for e in diagnosis.effects if e.name in known]
        words += [SCHEDULE_WORDS.get(name, name) for name in varying]
    return list(dict.fromkeys(words))[:COVARIATES]


def _residuals(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> Iterator[list[Part]]:
    """Rows of each panel of each covariate: before and, where an effect was named, after. `kind` is
    trial, bin, floor or session (a new one).
    """
    model, fit = evidence.base(boundary)
    data = evidence.observations[boundary]
    left = evidence.frame(LOOP_RESIDUALS, boundary=boundary).set_index("trial")
    data = data.take(usable(model, data) & np.isin(data.trial, left.index))
    if not data.n:
        return
    data = derive(data, lift_inf_N(fit, data), lift_ratio(model, data, fit.values))
    known = binning.columns(data)
    both = 100 * left.loc[data.trial, ["before", "after"]].reset_index(drop=True)
    for word in _covariates(diagnosis):
        name, second = AXES.get(word, (word, ""))
        if not np.isfinite(np.asarray(known.get(name, np.nan), dtype=float)).any():
            name, second = AXES["start"]
        rows = both.assign(x=known[name], level=known[second] if second else 0.0)
        series = rows[np.isfinite(rows).all(axis=1)].groupby("level")
        shared = {"covariate": name, "unit": "%", "note": second}
        floor = diagnosis.error.noise_floor if diagnosis.error else np.nan
        for when in ("before", "after") if diagnosis.verdict == "effect" else ("before",):
            parts: list[Part] = [{"kind": "floor", "value": 100 * floor}]
            for _, mine in series:
                x, y, at = mine["x"].to_numpy(), mine[when].to_numpy(), mine.index.to_numpy()
                # the same bins before and after
                label = binning.bins(x)
                if name == "run_order":
                    label = binning.time_bins(mine["before"].to_numpy(), data.session[at])
                count, centre, mean, error = binning.means(x, y, label)
                named = {"series": _level(second, mine["level"].iloc[0])}
                trials = {"label": data.trial[at], "x": x, "value": y}
                bins = {"x": centre, "value": mean, "u": error, "n_trials": count}
                parts += [{"kind": "trial", **named, **trials}, {"kind": "bin", **named, **bins}]
            if name == "run_order":
                parts.append({"kind": "session", "x": np.flatnonzero(np.diff(data.session)) + 1.5})
            yield [{**shared, "when": when, **part} for part in parts]


def _level(second: str, level: float) -> str:
    """Label of a series; empty where there is one."""
    if second == "approach":
        return "moved away" if level > 0 else "moved closer"
    return f"{plain(level, 3)} %" if second else ""


def _candidates(diagnosis: BoundaryDiagnosis) -> list[Part]:
    """The best candidates, the rejected ones with what they leave; the best single effect always,
    as it shows why one is not enough.
    """
    listed = ranked(diagnosis)
    single = next((c for c in listed if "+" not in c.tried.name), None)
    shown = listed[:CANDIDATES]
    if single is not None and single not in shown:
        shown[-1] = single
    return [
        {"kind": c.kind, "label": c.tried.name, "note": _outcome(diagnosis, c), "value": c.behind}
        | {"unit": "2 ln evidence"}
        for c in shown
    ]


def _outcome(diagnosis: BoundaryDiagnosis, candidate: RankedCandidate) -> str:
    """Outcome of a candidate with its probability, or the reason of its rejection."""
    if candidate.kind == "rejected":
        if candidate.refuted or candidate.tried.judged_by:
            return "not confirmed" if candidate.refuted else "too little"
        left_in = candidate.tried.left_in
        return f"leaves {along(left_in)}" if left_in else "explains too little"
    effects = {*candidate.tried.name.split(" + ")}
    known = {frozenset(p.effects): p.probability for p in diagnosis.probabilities or ()}
    probability = known.get(frozenset(effects))
    return MEANT[candidate.kind] + (f", {100 * probability:.0f} %" if probability else "")


def _errors(evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis) -> list[Part]:
    """Held-out errors as results.json has them, with their 90 %, and the noise floor."""
    error, quoted = diagnosis.error, evidence.quoted(boundary).error
    if not error or quoted is None:
        return []
    rows: list[Part] = [{"kind": "floor", "unit": "%", "value": 100 * quoted.noise_floor}]
    for when in ("before", "after") if diagnosis.verdict == "effect" else ("before",):
        interval = getattr(error, when)
        values = {"value": getattr(quoted, when), "lo90": interval.lo90, "hi90": interval.hi90}
        percent = {name: 100 * value for name, value in values.items()}
        rows.append({"kind": "rmse", "unit": "%", "when": when, **percent})
    return rows


def _coefficients(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> list[Part]:
    """The first coefficients as quoted, then under other assumptions, and the literature's value
    where there is one.
    """
    rows: list[Part] = []
    when = "after" if diagnosis.verdict == "effect" else "before"
    for name, c in [*evidence.quoted(boundary).coefficients.items()][:COEFFICIENTS]:
        about = {"label": name, "unit": c.unit}
        stated: list[Any] = [("quoted", "", c)]
        stated += [("doubt", d.condition, d) for d in c.doubts[:DOUBTS]]
        for kind, condition, e in stated:
            value = {"value": e.value, "lo90": e.lo90, "hi90": e.hi90}
            rows.append({"kind": kind, "when": when, **about, "note": condition, **value})
        for reference in references(evidence, boundary):
            source = reference.label.partition("(")[2].rstrip(")")
            if reference.model == diagnosis.base_model and name in reference.arguments and source:
                value = {"value": float(reference.arguments[name])}
                rows.append({"kind": "reference", **about, "note": source, **value})
    return rows


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption of each panel; letters as in the picture."""
    effect = (table["when"] == "after").any()
    letters = table.groupby("part")["letter"].agg(lambda column: ", ".join(column.unique()))
    parts = [
        (
            f"Relative residuals ({letters.get('residual', '')}) against the covariate of the"
            " largest test, and of a second effect. Dots: trials; beyond the axis, ticks at its"
            " edge. Symbols: means with their standard error. Shade: ± the noise floor."
        )
    ]
    if effect:
        parts.append(
            f"After: the effect added in its stated form, uncertain by {100 * FORM_SD:.0f} %."
        )
    best = "best accepted" if effect else "best"
    said = {
        "candidate": f"Candidates ({{}}): 2 ln B of the {best} over each. Hollow: rejected."
        " Right: the outcome, with the probability of what was accepted.",
        "error": "Cross-validated error ({}), 90 %. Dashed: noise floor.",
        "coefficient": "Coefficients ({}), 90 %. Bold: as quoted. Numbered: other assumptions.",
    }
    if (table["kind"] == "session").any():
        parts.append("Dashed vertical lines: a new session.")
    parts += [text.format(letters[part]) for part, text in said.items() if part in letters]
    return " ".join([*parts, *(_boundary(table, b) for (b,) in groups(table, "panel"))])


def _boundary(table: pd.DataFrame, boundary: str) -> str:
    mine = pick(table, panel=boundary)
    text = f"{boundary.capitalize()}: {pick(mine, part='verdict')['label'].iloc[0]}"
    rmse = pick(mine, kind="rmse")["value"]
    if len(rmse):
        values = " to ".join(f"{plain(v, 3)} %" for v in rmse)
        floor = float(pick(mine, part="error", kind="floor")["value"].iloc[0])
        text += f"; cross-validated error {values}, noise floor {plain(floor, 3)} %"
    conditions = pick(mine, kind="doubt")["note"].unique()
    listed = "; ".join(f"({i}) {c}" for i, c in enumerate(conditions, 1))
    return text + "." + (f" Assumptions: {listed}." if listed else "")


def draw(table: pd.DataFrame) -> Figure:
    """Blocks from top to bottom, no higher than the page."""
    blocks = [pick(table, panel=b) for (b,) in groups(table, "panel")]
    lines = [_lines(block) for block in blocks]
    # a candidate of two effects takes two lines
    pairs = [sum("+" in name for name in pick(b, part="candidate")["label"]) for b in blocks]
    heights = [1.72 if len(of) == 1 else 3.15 + 0.1 * n for of, n in zip(lines, pairs, strict=True)]
    height = min(style.DOUBLE_IN / 6.75 * sum(heights), PAGE_IN)
    figure = Figure(figsize=(style.DOUBLE_IN, height), layout="constrained")
    layout: Any = figure.get_layout_engine()
    layout.set(w_pad=0.06, h_pad=0.03, hspace=0.03, wspace=0.03)
    parts = figure.subfigures(len(blocks), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, block, panels, n in zip(parts, blocks, lines, pairs, strict=True):
        verdict = pick(block, part="verdict").iloc[0]
        headline = plain_text(titled(str(verdict["label"])))
        part.suptitle(
            f"{verdict['panel'].capitalize()}. {verdict['kind'].capitalize()}: {headline}",
            x=0.008, ha="left", fontsize=style.TEXT_PT + 0.5, fontweight="bold",
        )  # fmt: skip
        _block(part, block, panels, (1.0, 1.05 + 0.065 * n))
    return figure


def _lines(block: pd.DataFrame) -> list[list[tuple[str, str]]]:
    """Letter and part of the panels of a block, line by line. Residuals have a line of their own if
    they are two, or if candidates follow.
    """
    panels = [(letter, part) for letter, part in groups(block, "letter", "part") if letter]
    residuals = [panel for panel in panels if panel[1] == "residual"]
    others = [panel for panel in panels if panel[1] != "residual"]
    one_line = len(residuals) < 2 and not (block["part"] == "candidate").any()
    return [panels] if one_line else [residuals, others]


def _block(
    part: SubFigure,
    block: pd.DataFrame,
    lines: list[list[tuple[str, str]]],
    ratios: tuple[float, float],
) -> None:
    several = pick(block, part="coefficient")["label"].nunique() > 1
    wide = {"residual": 1.6, "candidate": 1.7, "error": 0.9, "coefficient": 2 if several else 1.25}
    effect = (block["when"] == "after").any()
    grid: Any = part.add_gridspec(len(lines), 1, height_ratios=ratios[: len(lines)])
    for cell, line in zip(grid, lines, strict=False):
        widths = [wide[kind] for _, kind in line]
        inside = cell.subgridspec(1, max(len(line), 1), width_ratios=widths or [1])
        first: Any = None
        for place, (letter, kind) in zip(inside, line, strict=False):
            rows = pick(block, letter=letter)
            if kind == "coefficient":
                ax, title = _draw_coefficients(place, rows), "coefficient"
            else:
                ax = part.add_subplot(place, sharey=first if kind == "residual" else None)
            if kind == "residual":
                _draw_residual(ax, rows, labelled=first is None)
                first = first or ax
                title = f"residual {rows['when'].iloc[0]}" if effect else "residual"
            elif kind == "candidate":
                _draw_candidates(ax, rows)
                rejected = (rows["kind"] == "rejected").all()
                title = "candidates, all rejected" if rejected else "candidates"
            elif kind == "error":
                _draw_error(ax, rows)
                title = "held-out error"
            ax.set_title(f"{letter}) {title}", pad=3)


def _draw_residual(ax: Axes, rows: pd.DataFrame, labelled: bool) -> None:
    """Cloud, means over bins with their standard error, the noise floor as a shade; trials beyond
    the axis as ticks at its edge.
    """
    covariate, when, second = rows[["covariate", "when", "note"]].iloc[0]
    cloud, means = pick(rows, kind="trial"), pick(rows, kind="bin")
    floor = float(pick(rows, kind="floor")["value"].iloc[0])
    size = cloud["value"].abs()
    reach = min(REACH * SD_PER_MAD * float(size.median()), 1.08 * float(size.max()))
    reach = max(reach, 1.15 * float((means["value"].abs() + means["u"].fillna(0)).max()), 1e-6)
    if labelled:
        ax.set_ylabel("relative residual (%)")
    else:
        # the panel before has the larger residuals
        reach = max(reach, ax.get_ylim()[1])
        ax.tick_params(axis="y", labelleft=False)
    if np.isfinite(floor):
        ax.axhspan(-floor, floor, color=FLOOR, linewidth=0, zorder=0)
    names = means["series"].unique()
    lone = len(names) == 1
    colour = SERIES[0][0] if lone else "0.55"
    inside, beyond = cloud[size <= reach], cloud[size > reach]
    style.dots(ax, inside.x, inside.value, colour)
    edge = 0.965 * reach * np.sign(beyond["value"])
    ax.plot(beyond.x, edge, "|", color=colour, markersize=3.5, markeredgewidth=0.5)
    style.zero(ax)
    for x in pick(rows, kind="session")["x"]:
        ax.axvline(x, color="0.6", linewidth=0.5, linestyle=(0, (2, 2)), zorder=0.5)
    for i, name in enumerate(names):
        mine = pick(means, series=name)
        style.bars(
            ax, mine.x, mine.value, mine.u, LOOKS[when] if lone else SERIES[i % len(SERIES)],
            linestyle="none" if lone else "-", linewidth=0.6, markersize=3.4 if lone else 2.8,
            markeredgecolor="white", markeredgewidth=0.3, label=plain_text(name),
        )  # fmt: skip
    ax.set_ylim(-reach, reach)
    binning.abscissa(ax, covariate, np.unique(means["x"]).tolist())
    if not lone:
        ax.legend(
            title="throttle" if second == "throttle_percent" else None, ncols=len(names),
            columnspacing=0.7, handlelength=1.1, frameon=True, framealpha=0.85, edgecolor="none",
        )  # fmt: skip


def _draw_candidates(ax: Axes, rows: pd.DataFrame) -> None:
    """Draw the deficit of each candidate from the best, with its outcome on the right.

    The axis is linear to ten and logarithmic beyond.
    """
    place = np.arange(len(rows))[::-1]
    ax.set_xscale("symlog", linthresh=10.0, linscale=1.0)
    ax.axvline(0, color="0.3", linewidth=0.6, zorder=1)
    ax.hlines(place, 0, rows.value, color="0.55", linewidth=0.6, zorder=2)
    for kind, x, y in zip(rows.kind, rows.value, place, strict=True):
        colour, marker = LOOKS["after"] if kind in ("named", "rival") else SERIES[0]
        inside = "white" if kind == "rejected" else colour
        ax.plot(
            [x], [y], marker, color=colour, markerfacecolor=inside, markersize=4,
            markeredgewidth=0.9, zorder=3,
        )  # fmt: skip
    ax.set_yticks(place, [style.effects(str(name)) for name in rows["label"]], linespacing=0.9)
    outcomes = ax.secondary_yaxis("right")
    outcomes.set_yticks(place, [plain_text(text) for text in rows["note"]], color="0.25")
    for axis in (ax, outcomes):
        axis.tick_params(axis="y", length=0)
    ax.set_ylim(-0.7, len(rows) - 0.3)
    low, far = float(rows["value"].min()), max(1.6 * float(rows["value"].max()), 40.0)
    ax.set_xlim(min(1.4 * low, -1.2), far)
    ticks = [t for t in (-100, -10, 0, 10, 100, 1000, 10000, 100000) if low <= t <= far]
    ax.set_xticks(ticks, [f"{t:,}".replace(",", "\u2009").replace("-", "−") for t in ticks])
    ax.tick_params(axis="x", which="minor", length=0)
    ax.set_xlabel(r"$2 \,\ln B$, best over candidate")


def _draw_error(ax: Axes, rows: pd.DataFrame) -> None:
    """Root mean square on held-out trials with its 90 % interval, and the noise floor."""
    shown, floor = pick(rows, kind="rmse"), float(pick(rows, kind="floor")["value"].iloc[0])
    if np.isfinite(floor):
        ax.axhline(floor, color=FITTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
    low = (shown["value"] - shown["lo90"]).fillna(0)
    high = (shown["hi90"] - shown["value"]).fillna(0)
    for i, when in enumerate(shown["when"]):
        reach = [[low[i]], [high[i]]]
        style.bars(ax, [i], [shown["value"][i]], reach, LOOKS[when], markersize=4, capsize=2)
    for i, (value, up) in enumerate(zip([*shown["value"], floor], [*high, 0.0], strict=True)):
        if math.isfinite(value):
            paper = {"facecolor": "white", "edgecolor": "none", "pad": 0.2}
            note(ax, f"{value:#.3g}", (i, value + up), (0, 2.5), ha="center", bbox=paper, zorder=4)
    n = len(shown)
    ax.set_ylim(0, 1.3 * float(np.nanmax([floor, *(shown["value"] + high)])))
    ax.set_xlim(-0.6, n + 0.6)
    ax.set_xticks(range(n + 1), [*(shown["when"] if n > 1 else ["base"]), "floor"])
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel("RMSE (% of lift)")


def _draw_coefficients(place: Any, rows: pd.DataFrame) -> Axes:
    """Each coefficient as quoted, and beneath it on each condition, every interval whole; the axes
    of the first.
    """
    names = rows["label"].unique()
    conditions = [*pick(rows, kind="doubt")["note"].unique()]
    axes = place.subgridspec(1, len(names), wspace=0.08).subplots(squeeze=False)[0]
    for ax, name in zip(axes, names, strict=True):
        _draw_coefficient(ax, pick(rows, label=name), conditions)
        ax.set_xlabel(style.labelled(name))
        ax.tick_params(axis="y", length=0, labelleft=ax is axes[0])
    return axes[0]  # type: ignore[no-any-return]


def _draw_coefficient(ax: Axes, rows: pd.DataFrame, conditions: list[str]) -> None:
    stated, reference = rows[rows["kind"] != "reference"], pick(rows, kind="reference")
    ends = pd.concat([stated["lo90"], stated["hi90"], reference["value"]])
    low, high = float(ends.min()), float(ends.max())
    margin = 0.08 * (high - low) or 1e-3 * max(abs(high), 1e-3)
    ax.set_xlim(low - margin, high + margin)
    n = len(conditions)
    for value, source in zip(reference["value"], reference["note"], strict=True):
        ax.axvline(value, color="0.35", linewidth=0.8, linestyle=(0, (5, 2)), zorder=1)
        side, apart = ("left", 2.5) if value < (low + high) / 2 else ("right", -2.5)
        words = plain_text(f"{source} {value:g}")
        note(ax, words, (value, n + 0.45), (apart, 0), ha=side, color="0.25")
    for row in records(stated):
        y = n - (1 + conditions.index(row.note) if row.kind == "doubt" else 0)
        colour, marker = LOOKS[str(row.when)]
        width = 2.2 if row.kind == "quoted" else 0.9
        ax.plot([row.lo90, row.hi90], [y, y], color=colour, linewidth=width, zorder=2)
        ax.plot(
            [row.value], [y], marker, color=colour, markersize=3.6, markerfacecolor="white",
            markeredgewidth=0.8, zorder=3,
        )  # fmt: skip
        # on top: an interval may be narrower than its symbol
        ax.plot([row.lo90, row.hi90], [y, y], "|", color=colour, markersize=7, zorder=4)
    ax.set_yticks(range(n, -1, -1), ["quoted", *(f"if ({i + 1})" for i in range(n))])
    ax.set_ylim(-0.6, n + (1.0 if len(reference) else 0.6))
    ax.xaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 2.5, 5, 10]))
    ax.xaxis.set_major_formatter("{x:g}")


FIGURE = FigureSpec(
    "diagnosis", "The loop: residual, candidates, error, coefficient",
    (TRIALS, FIT, DIAGNOSIS, LOOP_RESIDUALS), table, caption, draw, "value",
    ("panel", "part", "when"),
)  # fmt: skip
