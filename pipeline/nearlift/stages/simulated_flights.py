"""Flights near ground and ceiling, of the presets and of this campaign's models."""

from __future__ import annotations

import itertools
import math

from nearlift.campaign.choices import Simulate
from nearlift.campaign.manifest import boundaries_of
from nearlift.flight import paper
from nearlift.flight.crash_rate import Rows, StepTest, refuse_few
from nearlift.flight.fitted import SafetyResult, conditions, fitted_flights
from nearlift.flight.quoted_lift import QuotedLifts
from nearlift.flight.roll import Roll, roll_beside_wall
from nearlift.flight.vehicle import Craft
from nearlift.randomness import generator
from nearlift.run.engine import Job, subprogress
from nearlift.run.workers import for_compiled_code
from nearlift.stages.diagnose import quoted_lifts

#: Air density where the manifest gives none, kg/m^3: the paper's.
AIR = 1.2
#: Number of draws of the sidewall's model behind the torque.
ROLL_DRAWS = 400


def simulated_flights(job: Job) -> tuple[SafetyResult, Rows, Rows, tuple[str, ...]]:
    """The result, rows of crash rates and of sample flights, and notes."""
    chosen, campaign = job.campaign.simulate or Simulate(), job.campaign
    for risk in chosen.risks:
        refuse_few(risk, chosen.flights)
    quoted = quoted_lifts(job)
    flown = boundaries_of([b for b in quoted.fits.boundaries if b in paper.MODELS])
    contact_m = {boundary: campaign.contact_m(boundary) for boundary in flown}
    key = int(generator(job.seed, "simulate").integers(2**63))
    craft, held, done = vehicle(quoted), campaign.rig.held, itertools.count()
    steps = len(chosen.presets) * len(paper.MODELS) + len(flown)
    rates, samples, tests = Rows(), Rows(), dict[str, StepTest]()
    presets, fitted = dict[str, paper.PresetFlights](), {}

    def say(what: str) -> None:
        subprogress(job.say, next(done), steps)(f"simulate {what}")

    with for_compiled_code(job.executor) as executor:
        for name in chosen.presets:
            published = {}
            for boundary in paper.MODELS:
                say(f"{name} {boundary}")
                how = paper.simulation(name, boundary, chosen.flights, key, executor.map)
                entry, rows = paper.published_flights(name, how, chosen.risks)
                published[boundary] = entry
                tests[f"{name} {boundary}"] = entry.convergence
                rates += rows
                samples += paper.histories(name, boundary, key) if name == "paper" else []
            presets[name] = paper.PresetFlights(meaning=paper.MEANINGS[name], boundaries=published)
        for boundary in flown:
            say(f"fitted {boundary}")
            lift = quoted.lift(boundary, chosen.draws)
            how = conditions(chosen, boundary, craft, contact_m[boundary], key, executor.map)
            fitted[boundary], rows = fitted_flights(lift, chosen, how, held, craft, job.seed)
            tests[f"fitted {boundary}"] = fitted[boundary].convergence
            rates += rows
    result = SafetyResult(presets=presets, fitted=fitted, roll=_roll(quoted, chosen))
    warned = [f"{what}: {test.warning}" for what, test in tests.items() if not test.converged]
    return result, rates, samples, tuple(warned)


def vehicle(quoted: QuotedLifts) -> Craft:
    """The campaign's vehicle as the simulation knows it."""
    v, rig, fits = quoted.campaign.vehicle, quoted.campaign.rig, quoted.fits
    most = max(e.value for b in fits.boundaries for e in fits.of_base(b).L_inf_N.values())
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


def _roll(quoted: QuotedLifts, chosen: Simulate) -> Roll | None:
    """Roll next to a wall by this campaign's fit; None without a sidewall or four rotors."""
    v = quoted.campaign.vehicle
    if "sidewall" not in quoted.fits.boundaries or v.rotors != 4 or not v.rotor_spacing:
        return None
    lift = quoted.lift("sidewall", ROLL_DRAWS)
    return roll_beside_wall(
        lift.ratios,
        lift.measured_z_hat[0],
        weight_N=v.mass * quoted.campaign.rig.gravity,
        arm_m=v.rotor_spacing / 2,
        spacing_hat=v.rotor_spacing / v.rotor_radius,
        inertia_kg_m2=chosen.roll_inertia,
        rng=generator(quoted.seed, "roll"),
    )
