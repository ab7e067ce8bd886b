"""One coefficient over many campaigns: a table, a forest plot and a population fit in which shared
errors do not average down.

It reads the results of finished runs under ``processed/`` and writes ``reports/comparison/``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused, UsageError
from nearlift.fit.population import MIN_CAMPAIGNS, population
from nearlift.report.phrases import claim, coefficient_text
from nearlift.results.answers import (
    CampaignComparison,
    ComparedCampaign,
    ComparedCoefficient,
    HeadlineValue,
    Population,
)
from nearlift.results.diagnosis import NOTHING, DiagnosisResults
from nearlift.results.estimate import Estimate
from nearlift.results.provenance import ProvenanceLedger
from nearlift.results.quotation import BoundaryResult, CoefficientResult, Results
from nearlift.rounding import like, plain
from nearlift.run import tables
from nearlift.run.tables import PROVENANCE

FOLDER = "comparison"
#: Below this a p-value means no more than that.
LEAST_CHANCE = 1e-12
#: Part of the mean's interval by which a prior of twice the width may move an end unsaid.
PRIOR_MATTERS = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One campaign's result at one boundary, of which the headline coefficient is compared."""

    campaign: str
    vehicle: str
    boundary: Boundary
    result: BoundaryResult
    claim: str = ""

    @property
    def quoted(self) -> CoefficientResult:
        """The headline coefficient."""
        return self.result.coefficients[self.result.headline]

    @property
    def parts(self) -> dict[str, float]:
        """Signed contribution of each stated uncertainty that all trials of a campaign share."""
        shared = (line for line in self.quoted.budget if line.scope in ("boundary", "campaign"))
        return {line.source: math.copysign(line.u, line.sensitivity or 1.0) for line in shared}


def finished(out: Path, names: Sequence[str]) -> list[Path]:
    """Folders of finished runs under `out`/processed: those of the campaigns named, else all.

    Raises
    ------
    UsageError
        There are none, or a named one has not been fitted.
    """
    home = out / "processed"
    if not names:
        fitted = sorted(path.parent for path in home.glob(f"*/{Results.file}"))
        if not fitted:
            remedy = "`nearlift run CAMPAIGN` first, or say --out"
            raise UsageError(str(home), "holds no fitted campaign", remedy)
        return fitted
    missing = [name for name in names if not (home / name / Results.file).is_file()]
    if missing:
        what = f"is not fitted ({len(missing)} of {len(names)} campaigns)"
        remedy = "give names as in the manifests, not folders; `nearlift run CAMPAIGN` fits them"
        raise UsageError(str(home / missing[0]), what, remedy)
    return [home / name for name in names]


def entries(folder: Path) -> list[Entry]:
    """The headline coefficient of every boundary of one finished run."""
    results = tables.load(folder / Results.file, Results)
    diagnosed = tables.load_if_whole(folder / DiagnosisResults.file, NOTHING).boundaries
    vehicle = tables.load_if_whole(folder / PROVENANCE.file, ProvenanceLedger()).vehicle
    return [
        Entry(
            campaign=folder.name,
            vehicle=vehicle,
            boundary=boundary,
            result=result,
            claim=claim(result, diagnosed.get(boundary)),
        )
        for boundary, result in results.boundaries.items()
        if result.headline
    ]


def compared(listed: Sequence[Entry], shared: Sequence[str]) -> CampaignComparison:
    """Entries by boundary, base model and coefficient, each group with its population.

    `shared` names components that are one and the same error in all campaigns (the same load cell,
    the same gauge block).

    Raises
    ------
    UsageError
        One of them is no campaign's component.
    """
    known = {name for entry in listed for name in entry.parts}
    for name in sorted({*shared} - known):
        remedy = f"there are: {', '.join(map(repr, sorted(known))) or 'none'}"
        raise UsageError("--shared", f"no campaign has a component {name!r}", remedy)
    groups: dict[tuple[Boundary, str, str], list[Entry]] = {}
    for e in listed:
        groups.setdefault((e.boundary, e.result.base_model, e.result.headline), []).append(e)
    return CampaignComparison(
        shared=tuple(shared),
        groups=tuple(_group(*kind, groups[kind], shared) for kind in sorted(groups)),
    )


