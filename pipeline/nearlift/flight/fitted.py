"""Monte Carlo flights of the campaign's vehicle with its fitted lift, best estimate and draws.

Controller and gusts are the manifest's, or the paper's scaled to the vehicle. Below the nearest
station nothing was measured. Lift there is extrapolated in two ways, by the model's own form and by
its value at the station. A set-point is advised where both agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearlift.campaign.forecasts import Simulate
from nearlift.declare import Boundary
from nearlift.errors import ManifestError
from nearlift.flight import crash_rate, energy, paper
from nearlift.flight.crash_rate import CrashLevel
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.monte_carlo import (
    MonteCarlo,
    Spread,
    StepTest,
    Sweep,
    settings_of,
    steps_per_hold,
    sweep,
    tabulate,
)
from nearlift.flight.paper import Rows
from nearlift.flight.vehicle import (
    Craft,
    Disturbance,
    Gains,
    Groups,
    dimensionless,
    disturbance_for,
    gains_for,
    stable,
)
from nearlift.randomness import generator
from nearlift.results.document import Real

#: Least number of flights behind a set-point that is advised.
ADVISED_FLIGHTS = 1000
#: Tolerance, in rotor radii, on the agreement of the set-points of both extrapolations.
ALIKE = 0.05
#: Curves of the sweep: no boundary, the best estimate by its own form, and the best estimate held
#: constant below the nearest station.
NONE, FORM, HELD = range(3)


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLevel(CrashLevel):
    """Lowest set-point at a risk by the model's own form, with the 90 % interval of model and
    flights together.

    Attributes
    ----------
    model_only : (float, float)
        Interval of the model alone.
    held : float
        Level with lift held below the nearest station.
    agrees : bool
        Whether both extrapolations agree; the interval then includes both.
    without_model : float
        Level without a boundary, with the same sag.
    relative_power : float
        Power to hover at `value` over power far away.
    crashes : int
        Number of crashes at `value` in as many flights with other gusts.
    rate_lo90, rate_hi90 : float
        Interval of the crash rate by those.
    """

    model_only: tuple[Real, Real]
    held: Real
    agrees: bool
    without_model: Real
    relative_power: Real
    crashes: int
    rate_lo90: Real
    rate_hi90: Real

    @property
    def advised(self) -> bool:
        """Whether a set-point was found, and both extrapolations agree on it."""
        return self.agrees and math.isfinite(self.value)


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
    droop : float
        Relative change of lift by the end of a flight, with and without a boundary.
    held : str
        Quantity that each trial held constant.
    flights, draw_flights : int
        Number of flights per set-point by the best estimate, and by each draw.
    gains : Gains
        Those of `groups` in SI units, to set a controller by.
    """

    model: str
    title: str
    parameters: dict[str, Real]
    effects: tuple[str, ...]
    left_on_the_bench: tuple[str, ...]
    draws_from: str
    draws: int
    contact_z_hat: Real
    contact_m: Real
    bound_z_hat: Real
    measured_z_hat: tuple[Real, Real]
    droop: Real
    held: energy.Held
    flights: int
    draw_flights: int
    groups: Groups
    convergence: StepTest
    levels: tuple[FittedLevel, ...]
    gains: Gains


def conditions(
    chosen: Simulate,
    boundary: Boundary,
    craft: Craft,
    contact_m: float,
    key: int,
    spread: Spread,
    bare_kg: float | None = None,
) -> MonteCarlo:
    """Groups, scheme and step of a campaign's flights.

    They are the manifest's, else the paper's scaled to the vehicle. `contact_m` is the height of
    the rotor plane at contact, `bare_kg` the mass that gains and gusts are for (by default the
    craft's).

    Raises
    ------
    ManifestError
        The loop is unstable, or the step does not divide the gusts' hold. Or a flight is shorter
        than a gust, or the rotors cannot lift the manifest's mass.
    """
    like = paper.preset("converged")
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
    step_s = chosen.step or gusts.hold_s / like.steps_per_hold
    if chosen.mass and craft.most_lift_N < craft.weight_N:
        raise ManifestError(
            "simulate.mass",
            f"the rotors lift at most {craft.most_lift_N:.3g} N of a weight of"
            f" {craft.weight_N:.3g} N",
            "no such vehicle flies: give less mass, or a larger thrust_limit",
        )
    return MonteCarlo(
        boundary=boundary,
        groups=dimensionless(craft, gains, gusts, duration_s, contact_m / craft.radius_m),
        scheme=like.scheme,
        step_s=step_s,
        steps_per_hold=steps_per_hold(gusts.hold_s, step_s),
        flights=chosen.flights,
        key=key,
        spread=spread,
    )


