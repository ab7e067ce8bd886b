"""The campaign's own vehicle in flight: its fitted lift, best estimate and draws, under the
manifest's controller and gusts or the paper's carried over to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.simulation import crash_rate, energy, presets
from nearlift.flight.simulation.control import Gains, stable
from nearlift.flight.simulation.craft import Craft
from nearlift.flight.simulation.crash_rate import CrashLevel
from nearlift.flight.simulation.curve import tabulate
from nearlift.flight.simulation.disturbance import Disturbance
from nearlift.flight.simulation.energy import BestSetPoint
from nearlift.flight.simulation.flight import Spread, steps_per_hold
from nearlift.flight.simulation.groups import (
    Groups,
    dimensionless,
    disturbance_for,
    gains_for,
)
from nearlift.flight.simulation.monte_carlo import MonteCarlo, StepTest, Sweep, sweep
from nearlift.manifest.flight import Simulate
from nearlift.randomness import generator
from nearlift.results.serial import optional

Rows = list[dict[str, object]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLevel(CrashLevel):
    """With the model's uncertainty and the flights' together; the model's alone; and the level
    without a model.
    """

    model_only: tuple[float, float]
    without_model: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedFlights:
    """What flew at one boundary, and what follows.

    Attributes
    ----------
    model, title : str
    parameters : mapping of str to float
    effects, left_on_the_bench : tuple of str
    draws_from : str
        The product that the draws come from.
    draws : int
    bound_z_hat : float
        Below it L / L_inf is held constant.
    measured_z_hat : (float, float)
    droop : float
        Change of lift by the end of a flight.
    held : str
        What a trial held constant.
    flights : int
    groups : Groups
    spacing_hat : float or None
    convergence : StepTest
    levels : tuple of FittedLevel
    front_z_hat : array
        Set-points that no other beats in both energy and risk.
    best_set_points : tuple of BestSetPoint
    maps : StepTest or None
        Of the maps, where they were flown.
    """

    model: str
    title: str
    parameters: dict[str, float]
    effects: tuple[str, ...]
    left_on_the_bench: tuple[str, ...]
    draws_from: str
    draws: int
    bound_z_hat: float
    measured_z_hat: tuple[float, float]
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


def conditions(
    chosen: Simulate, boundary: Boundary, craft: Craft, key: int, spread: Spread
) -> tuple[Groups, MonteCarlo]:
    """Groups, scheme and step of a campaign's flights: the manifest's, else the paper's carried
    over to the vehicle.

    Raises
    ------
    ManifestError
        The gains make an unstable loop, or the step is no whole part of the gusts' hold.
    """
    like = presets.preset("converged")
    carried = like.groups(boundary)
    given, g = chosen.gains.get(boundary), chosen.gusts
    gains = (
        Gains(kP=given.proportional, kD=given.derivative, kI=given.integral)
        if given
        else gains_for(carried, craft)
    )
    stable(gains, craft, boundary)
    gusts = (
        Disturbance(sd_N=g.sd, hold_s=g.hold, correlation_s=g.correlation)
        if g
        else disturbance_for(carried, craft)
    )
    duration_s = chosen.duration or carried.duration * craft.time_s
    if duration_s < gusts.hold_s:
        raise ManifestError(
            "simulate.duration",
            f"{duration_s:g} s is shorter than one gust of {gusts.hold_s:g} s",
            "fly at least so long",
        )
    step_s = chosen.step or gusts.hold_s / like.steps_per_hold
    contact = chosen.contact_z_hat.get(boundary, 0.0)
    return dimensionless(craft, gains, gusts, duration_s, contact), MonteCarlo(
        scheme=chosen.scheme,
        step_s=step_s,
        steps_per_hold=steps_per_hold(gusts.hold_s, step_s),
        flights=chosen.flights,
        key=key,
        spread=spread,
    )


def bound_z_hat(lift: FittedLift, chosen: Simulate) -> float:
    """The height below which L / L_inf is held constant: the manifest's, else that of the nearest
    station, since nothing is known below.
    """
    return chosen.bound_z_hat.get(lift.boundary, lift.measured_z_hat[0])


def fitted_flights(
    lift: FittedLift,
    chosen: Simulate,
    groups: Groups,
    how: MonteCarlo,
    held: energy.Held,
    seed: int,
) -> tuple[FittedFlights, Sweep, Rows]:
    """The campaign's model, its best estimate and every draw of it, and no model at all for
    comparison; the sweep and the rows of crash_rates.parquet.
    """
    boundary = lift.boundary
    usual = presets.TARGETS[boundary]
    targets = chosen.set_points.get(boundary, usual[usual > groups.contact].tolist())
    curves = tabulate([np.ones_like, *lift.ratios], bound_z_hat(lift, chosen))
    members = range(-1, lift.number)
    droops = [0.0, *(lift.droop(chosen.supply_end, m) for m in members)]
    flown = sweep(boundary, curves, np.array(targets), groups, how, droops=droops, checked=(0, 1))
    labels = {"preset": "fitted", "boundary": boundary}
    none = labels | {"model": "none", "exponent": 0.0, "member": -1}
    rows = list(flown.rows(0, held, none))
    for i, member in enumerate(members, start=1):
        fitted = {"model": lift.model.name, "exponent": 1.0, "member": member}
        rows += flown.rows(i, held, labels | fitted)
    rng = generator(seed, "levels", "fitted", boundary)
    costs = [energy.cost(r, held)[1] for r in flown.ratio]
    entry = FittedFlights(
        model=lift.model.name,
        title=lift.title,
        parameters=dict(lift.best),
        effects=lift.effects,
        left_on_the_bench=lift.left,
        draws_from=lift.source,
        draws=lift.number,
        bound_z_hat=curves.low,
        measured_z_hat=lift.measured_z_hat,
        droop=droops[1],
        held=held,
        flights=flown.flights,
        groups=groups,
        spacing_hat=lift.arguments.get("spacing_hat"),
        convergence=flown.step_test,
        levels=tuple(_level(flown, risk, rng) for risk in chosen.risks),
        front_z_hat=flown.target_z_hat[energy.front(costs[1], flown.crashes[1] / flown.flights)],
        best_set_points=_best(flown, costs, chosen.crash_prices, rng),
    )
    return entry, flown, rows


def _level(flown: Sweep, risk: float, rng: np.random.Generator) -> FittedLevel:
    z_hat, weights = flown.target_z_hat, crash_rate.resamples(flown.flights, rng)
    per_draw = [
        crash_rate.levels(z_hat, c, risk, weights[: crash_rate.PER_DRAW]) for c in flown.crashed[2:]
    ]
    best, none = (crash_rate.levels(z_hat, flown.crashed[i], risk, weights) for i in (1, 0))
    lo90, hi90 = crash_rate.spread90(np.concatenate(per_draw))
    level = replace(CrashLevel.resampled(z_hat, best, risk), lo90=lo90, hi90=hi90)
    return FittedLevel(
        **asdict(level),
        model_only=crash_rate.spread90(np.array([v[0] for v in per_draw])),
        without_model=float(none[0]),
    )


def _best(
    flown: Sweep, costs: list[FloatArray], prices: Sequence[float], rng: np.random.Generator
) -> tuple[BestSetPoint, ...]:
    """For each price of a crash the set-point of least expected cost, over draws of the model and
    resamples of the flights.
    """
    z_hat = flown.target_z_hat
    drawn = [
        (cost, rate)
        for cost, crashed in zip(costs[2:], flown.crashed[2:], strict=True)
        for rate in crash_rate.rate_draws(crashed, crash_rate.PER_DRAW, rng)
    ]
    best = []
    for price in prices:
        choice = energy.choose(z_hat, costs[1], flown.crashes[1], flown.flights, price)
        if choice.resolved:
            each = [z_hat[energy.best_set_point(cost, rate, price)[0]] for cost, rate in drawn]
            lo90, hi90 = crash_rate.spread90(np.array(each))
            choice = replace(choice, lo90=lo90, hi90=hi90)
        best.append(choice)
    return tuple(best)
