"""Stage ingest, and trials.parquet."""

from __future__ import annotations

from nearlift.run.schema import Column, Product
from nearlift.run.stage import Stage

TRIALS = Product(
    file="trials.parquet",
    title="Reduced trials",
    row="a trial, in run order; rejected ones included, with the reason",
    open_ended=True,
    columns=(
        Column(name="trial", kind="text", meaning="id, as in the schedule"),
        Column(
            name="boundary", kind="text", meaning="ground, ceiling, sidewall, or none (free air)"
        ),
        Column(
            name="z_hat",
            unit="1",
            meaning=(
                "rotor plane (sidewall: nearest blade tip) to boundary over rotor radius; inf in"
                " free air"
            ),
        ),
        Column(name="z_m", unit="m", meaning="the same distance"),
        Column(name="throttle", unit="1", meaning="throttle as a fraction"),
        Column(name="lift_N", unit="N", meaning="mean lift, tare removed"),
        Column(
            name="u_lift_N",
            unit="N",
            meaning="standard error of lift_N from this record alone (batch means, tare included)",
        ),
        Column(
            name="u_zero_N",
            unit="N",
            optional=True,
            meaning=(
                "of records cut into pieces: the tare's part of u_lift_N, which all pieces of a"
                " record share"
            ),
        ),
        Column(name="n", kind="integer", meaning="samples averaged"),
        Column(name="n_eff", unit="1", meaning="effectively independent samples among them"),
        Column(name="drift_N_s", unit="N/s", meaning="slope of force within the record"),
        Column(name="sd_N", unit="N", meaning="standard deviation of the samples averaged"),
        Column(
            name="quality",
            kind="text",
            meaning=(
                "quality codes, space separated; empty is good; CAPITALS reject the trial, lower"
                " case only warns"
            ),
        ),
        Column(
            name="visit",
            kind="integer",
            meaning=(
                "counts the traverse's stops: consecutive trials at one boundary and distance"
                " share it"
            ),
        ),
        Column(
            name="source_sha256", kind="text", meaning="SHA-256 of the file the trial came from"
        ),
        Column(
            name="source",
            kind="text",
            optional=True,
            meaning="that file, relative to the campaign's folder",
        ),
        Column(
            name="samples",
            kind="integer",
            optional=True,
            meaning="samples in the record as read, tare and settle included",
        ),
        Column(
            name="completeness",
            kind="text",
            optional=True,
            meaning=(
                "of the record: complete, truncated, malformed, pending (still being written) or"
                " missing"
            ),
        ),
        Column(
            name="fault",
            kind="text",
            optional=True,
            meaning=(
                "what is wrong with a malformed record, in words, and why the manifest excludes the"
                " trial"
            ),
        ),
    ),
)
STAGE = Stage(
    name="ingest",
    summary="raw records to one row per trial",
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
    raw=True,
)
