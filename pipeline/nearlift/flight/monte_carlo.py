"""Monte Carlo flights: lift tables, settings, crash rates over set-points, and a test of the time
step. Flights are addressed by number, so blocks give the same result in any order.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.flight import NODES, Ratio, energy
from nearlift.flight.crash_rate import binomial90, levels, resamples, wide_gaps
from nearlift.flight.vehicle import AWAY, Groups
from nearlift.randomness import generator
from nearlift.results import IntArray
from nearlift.results.document import Real

Scheme = Literal["euler", "rk4"]
#: An executor's map.
Spread = Callable[[Callable[[int], Any], Iterable[int]], Iterable[Any]]
#: Height above which every table is constant; lift there is within 0.5 % of L_inf for the declared
#: models at their declared parameters.
TOP = 16.0
#: Largest block of flights, and number of blocks into which few flights are divided.
BLOCK, LEAST_BLOCKS = 50, 4
#: Share of the flights, and least number of them, that are flown again with half the step.
CHECKED, LEAST_CHECKED = 0.25, 50
#: Set-points beyond the last with a crash at which the step is tested too.
BEYOND = 2
#: Bit of the key that gives other flights other gusts.
OTHERS = 1 << 40
#: Largest number of passes, of which all but the first add set-points between those flown.
ROUNDS = 8
#: Track of flights whose heights are not kept.
UNTRACKED: FloatArray = np.empty((0, 0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """Tables (m, NODES) of L / L_inf over a common range of z_hat, from `low` to `TOP`.

    The ratio is constant beyond both, so `low` is the bound that the paper sets to 0.5.
    """

    low: float
    values: FloatArray

    @property
    def z_hat(self) -> FloatArray:
        """Heights of the nodes."""
        return np.linspace(self.low, TOP, NODES)

    @property
    def per_radius(self) -> float:
        """Table steps per rotor radius."""
        return (NODES - 1) / (TOP - self.low)

    def packed(self) -> FloatArray:
        """Value at and change over each step, tables one behind the other, for the kernel."""
        slope = np.zeros_like(self.values)
        slope[:, :-1] = np.diff(self.values, axis=1)
        return np.ascontiguousarray(np.stack([self.values, slope], axis=-1).reshape(-1))

    def at(self, z_hat: FloatArray) -> FloatArray:
        """Every table at heights (n,): shape (m, n)."""
        return np.stack([np.interp(z_hat, self.z_hat, row) for row in self.values])


def tabulate(ratios: Sequence[Ratio], low: float) -> Curves:
    """Tables of several functions of z_hat, each constant below `low`.

    Raises
    ------
    InputRefused
        A ratio has no positive value somewhere in the range (a singularity, or a bound below the
        model's validity), or the range is empty.
    """
    if not low < TOP:
        raise InputRefused(
            "simulate.bound_z_hat",
            f"{low:g} leaves no range: above z_hat = {TOP:g} lift is constant",
            f"bound the ratio below {TOP:g}",
        )
    z_hat = np.linspace(low, TOP, NODES)
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.stack([ratio(z_hat) for ratio in ratios])
    bad = ~(np.isfinite(values) & (values > 0))
    if bad.any():
        where = float(z_hat[bad.any(axis=0)].max())
        raise InputRefused(
            "simulate.bound_z_hat",
            f"L / L_inf has no value at z_hat = {where:.3g}",
            f"bound the ratio above {where:.3g}",
        )
    return Curves(low=low, values=values)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSetting:
    """A set-point with its lift curve and controller.

    The controller's f0 allows for the boundary there, as in the paper. `curve` is a row of the
    tables, `droop` the relative change of lift by the end of the flight as the supply sags (linear
    in time).
    """

    target_z_hat: float
    groups: Groups
    curve: int = 0
    droop: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """Settings to be flown at one boundary with one time step; all share hold, correlation,
    duration, motor lag and estimator delay.

    Flight f meets the same gusts in every setting, which makes differences far better known than
    rates.
    """

    boundary: Boundary
    settings: Sequence[FlightSetting]
    curves: Curves
    scheme: Scheme
    steps_per_hold: int

    @property
    def weather(self) -> Groups:
        """Groups whose hold, correlation, duration, lag and delay all settings share."""
        return self.settings[0].groups

    @property
    def holds(self) -> int:
        """Number of held gusts in a flight."""
        return max(round(self.weather.duration / self.weather.hold), 1)

    @property
    def step(self) -> float:
        """Time step in sqrt(r/g)."""
        return self.weather.hold / self.steps_per_hold

    def columns(self) -> tuple[FloatArray, IntArray]:
        """Settings for the compiled loop, (WIDTH, n), and the start of each one's table.

        Raises ManifestError if they differ in hold, correlation, duration, lag or delay.
        """
        times = {
            (g.hold, g.correlation, g.duration, g.motor_lag, g.delay)
            for g in (s.groups for s in self.settings)
        }
        if len(times) > 1:
            raise ManifestError(
                "simulate",
                "settings of one plan differ in hold, correlation, duration, lag or delay",
                "fly them as plans of their own",
            )
        side = AWAY[self.boundary]
        rows = []
        near = self.curves.at(np.array([s.target_z_hat for s in self.settings]))
        for i, s in enumerate(self.settings):
            g = s.groups
            most = np.sqrt(g.most_lift)
            gains = (g.alpha, g.beta, g.gamma, g.delta / np.sqrt(near[s.curve, i]))
            rows.append((s.target_z_hat, *gains, g.noise, side, s.droop, g.contact, most))
        which = np.array([2 * NODES * s.curve for s in self.settings], dtype=np.int64)
        return np.ascontiguousarray(np.array(rows, dtype=float).T), which


def steps_per_hold(hold_s: float, step_s: float) -> int:
    """Number of steps in a hold.

    Raises
    ------
    ManifestError
        The step is no whole part of the hold; says the nearest that is.
    """
    n = max(round(hold_s / step_s), 1)
    if abs(n * step_s - hold_s) > 1e-9 * hold_s:
        raise ManifestError(
            "simulate.step",
            f"{step_s:g} s is no whole part of the {hold_s:g} s for which a gust is held",
            f"the nearest is {hold_s / n:g} s",
        )
    return n


def _block(
    first: int, *, plan: FlightPlan, end: int, size: int, key: int, track: FloatArray = UNTRACKED
) -> NDArray[np.int32]:
    from nearlift.flight import kernel

    columns, which = plan.columns()
    ended = np.empty((len(plan.settings), min(size, end - first)), dtype=np.int32)
    weather = plan.weather
    memory = float(np.exp(-weather.hold / weather.correlation)) if weather.correlation > 0 else 0.0
    kernel.fly(
        np.uint64(key),
        first,
        plan.holds,
        plan.steps_per_hold,
        plan.step,
        plan.scheme == "rk4",
        memory,
        columns,
        which,
        plan.curves.packed(),
        plan.curves.low,
        plan.curves.per_radius,
        weather.motor_lag,
        weather.delay / plan.step,
        ended,
        track,
    )
    return ended


def fly(plan: FlightPlan, flights: int, key: int, spread: Spread = map) -> NDArray[np.int32]:
    """Hold in which each flight crashed, or -1: shape (settings, flights).

    Flight f meets the same gusts in every setting and every plan with this key. `spread` is an
    executor's map; the result does not depend on it.
    """
    # blocks of equal size, or one worker would fly nearly all of few flights
    size = min(BLOCK, math.ceil(flights / LEAST_BLOCKS))
    block = functools.partial(_block, plan=plan, end=flights, size=size, key=key)
    return np.concatenate(list(spread(block, range(0, flights, size))), axis=1)


def trace(plan: FlightPlan, flight: int, key: int) -> FloatArray:
    """Heights of one flight at the start and after every hold, (settings, holds + 1); nan once
    crashed.
    """
    track = np.full((len(plan.settings), plan.holds + 1), np.nan)
    _block(flight, plan=plan, end=flight + 1, size=1, key=key, track=track)
    return track


@dataclass(frozen=True, slots=True, kw_only=True)
class StepTest:
    """Change of crash rates on halving the time step: the largest, and its set-point.

    `beyond` is the number of settings whose two crash rates lie outside each other's binomial 90 %
    intervals. A step has converged if it is 0.
    """

    converged: bool
    worst: Real
    worst_target_z_hat: Real
    beyond: int
    settings: int
    flights: int
    step_s: Real
    halved_s: Real

    @property
    def warning(self) -> str:
        """Message for a step that is too long."""
        return (
            f"a step of {self.step_s:g} s is too long: halving it changes the crash rate by"
            f" {self.worst:.2f} at z_hat {self.worst_target_z_hat:g} ({self.beyond} of"
            f" {self.settings} settings leave their interval)"
        )


def combined(parts: Sequence[StepTest]) -> StepTest:
    """Several tests as one, with step and worst change of the one that changed most."""
    return replace(
        max(parts, key=lambda c: c.worst),
        converged=all(c.converged for c in parts),
        beyond=sum(c.beyond for c in parts),
        settings=sum(c.settings for c in parts),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MonteCarlo:
    """Flights per setting, and how they are integrated; `key` addresses the gusts, `spread` is an
    executor's map over blocks of flights.
    """

    scheme: Scheme
    step_s: float
    steps_per_hold: int
    flights: int
    key: int
    spread: Spread = map

    def halved(self) -> MonteCarlo:
        """Repeat the flights with half the step."""
        return replace(self, step_s=self.step_s / 2, steps_per_hold=2 * self.steps_per_hold)

    def others(self) -> MonteCarlo:
        """Repeat the flights with other gusts."""
        return replace(self, key=self.key ^ OTHERS)

    def crashed(
        self, boundary: Boundary, settings: Sequence[FlightSetting], curves: Curves
    ) -> NDArray[np.bool_]:
        """Whether each flight crashes: shape (settings, flights)."""
        plan = FlightPlan(
            boundary=boundary,
            settings=settings,
            curves=curves,
            scheme=self.scheme,
            steps_per_hold=self.steps_per_hold,
        )
        return fly(plan, self.flights, self.key, self.spread) >= 0

    def step_test(
        self,
        boundary: Boundary,
        settings: Sequence[FlightSetting],
        curves: Curves,
        crashed: NDArray[np.bool_],
    ) -> StepTest:
        """Step test on a share of the flights; `crashed` (settings, flights) is at full step."""
        share = max(round(CHECKED * self.flights), LEAST_CHECKED)
        few = replace(self, flights=min(share, self.flights))
        coarse = crashed[:, : few.flights].sum(axis=1)
        fine = few.halved().crashed(boundary, settings, curves).sum(axis=1)
        rates = np.stack([coarse, fine]) / few.flights
        low, high = binomial90(np.stack([fine, coarse]), few.flights)
        # each rate outside the other's interval: one flight among few makes no difference
        outside = ((rates < low) | (rates > high)).all(axis=0)
        change = np.abs(rates[1] - rates[0])
        worst = int(change.argmax())
        return StepTest(
            converged=not bool(outside.any()),
            worst=float(change[worst]),
            worst_target_z_hat=float(settings[worst].target_z_hat),
            beyond=int(outside.sum()),
            settings=len(settings),
            flights=few.flights,
            step_s=self.step_s,
            halved_s=self.step_s / 2,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Crashes (curves, t, flights) of every curve at every set-point (t,), and L / L_inf (curves,
    t) there.
    """

    target_z_hat: FloatArray
    crashed: NDArray[np.bool_]
    ratio: FloatArray

    def rows(
        self, curve: int, held: energy.Held, labels: Mapping[str, object]
    ) -> Iterator[dict[str, object]]:
        """Rows of crash_rates.parquet of one curve; `labels` are its identifying columns."""
        flights = int(self.crashed.shape[2])
        crashes = self.crashed[curve].sum(axis=1)
        low, high = binomial90(crashes, flights)
        ratio = self.ratio[curve]
        cost = energy.cost(ratio, held)
        for j, z in enumerate(self.target_z_hat):
            yield {
                **labels,
                "target_z_hat": float(z),
                "flights": flights,
                "crashes": int(crashes[j]),
                "rate": int(crashes[j]) / flights,
                "lo90": float(low[j]),
                "hi90": float(high[j]),
                "ratio": float(ratio[j]),
                "cost_paper": float(energy.paper_cost(ratio[j])),
                "cost": float(cost[1][j]),
                "cost_lo": float(cost[0][j]),
                "cost_hi": float(cost[2][j]),
            }


def sweep(
    boundary: Boundary,
    curves: Curves,
    target_z_hat: FloatArray,
    groups: Groups,
    how: MonteCarlo,
    risks: Sequence[float] = (),
    droop: float = 0.0,
) -> tuple[Sweep, StepTest]:
    """Sweep of every curve over set-points, refined until the levels at `risks` are resolved, and
    its step test. `droop` is the relative change of lift by the end of a flight.
    """
    n = len(curves.values)

    def settings(targets: FloatArray, which: Sequence[int]) -> list[FlightSetting]:
        return [
            FlightSetting(target_z_hat=float(z), groups=groups, curve=c, droop=droop)
            for c in which
            for z in targets
        ]

    z_hat, new = np.empty(0), np.asarray(target_z_hat, dtype=float)
    crashed = np.empty((n, 0, how.flights), dtype=bool)
    for _ in range(ROUNDS):
        flown = how.crashed(boundary, settings(new, range(n)), curves)
        order = np.argsort(np.concatenate([z_hat, new]))
        z_hat = np.concatenate([z_hat, new])[order]
        both = [crashed, flown.reshape(n, len(new), how.flights)]
        crashed = np.concatenate(both, axis=1)[:, order]
        weights = resamples(how.flights, generator(how.key % 2**32, "refine"))
        wanted = set[float]().union(
            *(wide_gaps(z_hat, levels(z_hat, c, r, weights)) for r in risks for c in crashed)
        )
        new = np.array(sorted(wanted - set(z_hat.tolist())))
        if not len(new):
            break
    # the step is tested at the set-points asked for: those added lie where flights graze
    asked = np.isin(z_hat, target_z_hat)
    again, before = list[FlightSetting](), list[NDArray[np.bool_]]()
    for c in range(n):
        seen = crashed[c][asked]
        hit = np.flatnonzero(seen.any(axis=1))
        upto = (int(hit[-1]) + 1 if len(hit) else 0) + BEYOND
        again += settings(z_hat[asked][:upto], [c])
        before.append(seen[:upto])
    test = how.step_test(boundary, again, curves, np.concatenate(before))
    return Sweep(target_z_hat=z_hat, crashed=crashed, ratio=curves.at(z_hat)), test
