"""Monte Carlo flights: lift tables, crashes over set-points, and a test of the time step.

Flights are addressed by number, so blocks give the same result in any order.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
        The range is empty, or a ratio has no positive value somewhere in it. Such a ratio
        has a singularity, or a bound below the model's validity.
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
class FlightSettings:
    """Set-points (n,) to be flown, each with a row of the lift tables.

    `droop` is the relative change of lift by the end of a flight, as the supply sags; it is linear
    in time.
    """

    target_z_hat: FloatArray
    curve: IntArray
    droop: FloatArray


def settings_of(
    target_z_hat: ArrayLike, curves: Sequence[int] = (0,), droop: ArrayLike = 0.0
) -> FlightSettings:
    """Every curve at every set-point, one curve after the other; `droop` is one, or a curve's."""
    targets = np.asarray(target_z_hat, dtype=float)
    each = np.broadcast_to(np.asarray(droop, dtype=float), len(curves))
    return FlightSettings(
        target_z_hat=np.tile(targets, len(curves)),
        curve=np.repeat(np.asarray(curves, dtype=np.int64), len(targets)),
        droop=np.repeat(each, len(targets)),
    )


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
    first: int, *, key: int, end: int, size: int, flown: tuple[Any, ...], track: FloatArray
) -> NDArray[np.int32]:
    """Hold in which each flight of one block crashed: of plain values, for any worker."""
    from nearlift.flight import kernel

    settings = flown[5]
    ended = np.empty((settings.shape[1], min(size, end - first)), dtype=np.int32)
    kernel.fly(np.uint64(key), first, *flown, ended, track)
    return ended


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
    """Flights at one boundary, and how they are integrated.

    The controller's f0 allows for the boundary at the set-point, as in the paper. `key` addresses
    the gusts: flight f meets the same ones in every setting, which makes differences far better
    known than rates. `spread` is an executor's map over blocks of flights; no result depends on it.
    """

    boundary: Boundary
    groups: Groups
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

    @property
    def holds(self) -> int:
        """Number of held gusts in a flight."""
        return max(round(self.groups.duration / self.groups.hold), 1)

    def _flown(self, curves: Curves, settings: FlightSettings) -> tuple[Any, ...]:
        """Arguments of the compiled loop from `holds` to `per`; settings in its order of rows."""
        g, n = self.groups, len(settings.curve)
        near = curves.at(settings.target_z_hat)[settings.curve, np.arange(n)]
        gains = (g.alpha, g.beta, g.gamma, g.delta / np.sqrt(near))
        rest = (g.noise, AWAY[self.boundary], settings.droop, g.contact, np.sqrt(g.most_lift))
        rows = [np.broadcast_to(row, n) for row in (settings.target_z_hat, *gains, *rest)]
        memory = float(np.exp(-g.hold / g.correlation)) if g.correlation > 0 else 0.0
        return (
            self.holds,
            self.steps_per_hold,
            g.hold / self.steps_per_hold,
            self.scheme == "rk4",
            memory,
            np.stack(rows),
            2 * NODES * settings.curve,
            curves.packed(),
            curves.low,
            curves.per_radius,
        )

    def ended(self, curves: Curves, settings: FlightSettings) -> NDArray[np.int32]:
        """Hold in which each flight crashed, or -1: shape (settings, flights)."""
        # blocks of equal size, or one worker would fly nearly all of few flights
        size = min(BLOCK, math.ceil(self.flights / LEAST_BLOCKS))
        block = functools.partial(
            _block,
            key=self.key,
            end=self.flights,
            size=size,
            flown=self._flown(curves, settings),
            track=UNTRACKED,
        )
        return np.concatenate(list(self.spread(block, range(0, self.flights, size))), axis=1)

    def crashed(self, curves: Curves, settings: FlightSettings) -> NDArray[np.bool_]:
        """Whether each flight crashes: shape (settings, flights)."""
        return self.ended(curves, settings) >= 0

    def trace(self, curves: Curves, settings: FlightSettings, flight: int) -> FloatArray:
        """Heights of one flight at the start and after every hold, (settings, holds + 1); nan once
        crashed.
        """
        track = np.full((len(settings.curve), self.holds + 1), np.nan)
        flown = self._flown(curves, settings)
        _block(flight, key=self.key, end=flight + 1, size=1, flown=flown, track=track)
        return track

    def step_test(
        self, curves: Curves, settings: FlightSettings, crashed: NDArray[np.bool_]
    ) -> StepTest:
        """Step test on a share of the flights; `crashed` (settings, flights) is at full step."""
        share = max(round(CHECKED * self.flights), LEAST_CHECKED)
        few = replace(self, flights=min(share, self.flights))
        coarse = crashed[:, : few.flights].sum(axis=1)
        fine = few.halved().crashed(curves, settings).sum(axis=1)
        rates = np.stack([coarse, fine]) / few.flights
        low, high = binomial90(np.stack([fine, coarse]), few.flights)
        # each rate outside the other's interval: one flight among few makes no difference
        outside = ((rates < low) | (rates > high)).all(axis=0)
        change = np.abs(rates[1] - rates[0])
        worst = int(change.argmax())
        return StepTest(
            converged=not bool(outside.any()),
            worst=float(change[worst]),
            worst_target_z_hat=float(settings.target_z_hat[worst]),
            beyond=int(outside.sum()),
            settings=len(settings.curve),
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
    how: MonteCarlo,
    curves: Curves,
    target_z_hat: FloatArray,
    risks: Sequence[float] = (),
    droop: float = 0.0,
) -> tuple[Sweep, StepTest]:
    """Sweep of every curve over set-points, refined until the levels at `risks` are resolved, and
    its step test. `droop` is the relative change of lift by the end of a flight.
    """
    n = len(curves.values)
    z_hat, new = np.empty(0), np.asarray(target_z_hat, dtype=float)
    crashed = np.empty((n, 0, how.flights), dtype=bool)
    for _ in range(ROUNDS):
        flown = how.crashed(curves, settings_of(new, range(n), droop))
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
    asked = np.flatnonzero(np.isin(z_hat, target_z_hat))
    tested = np.zeros((n, len(z_hat)), dtype=bool)
    for c in range(n):
        hit = np.flatnonzero(crashed[c, asked].any(axis=1))
        tested[c, asked[: (int(hit[-1]) + 1 if len(hit) else 0) + BEYOND]] = True
    curve, at = np.nonzero(tested)
    again = FlightSettings(
        target_z_hat=z_hat[at], curve=curve, droop=np.full(len(at), float(droop))
    )
    step_test = how.step_test(curves, again, crashed[tested])
    return Sweep(target_z_hat=z_hat, crashed=crashed, ratio=curves.at(z_hat)), step_test
