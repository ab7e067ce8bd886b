"""The schema of every product: which file, which columns, in which unit, meaning what. Stages, docs and tests read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nearlift.errors import ProductError

Kind = Literal["text", "real", "integer"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column: its name (with the unit in it), kind, unit and meaning; an `optional` one may be absent."""

    name: str
    kind: Kind = "real"
    unit: str = ""
    meaning: str
    optional: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """One file that a stage writes. Tables may carry further columns where `open_ended`."""

    file: str
    title: str
    row: str
    columns: tuple[Column, ...] = ()
    open_ended: bool = False

    @property
    def name(self) -> str:
        """The file's name without its suffix."""
        return self.file.split(".")[0]

    @property
    def schema(self) -> str:
        """Identifier written into the file."""
        return f"nearlift.{self.name}/1"


TRIALS = Product(
    file="trials.parquet",
    title="Reduced trials",
    row="a trial, in run order; rejected ones included, with the reason",
    open_ended=True,
    columns=(
        Column(name="trial", kind="text", meaning="id, as in the schedule"),
        Column(name="boundary", kind="text", meaning="ground, ceiling, sidewall, or none (free air)"),
        Column(name="z_hat", unit="1", meaning="rotor plane (sidewall: nearest blade tip) to boundary over rotor radius; inf in free air"),
        Column(name="z_m", unit="m", meaning="the same distance"),
        Column(name="throttle", unit="1", meaning="throttle as a fraction"),
        Column(name="lift_N", unit="N", meaning="mean lift, tare removed"),
        Column(name="u_lift_N", unit="N", meaning="standard error of lift_N from this record alone (batch means, tare included)"),
        Column(name="n", kind="integer", meaning="samples averaged"),
        Column(name="n_eff", unit="1", meaning="effectively independent samples among them"),
        Column(name="drift_N_s", unit="N/s", meaning="slope of force within the record"),
        Column(name="sd_N", unit="N", meaning="standard deviation of the samples averaged"),
        Column(
            name="quality", kind="text", meaning="quality codes, space separated; empty is good; CAPITALS reject the trial, lower case only warns"
        ),
        Column(name="visit", kind="integer", meaning="counts the traverse's stops: consecutive trials at one boundary and distance share it"),
        Column(name="source_sha256", kind="text", meaning="SHA-256 of the file the trial came from"),
        Column(name="source", kind="text", optional=True, meaning="that file, relative to the campaign's folder"),
        Column(name="samples", kind="integer", optional=True, meaning="samples in the record as read, tare and settle included"),
        Column(
            name="completeness",
            kind="text",
            optional=True,
            meaning="of the record: complete, truncated, malformed, pending (still being written) or missing",
        ),
    ),
)
LIFT = Product(
    file="lift.parquet",
    title="Cells",
    row="a (boundary, distance, throttle) cell",
    columns=(
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="z_hat", unit="1", meaning="distance over rotor radius"),
        Column(name="throttle", unit="1", meaning="throttle as a fraction"),
        Column(name="lift_N", unit="N", meaning="mean lift of the cell's trials"),
        Column(name="u_lift_N", unit="N", meaning="its standard uncertainty, from the scatter of trials"),
        Column(name="n_trials", kind="integer", meaning="trials averaged"),
        Column(
            name="delta_L",
            unit="1",
            meaning="(L - L_inf) / L_inf with L_inf the farthest station (or free air); for tables and figures, never fitted",
        ),
        Column(name="u_delta_L", unit="1", meaning="its standard uncertainty; zero at the farthest station by construction"),
    ),
)
LIFT_COVARIANCE = Product(
    file="lift_covariance.parquet",
    title="Covariance of delta_L",
    row="a cell of lift.parquet, in the same order; column c0, c1, ... its covariance with cell 0, 1, ...",
    open_ended=True,
)
FIT = Product(file="fit.json", title="Fits: least squares and posterior", row="boundary, then model")
POSTERIOR = Product(
    file="posterior.parquet",
    title="Posterior draws",
    row="a draw of one parameter of one model at one boundary",
    columns=(
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="model", kind="text", meaning="name of the lift model"),
        Column(name="chain", kind="integer", meaning="walker of emcee, or one of four hands that independent draws were dealt to"),
        Column(name="draw", kind="integer", meaning="position in the chain, thinned"),
        Column(name="parameter", kind="text", meaning="name of the parameter; for base models also L_inf_N[throttle], that throttle's lift far away"),
        Column(name="value", meaning="value, in the parameter's unit (L_inf in N)"),
        Column(name="log_prob", meaning="log posterior density of the draw's parameters, L_inf integrated out; not normalised"),
    ),
)
DIAGNOSIS = Product(file="diagnosis.json", title="The closed loop's findings", row="boundary")
LOOP_RESIDUALS = Product(
    file="loop_residuals.parquet",
    title="Residuals before and after the loop",
    row="an accepted trial at a boundary that was diagnosed; a free-air trial once per boundary",
    columns=(
        Column(name="boundary", kind="text", meaning="the boundary diagnosed"),
        Column(name="trial", kind="text", meaning="id, as in the schedule"),
        Column(name="before", unit="1", meaning="log lift less the base model's, fitted to all trials"),
        Column(name="after", unit="1", meaning="the same with the accepted effect added; equal to before where there is none"),
        Column(name="held_out_before", unit="1", meaning="the same as before, fitted without the trial's visit; nan where it cannot be predicted"),
        Column(name="held_out_after", unit="1", meaning="the whole search repeated without the trial's visit"),
    ),
)
PROVENANCE = Product(file="provenance.json", title="What made these products", row="stage")

PRODUCTS = (TRIALS, LIFT, LIFT_COVARIANCE, FIT, POSTERIOR, DIAGNOSIS, LOOP_RESIDUALS, PROVENANCE)


def product(file: str) -> Product:
    """The product of that file name."""
    for item in PRODUCTS:
        if item.file == file:
            return item
    raise ProductError(file, "is not a product", f"products are {', '.join(p.file for p in PRODUCTS)}")
