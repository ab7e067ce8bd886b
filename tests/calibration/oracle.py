"""What someone who knows the truth would do: generalised least squares with the true effect's form,
its size free.

The yardstick of coverage ("with the true model") and of held-out gain. Whitening is the true one;
tails are winsorised.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm
from tests.calibration import forms
from tests.calibration.simulator import Campaign, log_lift

LIMITS = {"K_b": (-10.0, 20.0), "alpha": (1e-3, 3.0), "a": (-0.5, 0.5), "lambda_": (0.05, 20.0)}
CLIP = 3.5
Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Coefficients with standard errors, and the log lift predicted for every trial, those left out
    included.
    """

    theta: dict[str, float]
    u: dict[str, float]
    predicted: Array
    residuals: Array

    def interval(self, name: str, level: float = 0.9) -> tuple[float, float]:
        """Central interval of a coefficient."""
        q = float(norm.ppf(0.5 + level / 2))
        return self.theta[name] - q * self.u[name], self.theta[name] + q * self.u[name]


def winsorised(x: Array, target: Array, inverse: Array) -> tuple[Array, Array, float]:
    """Least squares with residuals beyond `CLIP` robust deviations pulled in: the solution, its
    residuals, and the limit.
    """
    move = inverse @ target
    for _ in range(4):
        left = target - x @ move
        limit = CLIP * 1.4826 * float(np.median(np.abs(left)))
        move = move + inverse @ np.clip(left, -limit, limit)
    return move, target - x @ move, limit


def fit(campaign: Campaign, kinds: tuple[str, ...] | None = None, rows: Array | None = None) -> Fit:
    """Fit the base model with the true forms of `kinds` (all that are in the campaign if None) to
    `rows` (all if None).
    """
    truth, setting = campaign.truth, campaign.setting
    kinds = tuple(truth.amplitudes) if kinds is None else kinds
    pieces = [forms.form(k, campaign.spec.foreign) for k in kinds]
    names = tuple(truth.theta)
    p, levels = len(names), campaign.indicator.shape[1]
    rows = np.arange(campaign.data.n) if rows is None else rows
    log_inf = np.log(setting.levels_N)[setting.bench.level]
    y = np.log(campaign.data.lift_N)
    white = campaign.whitener if len(rows) == campaign.data.n else campaign.whitener.of(rows)

    def predict(x: Array) -> Array:
        at = replace(setting, theta=dict(zip(names, x[:p].tolist(), strict=True)))
        each = tuple(zip(pieces, x[p:].tolist(), strict=True))
        return (log_lift(at, each) - log_inf)[campaign.keep]

    at = np.array([*truth.theta.values(), *(truth.amplitudes[k] for k in kinds)])
    low = np.array([LIMITS[n][0] for n in names] + [min(3 * x, 0.0) for x in at[p:]])
    high = np.array([LIMITS[n][1] for n in names] + [max(3 * x, 0.0) for x in at[p:]])
    # an effect from which the data are silent must still have some slope
    steps = np.diag(1e-4 * np.maximum(np.abs(at), 1e-9))
    for _ in range(8):
        now = predict(at)
        slopes = [(predict(at + s) - predict(at - s)) / (2 * s.sum()) for s in steps]
        design = np.column_stack([campaign.indicator, *slopes])
        x = white(design[rows])
        scale = np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-300)
        inverse = np.linalg.pinv(x / scale, rcond=1e-9) / scale[:, None]
        move, _, _ = winsorised(x, white((y - now)[rows]), inverse)
        new = np.clip(at + move[levels:], low, high)
        done = np.allclose(new, at, rtol=1e-5, atol=1e-10)
        at = new
        if done:
            break
    now = predict(at)
    # levels are solved again at these coefficients, lest two iterates mix
    flat = white(campaign.indicator[rows])
    level, left, limit = winsorised(flat, white((y - now)[rows]), np.linalg.pinv(flat))
    pulled = np.clip(left, -limit, limit)
    dof = len(rows) - design.shape[1]
    factor = float((pulled**2).sum() / dof / np.mean(np.abs(left) < limit) ** 2)
    u = np.sqrt(factor * np.maximum((inverse**2).sum(axis=1), 0))[levels:]
    predicted = now + campaign.indicator @ level
    theta, sd = (dict(zip(names, v[:p].tolist(), strict=True)) for v in (at, u))
    return Fit(theta=theta, u=sd, predicted=predicted, residuals=y - predicted)


def folds(campaign: Campaign) -> list[Array]:
    """Masks of the trials left out in turn: the library's own split, so that both are scored on the
    same trials.
    """
    from nearlift.loop import confirmation

    return confirmation.folds(campaign.data)


def held_out(campaign: Campaign, kinds: tuple[str, ...] | None = None) -> float:
    """Rms relative residual of trials in visits that took no part in the fit."""
    squares = 0.0
    for out in folds(campaign):
        squares += float((fit(campaign, kinds, np.flatnonzero(~out)).residuals[out] ** 2).sum())
    return float(np.sqrt(squares / campaign.data.n))


def expected(campaign: Campaign, predicted: Array) -> float:
    """Rms error that predictions of log lift would have on an independent repeat of this campaign:
    noise and curve error.

    Needs no repeat to be drawn: the mean square of (truth + fresh noise - prediction) is the sum of
    the two.
    """
    return float(
        np.sqrt(np.mean((predicted - campaign.truth.log_lift) ** 2 + campaign.truth.variance))
    )
