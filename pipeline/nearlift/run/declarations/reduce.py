"""Stage reduce, and the cells with their covariance."""

from __future__ import annotations

from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.schema import Column, Product
from nearlift.run.stage import Stage

LIFT = Product(
    file="lift.parquet",
    title="Cells",
    row="a (boundary, distance, throttle) cell",
    columns=(
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="z_hat", unit="1", meaning="distance over rotor radius"),
        Column(name="throttle", unit="1", meaning="throttle as a fraction"),
        Column(name="lift_N", unit="N", meaning="mean lift of the cell's trials"),
        Column(
            name="u_lift_N",
            unit="N",
            meaning="its standard uncertainty, from the scatter of trials",
        ),
        Column(name="n_trials", kind="integer", meaning="trials averaged"),
        Column(
            name="delta_L",
            unit="1",
            meaning=(
                "(L - L_inf) / L_inf with L_inf the farthest station (or free air); nan at a"
                " throttle whose farthest is not far; never fitted"
            ),
        ),
        Column(
            name="u_delta_L",
            unit="1",
            meaning="its standard uncertainty; zero at the farthest station by construction",
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
STAGE = Stage(
    name="reduce",
    summary="trials to Delta L per cell, with its covariance",
    reads=(TRIALS,),
    writes=(LIFT, LIFT_COVARIANCE),
    sections=("vehicle", "quality"),
)
