"""Crash rates over set-points with intervals, their test of the time step, and the lowest
set-point (level) for a given risk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nearlift.declare import BoolArray, FloatArray, IntArray
from nearlift.errors import UsageError
from nearlift.flight import energy
from nearlift.flight.simulation import Curves, Simulation
from nearlift.randomness import generator
from nearlift.results.document import IfAny, Real

#: Rows of a product.
Rows = list[dict[Any, Any]]
#: Bootstrap resamples of the flights for the interval of a level.
RESAMPLES = 400
#: Least number of crashes that must be expected at a risk.
LEAST_CRASHES = 3
#: Gap between set-points, in rotor radii, that needs no refinement.
FINEST_GAP_Z_HAT = 0.005
#: Largest number of passes, of which all but the first add set-points between those flown.
MAX_PASSES = 8
#: Share of the flights, and least number of them, that are flown again with half the step.
STEP_TEST_SHARE, MIN_STEP_TEST_FLIGHTS = 0.25, 50
#: Set-points beyond the last with a crash at which the step is tested too.
SAFE_TARGETS_TESTED = 2


def binomial90(crashes: IntArray, flights: int) -> tuple[FloatArray, FloatArray]:
    """Jeffreys' equal-tailed 90 % interval of a crash rate, to 0 or 1 if none or all crashed."""
    from scipy.special import betaincinv

    k = np.asarray(crashes, dtype=float)
    low = np.where(k == 0, 0.0, betaincinv(k + 0.5, flights - k + 0.5, 0.05))
    high = np.where(k == flights, 1.0, betaincinv(k + 0.5, flights - k + 0.5, 0.95))
    return low, high


def refuse_few(risk: float, flights: int) -> None:
    """Refuse a risk at which fewer than three crashes are expected.

    Raises
    ------
    UsageError
        States how many flights would do.
    """
    if risk * flights < LEAST_CRASHES:
        what = f"a risk of {risk:g} is not detectable in {flights} flights"
        raise UsageError("risk", what, f"fly at least {math.ceil(LEAST_CRASHES / risk)}")


# ---- levels


@dataclass(frozen=True, slots=True, kw_only=True)
class CrashLevel:
    """Lowest set-point at a risk, with its 90 % bootstrap interval over the flights; an upper bound
    where it is `lowest_flown`. `exponent` is the power of the paper's model, where it is of that.
    """

    exponent: IfAny[float] = None
    risk: Real
    value: Real
    lo90: Real
    hi90: Real
    lowest_flown: Real


def level(target_z_hat: FloatArray, rate: FloatArray, risk: float, least: float) -> FloatArray:
    """Lowest set-point above which the crash rate stays within `risk`, shape (...).

    Rates (..., n) at ascending set-points (n,) are clipped to [least, 1 - least], half a crash
    among the flights, and their logits interpolated. The level is nan where the highest set-point
    is riskier; where all are safer it is the lowest, an upper bound.
    """
    safe = np.clip(np.asarray(rate, dtype=float), least, 1 - least)
    above, n = safe > risk, len(target_z_hat)
    # index of the highest set-point that is riskier; -1 where none is
    last = np.where(above.any(axis=-1), n - 1 - above[..., ::-1].argmax(axis=-1), -1)
    i = np.clip(last, 0, n - 2)
    a, b = (
        np.log(p / (1 - p))
        for p in (np.take_along_axis(safe, at[..., None], -1)[..., 0] for at in (i, i + 1))
    )
    share = (a - math.log(risk / (1 - risk))) / np.where(a == b, 1.0, a - b)
    between = target_z_hat[i] + (target_z_hat[i + 1] - target_z_hat[i]) * share
    between = np.where(last == n - 1, np.nan, between)
    return np.where(last < 0, target_z_hat[0], between)


def resamples(flights: int, rng: np.random.Generator) -> FloatArray:
    """Bootstrap weights of the flights (RESAMPLES, flights), the first row as flown."""
    drawn = rng.multinomial(flights, np.full(flights, 1 / flights), size=RESAMPLES - 1)
    return np.concatenate([np.ones((1, flights)), drawn]) / flights


def levels(
    target_z_hat: FloatArray, crashed: BoolArray, risk: float, weights: FloatArray
) -> FloatArray:
    """Levels under the bootstrap weights of `resamples`, (RESAMPLES,), the first as flown; each
    weight is common to all set-points, as the gusts are.
    """
    return level(target_z_hat, weights @ crashed.T, risk, 0.5 / crashed.shape[1])


def spread90(values: FloatArray) -> tuple[float, float]:
    """5 % and 95 % points; nan (no set-point was safe enough) ranks above every level."""
    n, ordered = len(values), np.sort(values)
    low, high = (float(ordered[min(int(q * n), n - 1)]) for q in (0.05, 0.95))
    return low, high


# ---- sweeps


