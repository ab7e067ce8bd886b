"""Stage simulate: crash rates, energy, and ways through a corridor."""

from __future__ import annotations

from nearlift.run.declarations.diagnose import DIAGNOSIS
from nearlift.run.declarations.fit import FIT, RESULTS
from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.schema import Product, integer, real, text
from nearlift.run.stage import Stage

CRASH_RATES = Product(
    file="crash_rates.parquet",
    title="Crash rates",
    row="a set-point of one lift model, at one boundary, under one preset",
    columns=(
        text(
            "preset", "paper or converged: the paper's vehicle and models; fitted: this campaign's"
        ),
        text("boundary", "ground or ceiling"),
        text("model", "name of the lift model; none: no boundary effect in the flight"),
        real("exponent", "1", "power to which L / L_inf is raised; 0 where there is no model"),
        integer("member", "which posterior draw of the model flies; -1 the best estimate"),
        text(
            "below_nearest",
            "what lift does nearer than the nearest station: form (the model's own), held (its"
            " value there); empty where neither flies",
        ),
        real(
            "contact_z_hat",
            "1",
            "what counts as a crash: the rotor plane so near, over rotor radius",
        ),
        real("target_z_hat", "1", "set-point over rotor radius"),
        integer("flights", "simulated flights; all settings meet the same gusts"),
        integer("crashes", "flights that touched the boundary"),
        real("rate", "1", "crashes over flights"),
        real("lo90", "1", "lower end of the rate's 90 % interval, binomial"),
        real("hi90", "1", "upper end"),
        real("ratio", "1", "L / L_inf at the set-point"),
        real("cost_paper", "1", "relative energy cost ratio^(-3/2), as the paper has it"),
        real("cost", "1", "relative energy cost by what is held (presets: the theory's 1 / ratio)"),
        real("cost_lo", "1", "least cost over what is not known of the held quantity"),
        real("cost_hi", "1", "largest cost over what is not known of the held quantity"),
    ),
)
FLIGHTS = Product(
    file="flights.parquet",
    title="Sample time histories",
    row="a moment of one sample flight",
    columns=(
        text("preset", "whose vehicle, controller and time step"),
        text("boundary", "ground or ceiling"),
        text("model", "name of the lift model; none: no boundary effect in the flight"),
        real("target_z_hat", "1", "set-point over rotor radius"),
        integer("flight", "number of the flight, which says which gusts it meets"),
        real("t_s", "s", "time since the start"),
        real(
            "z_hat", "1", "distance to the boundary over rotor radius; the record ends with a crash"
        ),
    ),
)
CRASH_MAP = Product(
    file="crash_map.parquet",
    title="Crash rate over dimensionless groups",
    row="a cell of one map at one boundary",
    columns=(
        text("boundary", "ground or ceiling"),
        text("model", "name of the lift model"),
        real("target_z_hat", "1", "set-point over rotor radius"),
        text("map", "which pair of groups"),
        text("x_group", "beta, correlation or spacing_hat: the group along the first axis"),
        text("y_group", "alpha or noise: the group along the second"),
        real(
            "x",
            "1",
            "size of the first group: derivative gain, correlation time over sqrt(r/g), or"
            " spacing over radius",
        ),
        real(
            "y",
            "1",
            "size of the second: proportional gain, or standard deviation of the disturbance"
            " over weight",
        ),
        integer("flights", "simulated flights"),
        integer("crashes", "flights that touched the boundary"),
        real("rate", "1", "crashes over flights"),
        real("lo90", "1", "lower end of the rate's 90 % interval, binomial"),
        real("hi90", "1", "upper end"),
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
        integer("way", "number of the way"),
        real(
            "price",
            "1",
            "price of a crash for which it is best, in energies of the straight way far from"
            " boundaries",
        ),
        real("energy", "1", "its energy over that of the straight way far from boundaries"),
        real("risk", "1", "its risk of a crash"),
        real(
            "lo90",
            "1",
            "lower end of the risk's 90 % interval, over the model's draws and the flights",
        ),
        real("hi90", "1", "upper end, by which it is chosen"),
        integer("chosen", "1: the cheapest that is shown to keep within the bound on risk"),
        text(
            "risk_from",
            "what the risk at this point rests on: flights that crashed, none that did, or none"
            " flown",
        ),
        real("x_m", "m", "distance along the corridor"),
        real("z_m", "m", "height of the rotor plane above the floor"),
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
