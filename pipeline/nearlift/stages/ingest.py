"""Stage ingest: raw records to one row for every trial of the schedule."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.isolation import load
from nearlift.run.engine import Inputs, Job, Outcome, Stage
from nearlift.run.tables import Product, integer, real, text

if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign


TRIALS = Product(
    file="trials.parquet",
    title="Reduced trials",
    row="a trial, in run order; rejected ones included, with the reason",
    open_ended=True,
    columns=(
        text("trial", "id, as in the schedule"),
        text("boundary", "ground, ceiling, sidewall, or none (free air)"),
        real(
            "z_hat",
            "1",
            "rotor plane (sidewall: nearest blade tip) to boundary over rotor radius; inf in"
            " free air",
        ),
        real("z_m", "m", "the same distance"),
        real("throttle", "1", "throttle as a fraction"),
        real("lift_N", "N", "mean lift, tare removed"),
        real(
            "u_lift_N",
            "N",
            "standard error of lift_N from this record alone (batch means, tare included)",
        ),
        real(
            "u_zero_N",
            "N",
            "of records cut into pieces: the tare's part of u_lift_N, which all pieces of a"
            " record share",
            optional=True,
        ),
        integer("n", "samples averaged"),
        integer(
            "n_removed",
            "readings of tare and live part left out as impossible or far from all others",
            optional=True,
        ),
        real("n_eff", "1", "effectively independent samples among them"),
        real("drift_N_s", "N/s", "slope of force within the record"),
        real("sd_N", "N", "standard deviation of the samples averaged"),
        text(
            "quality",
            "quality codes, space separated; empty is good; CAPITALS reject the trial, lower"
            " case only warns",
        ),
        integer(
            "visit",
            "counts the traverse's stops: consecutive trials at one boundary and distance share it",
        ),
        text("source_sha256", "SHA-256 of the file the trial came from"),
        text("source", "that file, relative to the campaign's folder", optional=True),
        integer(
            "samples", "samples in the record as read, tare and settle included", optional=True
        ),
        text(
            "completeness",
            "of the record: complete, truncated, malformed, pending (still being written) or"
            " missing",
            optional=True,
        ),
        text(
            "fault",
            "what is wrong with a malformed record, in words, and why the manifest excludes the"
            " trial",
            optional=True,
        ),
    ),
)


def inputs(root: Path, campaign: Campaign) -> Inputs:
    """Schedule and records; raises `NearliftError` where the schedule cannot be read."""
    from nearlift import readers
    from nearlift.readers.files import source_of
    from nearlift.schedule import read_schedule, schedule_file

    trials = list(read_schedule(campaign, root).trial)
    records = readers.reader(campaign.records.reader).places(campaign, root, trials).values()
    paths = [schedule_file(campaign, root), *dict.fromkeys(records)]
    return {file: (file,) for file in (source_of(root, path) for path in paths)}


def run(job: Job) -> Outcome:
    """Write trials.parquet.

    Raises
    ------
    NearliftError
        The schedule or the records are refused, no trial has a record, or none is good. Nothing is
        written then.
    """
    from nearlift.readers.rows import reduced_trials
    from nearlift.run.workers import Processes, ordered, shared

    spread = partial(ordered, job.executor)
    if isinstance(job.executor, Processes):
        # libraries are loaded while others read
        spread = partial(shared, job.executor, first=partial(load, job.ahead))
    table, rejected, notes = reduced_trials(
        job.campaign, job.root, job.inputs, job.stamps, spread, job.say
    )
    job.write(TRIALS, table)
    return Outcome(rejected=tuple(rejected), notes=tuple(notes))


STAGE = Stage(
    name="ingest",
    run=run,
    summary="read records into one row per trial",
    writes=(TRIALS,),
    sections=(
        "name",
        "simulated",
        "vehicle",
        "rig",
        "load_cell",
        "records",
        "segments",
        "trials",
        "quality",
    ),
    inputs=inputs,
    imports=("nearlift.reduction.judge",),
    workers=("nearlift.readers.rows",),
)
