"""The loop in pictures: at each boundary the residual before and after, the candidates, the
cross-validated error, the coefficient.

The column `letter` of the table names the panel. An adequate boundary has no panels for candidates
and for the residual after, an unexplained one none for the latter. Residuals are drawn against the
covariate of the largest test. L_inf is free at every throttle, so throttle and backlash are drawn
against distance, a series for each level; time is drawn as run order, since sessions may lie days
apart.
"""

from __future__ import annotations

import math
import string
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.textpath import TextPath
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from nearlift import nomenclature
from nearlift.catalogue import titled
from nearlift.declare import BOUNDARIES, Boundary, FloatArray
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import lift_ratio, usable
from nearlift.report.evidence import (
    Columns,
    Evidence,
    Rows,
    distinct,
    lift_inf_N,
    select,
    stack,
    where,
)
from nearlift.report.figures.covariate_bins import (
    axis_of,
    bins_of,
    chosen_covariates,
    column_of,
    series_of,
    smooth_curve,
)
from nearlift.report.figures.fig2 import references
from nearlift.report.figures.residuals import (
    DISCRETE,
    DISTANCES,
    in_units,
    means,
)
from nearlift.report.figures.residuals import label as covariate_label
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import (
    FITTED,
    SERIES,
    Style,
    dots,
    effects,
    note,
    plain_log,
    plain_text,
)
from nearlift.report.findings import RankedCandidate, ranked
from nearlift.report.phrases import along
from nearlift.results import Observations
from nearlift.results.diagnosis import FORM_SD, RIVAL_MAX_2LNB, BoundaryDiagnosis
from nearlift.rounding import plain
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS

