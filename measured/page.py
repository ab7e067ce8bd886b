"""Tables and figures of docs/measured.md."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from nearlift.catalogue import titled
from nearlift.report.figures.style import DOUBLE_IN, SERIES, context
from nearlift.report.phrases import MIN_LISTED
from nearlift.results.diagnosis import BoundaryDiagnosis, DiagnosisResults, HeldOutRmse
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS

from .campaigns import REMARKS
from .variants import (
    HEIGHTS_MM,
    KINDS,
    SIZES,
    WITHHELD,
    Case,
    Finding,
    Interval,
    Stability,
    outcome,
)

OUTCOMES = ("found", "missed", "false", "abstained")
#: Colour and marker of each outcome.
LOOKS = dict(zip(("missed", "false", "found", "abstained"), SERIES, strict=False))
TEXT = Path(__file__).with_name("page.md")


class Measured(NamedTuple):
    """Products of a campaign, and the verdict without each visit and trial."""

    name: str
    boundary: str
    trials: int
    diagnosis: BoundaryDiagnosis
    quoted: BoundaryResult
    held: Stability


class Pair(NamedTuple):
    """A variant's answer, and that of the campaign that it is compared with."""

    case: Case
    answer: Finding
    without: Finding


def products(place: Path) -> tuple[str, int, BoundaryDiagnosis, BoundaryResult]:
    """Boundary of a campaign, its number of trials, its diagnosis and its result."""
    diagnoses = tables.load(place / DiagnosisResults.file, DiagnosisResults).boundaries
    [(boundary, diagnosis)] = diagnoses.items()
    if not isinstance(diagnosis, BoundaryDiagnosis):
        raise SystemExit(f"{place}: {diagnosis.reason}")
    quoted = tables.load(place / Results.file, Results).boundaries[boundary]
    trials = tables.read_table(place / TRIALS.file, TRIALS)
    return boundary, len(trials["trial"]), diagnosis, quoted


# ---- cells


def number(x: float) -> str:
    """Three digits; a dash where there is none."""
    return f"{x:.3g}" if math.isfinite(x) else "–"


def interval(e: Interval) -> str:
    """A coefficient and its range."""
    value, low, high = map(number, e)
    return f"{value} ({low} to {high})"


def percent(e: Interval | None) -> str:
    """An error and its range, in per cent."""
    if e is None:
        return "–"
    value, low, high = (100 * x for x in e)
    return f"{value:.2f} ({low:.1f} to {high:.1f})"


def three(e: HeldOutRmse) -> Interval:
    """An error and its range."""
    return e.held_out_rmse, e.lo90, e.hi90


def said(answer: Finding) -> str:
    """Verdict with its effects, and the answer's probability."""
    names = ", or ".join(" and ".join(f"`{n}`" for n in e) for e in answer.explanations)
    return f"{answer.verdict}{f': {names}' if names else ''}, {100 * answer.probability:.0f} %"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = (head, ["---"] * len(head), *rows)
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


# ---- tables


def campaigns(rows: Sequence[Measured]) -> str:
    """Table of the campaigns as published."""
    head = ["campaign", "trials", "verdict: probabilities", "error before", "after", "floor"]
    head += ["quoted coefficient (90 %)", "depends on", "holds: visits, trials"]
    cells = []
    for m in rows:
        name, c = next(iter(m.quoted.coefficients.items()))
        visit, e = c.influence.visit, m.diagnosis.error
        held = (m.held.visits, m.held.trials)
        cells.append(
            (
                m.name,
                str(m.trials),
                f"**{m.diagnosis.verdict}**: {weighed(m.diagnosis)}",
                percent(three(e.before)) if e else "–",
                percent(three(e.after)) if e else "–",
                f"{100 * e.noise_floor:.2f}" if e else "–",
                f"{name} = {interval((c.value, c.lo90, c.hi90))}",
                f"z_hat = {visit.z_hat:.3g}: {visit.shift:+.2g}" if visit else "–",
                ", ".join(f"{a} of {b}" if b else "–" for a, b in held),
            )
        )
    return table(head, cells)


