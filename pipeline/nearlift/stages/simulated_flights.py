"""Flights near ground and ceiling, of the presets and of this campaign's models."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from nearlift.campaign.choices import Simulate
from nearlift.campaign.manifest import boundaries_of
from nearlift.declare import Boundary
from nearlift.flight import paper
from nearlift.flight.crash_rate import Rows, refuse_few
from nearlift.flight.fitted import FittedFlights, SafetyResult, conditions, fitted_flights
from nearlift.flight.paper import PresetFlights
from nearlift.flight.roll import Roll, roll_beside_wall
from nearlift.flight.vehicle import Craft
from nearlift.randomness import generator
from nearlift.results.fit import FitResults
from nearlift.run.engine import Job, Say, subprogress
from nearlift.run.workers import for_compiled_code
from nearlift.stages.diagnose import quoted_lifts
from nearlift.stages.fit import FIT

#: Air density where the manifest gives none, kg/m^3: the paper's.
AIR = 1.2
#: Number of draws of the sidewall's model behind the torque.
ROLL_DRAWS = 400


def simulated_flights(job: Job) -> tuple[SafetyResult, Rows, Rows, tuple[str, ...]]:
    """The result, rows of crash rates and of sample flights, and notes."""
    chosen = job.campaign.simulate or Simulate()
    for risk in chosen.risks:
        refuse_few(risk, chosen.flights)
    for boundary in _flown(job):
        job.campaign.contact_m(boundary)
    key = int(generator(job.seed, "simulate").integers(2**63))
    with for_compiled_code(job.executor) as executor:
        job = replace(job, say=_counting(job, chosen), executor=executor)
        published, rates, samples = _presets(job, chosen, key)
        fitted, fitted_rates = _fitted(job, chosen, key)
    result = SafetyResult(presets=published, fitted=fitted, roll=_roll(job, chosen))
    tests = {
        f"{name} {boundary}": flown.convergence
        for name, preset in published.items()
        for boundary, flown in preset.boundaries.items()
    } | {f"fitted {boundary}": flown.convergence for boundary, flown in fitted.items()}
    warned = [f"{what}: {test.warning}" for what, test in tests.items() if not test.converged]
    return result, rates + fitted_rates, samples, tuple(warned)


def _flown(job: Job) -> list[Boundary]:
    """Boundaries at which this campaign's models are flown."""
    return boundaries_of([b for b in job.read_json(FIT)["boundaries"] if b in paper.MODELS])


def _counting(job: Job, chosen: Simulate) -> Say:
    """Progress of the stage, one step for each boundary of each preset and fitted model."""
    of = len(chosen.presets) * len(paper.MODELS) + len(_flown(job))
    done = itertools.count()

    def say_step(text: str, share: float | None = None, /) -> None:
        subprogress(job.say, next(done), of)(text, share)

    return say_step


def vehicle(job: Job) -> Craft:
    """The campaign's vehicle as the simulation knows it."""
    v, rig = job.campaign.vehicle, job.campaign.rig
    fits = job.load(FitResults)
    most = max(
        (e.value for b in fits.boundaries for e in fits.of_base(b).L_inf_N.values()), default=0.0
    )
    return Craft(
        radius_m=v.rotor_radius,
        mass_kg=v.mass,
        gravity_m_s2=rig.gravity,
        density_kg_m3=rig.air_density or AIR,
        C_L=paper.CRAZYFLIE_AS_PRINTED.C_L,  # sets rotor speed, and no crash depends on that
        rotors=v.rotors,
        # a bench that never carried the weight does not show the largest lift
        most_lift_N=v.thrust_limit or (most if most > v.mass * rig.gravity else math.inf),
    )


def _presets(job: Job, chosen: Simulate, key: int) -> tuple[dict[str, PresetFlights], Rows, Rows]:
    """The paper's models under each preset, with their crash rates, and sample histories."""
    published: dict[str, PresetFlights] = {}
    rates, samples = Rows(), Rows()
    for name in chosen.presets:
        preset = paper.PRESETS[name]
        boundaries = {}
        for boundary in paper.MODELS:
            job.say(f"simulate {name} {boundary}")
            how = preset.simulation(boundary, chosen.flights, key, job.executor.map)
            boundaries[boundary], rows = paper.published_flights(name, how, chosen.risks)
            rates += rows
            samples += paper.histories(name, boundary, key) if name == "paper" else []
        published[name] = PresetFlights(meaning=preset.meaning, boundaries=boundaries)
    return published, rates, samples


def _fitted(job: Job, chosen: Simulate, key: int) -> tuple[dict[Boundary, FittedFlights], Rows]:
    """The campaign's models at each boundary, with their crash rates."""
    craft = vehicle(job)
    fitted: dict[Boundary, FittedFlights] = {}
    rates = Rows()
    for boundary in _flown(job):
        job.say(f"simulate fitted {boundary}")
        lift = quoted_lifts(job).lift(boundary, chosen.draws)
        contact_m = job.campaign.contact_m(boundary)
        how = conditions(chosen, boundary, craft, contact_m, key, job.executor.map)
        held = job.campaign.rig.held
        fitted[boundary], rows = fitted_flights(lift, chosen, how, held, craft, job.seed)
        rates += rows
    return fitted, rates


def _roll(job: Job, chosen: Simulate) -> Roll | None:
    """Roll next to a wall by this campaign's fit; None without a sidewall or four rotors."""
    v = job.campaign.vehicle
    if "sidewall" not in job.read_json(FIT)["boundaries"] or v.rotors != 4 or not v.rotor_spacing:
        return None
    lift = quoted_lifts(job).lift("sidewall", ROLL_DRAWS)
    return roll_beside_wall(
        lift.ratios,
        lift.measured_z_hat[0],
        weight_N=v.mass * job.campaign.rig.gravity,
        arm_m=v.rotor_spacing / 2,
        spacing_hat=v.rotor_spacing / v.rotor_radius,
        inertia_kg_m2=chosen.roll_inertia,
        rng=generator(job.seed, "roll"),
    )
