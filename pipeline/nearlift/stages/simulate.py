"""simulate: flights near ground and ceiling, to crash_rates.parquet, flights.parquet,
crash_map.parquet, routes.parquet and safety.json.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from nearlift.declare import Boundary
from nearlift.flight.simulation import maps, presets
from nearlift.flight.simulation.claims import CrashLevels, judge
from nearlift.flight.simulation.corridor import nearness
from nearlift.flight.simulation.craft import Craft
from nearlift.flight.simulation.crash_rate import refuse_few
from nearlift.flight.simulation.fitted import FittedFlights, conditions, fitted_flights
from nearlift.flight.simulation.groups import gains_for
from nearlift.flight.simulation.monte_carlo import StepTest, Sweep
from nearlift.flight.simulation.published import Rows, histories, published_flights
from nearlift.flight.simulation.roll import RollResult, fitted_roll
from nearlift.flight.simulation.route import planned_route
from nearlift.flight.simulation.safety_result import PresetFlights, SafetyResult
from nearlift.manifest.campaign import boundaries_of
from nearlift.manifest.flight import Simulate
from nearlift.products import CRASH_MAP, CRASH_RATES, FIT, FLIGHTS, ROUTES, SAFETY
from nearlift.randomness import generator
from nearlift.results.fit import FitResults
from nearlift.run.job import Job, Outcome, Say, part
from nearlift.stages.quoted_lift import fitted_lift

#: Air density where the manifest gives none, kg/m^3: the paper's.
AIR = 1.2
#: Draws of the sidewall's model behind the torque.
ROLL_DRAWS = 400


def run(job: Job) -> Outcome:
    """Fly the presets and this campaign's models; each run tests its own time step."""
    chosen = job.campaign.simulate or Simulate()
    for risk in chosen.risks:
        refuse_few(risk, chosen.flights)
    for boundary in _flown(job):
        job.campaign.contact_m(boundary)
    key = int(generator(job.seed, "simulate").integers(2**63))
    job = replace(job, say=_counting(job, chosen))
    rates: Rows = []
    tests: dict[str, StepTest] = {}
    published, samples, levels = _presets(job, chosen, key, rates, tests)
    craft = vehicle(job, chosen)
    fitted, flown, mapped = _fitted(job, chosen, craft, key, rates, tests)
    route, routes = None, Rows()
    if chosen.route:
        near = {}
        for boundary, entry in fitted.items():
            lowest = max(entry.measured_z_hat[0], entry.agreed_z_hat)
            time_s = entry.groups.duration * craft.time_s
            rng = generator(job.seed, "route", boundary)
            near[boundary] = nearness(flown[boundary], entry.held, time_s, lowest, rng)
        spacing_m = job.campaign.vehicle.rotor_spacing or 0.0
        route, routes = planned_route(chosen.route, craft, spacing_m, near, chosen.flights)
    job.write(CRASH_RATES, CRASH_RATES.columns_of(rates))
    job.write(FLIGHTS, FLIGHTS.columns_of(samples))
    job.write(CRASH_MAP, CRASH_MAP.columns_of(mapped))
    job.write(ROUTES, ROUTES.columns_of(routes))
    result = SafetyResult(
        schema=SAFETY.schema,
        presets=published,
        fitted=fitted,
        route=route,
        claims=judge(levels),
        roll=_roll(job, chosen),
    )
    job.write_json(SAFETY, result)
    warned = [f"{what}: {test.warning}" for what, test in tests.items() if not test.converged]
    return Outcome(notes=tuple(warned))


def _flown(job: Job) -> list[Boundary]:
    """Boundaries at which this campaign's models are flown."""
    return boundaries_of([b for b in job.read_json(FIT)["boundaries"] if b in presets.MODELS])


def _counting(job: Job, chosen: Simulate) -> Say:
    """What hears each step of the stage as it begins."""
    of = len(chosen.presets) * len(presets.MODELS) + (1 + chosen.maps) * len(_flown(job))
    done = itertools.count()

    def say_step(text: str, share: float | None = None, /) -> None:
        part(job.say, next(done), of)(text, share)

    return say_step


