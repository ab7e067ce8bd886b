"""The schema of every product: which file, which columns, in which unit, meaning what. Stages, docs
and tests read it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearlift.errors import ProductError

Kind = Literal["text", "real", "integer"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column: its name (with the unit in it), kind, unit and meaning; an `optional` one may be
    absent.
    """

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
    called: str = ""

    @property
    def name(self) -> str:
        """What it is `called`; else the file's name without its suffix."""
        return self.called or self.file.split(".")[0]

    @property
    def schema(self) -> str:
        """Identifier written into the file."""
        return f"nearlift.{self.file.split('.')[0]}/1"

    def columns_of(self, rows: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
        """Rows as this table's columns."""
        kinds: dict[Kind, Any] = {"text": object, "integer": np.int64, "real": float}
        return {
            c.name: np.array([row[c.name] for row in rows], dtype=kinds[c.kind])
            for c in self.columns
        }


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
FIT = Product(
    file="fit.json", title="Fits: least squares and posterior", row="boundary, then model"
)
RESULTS = Product(
    file="results.json",
    title="The one result to quote",
    row=(
        "boundary: verdict, effects, and each coefficient with interval, budget, influence and"
        " doubts; by fit alone until diagnosed"
    ),
)
PROFILES = Product(
    file="profiles.parquet",
    title="Profile likelihoods",
    row=(
        "a value of one coefficient of one model at one boundary, everything else at its best there"
    ),
    columns=(
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="model", kind="text", meaning="name of the lift model"),
        Column(name="parameter", kind="text", meaning="name of the coefficient"),
        Column(name="value", meaning="the value at which it is held, in the coefficient's unit"),
        Column(
            name="rise",
            unit="1",
            meaning="chi2 above its least, L_inf and the other coefficients optimised",
        ),
        Column(
            name="quadratic", unit="1", meaning="the same as the standard uncertainty would have it"
        ),
    ),
)
POSTERIOR = Product(
    file="posterior.parquet",
    title="Posterior draws",
    row="a draw of one parameter of one model at one boundary",
    columns=(
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="model", kind="text", meaning="name of the lift model"),
        Column(
            name="chain",
            kind="integer",
            meaning="walker of emcee, or one of four hands that independent draws were dealt to",
        ),
        Column(name="draw", kind="integer", meaning="position in the chain, thinned"),
        Column(
            name="parameter",
            kind="text",
            meaning=(
                "name of the parameter; for base models also L_inf_N[throttle], that throttle's"
                " lift far away"
            ),
        ),
        Column(name="value", meaning="value, in the parameter's unit (L_inf in N)"),
        Column(
            name="log_prob",
            meaning=(
                "log posterior density of the draw's parameters, L_inf integrated out; not"
                " normalised"
            ),
        ),
    ),
)
#: Verdict of a boundary that could not be diagnosed; its block of diagnosis.json holds the `reason`
#: in place of findings.
NOT_DIAGNOSED = "not_diagnosed"
DIAGNOSIS = Product(file="diagnosis.json", title="The closed loop's findings", row="boundary")
LOOP_RESIDUALS = Product(
    file="loop_residuals.parquet",
    title="Residuals before and after the loop",
    row="an accepted trial at a boundary that was diagnosed; a free-air trial once per boundary",
    columns=(
        Column(name="boundary", kind="text", meaning="the boundary diagnosed"),
        Column(name="trial", kind="text", meaning="id, as in the schedule"),
        Column(
            name="before", unit="1", meaning="log lift less the base model's, fitted to all trials"
        ),
        Column(
            name="after",
            unit="1",
            meaning="the same with the accepted effect added; equal to before where there is none",
        ),
        Column(
            name="held_out_before",
            unit="1",
            meaning=(
                "the same as before, fitted without the trial's visit; nan where it cannot be"
                " predicted"
            ),
        ),
        Column(
            name="held_out_after",
            unit="1",
            meaning="the whole search repeated without the trial's visit",
        ),
    ),
)
DOWNWASH = Product(
    file="downwash.parquet",
    # the ratio v / v_inf is called downwash already
    called="downwash_cuts",
    title="Downwash beneath the rotors",
    row="a cut beneath one rotor of a [piv] case, or beneath all that were measured (rotor = all)",
    columns=(
        Column(name="case", kind="text", meaning="name of the case in [piv]"),
        Column(
            name="boundary",
            kind="text",
            meaning="ground, ceiling, or none (the control and other free-air cases)",
        ),
        Column(
            name="z_hat",
            unit="1",
            meaning="rotor plane to boundary over rotor radius; inf in free air",
        ),
        Column(
            name="tilt_rad",
            unit="rad",
            meaning="positive where the vehicle's +x side is farther from the boundary",
        ),
        Column(
            name="rotor",
            kind="text",
            meaning="index of the rotor in the light sheet from 0, or all",
        ),
        Column(name="below_m", unit="m", meaning="distance of the cut below the rotor plane"),
        Column(name="half_span_m", unit="m", meaning="half the length of the cut"),
        Column(
            name="downwash_m_s", unit="m/s", meaning="mean velocity against thrust through the cut"
        ),
        Column(
            name="u_downwash_m_s",
            unit="m/s",
            meaning="its standard uncertainty, the parts that follow in quadrature",
        ),
        Column(
            name="u_noise_m_s",
            unit="m/s",
            meaning="part from the scatter of fields, correlation in time included",
        ),
        Column(
            name="u_mask_m_s", unit="m/s", meaning="part from stretches of the cut without vectors"
        ),
        Column(name="u_position_m_s", unit="m/s", meaning="part from the place of the cut"),
        Column(name="u_span_m_s", unit="m/s", meaning="part from the length of the cut"),
        Column(
            name="u_scale_m_s",
            unit="m/s",
            meaning="part from the velocity scale; it cancels in the reduction",
        ),
        Column(name="covered", unit="1", meaning="part of the cut that has vectors"),
        Column(name="n_fields", kind="integer", meaning="fields averaged"),
        Column(name="n_eff", unit="1", meaning="independent fields among them, for this cut"),
        Column(
            name="clearance_hat",
            unit="1",
            meaning="least distance from the cut to the boundary over rotor radius",
        ),
        Column(name="reduction", unit="1", meaning="1 - downwash over the control's"),
        Column(name="u_reduction", unit="1", meaning="its standard uncertainty"),
        Column(name="reduction_lo90", unit="1", meaning="lower end of its 90 % interval"),
        Column(name="reduction_hi90", unit="1", meaning="upper end of its 90 % interval"),
        Column(
            name="warnings",
            kind="text",
            meaning="space separated; why this is not the inflow at the disk, or not all of it",
        ),
    ),
)
DOWNWASH_PROFILE = Product(
    file="downwash_profile.parquet",
    title="Downwash along the cut",
    row="a node of the cut of one [piv] case; what was mirrored is there too, and marked",
    columns=(
        Column(name="case", kind="text", meaning="name of the case in [piv]"),
        Column(
            name="x_m",
            unit="m",
            meaning="place along the light sheet from midway between the rotors",
        ),
        Column(
            name="downwash_m_s",
            unit="m/s",
            meaning="mean velocity against thrust; nan where there is no vector",
        ),
        Column(
            name="u_downwash_m_s",
            unit="m/s",
            meaning="its standard error, correlation in time included",
        ),
        Column(
            name="mirrored",
            kind="integer",
            meaning="1 where the other half was measured and this is its reflection",
        ),
    ),
)
FLOW_FIELDS = Product(
    file="flow_fields.parquet",
    title="Mean velocity fields",
    row=(
        "a node of the mean field of one [piv] case, in vehicle axes (y along thrust from the rotor"
        " plane)"
    ),
    columns=(
        Column(name="case", kind="text", meaning="name of the case in [piv]"),
        Column(
            name="x_m", unit="m", meaning="along the light sheet from midway between the rotors"
        ),
        Column(name="y_m", unit="m", meaning="along thrust from the rotor plane"),
        Column(
            name="z_m",
            unit="m",
            meaning=(
                "distance to the boundary along its normal; inf in free air, negative behind it"
            ),
        ),
        Column(
            name="vx_m_s", unit="m/s", meaning="mean velocity along x; nan where there is no vector"
        ),
        Column(
            name="vy_m_s",
            unit="m/s",
            meaning="mean velocity along y (downwash is -vy); nan where there is no vector",
        ),
        Column(
            name="u_vx_m_s",
            unit="m/s",
            meaning="standard error of vx_m_s, correlation in time included",
        ),
        Column(
            name="u_vy_m_s",
            unit="m/s",
            meaning="standard error of vy_m_s, correlation in time included",
        ),
        Column(name="sd_vx_m_s", unit="m/s", meaning="standard deviation of one field's vx"),
        Column(name="sd_vy_m_s", unit="m/s", meaning="standard deviation of one field's vy"),
        Column(name="count", kind="integer", meaning="fields with a vector there"),
        Column(name="stagnant", kind="integer", meaning="1 in the stagnation zone"),
        Column(
            name="mirrored",
            kind="integer",
            meaning="1 where the other half was measured and this is its reflection",
        ),
    ),
)
FLOW_TOPOLOGY = Product(
    file="flow_topology.parquet",
    title="Topology of the wake near the ground",
    row="a number of one ground case of [piv]",
    columns=(
        Column(name="case", kind="text", meaning="name of the case in [piv]"),
        Column(name="z_hat", unit="1", meaning="rotor plane to boundary over rotor radius"),
        Column(
            name="tilt_rad",
            unit="rad",
            meaning="positive where the vehicle's +x side is farther from the boundary",
        ),
        Column(
            name="quantity", kind="text", meaning="which number; see the page of the flow stage"
        ),
        Column(name="value", meaning="its value in the mean field, in the unit that its name says"),
        Column(name="u", meaning="standard deviation over resampled mean fields"),
        Column(name="lo90", meaning="5 % quantile over resampled mean fields"),
        Column(name="hi90", meaning="95 % quantile over resampled mean fields"),
        Column(
            name="agreement",
            unit="1",
            meaning=(
                "share of resampled mean fields that give the same whole number; nan for what is no"
                " count"
            ),
        ),
    ),
)
FLOW = Product(
    file="flow.json", title="What was read and averaged of each velocity field", row="case"
)
JOINT = Product(file="joint.json", title="Lift and downwash fitted together", row="boundary")
FLOW_PRODUCTS = (DOWNWASH, DOWNWASH_PROFILE, FLOW_FIELDS, FLOW_TOPOLOGY, FLOW)
CRASH_RATES = Product(
    file="crash_rates.parquet",
    title="Crash rates",
    row="a set-point of one lift model, at one boundary, under one preset",
    columns=(
        Column(
            name="preset",
            kind="text",
            meaning="paper or converged: the paper's vehicle and models; fitted: this campaign's",
        ),
        Column(name="boundary", kind="text", meaning="ground or ceiling"),
        Column(
            name="model",
            kind="text",
            meaning="name of the lift model; none: no boundary effect in the flight",
        ),
        Column(
            name="exponent",
            unit="1",
            meaning="power to which L / L_inf is raised; 0 where there is no model",
        ),
        Column(
            name="member",
            kind="integer",
            meaning="which posterior draw of the model flies; -1 the best estimate",
        ),
        Column(name="target_z_hat", unit="1", meaning="set-point over rotor radius"),
        Column(
            name="flights",
            kind="integer",
            meaning="simulated flights; all settings meet the same gusts",
        ),
        Column(name="crashes", kind="integer", meaning="flights that touched the boundary"),
        Column(name="rate", unit="1", meaning="crashes over flights"),
        Column(name="lo90", unit="1", meaning="lower end of the rate's 90 % interval, binomial"),
        Column(name="hi90", unit="1", meaning="upper end"),
        Column(name="ratio", unit="1", meaning="L / L_inf at the set-point"),
        Column(
            name="cost_paper",
            unit="1",
            meaning="relative energy cost ratio^(-3/2), as the paper has it",
        ),
        Column(
            name="cost",
            unit="1",
            meaning="relative energy cost by what is held (presets: the theory's 1 / ratio)",
        ),
        Column(
            name="cost_lo",
            unit="1",
            meaning="least cost over what is not known of the held quantity",
        ),
        Column(
            name="cost_hi",
            unit="1",
            meaning="largest cost over what is not known of the held quantity",
        ),
    ),
)
FLIGHTS = Product(
    file="flights.parquet",
    title="Sample time histories",
    row="a moment of one sample flight",
    columns=(
        Column(name="preset", kind="text", meaning="whose vehicle, controller and time step"),
        Column(name="boundary", kind="text", meaning="ground or ceiling"),
        Column(
            name="model",
            kind="text",
            meaning="name of the lift model; none: no boundary effect in the flight",
        ),
        Column(name="target_z_hat", unit="1", meaning="set-point over rotor radius"),
        Column(
            name="flight",
            kind="integer",
            meaning="number of the flight, which says which gusts it meets",
        ),
        Column(name="t_s", unit="s", meaning="time since the start"),
        Column(
            name="z_hat",
            unit="1",
            meaning="distance to the boundary over rotor radius; the record ends with a crash",
        ),
    ),
)
CRASH_MAP = Product(
    file="crash_map.parquet",
    title="Crash rate over dimensionless groups",
    row="a cell of one map at one boundary",
    columns=(
        Column(name="boundary", kind="text", meaning="ground or ceiling"),
        Column(name="model", kind="text", meaning="name of the lift model"),
        Column(name="target_z_hat", unit="1", meaning="set-point over rotor radius"),
        Column(name="map", kind="text", meaning="which pair of groups"),
        Column(
            name="x_group",
            kind="text",
            meaning="beta, correlation or spacing_hat: the group along the first axis",
        ),
        Column(name="y_group", kind="text", meaning="alpha or noise: the group along the second"),
        Column(
            name="x",
            unit="1",
            meaning=(
                "size of the first group: derivative gain, correlation time over sqrt(r/g), or"
                " spacing over radius"
            ),
        ),
        Column(
            name="y",
            unit="1",
            meaning=(
                "size of the second: proportional gain, or standard deviation of the disturbance"
                " over weight"
            ),
        ),
        Column(name="flights", kind="integer", meaning="simulated flights"),
        Column(name="crashes", kind="integer", meaning="flights that touched the boundary"),
        Column(name="rate", unit="1", meaning="crashes over flights"),
        Column(name="lo90", unit="1", meaning="lower end of the rate's 90 % interval, binomial"),
        Column(name="hi90", unit="1", meaning="upper end"),
    ),
)
SAFETY = Product(
    file="safety.json",
    title="What the crash rates mean",
    row="preset or fitted model, then boundary",
)
ROUTES = Product(
    file="routes.parquet",
    title="Ways through the corridor",
    row="a point of one way; ways by falling risk",
    columns=(
        Column(name="way", kind="integer", meaning="number of the way"),
        Column(
            name="price",
            unit="1",
            meaning=(
                "price of a crash for which it is best, in energies of the straight way far from"
                " boundaries"
            ),
        ),
        Column(
            name="energy",
            unit="1",
            meaning="its energy over that of the straight way far from boundaries",
        ),
        Column(name="risk", unit="1", meaning="its risk of a crash"),
        Column(
            name="lo90",
            unit="1",
            meaning="lower end of the risk's 90 % interval, over the model's draws and the flights",
        ),
        Column(name="hi90", unit="1", meaning="upper end, by which it is chosen"),
        Column(
            name="chosen",
            kind="integer",
            meaning="1: the cheapest that is shown to keep within the bound on risk",
        ),
        Column(
            name="risk_from",
            kind="text",
            meaning=(
                "what the risk at this point rests on: flights that crashed, none that did, or none"
                " flown"
            ),
        ),
        Column(name="x_m", unit="m", meaning="distance along the corridor"),
        Column(name="z_m", unit="m", meaning="height of the rotor plane above the floor"),
    ),
)
DETECTION = Product(
    file="detection.parquet",
    title="Detection range",
    row="a boundary, an averaging time, an uncertainty of payload and one of the supply",
    columns=(
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="model", kind="text", meaning="name of the lift model"),
        Column(
            name="averaging_s",
            unit="s",
            meaning="time over which lift (or the throttle to hover) is averaged",
        ),
        Column(name="payload", unit="1", meaning="relative standard uncertainty of the weight"),
        Column(
            name="voltage", unit="1", meaning="relative standard uncertainty of the supply voltage"
        ),
        Column(
            name="supply",
            unit="1",
            meaning="relative standard uncertainty of lift from that of the supply voltage",
        ),
        Column(name="sigma", unit="1", meaning="standard deviation of the ratio's estimate"),
        Column(
            name="needed",
            unit="1",
            meaning="change of lift noticed at the rates of false alarms and misses",
        ),
        Column(
            name="range_z_hat",
            unit="1",
            meaning=(
                "farthest distance at which lift changes so much; nan: nowhere that was measured"
            ),
        ),
        Column(
            name="lo90",
            unit="1",
            meaning=(
                "lower end of its 90 % interval over the model's uncertainty; 0: perhaps nowhere"
            ),
        ),
        Column(name="hi90", unit="1", meaning="upper end"),
        Column(name="range_m", unit="m", meaning="the same distance"),
    ),
)
PROXIMITY = Product(file="proximity.json", title="Where the boundary is, from lift", row="boundary")
SIMULATION_PRODUCTS = (CRASH_RATES, FLIGHTS, CRASH_MAP, SAFETY, ROUTES)
PROXIMITY_PRODUCTS = (DETECTION, PROXIMITY)
#: A column of trials.parquet has the name of the file already.
QUALITY = Product(
    file="quality.json",
    called="ledger",
    title="Every trial from raw byte to figure, and what each exclusion is worth",
    row="trial",
)
PROVENANCE = Product(file="provenance.json", title="What made these products", row="stage")

PRODUCTS = (
    TRIALS,
    LIFT,
    LIFT_COVARIANCE,
    FIT,
    PROFILES,
    POSTERIOR,
    DIAGNOSIS,
    LOOP_RESIDUALS,
    RESULTS,
    *FLOW_PRODUCTS,
    JOINT,
    *SIMULATION_PRODUCTS,
    *PROXIMITY_PRODUCTS,
    QUALITY,
    PROVENANCE,
)


def product(file: str) -> Product:
    """The product of that file name."""
    for item in PRODUCTS:
        if item.file == file:
            return item
    raise ProductError(
        file, "is not a product", f"products are {', '.join(p.file for p in PRODUCTS)}"
    )