def weighed(found: BoundaryDiagnosis) -> str:
    """Explanations with their probabilities, those of `MIN_LISTED` or more."""
    words = []
    for e in found.probabilities or ():
        if e.other is None and e.probability >= MIN_LISTED:
            name = f"structure along {e.nameless}" if e.nameless else " with ".join(e.effects)
            words.append(f"{titled(name) or 'no effect'} {100 * e.probability:.0f} %")
    return ", ".join(words)


def remark(m: Measured) -> str:
    """What a reader of the row should know, and what to measure next."""
    found = m.diagnosis
    parts = [f"- **{m.name}** ({found.base_model}, {m.boundary}): {REMARKS[m.name]}."]
    if lost := m.held.lost:
        more = f" and {len(lost) - 4} more" if len(lost) > 4 else ""
        parts.append(f"Another verdict without {', '.join(lost[:4])}{more}.")
    if found.partial:
        shares = [f"`{x.name}` {100 * x.share:.0f} %" for x in found.partial[:2]]
        parts.append(f"In part: {', '.join(shares)}.")
    if wanted := [n.measure for n in found.next_experiment][:2]:
        parts.append(f"To measure next: {'; '.join(wanted)}.")
    if logs := dict.fromkeys(w for u in found.not_testable for w in u.log_next_time or u.needs):
        parts.append(f"To log next time: {', '.join(list(logs)[:6])}.")
    return " ".join(parts) + "\n"


def withheld(pairs: Sequence[Pair]) -> str:
    """Table of campaigns with and without the column of a logged cause."""
    head = ["campaign", "withheld", "with it", "without it", "error before", "after"]
    head += ["coefficient with it", "without it"]
    return table(
        head,
        [
            (
                case.campaign,
                ", ".join(WITHHELD[case.campaign]),
                said(full),
                said(without),
                percent(without.before),
                percent(without.after),
                f"{full.coefficient} = {interval(full.number)}",
                interval(without.number),
            )
            for case, without, full in pairs
        ],
    )


def injections(pairs: Sequence[Pair]) -> str:
    """Table of outcomes by kind and size."""
    count = Counter((p.case.kind, p.case.size, outcome(*p)) for p in pairs)
    rows = [
        (
            f"`{kind}`",
            f"{size:g}{' mm' if kind == 'height_offset' else ''}",
            *(str(count[kind, size, o]) for o in OUTCOMES),
        )
        for kind in KINDS
        for size in (HEIGHTS_MM if kind == "height_offset" else SIZES)
    ]
    sums = (str(sum(n for key, n in count.items() if key[2] == o)) for o in OUTCOMES)
    return table(("effect", "size", *OUTCOMES), [*rows, ("all", "", *sums)])


def coverage(pairs: Sequence[Pair]) -> str:
    """Table of campaigns: outcomes, and intervals that hold the coefficient without injection."""
    rows = []
    for name in dict.fromkeys(p.case.campaign for p in pairs):
        mine = [p for p in pairs if p.case.campaign == name]
        count = Counter(outcome(*p) for p in mine)
        holds = sum(p.answer.number[1] <= p.without.number[0] <= p.answer.number[2] for p in mine)
        counts = tuple(str(count[o]) for o in OUTCOMES)
        rows.append((name, said(mine[0].without), *counts, f"{holds} of {len(mine)}"))
    head = ("campaign", "without an injection", *OUTCOMES)
    return table((*head, "interval holds the coefficient without it"), rows)


def write(folder: Path, rows: Sequence[Measured], pairs: Sequence[Pair]) -> None:
    """Write page, rows and figures into `folder`."""
    put_in = [p for p in pairs if p.case.kind in KINDS]
    parts = {
        "campaigns": campaigns(rows),
        "remarks": "".join(map(remark, rows)),
        "withheld": withheld([p for p in pairs if p.case.kind == "withheld"]),
        "injections": injections(put_in),
        "coverage": coverage(put_in),
    }
    text = TEXT.read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace(f"{{{name}}}\n", part)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    (folder / "measured.md").write_text(text, encoding="utf-8")
    write_rows(folder / "measured-injections.csv", put_in)
    with context():
        for name, figure in (("errors", draw_errors(rows)), ("injections", draw(put_in))):
            figure.savefig(
                folder / f"figures/measured-{name}.png", dpi=160, metadata={"Software": None}
            )


