"""The motors' lag: their command behind a first-order lag, and the time constant at which lift
follows it best.

A motor follows its command as a first-order system does. The time constant is found on a grid: at
each of its values log lift is fitted by the filtered command, the supply, the climb and smooth
curves of height, with a level for each stretch of flight; where the height's set-point was logged,
by two-stage least squares with its history as instruments, since the command answers what disturbs
the vehicle. How far the best value moves when stretches are left out is its uncertainty, since
neighbouring samples are not independent of each other. Lag trades with climb (0.6 % per m/s for
every 10 ms), so both are free at once.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray, IntArray
from nearlift.manifest.flight_log import LONGEST_LAG_S

#: Time constants that are tried, s.
GRID = np.linspace(0.0, LONGEST_LAG_S, 41)
#: Samples that are averaged before they are fitted, s: noise of an accelerometer is faster.
BLOCK_S = 0.02
#: Decay lengths of the smooth curves of height, in rotor radii.
DECAYS = (1.0, 3.0)
#: How long before a sample the set-point is looked at, s.
SENT_S = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8)
#: By what least squares may be off where no set-point was logged, s: half-width of what feedback
#: did in simulated flights with gusts of 1 to 3 % of the weight that last 0.1 to 2 s.
FEEDBACK_S = 0.014
#: A flight is parted into stretches of so long, s, that are left out in turn, or so many parts.
STRETCH_S, PARTS = 4.0, 100
#: A share of a command that no number shows any more.
FORGOTTEN = 1e-18


@dataclass(frozen=True, slots=True, kw_only=True)
class LagMoments:
    """Sums of squares and products of one stretch of flight at each time constant, less their
    means: of log lift first, then of what it is fitted by, (T, k, k); of the instruments with
    these (T, q, k), and among themselves (q, q), where a set-point was logged.
    """

    products: FloatArray
    step_s: float
    seen: FloatArray | None = None
    instruments: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Lag:
    """A time constant and its standard uncertainty, s; the power of the filtered command that lift
    follows; `at_edge` where the best value lies at the end of the grid.
    """

    value_s: float
    u_s: float
    power: float
    at_edge: bool = False


def filtered(
    command: FloatArray, run: IntArray, step_s: float, lag_s: float | FloatArray
) -> FloatArray:
    """A command (n,) behind a first-order lag, or each of several (T, n), begun anew behind each
    hole of the log.

    A command holds from its sample to the next, so that at a sample it has not acted yet.
    """
    lags = np.atleast_1d(np.asarray(lag_s, dtype=np.float64))
    known = np.nan_to_num(command)
    edges = [0, *(np.flatnonzero(np.diff(run)) + 1).tolist(), len(command)]
    out = np.empty((len(lags), len(command)))
    # lag by lag, so that what is worked on stays at hand
    for behind, lag in zip(out, lags.tolist(), strict=True):
        kept = math.exp(-step_s / lag) if lag > 0 else 0.0
        behind[0] = (1 - kept) * known[0]
        np.multiply(1 - kept, known[:-1], out=behind[1:])
        for a, b in itertools.pairwise(edges):
            behind[a] = known[a]
            # each round adds as many samples of the past again
            reach, keeps = 1, kept
            while reach < b - a and keeps > FORGOTTEN:
                behind[a + reach : b] += keeps * behind[a : b - reach]
                reach, keeps = 2 * reach, keeps * keeps
    return out if np.ndim(lag_s) else out[0]


def moments(
    lift_N: FloatArray,
    commands: FloatArray,
    beside: Sequence[FloatArray],
    group: IntArray,
    step_s: float,
    instruments: FloatArray | None = None,
) -> list[LagMoments]:
    """The sums of each stretch: samples (n,) of one `group` (from 1; 0 is left out).

    Log lift is fitted by log `commands` (T, n), the mean one behind each lag, and by what is
    `beside` it, (n,) each; `instruments` (q, n) move the vehicle, and no disturbance moves them.
    """
    size = max(round(BLOCK_S / step_s), 1)
    places = np.flatnonzero(group)
    parts = np.split(places, np.flatnonzero(np.diff(group[places])) + 1)
    parts = [part[: len(part) // size * size] for part in parts]
    parts = [part for part in parts if len(part) >= 2 * size * (len(beside) + 2)]
    if not parts:
        return []
    mine = np.concatenate(parts)
    ends = np.cumsum([len(part) // size for part in parts]).tolist()

    def means(values: FloatArray) -> FloatArray:
        whole = np.take(values, mine[::size], axis=-1)
        for k in range(1, size):
            whole += np.take(values, mine[k::size], axis=-1)
        return np.asarray(whole / size, dtype=np.float64)

    log_command = np.log(np.maximum(means(commands), 1e-9))
    fixed = np.stack([np.log(np.maximum(means(lift_N), 1e-9)), *(means(x) for x in beside)])
    sent = None if instruments is None else means(instruments)
    return [
        _sums(log_command[:, a:b], fixed[:, a:b], None if sent is None else sent[:, a:b], step_s)
        for a, b in itertools.pairwise([0, *ends])
    ]


def _sums(
    log_command: FloatArray, fixed: FloatArray, sent: FloatArray | None, step_s: float
) -> LagMoments:
    """The sums of one stretch, from log command (T, n) and what no lag changes (k - 1, n)."""
    log_command, fixed = (x - x.mean(axis=1, keepdims=True) for x in (log_command, fixed))
    beside = [0, *range(2, len(fixed) + 1)]
    products = np.empty((len(log_command), len(fixed) + 1, len(fixed) + 1))
    products[:, np.array(beside)[:, None], beside] = fixed @ fixed.T
    products[:, beside, 1] = products[:, 1, beside] = log_command @ fixed.T
    products[:, 1, 1] = np.einsum("ti,ti->t", log_command, log_command)
    if sent is None:
        return LagMoments(products=products, step_s=step_s)
    sent = sent - sent.mean(axis=1, keepdims=True)
    seen = np.empty((len(log_command), len(sent), len(fixed) + 1))
    seen[:, :, beside] = sent @ fixed.T
    seen[:, :, 1] = log_command @ sent.T
    return LagMoments(products=products, step_s=step_s, seen=seen, instruments=sent @ sent.T)


def estimate(stretches: Sequence[LagMoments], given_s: float | None = None) -> Lag | None:
    """The lag that all stretches share, and the command's power there, or at the given lag; None
    where they cannot tell one.

    By two-stage least squares where all have instruments, unless these tell less than least squares
    with what feedback may do to it.
    """
    if len(stretches) < 2:
        return None
    plain = _PartSums.over(stretches, seen=False)
    lags = [_lag_of(plain, FEEDBACK_S / np.sqrt(3))]
    if all(s.seen is not None for s in stretches):
        lags.append(_lag_of(_PartSums.over(stretches, seen=True), 0.0))
    best = min(lags, key=lambda lag: (lag.at_edge, lag.u_s))
    if given_s is not None:
        return replace(best, value_s=given_s, u_s=0.0, at_edge=False)
    # a log does not say when between two samples a command acted
    within = max(s.step_s for s in stretches) / np.sqrt(12)
    return replace(best, u_s=float(np.hypot(best.u_s, within)))


def _lag_of(sums: _PartSums, feedback: float) -> Lag:
    """The lag by these sums, and its uncertainty from leaving out parts of flight."""
    best, power = _best(sums.products())
    n = len(sums.each)
    without = np.array([_best(sums.products(without=i))[0] for i in range(n)])
    # jackknife (Efron & Stein 1981, Ann. Stat. 9, 586)
    u = float(np.sqrt((n - 1) / n * np.sum((without - without.mean()) ** 2)))
    step = float(GRID[1] - GRID[0])
    return Lag(
        value_s=best,
        u_s=float(np.hypot(max(u, step / 2), feedback)),
        power=power,
        at_edge=not GRID[0] + step / 2 < best < GRID[-1] - step / 2,
    )


@dataclass(frozen=True, kw_only=True)
class _PartSums:
    """The sums of parts of flight, stretches that follow each other: their own, (parts, T, k, k),
    or those of the instruments with them, (parts, T, q, k), and among themselves, (parts, q, q).
    """

    each: FloatArray
    instruments: FloatArray | None = None

    @classmethod
    def over(cls, stretches: Sequence[LagMoments], seen: bool) -> _PartSums:
        edges = np.linspace(0, len(stretches), min(len(stretches), PARTS) + 1).astype(int).tolist()

        def summed(values: list[FloatArray]) -> FloatArray:
            parts = (np.array(values[a:b]) for a, b in itertools.pairwise(edges))
            return np.concatenate([np.add.reduceat(part, [0]) for part in parts])

        if not seen:
            return cls(each=summed([s.products for s in stretches]))
        return cls(
            each=summed([s.seen for s in stretches if s.seen is not None]),
            instruments=summed([s.instruments for s in stretches if s.instruments is not None]),
        )

    @functools.cached_property
    def whole(self) -> tuple[FloatArray, FloatArray | None]:
        """The sums of all parts."""
        instruments = self.instruments
        return self.each.sum(axis=0), None if instruments is None else instruments.sum(axis=0)

    def products(self, without: int | None = None) -> FloatArray:
        """Sums of squares and products (T, k, k) of all parts, or of all but one; of instruments,
        of what they see: least squares of those is two-stage least squares.
        """
        left, instruments = self.whole
        if without is not None:
            left = left - self.each[without]
        if self.instruments is None or instruments is None:
            return left
        if without is not None:
            instruments = instruments - self.instruments[without]
        scale = np.sqrt(np.maximum(np.diag(instruments), 1e-300))
        energy, turn = np.linalg.eigh(instruments / np.outer(scale, scale))
        kept = energy > 1e-9 * energy[-1]
        seen = (turn[:, kept] / np.sqrt(energy[kept])).T @ (left / scale[:, None])
        return np.asarray(seen.swapaxes(1, 2) @ seen, dtype=np.float64)


def _best(products: FloatArray) -> tuple[float, float]:
    """The time constant at the least squares, between nodes by a parabola, and the power there."""
    scale = np.sqrt(np.maximum(np.einsum("tii->ti", products), 1e-300))
    inner = products / (scale[:, :, None] * scale[:, None, :])
    # columns that others span get nothing
    solved = np.linalg.pinv(inner[:, 1:, 1:], rcond=1e-10, hermitian=True) @ inner[:, 1:, :1]
    share = np.einsum("ti,ti->t", inner[:, 0, 1:], solved[:, :, 0])
    left = products[:, 0, 0] * np.maximum(1.0 - share, 0.0)
    power = solved[:, 0, 0] * scale[:, 0] / scale[:, 1]
    k = int(np.argmin(left))
    if not 0 < k < len(GRID) - 1:
        return float(GRID[k]), float(power[k])
    a, b, c = left[k - 1 : k + 2]
    away = 0.5 * (a - c) / (a - 2 * b + c) if a - 2 * b + c > 0 else 0.0
    value = GRID[k] + away * (GRID[1] - GRID[0])
    return float(value), float(np.interp(value, GRID, power))
