"""The closed loop on every boundary."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary
from nearlift.errors import NotConverged
from nearlift.fit.base_result import base_result, shape_doubts
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.loop.diagnose import diagnose
from nearlift.observed import boundaries, choice, interim_look, observe, search_options
from nearlift.report import phrases
from nearlift.results.diagnosis import (
    BoundaryDiagnosis,
    DiagnosisResults,
    NotDiagnosed,
)
from nearlift.results.fit import FitResults
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.run.engine import Say, subprogress
from nearlift.run.tables import Table


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnoses:
    """Findings at each boundary, what is quoted, and rows of residuals."""

    results: DiagnosisResults
    quoted: Results
    residuals: list[Table]
    notes: tuple[str, ...]


def diagnose_boundaries(
    trials: Table, campaign: Campaign, fitted: FitResults, seed: int, say: Say
) -> Diagnoses:
    """Diagnose each boundary; of one that cannot be, its block and a note say why."""
    parts = budget.components(campaign)
    chosen = search_options(campaign, seed)
    findings: dict[Boundary, BoundaryDiagnosis | NotDiagnosed] = {}
    residuals: list[Table] = []
    quoted: dict[Boundary, BoundaryResult] = {}
    notes = []
    present = boundaries(trials)
    for i, boundary in enumerate(present):
        step = subprogress(say, i, len(present))
        step(f"diagnose {boundary}")
        data = observe(trials, campaign, boundary)
        base, _ = choice(campaign, boundary)
        try:
            diagnosis = diagnose(
                data,
                base,
                parts,
                chosen,
                look=interim_look(trials, campaign, boundary),
                progress=functools.partial(_fold, step, boundary),
            )
        except NotConverged as fault:
            reason = f"{fault.what}; {fault.remedy}"
            findings[boundary] = NotDiagnosed(reason=reason, base_model=base.name)
            quoted[boundary] = base_result(
                fit(base, data, parts),
                fitted.boundaries[boundary][base.name],
                reason,
                wanted=fault.remedy,
            )
            notes.append(f"{boundary}: not diagnosed: {reason}")
            continue
        findings[boundary] = diagnosis.findings
        if look := diagnosis.findings.look:
            notes.append(f"{boundary}: {look.text}")
        if could := diagnosis.findings.sensitivity:
            notes.append(f"{boundary}: {data.n} trials {could}")
        # the same likelihood but for its noise
        quoted[boundary] = diagnosis.quoted
        if diagnosis.quoted.verdict == "adequate":
            doubts = shape_doubts(fitted.boundaries[boundary][base.name])
            quoted[boundary] = diagnosis.quoted.doubting(doubts)
        notes += [
            f"{boundary}: {remark}"
            for remark in (
                *(diagnosis.findings.contradicted or ()),
                phrases.random_walk(diagnosis.findings.wander) if diagnosis.findings.wander else "",
                phrases.dependence(diagnosis.quoted),
            )
            if remark
        ]
        residuals.append(
            {
                "boundary": np.full(len(diagnosis.residuals["trial"]), boundary, dtype=object),
                **diagnosis.residuals,
            }
        )
    return Diagnoses(
        results=DiagnosisResults(false_alarm_rate=chosen.false_alarm_rate, boundaries=findings),
        quoted=Results(boundaries=quoted),
        residuals=residuals,
        notes=tuple(notes),
    )


def _fold(say: Say, boundary: Boundary, fold: int, count: int) -> None:
    # the search itself, and what follows the folds, take as long as one of them
    say(f"diagnose {boundary}: fold {fold + 1} of {count}", (fold + 1) / (count + 2))