def write_rows(path: Path, pairs: Sequence[Pair]) -> None:
    """Every injection as a row of a CSV file."""
    head = (
        "campaign,effect,size,outcome,verdict,effects,probability,error_before,error_after,"
        "coefficient,value,lo90,hi90,value_without,lo90_without,hi90_without,command"
    )
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head.split(","))
        for pair in pairs:
            case, f, base = pair
            names = " or ".join(map(" and ".join, f.explanations))
            errors = [f"{e[0]:.4g}" if e else "" for e in (f.before, f.after)]
            numbers = [f"{x:.4g}" for x in (*f.number, *base.number)]
            row = [case.campaign, case.kind, f"{case.size:g}", outcome(*pair), f.verdict, names]
            row += [f"{f.probability:.3f}", *errors, f.coefficient, *numbers]
            words = f"{case.campaign} {case.kind} {case.size:g}"
            writer.writerow([*row, f"python -m measured --case {words}"])


# ---- figures


def draw_errors(rows: Sequence[Measured]) -> Figure:
    """Held-out errors before and after, by campaign."""
    figure = Figure(figsize=(DOUBLE_IN, 2.5), layout="constrained")
    ax = figure.subplots()
    colour = SERIES[0][0]
    at = np.arange(len(rows))
    errors = [m.diagnosis.error for m in rows]
    for key, shift, face in (("before", -0.13, "white"), ("after", 0.13, colour)):
        x, low, high = 100 * np.array([three(getattr(e, key)) for e in errors if e]).T
        bars = np.maximum([x - low, high - x], 0)
        ax.errorbar(
            x,
            at + shift,
            xerr=bars,
            color=colour,
            fmt="o",
            markersize=4,
            markerfacecolor=face,
            elinewidth=0.8,
            label=key,
        )
    floors = [100 * e.noise_floor for e in errors if e]
    ax.vlines(floors, at - 0.32, at + 0.32, color="0.35", linewidth=1.4, label="noise floor")
    ax.set_yticks(at, [m.name for m in rows])
    ax.tick_params(axis="y", length=0)
    ax.invert_yaxis()
    ax.set_xlim(0)
    ax.set_xlabel("error on visits left out (% of lift)")
    ax.legend(loc="lower right")
    return figure


def draw(pairs: Sequence[Pair]) -> Figure:
    """A mark for each injection, by campaign (rows), effect and size (columns)."""
    names = list(dict.fromkeys(p.case.campaign for p in pairs))
    columns = list(dict.fromkeys((p.case.kind, p.case.size) for p in pairs))
    where = {(k, s): i + 0.6 * KINDS.index(k) for i, (k, s) in enumerate(columns)}
    figure = Figure(figsize=(DOUBLE_IN, 0.9 + 0.24 * len(names)), layout="constrained")
    ax = figure.subplots()
    for name in OUTCOMES:
        mine = [p.case for p in pairs if outcome(*p) == name]
        x = [where[c.kind, c.size] for c in mine]
        y = [names.index(c.campaign) for c in mine]
        colour, marker = LOOKS[name]
        face = "none" if name in ("missed", "abstained") else colour
        ax.plot(x, y, marker, color=colour, markerfacecolor=face, label=name)
    ax.set_xticks(list(where.values()), [f"{size:g}" for _, size in columns])
    ax.set_yticks(range(len(names)), names)
    ax.tick_params(length=0)
    ax.set_ylim(len(names) - 0.5, -0.5)
    for kind in dict.fromkeys(kind for kind, _ in columns):
        middle = float(np.mean([x for (k, _), x in where.items() if k == kind]))
        unit = ", mm" if kind == "height_offset" else ""
        ax.text(middle, -0.75, kind.replace("_", " ") + unit, ha="center", va="bottom")
    ax.set_xlabel("size, in noise floors")
    figure.legend(loc="outside lower right", ncols=len(OUTCOMES))
    return figure
