"""Monte Carlo flights of the campaign's vehicle with its fitted lift, best estimate and draws.

Controller and gusts are the manifest's, or the paper's scaled to the vehicle. Below the nearest
station nothing was measured. Lift there is extrapolated in two ways, by the model's own form and by
its value at the station. A set-point is advised where both agree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from nearlift.campaign.choices import Simulate
from nearlift.declare import BoolArray, Boundary, FloatArray
from nearlift.errors import ManifestError
from nearlift.flight import crash_rate, energy, paper
from nearlift.flight.crash_rate import CrashLevel, Rows, StepTest, Sweep, sweep
from nearlift.flight.quoted_lift import QuotedLift
from nearlift.flight.roll import Roll
from nearlift.flight.simulation import Simulation, Spread, tabulate
from nearlift.flight.vehicle import Craft, Disturbance, Gains, Groups
from nearlift.randomness import generator
from nearlift.results.document import IfAny, Real
from nearlift.results.quotation import Results

#: Least number of flights behind a set-point that is advised.
ADVISED_FLIGHTS = 1000
#: Bit of the key that gives other flights other gusts.
OTHER_GUSTS_BIT = 1 << 40
#: Tolerance, in rotor radii, on the agreement of the set-points of both extrapolations.
SAME_LEVEL_Z_HAT = 0.05
#: Lowest and highest default set-point above the height of contact, in rotor radii.
ABOVE_CONTACT: dict[Boundary, tuple[float, float]] = {"ground": (0.1, 2.0), "ceiling": (0.5, 2.8)}
#: Curves of the sweep: no boundary, the best estimate by its own form, and the best estimate held
#: constant below the nearest station.
NONE, FORM, HELD = range(3)


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLevel(CrashLevel):
    """Lowest set-point at a risk by the model's own form, with the 90 % interval of model and
    flights together.

    `held` is the level with lift held below the nearest station. Where both extrapolations agree,
    the interval includes both. `without_model` is the level without a boundary, with the same sag.
    `relative_power` is power to hover at `value` over that far away. `crashes` at `value`, in as
    many flights with other gusts, have the rate `rate_lo90` to `rate_hi90`.
    """

    held: Real
    agrees: bool
    without_model: Real
    relative_power: Real = math.nan
    crashes: int = 0
    rate_lo90: Real = math.nan
    rate_hi90: Real = math.nan

    @property
    def advised(self) -> bool:
        """Whether a set-point was found, and both extrapolations agree on it."""
        return self.agrees and math.isfinite(self.value)


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedFlights:
    """Flights at one boundary and their results.

    Below `bound_z_hat` L / L_inf is constant. `measured_z_hat` are the nearest and the farthest
    station. `droop` is the relative change of lift by the end of a flight, with and without a
    boundary. `held` is the quantity that each trial held constant. A set-point has `flights` by the
    best estimate and `draw_flights` by each draw. `gains` are those of `groups`, in SI units.
    """

    model: str
    title: str
    parameters: dict[str, Real]
    effects: tuple[str, ...]
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


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyResult:
    """Content of safety.json: flights of the paper's and the fitted models near the boundaries, and
    roll near a wall.
    """

    schema: str = "nearlift.safety/2"
    presets: Mapping[str, paper.PresetFlights]
    fitted: Mapping[Boundary, FittedFlights]
    roll: IfAny[Roll] = None


def conditions(
    chosen: Simulate, boundary: Boundary, craft: Craft, contact_m: float, key: int, spread: Spread
) -> Simulation:
    """Groups, scheme and step of a campaign's flights: the manifest's, else the paper's scaled to
    the vehicle. `contact_m` is the height of the rotor plane at contact.

    Raises
    ------
    ManifestError
        The loop is unstable, or a flight is shorter than a gust.
    """
    published = paper.groups(boundary)
    gains, gusts = published.gains(craft), published.disturbance(craft)
    if given := chosen.gains.get(boundary):
        gains = Gains(kP=given.proportional, kD=given.derivative, kI=given.integral)
    gains.refuse_unstable(craft, boundary)
    if g := chosen.gusts:
        gusts = Disturbance(sd_N=g.sd, hold_s=g.hold, correlation_s=g.correlation)
    duration_s = published.duration * craft.time_s
    if duration_s < gusts.hold_s:
        what = f"{gusts.hold_s:g} s is longer than a flight of {duration_s:.3g} s"
        raise ManifestError("simulate.gusts.hold", what, "give a shorter hold")
    return replace(
        paper.simulation("converged", boundary, chosen.flights, key, spread),
        groups=Groups.scaled(craft, gains, gusts, duration_s, contact_m / craft.radius_m),
        hold_s=gusts.hold_s,
    )


def set_points(boundary: Boundary, contact_z_hat: float) -> list[float]:
    """Default set-points of a vehicle that touches at `contact_z_hat`: whole tenths of a radius."""
    low, high = (10 * (contact_z_hat + above) for above in ABOVE_CONTACT[boundary])
    return [tenths / 10 for tenths in range(math.ceil(low), math.ceil(high + 1))]


def fitted_flights(
    lift: QuotedLift, chosen: Simulate, how: Simulation, held: energy.Held, craft: Craft, seed: int
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
    boundary, contact, nearest = how.boundary, how.groups.contact, lift.measured_z_hat[0]
    targets = np.array(chosen.set_points.get(boundary, set_points(boundary, contact)))
    if targets[0] <= contact:
        raise ManifestError(
            f"simulate.set_points.{boundary}",
            f"begins at {targets[0]:g}, where the vehicle touches (z_hat = {contact:.3g})",
            "begin above",
        )
    form, *drawn = lift.ratios
    # the own form is carried down to contact, or to the nearest station if that is lower
    bound = min(contact, nearest)
    droop, *droops = lift.droop()
    many = replace(how, flights=max(how.flights, ADVISED_FLIGHTS))
    curves = tabulate([np.ones_like, form, lambda z: form(np.maximum(z, nearest))], bound)
    flown, step_test = sweep(many, curves, targets, chosen.risks, droop)
    draw_curves, members = tabulate(drawn, bound), np.arange(lift.number)
    ended = how.ended(draw_curves, flown.target_z_hat, members[:, None], np.array(droops)[:, None])
    ratio = draw_curves.at(flown.target_z_hat)
    draws = Sweep(target_z_hat=flown.target_z_hat, crashed=ended >= 0, ratio=ratio)
    rng = generator(seed, "levels", "fitted", boundary)
    levels = []
    for risk in chosen.risks:
        level = _level(flown, draws, risk, rng)
        if np.isfinite(level.value):
            others = replace(many, key=many.key ^ OTHER_GUSTS_BIT)
            crashes = int((others.ended(curves, level.value, FORM, droop) >= 0).sum())
            low, high = crash_rate.binomial90(np.array(crashes), many.flights)
            level = replace(
                level,
                relative_power=float(
                    energy.cost(curves.at(np.array([level.value]))[FORM], held)[1][0]
                ),
                crashes=crashes,
                rate_lo90=float(low),
                rate_hi90=float(high),
            )
        levels.append(level)
    entry = FittedFlights(
        model=lift.model.name,
        title=lift.title,
        parameters=dict(lift.best),
        effects=lift.effects,
        draws_from=Results.file,
        draws=lift.number,
        contact_z_hat=contact,
        contact_m=contact * craft.radius_m,
        bound_z_hat=bound,
        measured_z_hat=lift.measured_z_hat,
        droop=droop,
        held=held,
        flights=many.flights,
        draw_flights=how.flights,
        groups=how.groups,
        convergence=step_test,
        levels=tuple(levels),
        gains=how.groups.gains(craft),
    )
    # no boundary, both extrapolations, and every draw
    name, rows = lift.model.name, Rows()
    for part, curve, member, below_nearest in (
        (flown, NONE, -1, ""),
        (flown, FORM, -1, "form"),
        (flown, HELD, -1, "held"),
        *((draws, member, member, "form") for member in members.tolist()),
    ):
        labels = {"preset": "fitted", "boundary": boundary, "contact_z_hat": contact}
        labels |= {
            "model": name if below_nearest else "none",
            "exponent": float(below_nearest != ""),
        }
        rows += part.rows(curve, held, below_nearest=below_nearest, member=member, **labels)
    return entry, rows


def _level(flown: Sweep, draws: Sweep, risk: float, rng: np.random.Generator) -> FittedLevel:
    """Level at a risk. Draws shift it by their own level less that of the best estimate in the same
    flights.
    """
    z_hat = flown.target_z_hat
    weights = crash_rate.resamples(flown.crashed.shape[2], rng)
    none, best, held = (crash_rate.levels(z_hat, c, risk, weights) for c in flown.crashed)
    few = draws.crashed.shape[2]

    def as_flown(crashed: BoolArray) -> FloatArray:
        return crash_rate.level(z_hat, crashed[..., :few].mean(axis=-1), risk, 0.5 / few)

    shifts = as_flown(draws.crashed) - as_flown(flown.crashed[FORM])
    lo90, hi90 = crash_rate.spread90((best + shifts[:, None]).ravel())
    agrees = lo90 - SAME_LEVEL_Z_HAT <= held[0] <= hi90 + SAME_LEVEL_Z_HAT
    if agrees:
        lo90, hi90 = min(lo90, float(held[0])), max(hi90, float(held[0]))
    return FittedLevel(
        risk=risk,
        value=float(best[0]),
        lo90=lo90,
        hi90=hi90,
        lowest_flown=float(z_hat[0]),
        held=float(held[0]),
        agrees=bool(agrees),
        without_model=float(none[0]),
    )
