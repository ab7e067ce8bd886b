"""Gain at two rotor radii and decay length of a boundary's effect on lift, from flights, by
estimators that feedback does not bias.

In closed loop the command responds to every disturbance, so command, climb and height are
correlated with the error of the lift that they are to explain, and least squares is biased however
many windows there are. A logged height set-point moves the vehicle but responds to no disturbance:
its history is the instrument of two-stage least squares. Without one, the command's power, through
which most of the bias acts, is taken to be anywhere in `POWERS`, and the interval spans the
answers.

Every start has a level of its own. Standard uncertainties are a jackknife over stretches of flight,
since windows are not independent. Sources: Wooldridge 2010, Econometric Analysis of Cross Section
and Panel Data, ch. 5 (two-stage least squares); Efron & Stein 1981, Ann. Stat. 9, 586 (jackknife).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged

#: Distance at which the gain is quoted, in rotor radii.
REFERENCE_Z_HAT = 2.0
#: Range of the power with which lift follows the command: 2 in theory at a given voltage, less with
#: motor losses, as thrust stands measure it.
POWERS = (1.5, 2.2)
#: Decay lengths, in rotor radii, of the instruments made from the set-point.
SHAPES = (1.0, 3.0)
#: Powers of distance with which a gain may decay: the square for image systems, exponential (inf)
#: in a measured flight. A form is kept where its chi2 exceeds the least by less than KEPT, each
#: window counting as WORTH of one, since neighbours are correlated.
FORMS, KEPT, WORTH = (2.0, 4.0, np.inf), 4.0, 0.25
#: Windows in a stretch that the jackknife leaves out, and the fewest stretches for a jackknife.
STRETCH, FEWEST = 16, 6
#: Maximum number of Gauss-Newton steps, and the step at which they have converged.
STEPS, SETTLED = 100, 1e-5
#: Normal prior of the logarithms of gain and decay length: means and standard deviations.
BELIEVED = (np.log([0.1, 1.5]), np.array([1.0, 0.7]))
#: Largest step of the logarithm of gain or decay length, and least factor that damps a step.
FARTHEST, SLOWEST = 0.5, 0.1

Ratio = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """Windows of flight, (n,) each; `instruments` (n, q), or None where no set-point was logged;
    log lift is linear in the command and in the columns `beside` (n, k).
    """

    log_lift: FloatArray
    log_command: FloatArray
    beside: FloatArray
    z_hat: FloatArray
    start: NDArray[np.int64]
    instruments: FloatArray | None

    @property
    def stretch(self) -> NDArray[np.int64]:
        """Index of each window's stretch, from 0."""
        both = np.stack([self.start, since_start(self.start) // STRETCH])
        return np.unique(both, axis=1, return_inverse=True)[1].astype(np.int64)

    def taken(self, kept: NDArray[np.bool_]) -> Windows:
        """The windows of a mask."""
        return Windows(
            log_lift=self.log_lift[kept],
            log_command=self.log_command[kept],
            beside=self.beside[kept],
            z_hat=self.z_hat[kept],
            start=self.start[kept],
            instruments=None if self.instruments is None else self.instruments[kept],
        )

    def linear(self, power: float | None) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Level columns (n, starts), all columns that log lift is linear in besides the ratio, and
        log lift less the contribution of the command at a given `power`.
        """
        level = np.eye(int(self.start.max()) + 1)[self.start]
        level = level[:, level.any(axis=0)]
        if power is None:
            return (
                level,
                np.hstack([level, self.beside, self.log_command[:, None]]),
                self.log_lift,
            )
        return level, np.hstack([level, self.beside]), self.log_lift - power * self.log_command

    def moved(self, log_lift: FloatArray | float = 0.0, z_hat: float = 0.0) -> Windows:
        """The windows with log lift and every height shifted."""
        return replace(self, log_lift=self.log_lift + log_lift, z_hat=self.z_hat + z_hat)


def since_start(start: NDArray[np.int64]) -> NDArray[np.int64]:
    """Index of each window within its start, from 0."""
    first = np.flatnonzero(np.diff(start, prepend=start[0] - 1))
    begun = np.repeat(first, np.diff([*first.tolist(), len(start)]))
    return np.asarray(np.arange(len(start)) - begun, dtype=np.int64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Solved:
    """Coefficients with their jackknife covariance, the command's power, the degrees of freedom and
    the sum of squared residuals.
    """

    theta: FloatArray
    covariance: FloatArray
    power: float
    dof: int
    squares: float


def decaying(z_hat: FloatArray, power: float) -> Ratio:
    """Log of 1 + gain (1 + (z_hat - 2) / (power decay))^-power and its derivatives with respect to
    log gain and log decay; exponential for an infinite power.
    """

    def ratio(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        gain, decay = np.exp(theta)
        away = (z_hat - REFERENCE_Z_HAT) / decay
        if np.isinf(power):
            part, along = gain * np.exp(-away), away
        else:
            # the pole lies below every height that is flown
            base = np.maximum(1 + away / power, 0.05)
            part, along = gain * base**-power, away / base
        slope = part / (1 + part)
        return np.log1p(part), np.stack([slope, slope * along], axis=1)

    return ratio


def instruments_of(setpoint_m: FloatArray, offset_m: float, radius_m: float) -> FloatArray:
    """Instruments (n, q): set-point lags (n, lags) in rotor radii, and exponentials of them."""
    z_hat = np.maximum(np.nan_to_num(setpoint_m) + offset_m, 0.0) / radius_m
    shapes = [np.exp(-z_hat / decay) for decay in SHAPES]
    return np.hstack([z_hat / 10, *shapes])


def solve(
    windows: Windows,
    ratio: Ratio,
    theta: FloatArray,
    power: float | None = None,
    believed: tuple[FloatArray, FloatArray] | None = None,
) -> Solved:
    """Two-stage least squares by Gauss-Newton steps; ordinary least squares without instruments.

    A given `power` of the command is held. With a normal prior `believed` of theta (means, standard
    deviations), variances are at least those of the posterior.

    Raises
    ------
    NotConverged
        The steps do not converge, or the windows do not determine the coefficients.
    """
    level, free, fixed = windows.linear(power)
    theta, p = theta.astype(float), len(theta)
    scatter = float(np.std(fixed - level @ np.linalg.lstsq(level, fixed, rcond=None)[0]))
    pace, before, last = 1.0, np.inf, np.zeros(p)
    for _ in range(STEPS):
        log_ratio, slopes = ratio(theta)
        columns = np.hstack([free, slopes])
        outer = columns if windows.instruments is None else np.hstack([level, windows.instruments])
        sums = _StretchSums.from_columns(columns, outer, fixed - log_ratio, windows.stretch)
        weight, towards = np.zeros(p), np.zeros(p)
        if believed is not None:
            # neighbours are correlated, so windows carry less information than their number
            weight = scatter / np.sqrt(WORTH) / believed[1]
            towards = believed[0] - theta
        coefficients = sums.solved(weight, towards)
        move = coefficients[-p:]
        if not np.isfinite(move).all():
            break
        size, left = float(np.abs(move).max()), fixed - log_ratio - columns @ coefficients
        scatter = float(np.sqrt(np.mean(left**2)))
        # a step that grows or reverses has overshot
        pace = max(0.5 * pace, SLOWEST) if size > before or move @ last < 0 else pace
        before, last = size, move
        theta = theta + move * min(pace, FARTHEST / max(size, 1e-300))
        if size < SETTLED:
            each = np.array([sums.solved(weight, towards, g) for g in range(sums.groups)])
            if sums.groups < FEWEST or not np.isfinite(each).all():
                break
            away = each - each.mean(axis=0)
            whole = (sums.groups - 1) / sums.groups * away.T @ away
            spread = whole[-p:, -p:]
            if believed is not None:
                least = scatter**2 / WORTH * sums.inverse(weight)[-p:, -p:]
                spread = spread + np.diag(np.maximum(np.diag(least) - np.diag(spread), 0.0))
            return Solved(
                theta=theta,
                covariance=spread,
                power=float(coefficients[free.shape[1] - 1]) if power is None else power,
                dof=sums.groups - 1,
                squares=float(left @ left),
            )
    raise NotConverged(
        "the gain near the boundary",
        "is not told by these windows of flight",
        "fly lower, change the height more often, or log more flights",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _StretchSums:
    """Z'Z, Z'X and Z'y of every stretch, (groups, ...)."""

    zz: FloatArray
    zx: FloatArray
    zy: FloatArray

    @classmethod
    def from_columns(
        cls, x: FloatArray, z: FloatArray, y: FloatArray, group: NDArray[np.int64]
    ) -> _StretchSums:
        z = z / np.maximum(np.sqrt(np.mean(z**2, axis=0)), 1e-300)
        parts = [np.flatnonzero(group == g) for g in range(int(group.max()) + 1)]
        return cls(
            zz=np.array([z[i].T @ z[i] for i in parts]),
            zx=np.array([z[i].T @ x[i] for i in parts]),
            zy=np.array([z[i].T @ y[i] for i in parts]),
        )

    @property
    def groups(self) -> int:
        return len(self.zz)

    def solved(
        self, weight: FloatArray, towards: FloatArray, without: int | None = None
    ) -> FloatArray:
        """Coefficients, the last ones shrunk `towards` values with a ridge `weight`."""
        first, second = self._reduced(weight, towards, without)
        scale = np.maximum(np.linalg.norm(first, axis=0), 1e-300)
        return np.asarray(
            np.linalg.lstsq(first / scale, second, rcond=1e-8)[0] / scale, dtype=np.float64
        )

    def inverse(self, weight: FloatArray) -> FloatArray:
        """The inverse of the coefficients' information in units of a window's variance."""
        first, _ = self._reduced(weight, np.zeros(len(weight)), None)
        return np.asarray(np.linalg.pinv(first.T @ first), dtype=np.float64)

    def _reduced(
        self, weight: FloatArray, towards: FloatArray, without: int | None
    ) -> tuple[FloatArray, FloatArray]:
        zz, zx, zy = (a.sum(axis=0) for a in (self.zz, self.zx, self.zy))
        if without is not None:
            zz, zx, zy = zz - self.zz[without], zx - self.zx[without], zy - self.zy[without]
        energy, turn = np.linalg.eigh(zz)
        kept = energy > 1e-9 * energy[-1]
        root = turn[:, kept] / np.sqrt(energy[kept])
        drawn = np.zeros((len(weight), zx.shape[1]))
        drawn[:, -len(weight) :] = np.diag(weight)
        return np.vstack([root.T @ zx, drawn]), np.concatenate([root.T @ zy, weight * towards])


def without_each(windows: Windows, ratio: Ratio, theta: FloatArray) -> FloatArray:
    """One-step change of theta without each window, (n, p); the first stage is held."""
    level, free, fixed = windows.linear(None)
    log_ratio, slopes = ratio(theta)
    x, y = np.hstack([free, slopes]), fixed - log_ratio
    seen = x
    if windows.instruments is not None:
        z = np.hstack([level, windows.instruments])
        seen = z @ np.linalg.lstsq(z, x, rcond=1e-8)[0]
    scale = np.maximum(np.linalg.norm(seen, axis=0), 1e-300)
    seen = seen / scale
    inner = np.linalg.pinv(seen.T @ seen)
    left = y - x @ (inner @ (seen.T @ y) / scale)
    along = seen @ inner
    kept = np.maximum(1 - np.einsum("ij,ij->i", along, seen), 1e-3)
    moved = -along * (left / kept)[:, None] / scale
    return np.asarray(moved[:, -len(theta) :], dtype=np.float64)


def gains(windows: Windows, power: float | None = None) -> list[tuple[float, Solved]]:
    """Solutions for log gain at two radii and log decay length by every form that the windows
    allow, least squared residuals first.

    Raises
    ------
    NotConverged
        No form converges.
    """
    answers = []
    for form in FORMS:
        try:
            ratio = decaying(windows.z_hat, form)
            answers.append((form, solve(windows, ratio, BELIEVED[0], power, BELIEVED)))
        except NotConverged:
            if not answers and form == FORMS[-1]:
                raise
    answers.sort(key=lambda pair: pair[1].squares)
    least, n = answers[0][1].squares, WORTH * len(windows.z_hat)
    return [pair for pair in answers if n * np.log(pair[1].squares / least) < KEPT]
