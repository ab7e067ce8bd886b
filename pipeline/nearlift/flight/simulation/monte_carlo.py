"""Monte Carlo crash rates over set-points for several lift curves, with a test of the time step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.flight.simulation import energy
from nearlift.flight.simulation.crash_rate import PER_DRAW, binomial90, levels, resamples, wide_gaps
from nearlift.flight.simulation.curve import Curves
from nearlift.flight.simulation.flight import FlightPlan, FlightSetting, Scheme, Spread, fly
from nearlift.flight.simulation.groups import Groups
from nearlift.randomness import generator
from nearlift.results import IntArray

#: Share of the flights, and least number of them, that are flown again with half the step.
CHECKED, LEAST_CHECKED = 0.25, 50
#: Set-points beyond the last with a crash at which the step is tested too: crash rates fall with
#: distance, whatever the step.
BEYOND = 2
#: Bit of the key that gives other flights other gusts.
OTHERS = 1 << 40


@dataclass(frozen=True, slots=True, kw_only=True)
class StepTest:
    """Change of crash rates on halving the time step, in so many settings with so many flights
    each: the largest, its set-point, and the number of settings `beyond`, whose two crash rates lie
    outside each other's binomial 90 % intervals. Converged is a step with none beyond.
    """

    converged: bool
    worst: float
    worst_target_z_hat: float
    beyond: int
    settings: int
    flights: int
    step_s: float
    halved_s: float

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

    def finer(self, parts: int) -> MonteCarlo:
        """The same flights with the step divided by `parts`."""
        return replace(self, step_s=self.step_s / parts, steps_per_hold=parts * self.steps_per_hold)

    def at_most(self, flights: int) -> MonteCarlo:
        """The first of the same flights, at most so many."""
        return replace(self, flights=min(flights, self.flights))

    def others(self) -> MonteCarlo:
        """As many flights with other gusts."""
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
        few = self.at_most(max(round(CHECKED * self.flights), LEAST_CHECKED))
        coarse = crashed[:, : few.flights].sum(axis=1)
        fine = few.finer(2).crashed(boundary, settings, curves).sum(axis=1)
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
    step_test: StepTest

    @property
    def flights(self) -> int:
        """Flights per setting."""
        return int(self.crashed.shape[2])

    @property
    def crashes(self) -> IntArray:
        """Number of crashes (curves, t)."""
        crashes: IntArray = self.crashed.sum(axis=2)
        return crashes

    def rows(
        self, curve: int, held: energy.Held, labels: Mapping[str, object]
    ) -> Iterator[dict[str, object]]:
        """Rows of crash_rates.parquet of one curve; `labels` are its identifying columns."""
        low, high = binomial90(self.crashes[curve], self.flights)
        ratio = self.ratio[curve]
        cost = energy.cost(ratio, held)
        for j, z in enumerate(self.target_z_hat):
            crashes = int(self.crashes[curve, j])
            yield {
                **labels,
                "target_z_hat": float(z),
                "flights": self.flights,
                "crashes": crashes,
                "rate": crashes / self.flights,
                "lo90": float(low[j]),
                "hi90": float(high[j]),
                "ratio": float(ratio[j]),
                "cost_paper": float(energy.paper_cost(ratio[j])),
                "cost": float(cost[1][j]),
                "cost_lo": float(cost[0][j]),
                "cost_hi": float(cost[2][j]),
            }


#: Largest number of passes, of which all but the first add set-points between those flown.
ROUNDS = 8


def _missing(
    z_hat: FloatArray,
    crashed: NDArray[np.bool_],
    key: int,
    stated: Sequence[Sequence[int]],
    risks: Sequence[float],
) -> FloatArray:
    """Set-points without which a level would be interpolated across too wide a gap."""
    weights = resamples(crashed.shape[2], generator(key % 2**32, "refine"))
    wanted: set[float] = set()
    for risk in risks:
        for members in stated:
            rows = weights if len(members) == 1 else weights[:PER_DRAW]
            wanted |= wide_gaps(z_hat, [levels(z_hat, crashed[c], risk, rows) for c in members])
    return np.array(sorted(wanted - set(z_hat.tolist())))


def sweep(
    boundary: Boundary,
    curves: Curves,
    target_z_hat: FloatArray,
    groups: Groups,
    how: MonteCarlo,
    *,
    droops: Sequence[float] = (),
    stated: Sequence[Sequence[int]] = (),
    risks: Sequence[float] = (),
) -> Sweep:
    """Sweep of every curve over set-points, refined until levels are resolved, with its step test.

    `droops` gives each curve's relative change of lift by the end of a flight (0 by default). A
    level is wanted at each of `risks` for each group of curves that is `stated` as one interval (by
    default each curve by itself); the first of each group has its step tested.
    """
    n = len(curves.values)
    stated = stated or [[c] for c in range(n)]

    def settings(targets: FloatArray, which: Sequence[int]) -> list[FlightSetting]:
        return [
            FlightSetting(
                target_z_hat=float(z),
                groups=groups,
                curve=c,
                droop=float(droops[c]) if len(droops) else 0.0,
            )
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
        new = _missing(z_hat, crashed, how.key, stated, risks)
        if not len(new):
            break
    # the step is tested at the set-points asked for: those added lie where flights graze
    asked = np.isin(z_hat, target_z_hat)
    again, before = list[FlightSetting](), list[NDArray[np.bool_]]()
    for c, *_ in stated:
        seen = crashed[c][asked]
        hit = np.flatnonzero(seen.any(axis=1))
        upto = (int(hit[-1]) + 1 if len(hit) else 0) + BEYOND
        again += settings(z_hat[asked][:upto], [c])
        before.append(seen[:upto])
    return Sweep(
        target_z_hat=z_hat,
        crashed=crashed,
        ratio=curves.at(z_hat),
        step_test=how.step_test(boundary, again, curves, np.concatenate(before)),
    )
