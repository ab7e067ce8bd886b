"""Monte Carlo flights of the campaign's vehicle: fitted lift, best estimate and draws, under the
manifest's controller and gusts or the paper's scaled to it.

Below the nearest station nothing was measured. Lift there is extrapolated in two ways, by the
model's own form and by its value at the station; advice is given where both lead to the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.simulation import crash_rate, energy, presets
from nearlift.flight.simulation.control import Gains, stable
from nearlift.flight.simulation.craft import Craft, Disturbance
from nearlift.flight.simulation.crash_rate import CrashLevel
from nearlift.flight.simulation.curve import Curves, tabulate
from nearlift.flight.simulation.energy import BestSetPoint
from nearlift.flight.simulation.flight import FlightSetting, Spread, steps_per_hold
from nearlift.flight.simulation.groups import Groups, dimensionless, disturbance_for, gains_for
from nearlift.flight.simulation.monte_carlo import MonteCarlo, StepTest, Sweep, sweep
from nearlift.manifest.flight import Simulate
from nearlift.randomness import generator
from nearlift.results import IntArray
from nearlift.results.serial import Unbounded, optional

Rows = list[dict[str, object]]
#: Tolerance, in rotor radii, on the agreement of the set-points of both extrapolations.
ALIKE = 0.05
#: Curves of the sweep: no boundary, the best estimate by its own form, the best estimate held
#: constant below the nearest station, and from then on the draws.
NONE, FORM, HELD, FIRST_DRAW = range(4)


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLevel(CrashLevel):
    """Level by the model's own form, with the 90 % interval of model and flights together.

    `model_only` is the interval of the model alone, `held` the level with lift held below the
    nearest station, `agrees` whether both extrapolations agree (the interval then includes both),
    `without_model` the level without a boundary.
    """

    model_only: tuple[float, float]
    held: float
    agrees: bool
    without_model: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedFlights:
    """Flights at one boundary and their results.

    Attributes
    ----------
    draws_from : str
        Product that the draws come from.
    contact_z_hat, contact_m : float
        Height of the rotor plane at contact, which counts as a crash.
    bound_z_hat : float
        Lower end of the model's own form; below it L / L_inf is constant.
    measured_z_hat : (float, float)
        Nearest and farthest station.
    agreed_z_hat : float
        Lowest set-point from which upwards both extrapolations' crash rates agree.
    droop : float
        Relative change of lift by the end of a flight.
    held : str
        Quantity that each trial held constant.
    front_z_hat : array
        Set-points on the Pareto front of energy and risk.
    maps : StepTest or None
        Of the maps, where they were flown.
    gains : Gains or None
        Those of `groups` in SI units, to set a controller by.
    """

    model: str
    title: str
    parameters: dict[str, float]
    effects: tuple[str, ...]
    left_on_the_bench: tuple[str, ...]
    draws_from: str
    draws: int
    contact_z_hat: float
    contact_m: float
    bound_z_hat: float
    measured_z_hat: tuple[float, float]
    agreed_z_hat: Unbounded
    droop: float
    held: energy.Held
    flights: int
    groups: Groups
    spacing_hat: float | None
    convergence: StepTest
    levels: tuple[FittedLevel, ...]
    front_z_hat: FloatArray
    best_set_points: tuple[BestSetPoint, ...]
    maps: StepTest | None = optional()
    gains: Gains | None = optional()


def conditions(
    chosen: Simulate,
    boundary: Boundary,
    craft: Craft,
    contact_m: float,
    key: int,
    spread: Spread,
    bare_kg: float | None = None,
) -> tuple[Groups, MonteCarlo]:
    """Groups, scheme and step of a campaign's flights: the manifest's, else the paper's scaled to
    the vehicle. `contact_m` is the height of the rotor plane at contact, `bare_kg` the mass that
    gains and gusts are for (by default the craft's).

    Raises
    ------
    ManifestError
        The gains make an unstable loop, the step is no whole part of the gusts' hold, a flight is
        shorter than a gust, or the rotors cannot lift the manifest's mass.
    """
    like = presets.preset("converged")
    carried = like.groups(boundary)
    given, g = chosen.gains.get(boundary), chosen.gusts
    bare = replace(craft, mass_kg=bare_kg or craft.mass_kg)
    gains = (
        Gains(kP=given.proportional, kD=given.derivative, kI=given.integral)
        if given
        else gains_for(carried, bare)
    )
    if chosen.scale_gains:
        # the loop's poles depend on gain over hover frequency
        gains = gains.times(craft.hover_Hz / bare.hover_Hz)
    stable(gains, craft, boundary)
    gusts = (
        Disturbance(sd_N=g.sd, hold_s=g.hold, correlation_s=g.correlation)
        if g
        else disturbance_for(carried, bare)
    )
    duration_s = chosen.duration or carried.duration * bare.time_s
    if duration_s < gusts.hold_s:
        raise ManifestError(
            "simulate.duration",
            f"{duration_s:g} s is shorter than one gust of {gusts.hold_s:g} s",
            "fly at least so long",
        )
    # at least two steps within the shortest lag or delay
    delays = [t for t in (craft.motor_lag_s, chosen.estimator_delay) if t > 0]
    parts = max([like.steps_per_hold, *(math.ceil(2 * gusts.hold_s / t) for t in delays)])
    step_s = chosen.step or gusts.hold_s / parts
    contact = contact_m / craft.radius_m
    groups = dimensionless(craft, gains, gusts, duration_s, contact, chosen.estimator_delay)
    if chosen.mass and craft.most_lift_N < craft.weight_N:
        raise ManifestError(
            "simulate.mass",
            f"the rotors lift at most {craft.most_lift_N:.3g} N of a weight of"
            f" {craft.weight_N:.3g} N",
            "no such vehicle flies: give less mass, or a larger thrust_limit",
        )
    return groups, MonteCarlo(
        scheme=chosen.scheme,
        step_s=step_s,
        steps_per_hold=steps_per_hold(gusts.hold_s, step_s),
        flights=chosen.flights,
        key=key,
        spread=spread,
    )


def fitted_flights(
    lift: FittedLift,
    chosen: Simulate,
    groups: Groups,
    how: MonteCarlo,
    held: energy.Held,
    radius_m: float,
    seed: int,
) -> tuple[FittedFlights, Sweep, Rows]:
    """Sweep without a boundary, with the best estimate by its own form and held below the nearest
    station, and with every draw; its entry in safety.json, and its rows of crash_rates.parquet.

    Raises
    ------
    ManifestError
        A set-point is not above the height of contact.
    """
    boundary, nearest = lift.boundary, lift.measured_z_hat[0]
    usual = presets.set_points(boundary, groups.contact)
    targets = np.array(chosen.set_points.get(boundary, usual))
    if targets[0] <= groups.contact:
        raise ManifestError(
            f"simulate.set_points.{boundary}",
            f"begins at {targets[0]:g}, where the vehicle touches (z_hat = {groups.contact:.3g})",
            "begin above",
        )
    form, *drawn = lift.ratios
    held_below = lambda z_hat: form(np.maximum(z_hat, nearest))  # noqa: E731
    # the own form is carried down to contact, or to the nearest station if that is lower
    bound = chosen.bound_z_hat.get(boundary, min(groups.contact, nearest))
    curves = tabulate([np.ones_like, form, held_below, *drawn], bound)
    droop = lift.droop(chosen.supply_end)
    droops = [0.0, droop, droop, *(lift.droop(chosen.supply_end, m) for m in range(lift.number))]
    stated = [[NONE], [FORM], [HELD], range(FIRST_DRAW, FIRST_DRAW + lift.number)]
    flown = sweep(
        boundary, curves, targets, groups, how, droops=droops, stated=stated, risks=chosen.risks
    )
    rows = [
        row
        for i in range(len(droops))
        for row in flown.rows(
            i,
            held,
            {
                "preset": "fitted",
                "boundary": boundary,
                "model": lift.model.name if i else "none",
                "exponent": float(i > 0),
                "member": max(i - FIRST_DRAW, -1),
                "below_nearest": ("", "form", "held")[i] if i < FIRST_DRAW else "form",
                "contact_z_hat": groups.contact,
            },
        )
    ]
    rng = generator(seed, "levels", "fitted", boundary)
    costs = [energy.cost(r, held)[1] for r in flown.ratio]
    again = _again(flown, costs, chosen.crash_prices, boundary, curves, groups, how, droop)
    entry = FittedFlights(
        model=lift.model.name,
        title=lift.title,
        parameters=dict(lift.best),
        effects=lift.effects,
        left_on_the_bench=lift.left,
        draws_from=lift.source,
        draws=lift.number,
        contact_z_hat=groups.contact,
        contact_m=groups.contact * radius_m,
        bound_z_hat=curves.low,
        measured_z_hat=lift.measured_z_hat,
        agreed_z_hat=agreed_z_hat(flown),
        droop=droop,
        held=held,
        flights=flown.flights,
        groups=groups,
        spacing_hat=lift.arguments.get("spacing_hat"),
        convergence=flown.step_test,
        levels=tuple(_level(flown, risk, rng) for risk in chosen.risks),
        front_z_hat=flown.target_z_hat[
            energy.front(costs[FORM], flown.crashes[FORM] / flown.flights)
        ],
        best_set_points=_best(flown, again, costs, chosen.crash_prices, rng),
    )
    return entry, flown, rows


def _level(flown: Sweep, risk: float, rng: np.random.Generator) -> FittedLevel:
    z_hat, weights = flown.target_z_hat, crash_rate.resamples(flown.flights, rng)
    per_draw = [
        crash_rate.levels(z_hat, c, risk, weights[: crash_rate.PER_DRAW])
        for c in flown.crashed[FIRST_DRAW:]
    ]
    none, best, held = (
        crash_rate.levels(z_hat, flown.crashed[i], risk, weights) for i in (NONE, FORM, HELD)
    )
    lo90, hi90 = crash_rate.spread90(np.concatenate(per_draw))
    agrees, lo90, hi90 = _both(float(held[0]), lo90, hi90)
    return FittedLevel(
        risk=risk,
        value=float(best[0]),
        lo90=lo90,
        hi90=hi90,
        lowest_flown=float(z_hat[0]),
        model_only=crash_rate.spread90(np.array([v[0] for v in per_draw])),
        held=float(held[0]),
        agrees=agrees,
        without_model=float(none[0]),
    )


def _both(held: float, lo90: float, hi90: float) -> tuple[bool, float, float]:
    """Whether the level with lift `held` below the nearest station is within ALIKE of the interval
    by the model's own form; and the interval, extended to it if so.
    """
    if lo90 - ALIKE <= held <= hi90 + ALIKE:
        return True, min(lo90, held), max(hi90, held)
    return False, lo90, hi90


def agreed_z_hat(flown: Sweep) -> float:
    """Lowest set-point from which upwards the two extrapolations' 90 % intervals of the crash rate
    overlap; infinite where they do not at the highest.
    """
    low, high = crash_rate.binomial90(flown.crashes[[FORM, HELD]], flown.flights)
    apart = np.flatnonzero(low.max(axis=0) > high.min(axis=0))
    at = int(apart[-1]) + 1 if len(apart) else 0
    return float(flown.target_z_hat[at]) if at < len(flown.target_z_hat) else math.inf


def _again(
    flown: Sweep,
    costs: list[FloatArray],
    prices: Sequence[float],
    boundary: Boundary,
    curves: Curves,
    groups: Groups,
    how: MonteCarlo,
    droop: float,
) -> IntArray:
    """Crashes (curves, set-points) of other flights at each price's best set-point; 0 elsewhere."""
    rate = crash_rate.estimate(flown.crashes, flown.flights)
    best = {energy.best_set_point(costs[i], rate[i], p)[0] for i in (FORM, HELD) for p in prices}
    at = sorted(best)
    settings = [
        FlightSetting(
            target_z_hat=float(flown.target_z_hat[j]), groups=groups, curve=i, droop=droop
        )
        for i in (FORM, HELD)
        for j in at
    ]
    crashes = np.zeros_like(flown.crashes)
    if settings:
        crashed = how.others().crashed(boundary, settings, curves).sum(axis=1)
        crashes[np.ix_([FORM, HELD], at)] = crashed.reshape(2, len(at))
    return crashes


def _best(
    flown: Sweep,
    again: IntArray,
    costs: list[FloatArray],
    prices: Sequence[float],
    rng: np.random.Generator,
) -> tuple[BestSetPoint, ...]:
    """Set-point of least expected cost for each price, with its interval over draws of the model
    and resamples of the flights; none where the two extrapolations disagree.
    """
    z_hat = flown.target_z_hat
    drawn = [
        (cost, rate)
        for cost, crashed in zip(costs[FIRST_DRAW:], flown.crashed[FIRST_DRAW:], strict=True)
        for rate in crash_rate.rate_draws(crashed, crash_rate.PER_DRAW, rng)
    ]
    best = []
    for price in prices:
        choice, held = (
            energy.choose(z_hat, costs[i], flown.crashes[i], again[i], flown.flights, price)
            for i in (FORM, HELD)
        )
        if choice.target_z_hat is not None:
            each = [z_hat[energy.best_set_point(cost, rate, price)[0]] for cost, rate in drawn]
            lo90, hi90 = crash_rate.spread90(np.array(each))
            agrees, lo90, hi90 = _both(held.target_z_hat or math.nan, lo90, hi90)
            choice = replace(
                choice,
                target_z_hat=choice.target_z_hat if agrees else None,
                lo90=lo90,
                hi90=hi90,
                agrees=agrees,
            )
        best.append(choice)
    return tuple(best)
