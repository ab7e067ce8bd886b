"""Stage diagnose: the loop's findings, and the residuals before and after it."""

from __future__ import annotations

from nearlift.run.declarations.fit import FIT, RESULTS
from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.schema import Product, real, text
from nearlift.run.stage import Option, Stage, StageQuestion

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
STAGE = Stage(
    name="diagnose",
    summary="residuals, traced to their cause",
    reads=(TRIALS, FIT),
    writes=(DIAGNOSIS, LOOP_RESIDUALS, RESULTS),
    sections=("vehicle", "rig", "load_cell", "trials", "levels", "uncertainty", "fit", "diagnose"),
    question=StageQuestion(
        module="nearlift.commands.explain",
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
