"""Stage diagnose: findings of the loop, residuals before and after it, what is quoted."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from nearlift.errors import NotConverged
from nearlift.run import tables
from nearlift.run.engine import Job, Outcome, Say, Stage, subprogress
from nearlift.run.tables import Product, real, text
from nearlift.stages.fit import FIT, POSTERIOR, RESULTS
from nearlift.stages.flow import DOWNWASH
from nearlift.stages.ingest import TRIALS

if TYPE_CHECKING:
    from nearlift.declare import Boundary
    from nearlift.flight.quoted_lift import QuotedLifts
    from nearlift.results.diagnosis import BoundaryDiagnosis

#: Verdict of a boundary that could not be diagnosed; its block of diagnosis.json holds the `reason`
#: in place of findings.
NOT_DIAGNOSED = "not_diagnosed"
DIAGNOSIS = Product(file="diagnosis.json", title="The closed loop's findings", row="boundary")
LOOP_RESIDUALS = Product(
    file="loop_residuals.parquet",
    title="Residuals before and after the loop",
    row="an accepted trial at a boundary that was diagnosed; a free-air trial once per boundary",
    columns=(
        text("boundary", "the boundary diagnosed"),
        text("trial", "id, as in the schedule"),
        real("before", "1", "log lift less the base model's, fitted to all trials"),
        real(
            "after",
            "1",
            "the same with the accepted effect added; equal to before where there is none",
        ),
        real(
            "held_out_before",
            "1",
            "the same as before, fitted without the trial's visit; nan where it cannot be"
            " predicted",
        ),
        real("held_out_after", "1", "the whole search repeated without the trial's visit"),
    ),
)
QUOTED_POSTERIOR = Product(
    file="quoted_posterior.parquet",
    title="Posterior draws of the quoted coefficients",
    row=(
        "a draw of one coefficient at one boundary that was diagnosed, by the most probable"
        " explanation"
    ),
    columns=POSTERIOR.columns,
)


def run(job: Job) -> Outcome:
    """Diagnose each boundary; of one that cannot be, its block and a note say why.

    A posterior of quoted coefficients that does not converge ends the run with exit code 5.
    """
    from dataclasses import replace

    import numpy as np

    from nearlift.fit.estimator import base_result, shape_doubts
    from nearlift.fit.least_squares import fit
    from nearlift.fit.posterior import sample
    from nearlift.likelihood import budget
    from nearlift.loop.diagnose import diagnose
    from nearlift.loop.result import with_posterior
    from nearlift.observed import (
        at_the_disk,
        boundaries,
        choice,
        interim_progress,
        observe,
        search_options,
    )
    from nearlift.report import phrases
    from nearlift.results.diagnosis import DiagnosisResults, NotDiagnosed
    from nearlift.results.fit import FitResults
    from nearlift.results.quotation import BoundaryResult, Results

    trials, fitted = job.read(TRIALS), job.load(FitResults)
    parts = budget.components(job.campaign)
    blocks: dict[Boundary, BoundaryDiagnosis | NotDiagnosed] = {}
    quoted: dict[Boundary, BoundaryResult] = {}
    residuals, draws, notes = list[tables.Table](), list[tables.Table](), list[str]()
    sampling = job.campaign.fit
    present = boundaries(trials)
    # of a campaign that had grids once, their downwash is left
    measured = job.campaign.piv is not None and (job.processed / DOWNWASH.file).is_file()
    cuts = job.read(DOWNWASH) if measured else None
    for i, boundary in enumerate(present):
        say = subprogress(job.say, i, len(present))
        say(f"diagnose {boundary}")
        data, (base, _) = observe(trials, job.campaign, boundary), choice(job.campaign, boundary)
        base_fit = fitted.boundaries[boundary][base.name]
        downwash = at_the_disk(cuts, boundary) if cuts and base.downwash else ()
        options = search_options(job.campaign, boundary, job.seed)
        try:
            diagnosis = diagnose(
                data,
                base,
                parts,
                replace(options, downwash=downwash),
                look=interim_progress(trials, job.campaign, boundary),
                progress=partial(_say_fold, say, boundary),
            )
        except NotConverged as fault:
            reason = f"{fault.what}; {fault.remedy}"
            blocks[boundary] = NotDiagnosed(reason=reason, base_model=base.name)
            result = fit(base, data, parts, quoted=True)
            quoted[boundary] = base_result(result, base_fit, reason, wanted=fault.remedy)
            notes.append(f"{boundary}: not diagnosed: {reason}")
            continue
        blocks[boundary], quoted[boundary] = diagnosis.findings, diagnosis.quoted
        if diagnosis.quoted.verdict == "adequate":
            # the same likelihood but for its noise
            quoted[boundary] = diagnosis.quoted.doubting(shape_doubts(base_fit))
        size = len(diagnosis.residuals["trial"])
        column = {"boundary": np.full(size, boundary, dtype=object)}
        residuals.append(column | diagnosis.residuals)
        if density := diagnosis.density:
            drawn = sample(
                density,
                job.seed,
                boundary,
                base.name,
                "quoted",
                ess=sampling.ess,
                steps=sampling.steps,
            )
            quoted[boundary] = with_posterior(quoted[boundary], drawn)
            draws += [
                drawn.rows(boundary, base.name, n, drawn.theta[:, :, k])
                for k, n in enumerate(drawn.names)
            ]
        loop = diagnosis.findings
        remarks = (
            loop.look.text if loop.look else "",
            f"{data.n} trials {loop.sensitivity}" if loop.sensitivity else "",
            *(loop.contradicted or ()),
            *(loop.at_bound or ()),
            phrases.random_walk(loop.random_walk_gain) if loop.random_walk_gain else "",
            phrases.dependence(diagnosis.quoted),
            *phrases.implausible(diagnosis.quoted),
            f"downwash at {len(downwash)} distances enters the probabilities" if downwash else "",
        )
        notes += [f"{boundary}: {remark}" for remark in remarks if remark]
    job.write(LOOP_RESIDUALS, tables.stacked(LOOP_RESIDUALS, residuals))
    job.write(QUOTED_POSTERIOR, tables.stacked(QUOTED_POSTERIOR, draws))
    rate = options.false_alarm_rate
    job.write(DIAGNOSIS, DiagnosisResults(false_alarm_rate=rate, boundaries=blocks))
    job.write(RESULTS, Results(boundaries=quoted))
    return Outcome(notes=tuple(notes))


def _say_fold(say: Say, boundary: Boundary, fold: int, count: int) -> None:
    # the search itself, and what follows the folds, take as long as one of them
    say(f"diagnose {boundary}: fold {fold + 1} of {count}", (fold + 1) / (count + 2))


def findings(processed: Path) -> dict[Boundary, BoundaryDiagnosis]:
    """Findings of the loop at each boundary that it could diagnose; none where it has not run."""
    from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis

    results = tables.load_if_whole(processed / DIAGNOSIS.file, NOTHING)
    return {b: d for b, d in results.boundaries.items() if isinstance(d, BoundaryDiagnosis)}


def quoted_lifts(job: Job) -> QuotedLifts:
    """Lift of each boundary as it is quoted."""
    from nearlift.flight.quoted_lift import QuotedLifts
    from nearlift.results.fit import FitResults
    from nearlift.results.quotation import Results

    return QuotedLifts(
        campaign=job.campaign,
        seed=job.seed,
        trials=job.read(TRIALS),
        fits=job.load(FitResults),
        results=job.load(Results),
        findings=findings(job.processed),
    )


STAGE = Stage(
    name="diagnose",
    run=run,
    imports=("nearlift.loop.diagnose",),
    summary="look for the cause of the residuals",
    reads=(TRIALS, FIT, DOWNWASH),
    writes=(DIAGNOSIS, LOOP_RESIDUALS, QUOTED_POSTERIOR, RESULTS),
    sections=(
        "vehicle",
        "rig",
        "load_cell",
        "trials",
        "levels",
        "uncertainty",
        "fit",
        "piv",
        "diagnose",
    ),
    question=(
        click.Option(
            ["--explain"],
            metavar="EFFECT",
            help=(
                "Instead: one effect, what it is, what this campaign could see of it, and what"
                " it is confused with."
            ),
        ),
    ),
    example="--explain supply_sag",
)
