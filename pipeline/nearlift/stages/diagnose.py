"""diagnose: the closed loop on every boundary, to diagnosis.json, loop_residuals.parquet, and what
is to be quoted to results.json.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from nearlift.declare import Boundary
from nearlift.errors import NotConverged
from nearlift.fit.base_result import base_result, shape_doubts
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.loop.diagnose import diagnose
from nearlift.loop.search_problem import Options
from nearlift.products import DIAGNOSIS, LOOP_RESIDUALS, TRIALS
from nearlift.report import words
from nearlift.results.diagnosis import (
    NOTHING,
    BoundaryDiagnosis,
    DiagnosisResults,
    NotDiagnosed,
)
from nearlift.results.fit import FitResults
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.run import expense, store
from nearlift.run.job import Job, Outcome, Say, part
from nearlift.run.store import Table, stacked
from nearlift.stages.fit import choice
from nearlift.stages.observe import boundaries, interim_look, observe


def run(job: Job) -> Outcome:
    """Diagnose each boundary; of one that cannot be, its block and a note say why."""
    trials = job.read(TRIALS)
    parts = budget.components(job.campaign)
    options = chosen(job)
    findings: dict[Boundary, BoundaryDiagnosis | NotDiagnosed] = {}
    residuals: list[Table] = []
    quoted: dict[Boundary, BoundaryResult] = {}
    fitted = job.load(FitResults)
    notes = []
    present = boundaries(trials)
    for i, boundary in enumerate(present):
        say = part(job.say, i, len(present))
        say(f"diagnose {boundary}")
        data = observe(trials, job.campaign, boundary)
        expense.announce(
            job.announce,
            f"diagnose {boundary}",
            expense.DIAGNOSE,
            data,
            "; several times as long if there is structure to name",
        )
        base, _ = choice(job.campaign, boundary)
        try:
            diagnosis = diagnose(
                data,
                base,
                parts,
                options,
                look=interim_look(trials, job.campaign, boundary),
                progress=functools.partial(_fold, say, boundary),
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
                words.random_walk(diagnosis.findings.wander) if diagnosis.findings.wander else "",
                words.dependence(diagnosis.quoted),
            )
            if remark
        ]
        residuals.append(
            {
                "boundary": np.full(len(diagnosis.residuals["trial"]), boundary, dtype=object),
                **diagnosis.residuals,
            }
        )
    job.write(LOOP_RESIDUALS, stacked(LOOP_RESIDUALS, residuals))
    job.save(DiagnosisResults(false_alarm_rate=options.false_alarm_rate, boundaries=findings))
    job.save(Results(boundaries=quoted))
    return Outcome(notes=tuple(notes))


def _fold(say: Say, boundary: Boundary, fold: int, count: int) -> None:
    # the search itself, and what follows the folds, take as long as one of them
    say(f"diagnose {boundary}: fold {fold + 1} of {count}", (fold + 1) / (count + 2))


def chosen(job: Job) -> Options:
    """The search's options that a manifest may set."""
    asked = job.campaign.diagnose
    return Options(
        seed=job.seed,
        false_alarm_rate=asked.false_alarm_rate,
        not_feasible=tuple(asked.not_feasible),
    )


def diagnosed(processed: Path) -> dict[Boundary, BoundaryDiagnosis]:
    """What the loop found at each boundary that it could diagnose; nothing where it has not run."""
    diagnosis = store.load_if_whole(processed / DIAGNOSIS.file, NOTHING)
    return {b: d for b, d in diagnosis.boundaries.items() if isinstance(d, BoundaryDiagnosis)}