def fitted_flights(
    lift: FittedLift,
    chosen: Simulate,
    how: MonteCarlo,
    held: energy.Held,
    craft: Craft,
    seed: int,
) -> tuple[FittedFlights, Rows]:
    """Entry in safety.json and rows of crash_rates.parquet.

    Flights are without a boundary, with every draw, and with the best estimate: by its own form,
    and held below the nearest station. Draws are flown as often as the manifest asks, the others at
    least ADVISED_FLIGHTS times. The supply sags alike with and without a boundary.

    Raises
    ------
    ManifestError
        A set-point is not above the height of contact.
    """
    boundary, groups, nearest = how.boundary, how.groups, lift.measured_z_hat[0]
    usual = paper.set_points(boundary, groups.contact)
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
    droop = lift.droop(chosen.supply_end)
    many = replace(how, flights=max(how.flights, ADVISED_FLIGHTS))
    curves = tabulate([np.ones_like, form, held_below], bound)
    flown, step_test = sweep(many, curves, targets, chosen.risks, droop)
    draw_curves = tabulate(drawn, bound)
    droops = [lift.droop(chosen.supply_end, m) for m in range(lift.number)]
    settings = settings_of(flown.target_z_hat, range(lift.number), droops)
    draws = Sweep(
        target_z_hat=flown.target_z_hat,
        crashed=how.crashed(draw_curves, settings).reshape(lift.number, -1, how.flights),
        ratio=draw_curves.at(flown.target_z_hat),
    )
    labels: dict[str, object] = {
        "preset": "fitted",
        "boundary": boundary,
        "contact_z_hat": groups.contact,
    }
    name, rows = lift.model.name, Rows()
    for curve, (model, below) in enumerate((("none", ""), (name, "form"), (name, "held"))):
        label = {"model": model, "exponent": float(bool(below)), "member": -1}
        rows += flown.rows(curve, held, labels | label | {"below_nearest": below})
    for member in range(lift.number):
        label = {"model": name, "exponent": 1.0, "member": member, "below_nearest": "form"}
        rows += draws.rows(member, held, labels | label)
    rng = generator(seed, "levels", "fitted", boundary)
    levels = []
    for risk in chosen.risks:
        level = _level(flown, draws, risk, rng)
        if np.isfinite(level.value):
            again = many.others().crashed(curves, settings_of([level.value], (FORM,), droop))
            crashes = again.sum(axis=1)
            low, high = crash_rate.binomial90(crashes, many.flights)
            power = energy.cost(curves.at(np.array([level.value]))[FORM], held)[1]
            level = replace(
                level,
                relative_power=float(power[0]),
                crashes=int(crashes[0]),
                rate_lo90=float(low[0]),
                rate_hi90=float(high[0]),
            )
        levels.append(level)
    entry = FittedFlights(
        model=lift.model.name,
        title=lift.title,
        parameters=dict(lift.best),
        effects=lift.effects,
        left_on_the_bench=lift.left,
        draws_from=lift.source,
        draws=lift.number,
        contact_z_hat=groups.contact,
        contact_m=groups.contact * craft.radius_m,
        bound_z_hat=curves.low,
        measured_z_hat=lift.measured_z_hat,
        droop=droop,
        held=held,
        flights=many.flights,
        draw_flights=how.flights,
        groups=groups,
        convergence=step_test,
        levels=tuple(levels),
        gains=gains_for(groups, craft),
    )
    return entry, rows


def _level(flown: Sweep, draws: Sweep, risk: float, rng: np.random.Generator) -> FittedLevel:
    """Level at a risk. Draws shift it by their own level less that of the best estimate in the same
    flights.
    """
    z_hat = flown.target_z_hat
    weights = crash_rate.resamples(flown.crashed.shape[2], rng)
    none, best, held = (crash_rate.levels(z_hat, c, risk, weights) for c in flown.crashed)
    few = draws.crashed.shape[2]

    def as_flown(crashed: NDArray[np.bool_]) -> float:
        rate = crashed[:, :few].mean(axis=1)
        return float(crash_rate.level(z_hat, rate, risk, 0.5 / few))

    start = as_flown(flown.crashed[FORM])
    shifts = np.array([as_flown(c) - start for c in draws.crashed])
    lo90, hi90 = crash_rate.spread90((best + shifts[:, None]).ravel())
    agrees = lo90 - ALIKE <= float(held[0]) <= hi90 + ALIKE
    if agrees:
        lo90, hi90 = min(lo90, float(held[0])), max(hi90, float(held[0]))
    return FittedLevel(
        risk=risk,
        value=float(best[0]),
        lo90=lo90,
        hi90=hi90,
        lowest_flown=float(z_hat[0]),
        model_only=crash_rate.spread90(best[0] + shifts),
        held=float(held[0]),
        agrees=agrees,
        without_model=float(none[0]),
        relative_power=math.nan,
        crashes=0,
        rate_lo90=math.nan,
        rate_hi90=math.nan,
    )
