"""Stage simulate: crash rates, energy, and ways through a corridor."""

from __future__ import annotations

from nearlift.run.declarations.diagnose import DIAGNOSIS
from nearlift.run.declarations.fit import FIT, RESULTS
from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.schema import Column, Product
from nearlift.run.stage import Stage

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
SIMULATION_PRODUCTS = (CRASH_RATES, FLIGHTS, CRASH_MAP, SAFETY, ROUTES)
STAGE = Stage(
    name="simulate",
    summary="crash rates and energy near ground and ceiling",
    help="Only where the manifest has [simulate].",
    reads=(TRIALS, FIT, DIAGNOSIS, RESULTS),
    writes=SIMULATION_PRODUCTS,
    sections=("vehicle", "rig", "simulate"),
    where="simulate",
)
