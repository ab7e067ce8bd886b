"""Stage diagnose: findings of the loop, residuals before and after it, what is quoted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.run import tables
from nearlift.run.engine import Job, Option, Outcome, Stage, StageQuestion
from nearlift.run.tables import Product, real, text
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.ingest import TRIALS

if TYPE_CHECKING:
    from nearlift.declare import Boundary
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


def run(job: Job) -> Outcome:
    """Diagnose each boundary; of one that cannot be, its block and a note say why."""
    from nearlift.results.fit import FitResults
    from nearlift.stages.diagnoses import diagnose_boundaries

    diagnoses = diagnose_boundaries(
        job.read(TRIALS), job.campaign, job.load(FitResults), job.seed, job.say
    )
    job.write(LOOP_RESIDUALS, tables.stacked(LOOP_RESIDUALS, diagnoses.residuals))
    job.save(diagnoses.results)
    job.save(diagnoses.quoted)
    return Outcome(notes=diagnoses.notes)


def findings(processed: Path) -> dict[Boundary, BoundaryDiagnosis]:
    """Findings of the loop at each boundary that it could diagnose; none where it has not run."""
    from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis

    results = tables.load_if_whole(processed / DIAGNOSIS.file, NOTHING)
    return {b: d for b, d in results.boundaries.items() if isinstance(d, BoundaryDiagnosis)}


STAGE = Stage(
    name="diagnose",
    run=run,
    summary="residuals, traced to their cause",
    reads=(TRIALS, FIT),
    writes=(DIAGNOSIS, LOOP_RESIDUALS, RESULTS),
    sections=("vehicle", "rig", "load_cell", "trials", "levels", "uncertainty", "fit", "diagnose"),
    question=StageQuestion(
        example="--explain supply_sag",
        options=(
            Option(
                flag="--explain",
                metavar="EFFECT",
                help=(
                    "Instead: one effect, what it is, what this campaign could see of it, and what"
                    " it is confused with."
                ),
            ),
        ),
    ),
)