#: So many candidates are drawn.
CANDIDATES = 8
#: And so many coefficients of a base model.
COEFFICIENTS = 2
#: And so many of the conditions on which it would be another.
DOUBTS = 3
#: Reach of the axis in standard deviations of a trial; trials beyond are ticks at its edge.
REACH = 3.2
COLUMNS = (
    *("panel", "letter", "part", "kind", "when", "covariate", "series", "label", "note", "unit"),
    *("x", "value", "u", "lo90", "hi90", "n_trials"),
)
MEANINGS = {
    "adequate": "no residual structure, so no effect is added",
    "unexplained": ("structure that no candidate explains; the curve only follows it"),
}
#: Heights in inches at 6.75 in of width.
TALL, LOW = 3.15, 1.72
#: What a candidate of two effects, beneath one another, takes more.
PAIR = 0.1
CLOUD = SERIES[0][0]
#: Before and after, in colour and in symbol.
LOOKS = {"before": SERIES[1], "after": SERIES[2]}
FLOOR = "0.88"
LABELS = {
    "previous_throttle_percent": "previous throttle (%)",
    "order_in_visit": "order within a visit",
}
#: Where the axis of evidence turns logarithmic.
LINEAR = 10.0
#: No axis of evidence need go farther for its words' sake.
FARTHEST = 1e6
#: What a candidate is called that was not rejected.
MEANT = {"named": "named", "rival": "rival", "worse": "accepted"}
#: A word's distance from its symbol in points, and the panel's width as a part of the figure's.
BESIDE, PANEL = 4.5, 0.29
#: A floor lower than this part of its axis has its number above it.
BENEATH = 1 / 6
#: Behind numbers on a line.
PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 0.2}


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopNumber:
    """A number of a candidate, an error or a coefficient, with the columns of the table."""

    kind: str
    when: str = ""
    label: str = ""
    note: str = ""
    unit: str
    value: float
    lo90: float = math.nan
    hi90: float = math.nan


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `panel` (boundary), `letter`, `part` (verdict,
    residual, candidate, error, coefficient), `kind`, `when` (before or after), `covariate` and
    `series` (of a residual), `label` (trial, candidate or coefficient), `note`, `unit`, `x`,
    `value`, `u` (one standard error), `lo90`, `hi90`, `n_trials`. A candidate's value is twice the
    log evidence by which it trails the best.
    """
    letters = iter(string.ascii_lowercase + string.ascii_uppercase)
    parts: list[dict[str, object]] = []
    for boundary, diagnosis in ((b, evidence.diagnosed(b)) for b in BOUNDARIES):
        if not diagnosis:
            continue
        verdict = {"part": "verdict", "kind": diagnosis.verdict, "label": _headline(diagnosis)}
        parts.append({"panel": boundary, **verdict})
        for word in chosen_covariates(diagnosis):
            drawn = residuals(evidence, boundary, diagnosis, word)
            for when in distinct(drawn["when"]) if drawn else ():
                parts.append({**where(drawn, when=when), "letter": next(letters)})
        numbers = {
            "candidate": candidates(diagnosis),
            "error": errors(evidence, boundary, diagnosis),
            "coefficient": coefficients(evidence, boundary, diagnosis),
        }
        for part, rows in numbers.items():
            if rows:
                shared = {"panel": boundary, "part": part, "letter": next(letters)}
                parts += [{**shared, **asdict(row)} for row in rows]
    return stack(parts, COLUMNS)


def _headline(diagnosis: BoundaryDiagnosis) -> str:
    if diagnosis.verdict == "adequate":
        return "nothing beyond the noise"
    if diagnosis.verdict == "unexplained":
        return "structure that no candidate explains"
    named = ((e.name, diagnosis.stand_ins(e)) for e in diagnosis.effects)
    return ", and ".join(
        f"{name} (or {', '.join(others)})" if others else name for name, others in named
    )


def residuals(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis, word: str
) -> Columns:
    """Rows of one covariate, in percent: `trial` (`beyond` where outside the axis), `bin`, `curve`,
    `floor`, `reach`, `session`.

    `when` is before and, where an effect was named, after. A curve without a name follows what
    stays unexplained.
    """
    data, both = _joined(evidence, boundary)
    if not data.n:
        return {}
    axis = axis_of(word, data)
    whens = ("before", "after") if diagnosis.verdict == "effect" else ("before",)
    covariate = column_of(axis.column, data)
    known = np.isfinite(covariate) & np.isfinite(both["before"]) & np.isfinite(both["after"])
    labels: dict[str, NDArray[np.int64]] = {}
    parts: list[dict[str, object]] = []
    for when in whens:
        for name, level in series_of(axis.series, data):
            mine = level & known
            x, y, trial = covariate[mine], both[when][mine], data.trial[mine]
            if not len(x):
                continue
            # the same bins before and after
            bins = labels.setdefault(name, bins_of(axis.column, x, y, data.session[mine]))
            count, centre, mean, error = means(x, y, bins)
            drawn = {"when": when, "series": name}
            parts += [
                {**drawn, "kind": "trial", "label": trial, "x": x, "value": y},
                {**drawn, "kind": "bin", "x": centre, "value": mean, "u": error, "n_trials": count},
            ]
            if diagnosis.verdict == "unexplained" and not axis.series:
                along, curve = smooth_curve(axis.column, x, y)
                parts.append({**drawn, "kind": "curve", "x": along, "value": curve})
        parts.append({"kind": "floor", "when": when, "value": 100 * diagnosis.noise_floor})
        if axis.column == "run_order":
            starts = np.flatnonzero(np.diff(data.session)) + 1.5
            parts.append({"kind": "session", "when": when, "x": starts, "value": 0.0})
    shared = {
        "panel": boundary,
        "part": "residual",
        "covariate": axis.column,
        "unit": "%",
        # what the series are levels of, for the legend
        "note": axis.series,
    }
    table = stack([{**part, **shared} for part in parts], COLUMNS)
    reach = _reach(table)
    far = (table["kind"] == "trial") & (np.abs(table["value"]) > reach)
    table["kind"][far] = "beyond"
    ends = [{"kind": "reach", "when": when, "value": reach, **shared} for when in whens]
    return stack([table, *ends], COLUMNS)


def _joined(evidence: Evidence, boundary: Boundary) -> tuple[Observations, dict[str, FloatArray]]:
    """The boundary's trials with derived covariates, and their residuals before and after in
    percent.
    """
    model, fit = evidence.base(boundary)
    data = evidence.observations[boundary]
    data = data.take(usable(model, data))
    data = derive(data, lift_inf_N(fit, data), lift_ratio(model, data, fit.values))
    table = where(evidence.table(LOOP_RESIDUALS), boundary=boundary)
    row = {str(trial): i for i, trial in enumerate(table["trial"])}
    data = data.take(np.array([str(t) in row for t in data.trial], dtype=bool))
    at = np.array([row[str(t)] for t in data.trial], dtype=int)
    return data, {when: 100 * table[when][at].astype(float) for when in ("before", "after")}


def _reach(table: Columns) -> float:
    """Half the height of the axis: most of the trials before, and every mean with its standard
    error.
    """
    cloud = np.abs(where(table, kind="trial", when="before")["value"])
    means = where(table, kind="bin")
    ends = np.abs(means["value"]) + np.nan_to_num(means["u"])
    most = min(REACH * 1.4826 * float(np.median(cloud)), 1.08 * float(cloud.max()))
    return float(max(most, 1.15 * ends.max(initial=0.0), 1e-6))


def candidates(diagnosis: BoundaryDiagnosis) -> list[LoopNumber]:
    """The best candidates, the rejected ones with what they leave."""
    listed = ranked(diagnosis)
    shown = listed[:CANDIDATES]
    if listed and not any("+" not in c.tried.name for c in shown):
        # the best single effect shows why one is not enough
        shown = [*shown[:-1], next((c for c in listed if "+" not in c.tried.name), shown[-1])]
    return [
        LoopNumber(
            kind=c.kind,
            label=c.tried.name,
            note=_why_not(c) if c.kind == "rejected" else "",
            unit="2 ln evidence",
            value=c.behind,
        )
        for c in shown
    ]


def _why_not(candidate: RankedCandidate) -> str:
    if candidate.refuted:
        return "not confirmed"
    if candidate.tried.judged_by:
        return "too little"
    if candidate.tried.left_in:
        return f"leaves {along(candidate.tried.left_in)}"
    return "explains too little"


def errors(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> list[LoopNumber]:
    """Held-out errors in percent of lift as results.json has them, before and (where an effect was
    named) after, with their 90 %, and the noise floor.
    """
    error, quoted = diagnosis.error, evidence.quoted(boundary).error
    if not error or quoted is None:
        return []
    held_out = [("before", quoted.before, error.before)]
    if diagnosis.verdict == "effect":
        held_out.append(("after", quoted.after, error.after))
    return [
        LoopNumber(kind="floor", unit="%", value=100 * quoted.noise_floor),
        *(
            LoopNumber(
                kind="rmse",
                when=when,
                unit="%",
                value=100 * value,
                lo90=100 * interval.lo90,
                hi90=100 * interval.hi90,
            )
            for when, value, interval in held_out
        ),
    ]


def coefficients(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> list[LoopNumber]:
    """The first coefficients as quoted, beneath them what they would be on other conditions, and
    the literature's value where there is one.
    """
    rows = []
    when = "after" if diagnosis.verdict == "effect" else "before"
    for name, c in [*evidence.quoted(boundary).coefficients.items()][:COEFFICIENTS]:
        number = LoopNumber(
            kind="quoted",
            when=when,
            label=name,
            unit=c.unit,
            value=c.value,
            lo90=c.lo90,
            hi90=c.hi90,
        )
        rows.append(number)
        for d in c.doubts[:DOUBTS]:
            doubt = replace(number, kind="doubt", note=d.condition)
            rows.append(replace(doubt, value=d.value, lo90=d.lo90, hi90=d.hi90))
        for reference in references(evidence, boundary):
            source = reference.label.partition("(")[2].rstrip(")")
            of_base = reference.model == diagnosis.base_model and name in reference.arguments
            if of_base and source:
                value = float(reference.arguments[name])
                rows.append(
                    LoopNumber(kind="reference", label=name, note=source, unit=c.unit, value=value)
                )
    return rows


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption of each panel; letters as in the picture."""
    after = "after" in table["when"]
    drawn = where(table, kind="reach")
    second = len(distinct(drawn["panel"], drawn["covariate"])) > len(distinct(drawn["panel"]))
    also = ", and of the other effect" if second else ""
    beyond = int(np.count_nonzero(table["kind"] == "beyond"))
    ticks = f", of which {beyond} beyond the axis are ticks at its edge" if beyond else ""
    residuals = (
        f"Relative residuals ({_letters(table, 'residual')}) against the covariate of the largest"
        f" test{also}. Dots: trials{ticks}. Symbols: means with their standard error. Shade: ±"
        " the noise floor."
    )
    parts = [residuals]
    if after:
        parts.append(
            f"After: the effect added in its stated form, uncertain by {100 * FORM_SD:.0f} %."
        )
    if "session" in table["kind"]:
        parts.append("Dashed vertical lines: a new session.")
    if "candidate" in table["part"]:
        reference = "best accepted" if after else "best"
        parts.append(
            f"Candidates ({_letters(table, 'candidate')}): 2 ln B of the {reference} over each."
            f" Hollow: rejected. Shade: within {RIVAL_MAX_2LNB:g}, not distinguishable."
        )
    if "error" in table["part"]:
        parts.append(
            f"Cross-validated error ({_letters(table, 'error')}), 90 %. Dashed: noise floor."
        )
    if "coefficient" in table["part"]:
        parts.append(
            f"Coefficients ({_letters(table, 'coefficient')}), 90 %: bold as quoted, numbered"
            " under another assumption."
        )
    return " ".join([*parts, *(_boundary(table, b) for b in distinct(table["panel"]))])