@dataclass(frozen=True, slots=True, kw_only=True)
class StepTest:
    """Largest change of a crash rate on halving the time step `step_s`, and its set-point.

    The step has converged if no two rates lie outside each other's binomial 90 % intervals.
    """

    converged: bool
    worst: Real
    worst_target_z_hat: Real
    step_s: Real

    @property
    def warning(self) -> str:
        """Message for a step that is too long."""
        return (
            f"a step of {self.step_s:g} s is too long: halving it changes the crash rate by"
            f" {self.worst:.2f} at z_hat {self.worst_target_z_hat:g}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Crashes (curves, t, flights) of every curve at every set-point (t,), and L / L_inf (curves,
    t) there.
    """

    target_z_hat: FloatArray
    crashed: BoolArray
    ratio: FloatArray

    def rows(self, curve: int, held: energy.Held, **labels: object) -> Rows:
        """Rows of crash_rates.parquet of one curve; `labels` are its identifying columns."""
        flights = int(self.crashed.shape[2])
        crashes, ratio = self.crashed[curve].sum(axis=1), self.ratio[curve]
        low, high = binomial90(crashes, flights)
        cheapest, cost, dearest = energy.cost(ratio, held)
        columns = {
            "target_z_hat": self.target_z_hat,
            "crashes": crashes,
            "rate": crashes / flights,
            "lo90": low,
            "hi90": high,
            "ratio": ratio,
            "cost_paper": energy.paper_cost(ratio),
            "cost": cost,
            "cost_lo": cheapest,
            "cost_hi": dearest,
        }
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        labels["flights"] = flights
        return [labels | dict(zip(columns, row, strict=True)) for row in rows]


def sweep(
    how: Simulation,
    curves: Curves,
    target_z_hat: FloatArray,
    risks: Sequence[float] = (),
    droop: float = 0.0,
) -> tuple[Sweep, StepTest]:
    """Sweep of every curve over set-points, refined until the levels at `risks` are resolved, and
    its step test. `droop` is the relative change of lift by the end of a flight.
    """
    n = len(curves.values)
    weights = resamples(how.flights, generator(how.key % 2**32, "refine"))
    z_hat, new = np.empty(0), np.asarray(target_z_hat, dtype=float)
    crashed = np.empty((n, 0, how.flights), dtype=bool)
    for _ in range(MAX_PASSES):
        more = how.ended(curves, new, np.arange(n)[:, None], droop) >= 0
        z_hat = np.append(z_hat, new)
        order = np.argsort(z_hat)
        z_hat, crashed = z_hat[order], np.concatenate([crashed, more], axis=1)[:, order]
        wanted = set[float]().union(
            *(_wide_gaps(z_hat, levels(z_hat, c, r, weights)) for r in risks for c in crashed)
        )
        new = np.array(sorted(wanted - set(z_hat.tolist())))
        if not len(new):
            break
    # the step is tested at the set-points asked for: those added lie where flights graze
    asked = np.flatnonzero(np.isin(z_hat, target_z_hat))
    tested = np.zeros((n, len(z_hat)), dtype=bool)
    for c in range(n):
        hit = np.flatnonzero(crashed[c, asked].any(axis=1))
        tested[c, asked[: (int(hit[-1]) + 1 if len(hit) else 0) + SAFE_TARGETS_TESTED]] = True
    curve, at = np.nonzero(tested)
    step_test = halved_step(how, curves, z_hat[at], curve, droop, crashed[tested])
    return Sweep(target_z_hat=z_hat, crashed=crashed, ratio=curves.at(z_hat)), step_test


def _wide_gaps(target_z_hat: FloatArray, resampled: FloatArray) -> set[float]:
    """Set-points to add so that no level is interpolated over a gap wider than half its interval.

    `resampled` are the levels of one curve under resampling, the first as flown. Empty where the
    level and the ends of its interval lie in narrow gaps. A gap of `FINEST_GAP_Z_HAT` is narrow.
    """
    low, high = spread90(resampled)
    allowed = (
        max(FINEST_GAP_Z_HAT, 0.5 * (high - low)) if np.isfinite(high - low) else FINEST_GAP_Z_HAT
    )
    middles = set()
    for at in (low, high, resampled[0]):
        if np.isfinite(at) and at > target_z_hat[0]:
            i = int(np.searchsorted(target_z_hat, at))
            below, above = float(target_z_hat[i - 1]), float(target_z_hat[i])
            if above - below > allowed:
                middles.add(round(0.5 * (below + above), 6))
    return middles


def halved_step(
    how: Simulation,
    curves: Curves,
    target_z_hat: FloatArray,
    curve: IntArray,
    droop: float,
    crashed: BoolArray,
) -> StepTest:
    """Step test of settings (n,) on a share of the flights; `crashed` (n, flights) as flown."""
    flights = min(max(round(STEP_TEST_SHARE * how.flights), MIN_STEP_TEST_FLIGHTS), how.flights)
    halved = replace(how, flights=flights, steps_per_hold=2 * how.steps_per_hold)
    fine = (halved.ended(curves, target_z_hat, curve, droop) >= 0).sum(axis=1)
    both = np.stack([crashed[:, :flights].sum(axis=1), fine])
    low, high = binomial90(both[::-1], flights)
    # each rate outside the other's interval: one flight among few makes no difference
    outside = ((both / flights < low) | (both / flights > high)).all(axis=0)
    change = np.abs(both[1] - both[0]) / flights
    worst = int(change.argmax())
    return StepTest(
        converged=not bool(outside.any()),
        worst=float(change[worst]),
        worst_target_z_hat=float(target_z_hat[worst]),
        step_s=how.step_s,
    )
