"""Stage simulate: simulate crash rates and energy near a boundary."""

from __future__ import annotations

from nearlift.run.engine import Job, Outcome, Stage
from nearlift.run.tables import Product, integer, real, text
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.ingest import TRIALS

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
SAFETY = Product(
    file="safety.json",
    title="What the crash rates mean",
    row="preset or fitted model, then boundary",
)
SIMULATION_PRODUCTS = (CRASH_RATES, FLIGHTS, SAFETY)


def run(job: Job) -> Outcome:
    """Fly the presets and this campaign's models; each run tests its own time step."""
    from nearlift.stages.simulated_flights import simulated_flights

    result, rates, samples, notes = simulated_flights(job)
    job.write(CRASH_RATES, CRASH_RATES.columns_of(rates))
    job.write(FLIGHTS, FLIGHTS.columns_of(samples))
    job.write(SAFETY, result)
    return Outcome(notes=notes)


STAGE = Stage(
    name="simulate",
    run=run,
    summary="simulate crash rates and energy near a boundary",
    help="Only where the manifest has [simulate].",
    reads=(TRIALS, FIT, DIAGNOSIS, RESULTS),
    writes=SIMULATION_PRODUCTS,
    sections=("vehicle", "rig", "simulate"),
    where="simulate",
)