def alt(evidence: Evidence, table: Columns) -> str:
    """The picture's numbers for those who do not see it."""
    parts = []
    for boundary in distinct(table["panel"]):
        parts.append(_boundary(table, boundary))
        means = where(table, panel=boundary, kind="bin")
        for when in distinct(means["when"]):
            most = float(np.abs(where(means, when=when)["value"]).max())
            name = str(means["covariate"][0]).replace("_", " ")
            parts.append(f"Bin means {when} deviate by up to {plain(most, 2)} % against {name}.")
        listed = where(table, panel=boundary, part="coefficient")
        listed = select(listed, listed["kind"] != "reference")
        columns = (listed[name] for name in ("label", "note", "value", "lo90", "hi90"))
        for name, said, value, low, high in zip(*columns, strict=True):
            condition = f", {said}" if said else ""
            interval = f"{plain(value, 3)}, 90 % {plain(low, 3)} to {plain(high, 3)}"
            parts.append(f"{name}{condition}: {interval}.")
    return " ".join(parts)


def _boundary(table: Columns, boundary: str) -> str:
    mine = where(table, panel=boundary)
    verdict = where(mine, part="verdict")
    kind, label = str(verdict["kind"][0]), str(verdict["label"][0])
    text = f"{boundary.capitalize()}: {MEANINGS.get(kind, label)}"
    rmse = where(mine, kind="rmse")["value"].tolist()
    if rmse:
        values = " to ".join(f"{plain(v, 3)} %" for v in rmse)
        floor = float(where(mine, part="error", kind="floor")["value"][0])
        text += f"; cross-validated error {values}, noise floor {plain(floor, 3)} %"
    conditions = distinct(where(mine, kind="doubt")["note"])
    listed = "; ".join(f"({i}) {c}" for i, c in enumerate(conditions, 1))
    return text + "." + (f" Assumptions: {listed}." if listed else "")