def _group(
    boundary: Boundary,
    model: str,
    coefficient: str,
    members: Sequence[Entry],
    shared: Sequence[str],
) -> ComparedCoefficient:
    """Entries of one kind, and their population unless they are too few."""
    together: Population | None = None
    if len(members) >= MIN_CAMPAIGNS:
        # an interval over rivals is lopsided, and its best value no centre: the population is
        # fitted to the interval
        value = np.array([(e.quoted.lo90 + e.quoted.hi90) / 2 for e in members])
        together = population(value, covariance(members, shared), members[0].quoted.unit)
    keys = ("value", "u", "lo90", "hi90", "unit", "holds")
    return ComparedCoefficient(
        boundary=boundary,
        model=model,
        coefficient=coefficient,
        campaigns=tuple(
            ComparedCampaign(
                campaign=e.campaign,
                vehicle=e.vehicle,
                verdict=e.result.verdict,
                claim=e.claim,
                quoted=HeadlineValue(**{key: getattr(e.quoted, key) for key in keys}),
            )
            for e in members
        ),
        remarks=tuple(_remarks(members, together)),
        population=together,
    )


def covariance(members: Sequence[Entry], shared: Sequence[str]) -> FloatArray:
    """Covariance (n, n) of the errors of these entries; shared errors are off the diagonal too."""
    variance = np.array([e.quoted.u**2 for e in members])
    total: FloatArray = np.diag(variance)
    for name in shared:
        part = np.array([e.parts.get(name, 0.0) for e in members])
        if (part**2 > variance * (1 + 1e-9)).any():
            what = f"{name!r} is larger than a campaign's whole uncertainty"
            raise InputRefused("--shared", what, "fit that campaign again")
        total += np.outer(part, part) - np.diag(part**2)
    return total


def _remarks(members: Sequence[Entry], together: Population | None) -> Iterator[str]:
    """Remarks on a group: equal campaigns, and a spread that depends on its prior."""
    same: dict[tuple[float, float], list[str]] = {}
    for e in members:
        same.setdefault((e.quoted.value, e.quoted.u), []).append(e.campaign)
    for names in same.values():
        if len(names) > 1:
            yield (
                f"{', '.join(names)} agree to the last digit: if they are the same trials, compare"
                " only one of them"
            )
    if together is not None:
        mean, doubled = together.mean, together.spread_prior.mean_if_doubled
        wider = max(abs(doubled.lo90 - mean.lo90), abs(doubled.hi90 - mean.hi90))
        if wider > PRIOR_MATTERS * (mean.hi90 - mean.lo90):
            ends = " to ".join(like(x, mean.u) for x in (doubled.lo90, doubled.hi90))
            yield (
                f"of {len(members)} campaigns the spread is little known, and its prior"
                f" counts: were it twice as wide, the mean would be {ends}"
            )


def run(out: Path, names: Sequence[str], shared: Sequence[str]) -> CampaignComparison:
    """Write ``reports/comparison/``: comparison.json, forest.pdf, .png and .csv; return the content
    of the first.
    """
    from nearlift.report.figures import forest
    from nearlift.report.figures.files import render
    from nearlift.report.tables import csv

    content = compared([e for folder in finished(out, names) for e in entries(folder)], shared)
    rows = forest.table(content)
    drawn = render(forest.draw, rows) | {"csv": csv(rows)}
    written = {f"forest.{kind}": data for kind, data in drawn.items()}
    written["comparison.json"] = tables.json_bytes(content)
    for name, data in written.items():
        tables.write_whole(out / "reports" / FOLDER / name, data)
    return content


def table(content: CampaignComparison) -> list[str]:
    """The comparison as lines of text."""
    lines = []
    for group in content.groups:
        lines.append(f"{group.boundary}: {group.coefficient} of {group.model}")
        rows: list[tuple[str, Estimate, str]] = [
            (c.campaign, c.quoted, c.claim or c.verdict) for c in group.campaigns
        ]
        if together := group.population:
            spread, p = together.spread, together.p_value
            chance = f"p = {plain(p, 2)}" if p > LEAST_CHANCE else f"p < {LEAST_CHANCE:g}"
            up_to = f"spread {plain(spread.value, 2)} (up to {plain(spread.hi90, 2)})"
            rows.append(("population mean", together.mean, f"{up_to}; no spread: {chance}"))
            rows.append(("next campaign", together.next, ""))
        wide = max(len(name) for name, _, _ in rows)
        lines += [f"  {n:<{wide}}  {coefficient_text(e)}  {words}".rstrip() for n, e, words in rows]
        lines += [f"  {remark}" for remark in group.remarks]
    return lines
