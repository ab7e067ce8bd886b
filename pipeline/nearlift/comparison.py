"""One coefficient over many campaigns: a table, a forest plot and a population fit in which shared
errors do not average down.

It reads the results of finished runs under ``processed/`` and writes ``reports/comparison/``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused, UsageError
from nearlift.fit.population import FEWEST, population
from nearlift.report.phrases import claim, coefficient_text
from nearlift.results.comparison import (
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
from nearlift.stages.fit import RESULTS

FOLDER = "comparison"
#: Below this a p-value means no more than that.
LEAST_CHANCE = 1e-12
#: Where a prior of twice the width moves an end of the mean's interval by more than this part of
#: the interval, that is said.
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
    def kind(self) -> tuple[Boundary, str, str]:
        """Boundary, base model and coefficient: only what has these in common is compared."""
        return self.boundary, self.result.base_model, self.result.headline

    @property
    def quoted(self) -> CoefficientResult:
        """The headline coefficient."""
        return self.result.coefficients[self.result.headline]

    @property
    def parts(self) -> dict[str, float]:
        """Signed contribution of each stated uncertainty that all trials of a campaign share."""
        shared = (line for line in self.quoted.budget if line.scope in ("boundary", "campaign"))
        return {line.source: math.copysign(line.u, line.sensitivity or 1.0) for line in shared}

    def compared(self, shrunk: Estimate | None) -> ComparedCampaign:
        """Row of the campaign in the comparison."""
        c = self.quoted
        return ComparedCampaign(
            campaign=self.campaign,
            vehicle=self.vehicle,
            verdict=self.result.verdict,
            claim=self.claim,
            quoted=HeadlineValue(
                value=c.value, u=c.u, lo90=c.lo90, hi90=c.hi90, unit=c.unit, holds=c.holds
            ),
            in_population=shrunk,
        )


def finished(out: Path, names: Sequence[str]) -> list[Path]:
    """Folders of finished runs under `out`/processed: those of the campaigns named, else all.

    Raises
    ------
    UsageError
        There are none, or a named one has not been fitted.
    """
    home = out / "processed"
    if not names:
        fitted = sorted(path.parent for path in home.glob(f"*/{RESULTS.file}"))
        if not fitted:
            raise UsageError(
                str(home), "holds no fitted campaign", "`nearlift run CAMPAIGN` first, or say --out"
            )
        return fitted
    missing = [name for name in names if not (home / name / RESULTS.file).is_file()]
    if missing:
        raise UsageError(
            str(home / missing[0]),
            f"is not fitted ({len(missing)} of {len(names)} campaigns)",
            "`nearlift run CAMPAIGN` first, for each of them",
        )
    return [home / name for name in names]


def entries(folder: Path) -> list[Entry]:
    """The headline coefficient of every boundary of one finished run."""
    results = tables.load(folder / RESULTS.file, Results)
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


def grouped(listed: Sequence[Entry], shared: Sequence[str]) -> tuple[ComparedCoefficient, ...]:
    """Entries by boundary, base model and coefficient, each group with its population.

    `shared` names components that are one and the same error in all campaigns (the same load cell,
    the same gauge block).

    Raises
    ------
    UsageError
        One of them is no campaign's component.
    """
    known = sorted({name for entry in listed for name in entry.parts})
    for name in shared:
        if name not in known:
            raise UsageError(
                "--shared",
                f"no campaign has a component {name!r}",
                f"there are: {', '.join(map(repr, known)) or 'none'}",
            )
    kinds = sorted({e.kind for e in listed})
    return tuple(_compared([e for e in listed if e.kind == kind], shared) for kind in kinds)


def covariance(members: Sequence[Entry], shared: Sequence[str]) -> FloatArray:
    """Covariance (n, n) of the errors of these entries; shared errors are off the diagonal too."""
    total: FloatArray = np.diag([e.quoted.u**2 for e in members])
    for name in shared:
        part = np.array([e.parts.get(name, 0.0) for e in members])
        if (part**2 > np.diag(total) * (1 + 1e-9)).any():
            raise InputRefused(
                "--shared",
                f"{name!r} is larger than a campaign's whole uncertainty",
                "fit that campaign again",
            )
        common = np.outer(part, part)
        np.fill_diagonal(common, 0.0)
        total += common
    return total


def run(out: Path, names: Sequence[str], shared: Sequence[str]) -> CampaignComparison:
    """Write ``reports/comparison/``: comparison.json, forest.pdf, .png and .csv, index.html, and
    return the content of the first.
    """
    from nearlift.report.figures import forest
    from nearlift.report.page import comparison
    from nearlift.stages.gathering import for_print

    listed = [entry for folder in finished(out, names) for entry in entries(folder)]
    compared = CampaignComparison(shared=tuple(shared), groups=grouped(listed, shared))
    target = out / "reports" / FOLDER
    rows = forest.table(compared)
    files = for_print(forest.draw, rows)
    for kind, drawn in files.items():
        tables.write_whole(target / f"forest.{kind}", drawn)
    said = [
        f"{group.boundary.capitalize()}, {group.coefficient}: {remark}"
        for group in compared.groups
        for remark in group.remarks
    ]
    reported = {
        str(name)
        for name in rows["label"]
        if (out / "reports" / str(name) / "index.html").is_file()
    }
    claims: dict[tuple[str, str], str] = {
        (c.campaign, g.boundary): c.claim for g in compared.groups for c in g.campaigns
    }
    page = comparison.page(rows, files["png"], reported, said, claims)
    tables.write_whole(target / "index.html", page)
    tables.write_whole(target / "comparison.json", tables.json_bytes(compared))
    return compared


def table(compared: CampaignComparison) -> list[str]:
    """The comparison as lines of text."""
    lines = []
    for group in compared.groups:
        lines.append(f"{group.boundary}: {group.coefficient} of {group.model}")
        rows: list[tuple[str, Estimate, str]] = [
            (c.campaign, c.quoted, c.claim or c.verdict) for c in group.campaigns
        ]
        if together := group.population:
            spread = together.spread
            words = (
                f"spread {plain(spread.value, 2)} (up to {plain(spread.hi90, 2)}); no spread:"
                f" {_chance(together.p_value)}"
            )
            rows += [
                ("population mean", together.mean, words),
                ("next campaign", together.next, ""),
            ]
        wide = max(len(name) for name, _, _ in rows)
        for name, e, words in rows:
            lines.append(f"  {name:<{wide}}  {coefficient_text(e)}  {words}".rstrip())
        lines += [f"  {remark}" for remark in group.remarks]
    return lines


def _remarks(members: Sequence[Entry], p: Population | None) -> tuple[str, ...]:
    """Remarks on a group: equal campaigns, and a spread that depends on its prior."""
    listed = []
    same: dict[tuple[float, float], list[str]] = {}
    for e in members:
        same.setdefault((e.quoted.value, e.quoted.u), []).append(e.campaign)
    for names in same.values():
        if len(names) > 1:
            listed.append(
                f"{', '.join(names)} agree to the last digit: if they are the same trials, they"
                f" count once, not {len(names)} times"
            )
    if p is not None:
        doubled = p.spread_prior.mean_if_doubled
        wider = max(abs(doubled.lo90 - p.mean.lo90), abs(doubled.hi90 - p.mean.hi90))
        if wider > PRIOR_MATTERS * (p.mean.hi90 - p.mean.lo90):
            ends = " to ".join(like(x, p.mean.u) for x in (doubled.lo90, doubled.hi90))
            listed.append(
                f"of {len(members)} campaigns the spread is little known, and its prior"
                f" counts: were it twice as wide, the mean would be {ends}"
            )
    return tuple(listed)


def _chance(p: float) -> str:
    return f"p = {plain(p, 2)}" if p > LEAST_CHANCE else f"p < {LEAST_CHANCE:g}"


def _compared(members: Sequence[Entry], shared: Sequence[str]) -> ComparedCoefficient:
    """Entries of one kind, and what they say together unless they are too few."""
    together: Population | None = None
    shrunk: Sequence[Estimate | None] = [None] * len(members)
    if len(members) >= FEWEST:
        # an interval over rivals is lopsided, and its best value no centre: the population is
        # fitted to the interval
        value = np.array([(e.quoted.lo90 + e.quoted.hi90) / 2 for e in members])
        together, shrunk = population(value, covariance(members, shared), members[0].quoted.unit)
    boundary, model, coefficient = members[0].kind
    return ComparedCoefficient(
        boundary=boundary,
        model=model,
        coefficient=coefficient,
        campaigns=tuple(e.compared(s) for e, s in zip(members, shrunk, strict=True)),
        remarks=_remarks(members, together),
        population=together,
    )