def _letters(table: Columns, part: str) -> str:
    """Letters of the panels of a part: ``a, b, f``, neighbours of three and more as ``a–d``."""
    runs: list[list[str]] = []
    for letter in distinct(where(table, part=part)["letter"]):
        if runs and ord(letter) == ord(runs[-1][-1]) + 1:
            runs[-1].append(letter)
        else:
            runs.append([letter])
    return ", ".join(f"{r[0]}–{r[-1]}" if len(r) > 2 else ", ".join(r) for r in runs)


def draw(table: Rows, look: Style) -> Figure:
    """Blocks from top to bottom, no higher than the page."""
    table = in_units(table, look)
    boundaries = distinct(table["panel"])
    blocks = [where(table, panel=b) for b in boundaries]
    heights = [TALL + _more(b) if _two_lines(b) else LOW for b in blocks]
    height = min(look.double_in / 6.75 * sum(heights), look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.04, h_pad=0.03, hspace=0.03, wspace=0.03)  # type: ignore[union-attr, call-arg]
    parts = figure.subfigures(len(blocks), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, boundary, block in zip(parts, boundaries, blocks, strict=True):
        verdict = where(block, part="verdict")
        kind, headline = str(verdict["kind"][0]), plain_text(titled(str(verdict["label"][0])))
        part.suptitle(
            f"{boundary.capitalize()}. {kind.capitalize()}: {headline}",
            x=0.008,
            ha="left",
            fontsize=look.text_pt + 0.5,
            fontweight="bold",
        )
        _block(part, block, look, named=kind == "effect")
    return figure


def _block(part: SubFigure, block: Rows, look: Style, named: bool) -> None:
    above = distinct(where(block, part="residual")["letter"])
    several = len(distinct(where(block, part="coefficient")["label"])) > 1
    wide = {"candidate": 1.7, "error": 0.9, "coefficient": 2.0 if several else 1.25}
    beneath = [(x, kind) for kind in wide for x in distinct(where(block, part=kind)["letter"])]
    widths = [wide[kind] for _, kind in beneath]
    if _two_lines(block):
        ratios = (1.0, 1.05 + 2.05 * _more(block) / TALL)
        two: Any = part.subfigures(2, 1, height_ratios=ratios, hspace=0.0)
        upper = two[0].subplots(1, max(len(above), 1), sharey=True, squeeze=False)[0]
        lower = (
            two[1].subplots(1, len(beneath), width_ratios=widths, squeeze=False)[0]
            if beneath
            else []
        )
    else:
        widths = [1.6] * len(above) + widths
        row = part.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
        upper, lower = row[: len(above)], row[len(above) :]
    for ax, letter in zip(upper, above, strict=False):
        rows = where(block, letter=letter)
        _draw_residual(ax, rows, look, first=ax is upper[0])
        _title(ax, letter, f"residual {rows['when'][0]}" if named else "residual")
    for ax, (letter, kind) in zip(lower, beneath, strict=True):
        rows = where(block, letter=letter)
        if kind == "candidate":
            _draw_candidates(ax, rows)
            rejected = (rows["kind"] == "rejected").all()
            _title(ax, letter, "candidates, all rejected" if rejected else "candidates")
        elif kind == "error":
            _draw_error(ax, rows)
            _title(ax, letter, "held-out error")
        else:
            _title(_draw_coefficients(ax, rows), letter, "coefficient")


def _two_lines(block: Rows) -> bool:
    """Whether the residuals have a line of their own."""
    residuals = distinct(where(block, part="residual")["letter"])
    return "candidate" in block["part"] or len(residuals) > 1


def _more(block: Rows) -> float:
    """Height in inches that pairs of effects among the candidates need."""
    names = where(block, part="candidate")["label"].tolist()
    return PAIR * sum(" + " in name for name in names)


def _title(ax: Axes, letter: str, text: str) -> None:
    ax.set_title(f"{letter}) {text}", pad=3)


def _draw_residual(ax: Axes, rows: Rows, look: Style, first: bool) -> None:
    """Cloud, means over bins with their standard error, the noise floor as a shade; trials beyond
    the axis as ticks at its edge.
    """
    cloud, far, means, line = (
        where(rows, kind=kind) for kind in ("trial", "beyond", "bin", "curve")
    )
    floor, reach = (float(where(rows, kind=kind)["value"][0]) for kind in ("floor", "reach"))
    covariate, when = str(rows["covariate"][0]), str(rows["when"][0])
    if np.isfinite(floor):
        ax.axhspan(-floor, floor, color=FLOOR, linewidth=0, zorder=0)
    names = distinct(means["series"])
    lone = len(names) == 1
    colour = CLOUD if lone else "0.55"
    dots(ax, cloud["x"], cloud["value"], colour)
    edge = 0.965 * reach * np.sign(far["value"])
    ax.plot(far["x"], edge, "|", color=colour, markersize=3.5, markeredgewidth=0.5, zorder=1)
    ax.axhline(0, color="0.3", linewidth=0.6, zorder=2)
    for x in where(rows, kind="session")["x"]:
        ax.axvline(x, color="0.6", linewidth=0.5, linestyle=(0, (2, 2)), zorder=0.5)
    for i, name in enumerate(names):
        mine = where(means, series=name)
        colour, marker = LOOKS[when] if lone else SERIES[i % len(SERIES)]
        ax.errorbar(
            mine["x"],
            mine["value"],
            mine["u"],
            fmt=marker,
            color=colour,
            markersize=3.4 if lone else 2.8,
            elinewidth=0.8,
            markeredgecolor="white",
            markeredgewidth=0.3,
            linestyle="none" if lone else "-",
            linewidth=0.6,
            zorder=4,
            label=plain_text(name),
        )
    ax.plot(line["x"], line["value"], color=FITTED, linewidth=1.0, zorder=3)
    ax.set_ylim(-reach, reach)
    _abscissa(ax, covariate, np.unique(means["x"]), look)
    if len(names) > 1:
        _series_legend(ax, names, str(rows["note"][0]), look)
    if first:
        ax.set_ylabel("relative residual (%)")


def _series_legend(ax: Axes, names: list[str], levels_of: str, look: Style) -> None:
    """Series in one line, headed by what they are levels of."""
    handles = [
        Line2D([], [], color=c, marker=m, markersize=2.8)
        for (c, m), _ in zip(SERIES, names, strict=False)
    ]
    words = [plain_text(n) for n in names]
    if levels_of != "approach":
        head = covariate_label(levels_of, look).partition(" $")[0].partition(" (")[0]
        handles, words = [Line2D([], [], linestyle="none"), *handles], [f"{head}:", *words]
    ax.legend(
        handles,
        words,
        ncols=len(words),
        columnspacing=0.7,
        handlelength=1.1,
        handletextpad=0.3,
        borderaxespad=0.2,
        loc="best",
    )


def _abscissa(ax: Axes, covariate: str, means: Any, look: Style) -> None:
    if covariate in DISTANCES:
        ax.set_xscale("log")
        plain_log(ax.xaxis)
    elif len(means) <= DISCRETE:
        ax.set_xticks(means, [f"{x:.3g}".replace("-", "−") for x in means])
        ax.margins(x=0.12)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.margins(x=0.03)
    ax.set_xlabel(LABELS.get(covariate) or covariate_label(covariate, look), labelpad=1)


def _draw_candidates(ax: Axes, rows: Rows) -> None:
    """How far each trails the best, on an axis linear to ten and logarithmic beyond; rejected ones
    are hollow, with what they leave.
    """
    behind = rows["value"]
    y = np.arange(len(behind))[::-1]
    accepted = bool((rows["kind"] != "rejected").any())
    words = [
        MEANT.get(str(kind), plain_text(str(note)))
        for kind, note in zip(rows["kind"], rows["note"], strict=True)
    ]
    ax.set_xscale("symlog", linthresh=LINEAR, linscale=1.0)
    low, far = min(1.4 * float(behind.min()), -1.2), max(float(behind.max()) * 2.2, 40.0)
    ax.set_xlim(low, far)
    while (sides := _sides(ax, behind, words)) is None and far < FARTHEST:
        far *= 1.5
        ax.set_xlim(low, far)
    if accepted:
        ax.axvspan(0, RIVAL_MAX_2LNB, color=FLOOR, linewidth=0, zorder=0)
    ax.axvline(0, color="0.3", linewidth=0.6, zorder=1)
    sides = sides or [1] * len(y)
    for kind, word, at, x, side in zip(rows["kind"], words, y, behind, sides, strict=True):
        colour, marker = LOOKS["after"] if kind in ("named", "rival") else (CLOUD, "o")
        ax.plot([0, x], [at, at], color="0.55", linewidth=0.6, zorder=2)
        ax.plot(
            [x],
            [at],
            marker=marker,
            color=colour,
            markerfacecolor="white" if kind == "rejected" else colour,
            markersize=4,
            markeredgewidth=0.9,
            zorder=3,
        )
        start, slant = (max(x, 0.0), "left") if side > 0 else (x, "right")
        paper = {**PAPER, "pad": 0.6} if side < 0 else {"alpha": 0, "pad": 0}
        note(
            ax,
            word,
            (start, at),
            (BESIDE * side, 0),
            ha=slant,
            va="center",
            color="0.25",
            bbox=paper,
            zorder=4,
        )
    ax.set_yticks(y, [effects(str(name)) for name in rows["label"]], linespacing=0.9)
    ax.tick_params(axis="y", length=0)
    ax.tick_params(axis="x", which="minor", length=0)
    ax.set_ylim(-0.7, len(y) - 0.3)
    ticks = [
        t
        for t in (-100, -10, 0, 5, 10, 100, 1000, 10000, 100000)
        if float(behind.min()) <= t <= far and (t != 5 or far < 2000)
    ]
    ax.set_xticks(ticks, [f"{t:,}".replace(",", "\u2009").replace("-", "−") for t in ticks])
    ax.set_xlabel(r"$2 \,\ln B$, best over candidate", labelpad=1)


def _sides(ax: Axes, behind: Any, words: list[str]) -> list[int] | None:
    """On which side of its symbol each word has room, right (1) or left (-1) where it covers no
    more than the stem; None where one has none.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    width = 72 * PANEL * figure.get_figwidth()
    to_axes: Any = ax.transScale + ax.transLimits
    zero, *places = to_axes.transform([(x, 0.0) for x in (0.0, *behind)])[:, 0]
    sides = []
    for at, word in zip(places, words, strict=True):
        size = rcParams["legend.fontsize"]
        reach = (BESIDE + 2 + TextPath((0, 0), word, size=size).get_extents().width) / width
        if max(at, zero) + reach <= 1:
            sides.append(1)
        elif at - reach >= zero:
            sides.append(-1)
        else:
            return None
    return sides


def _draw_error(ax: Axes, rows: Rows) -> None:
    """Root mean square on held-out trials with its 90 % interval, and the noise floor."""
    floor = float(rows["value"][rows["kind"] == "floor"][0])
    shown = rows["kind"] == "rmse"
    whens, values, low, high = (rows[k][shown] for k in ("when", "value", "lo90", "hi90"))
    n = len(values)
    if np.isfinite(floor):
        ax.axhline(floor, color=FITTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
    for i, when in enumerate(whens):
        colour, marker = LOOKS[str(when)]
        reach = np.nan_to_num([[values[i] - low[i]], [high[i] - values[i]]])
        ax.errorbar(
            [i],
            [values[i]],
            reach,
            fmt=marker,
            color=colour,
            markersize=4,
            elinewidth=1.0,
            capsize=2,
            zorder=3,
        )
    top = 1.3 * float(np.nanmax([floor, *values, *high]))
    # numbers are above their mark, the floor's below its line if there is room
    numbers, places = [*values, floor], [*np.fmax(values, high), floor]
    for i, (value, at) in enumerate(zip(numbers, places, strict=True)):
        if np.isfinite(value):
            below = i == n and floor > BENEATH * top
            up, va = (-2.5, "top") if below else (2.5, "bottom")
            note(ax, f"{value:#.3g}", (i, at), (0, up), ha="center", va=va, bbox=PAPER, zorder=4)
    ax.set_ylim(0, top)
    ax.set_xlim(-0.6, n + 0.6)
    ax.set_xticks(range(n + 1), [*([str(w) for w in whens] if n > 1 else ["base"]), "floor"])
    ax.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel("RMSE (% of lift)")


def _draw_coefficients(ax: Axes, rows: Rows) -> Axes:
    """Each coefficient's intervals, next to each other; returns the leftmost axes."""
    names = distinct(rows["label"])
    figure, place = ax.get_figure(), ax.get_subplotspec()
    axes = [ax]
    if len(names) > 1 and figure is not None and place is not None:
        ax.remove()
        inside = place.subgridspec(1, len(names), wspace=0.08)
        axes = [figure.add_subplot(inside[0, i]) for i in range(len(names))]
        for other in axes[1:]:
            other.tick_params(axis="y", labelleft=False)
    conditions = distinct(where(rows, kind="doubt")["note"])
    for panel, name in zip(axes, names, strict=False):
        _coefficient(panel, where(rows, label=name), name, conditions, lone=len(names) == 1)
    return axes[0]


def _coefficient(ax: Axes, rows: Rows, name: str, conditions: list[str], lone: bool) -> None:
    """One coefficient: as quoted, and beneath it on each of the conditions, which have the same
    places in neighbouring axes.
    """
    ticks = 4 if lone else 2
    reference, stated = where(rows, kind="reference"), select(rows, rows["kind"] != "reference")
    ends = [*stated["lo90"], *stated["hi90"], *reference["value"]]
    margin = 0.08 * (max(ends) - min(ends)) or 1e-3 * max(abs(max(ends)), 1e-3)
    left, right = min(ends) - margin, max(ends) + margin
    ax.set_xlim(left, right)
    for value, source in zip(reference["value"], reference["note"], strict=True):
        ax.axvline(value, color="0.35", linewidth=0.8, linestyle=(0, (5, 2)), zorder=1)
        side = 1 if value < (left + right) / 2 else -1
        note(
            ax,
            plain_text(f"{source} {value:g}"),
            (value, 1),
            (2.5 * side, -4),
            xycoords=("data", "axes fraction"),
            ha="left" if side > 0 else "right",
            va="top",
            color="0.25",
            in_layout=False,
        )
    columns = (stated[name] for name in ("kind", "note", "when", "value", "lo90", "hi90"))
    for kind, condition, when, value, low, high in zip(*columns, strict=True):
        at = len(conditions) - (1 + conditions.index(condition) if kind == "doubt" else 0)
        colour, marker = LOOKS[str(when)]
        ax.plot(
            [low, high],
            [at, at],
            color=colour,
            linewidth=2.2 if kind == "quoted" else 0.9,
            solid_capstyle="butt",
            zorder=2,
        )
        caps: dict[str, Any] = {
            "color": colour,
            "markersize": 7,
            "markeredgewidth": 1.0,
            "zorder": 2,
        }
        ax.plot([low, high], [at, at], "|", **caps)
        ax.plot([value], [at], marker, color=colour, markersize=3.6, markeredgewidth=0, zorder=3)
    names = ["quoted", *(f"if ({i + 1})" for i in range(len(conditions)))]
    ax.set_yticks(range(len(conditions), -1, -1), names)
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(-0.6, len(conditions) + 1 - (0.15 if len(reference["value"]) else 0.4))
    ax.xaxis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 2.5, 5, 10]))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", "−")))
    ax.set_xlabel(nomenclature.label(name), labelpad=1)


FIGURE = FigureSpec(
    name="diagnosis",
    title="The loop: residual, candidates, error, coefficient",
    needs=(TRIALS, FIT, DIAGNOSIS, LOOP_RESIDUALS),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
