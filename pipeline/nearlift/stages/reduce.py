"""Stage reduce: average trials into the change of lift per cell."""

from __future__ import annotations

from nearlift.errors import InputRefused
from nearlift.nomenclature import CARRIED, symbol
from nearlift.run.engine import Job, Outcome, Stage
from nearlift.run.tables import Product, integer, real, text
from nearlift.stages.ingest import TRIALS

LIFT = Product(
    file="lift.parquet",
    title="Cells",
    row="a (boundary, distance, throttle) cell",
    columns=(
        text("boundary", "ground, ceiling or sidewall"),
        real("z_hat", "1", "distance over rotor radius"),
        real("throttle", "1", "throttle as a fraction"),
        real("lift_N", "N", "mean lift of the cell's trials"),
        real("u_lift_N", "N", "its standard uncertainty, from the scatter of trials"),
        integer("n_trials", "trials averaged"),
        real(
            "delta_L",
            "1",
            "(L - L_inf) / L_inf with L_inf the farthest station (or free air); nan at a"
            " throttle whose farthest is not far; never fitted",
        ),
        real(
            "u_delta_L",
            "1",
            "its standard uncertainty; zero at the farthest station by construction",
        ),
        *(
            column
            for name, u in CARRIED.items()
            for column in (
                real(
                    name,
                    symbol(name).unit,
                    f"mean of the cell's trials: {symbol(name).meaning}; no model is fitted to it",
                    optional=True,
                ),
                real(u, symbol(name).unit, "its standard uncertainty", optional=True),
            )
        ),
    ),
)
LIFT_COVARIANCE = Product(
    file="lift_covariance.parquet",
    title="Covariance of delta_L",
    row=(
        "a cell of lift.parquet, in the same order; column c0, c1, ... its covariance with cell 0,"
        " 1, ...; empty beyond 2000 cells"
    ),
    open_ended=True,
)


def run(job: Job) -> Outcome:
    """Write lift.parquet and lift_covariance.parquet.

    Raises
    ------
    InputRefused
        All accepted trials are in free air.
    """
    from nearlift.observed import boundaries, observe
    from nearlift.reduction.lift_change import lift_change

    trials = job.read(TRIALS)
    observed = {b: observe(trials, job.campaign, b) for b in boundaries(trials)}
    if not observed:
        raise InputRefused(
            job.campaign.trials.file,
            "has no good trial near a boundary, only in free air",
            "trials.parquet is written; a change of lift needs trials at some distance to a"
            " ground, ceiling or sidewall",
        )
    near_reference = job.campaign.quality.near_reference
    lift, covariance, notes = lift_change(trials, observed, near_reference)
    job.write(LIFT, lift)
    job.write(LIFT_COVARIANCE, covariance)
    return Outcome(notes=notes)


STAGE = Stage(
    name="reduce",
    run=run,
    summary="average trials into the change of lift per cell",
    reads=(TRIALS,),
    writes=(LIFT, LIFT_COVARIANCE),
    sections=("vehicle", "quality", "levels"),
)