def vehicle(job: Job, chosen: Simulate) -> Craft:
    """The campaign's vehicle as the simulation knows it, with the mass that it flies with."""
    v, rig = job.campaign.vehicle, job.campaign.rig
    fits, mass_kg = job.load(FitResults), chosen.mass or v.mass
    most = max(
        (e.value for b in fits.boundaries for e in fits.of_base(b).L_inf_N.values()), default=0.0
    )
    return Craft(
        radius_m=v.rotor_radius,
        mass_kg=mass_kg,
        gravity_m_s2=rig.gravity,
        density_kg_m3=rig.air_density or AIR,
        C_L=chosen.lift_coefficient,
        rotors=v.rotors,
        motor_lag_s=v.motor_lag,
        # a bench that never carried the weight says nothing of the most
        most_lift_N=v.thrust_limit or (most if most > mass_kg * rig.gravity else math.inf),
    )


def _presets(
    job: Job, chosen: Simulate, key: int, rates: Rows, tests: dict[str, StepTest]
) -> tuple[dict[str, PresetFlights], Rows, dict[str, CrashLevels]]:
    """The paper's models under each preset, sample histories, and what the claims are judged by."""
    published: dict[str, PresetFlights] = {}
    samples: Rows = []
    levels = {name: CrashLevels() for name in chosen.presets}
    for name in chosen.presets:
        preset = presets.preset(name)
        how = preset.monte_carlo(chosen.flights, key, job.executor.map)
        boundaries = {}
        for boundary in presets.MODELS:
            job.say(f"simulate {name} {boundary}")
            flown, rows = published_flights(preset, boundary, how, chosen.risks, levels[name])
            boundaries[boundary] = flown
            rates += rows
            samples += histories(preset, boundary, key) if name == "paper" else []
            tests[f"{name} {boundary}"] = flown.convergence
            if flown.convergence.converged:
                tests[f"{name} {boundary}, other gains and noise"] = flown.variants
        published[name] = PresetFlights(meaning=preset.meaning, boundaries=boundaries)
    return published, samples, levels


def _fitted(
    job: Job, chosen: Simulate, craft: Craft, key: int, rates: Rows, tests: dict[str, StepTest]
) -> tuple[dict[Boundary, FittedFlights], dict[Boundary, Sweep], Rows]:
    """The campaign's models at each boundary, and the maps where they are wanted."""
    fitted: dict[Boundary, FittedFlights] = {}
    flown: dict[Boundary, Sweep] = {}
    mapped: Rows = []
    for boundary in _flown(job):
        job.say(f"simulate fitted {boundary}")
        lift = fitted_lift(job, boundary, chosen.draws)
        contact_m = job.campaign.contact_m(boundary)
        groups, how = conditions(
            chosen, boundary, craft, contact_m, key, job.executor.map, job.campaign.vehicle.mass
        )
        # the command of a flight is its throttle
        said, radius_m = job.campaign.rig.held, craft.radius_m
        held = "throttle" if said == "command" else said
        entry, flown[boundary], rows = fitted_flights(
            lift, chosen, groups, how, held, radius_m, job.seed
        )
        entry = replace(entry, gains=gains_for(groups, craft))
        rates += rows
        tests[f"fitted {boundary}"] = entry.convergence
        if chosen.maps:
            job.say(f"simulate map {boundary}")
            bound, name = entry.bound_z_hat, lift.model.name
            cells, tested = maps.scan(
                boundary, lift.spaced, name, bound, entry.spacing_hat, groups, how
            )
            mapped += cells
            entry = replace(entry, maps=tested)
            tests[f"map {boundary}"] = tested
        fitted[boundary] = entry
    return fitted, flown, mapped


def _roll(job: Job, chosen: Simulate) -> RollResult:
    """What a sidewall's differential lift does by this campaign's fit, where it has a sidewall."""
    v = job.campaign.vehicle
    if "sidewall" not in job.read_json(FIT)["boundaries"] or v.rotors != 4 or not v.rotor_spacing:
        return RollResult()
    lift = fitted_lift(job, "sidewall", ROLL_DRAWS)
    return RollResult(
        fitted=fitted_roll(
            lift.ratios,
            lift.measured_z_hat[0],
            weight_N=v.mass * job.campaign.rig.gravity,
            arm_m=v.rotor_spacing / 2,
            spacing_hat=v.rotor_spacing / v.rotor_radius,
            inertia_kg_m2=chosen.roll_inertia,
            u_inertia=chosen.roll_inertia_uncertainty,
            rng=generator(job.seed, "roll"),
        )
    )
