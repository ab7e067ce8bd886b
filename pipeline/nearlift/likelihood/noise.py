"""Scatter of trials: variance components of log lift, by penalised restricted maximum likelihood.

A trial's noise has a part within its record (known), one in proportion to lift and one of force.
The trials of a visit share an error of height, which acts through the slope of the curve, and a
gain. Slow drift correlates neighbours in time: four Ornstein-Uhlenbeck processes with fixed
correlation lengths in trials, so that only their sizes are unknown. All are estimated once for each
mean model.

Structure that the mean model may lack is not noise. It takes part as unknowns of a generous size,
so that neither hides in the other and nothing runs out of degrees of freedom. Every size has a weak
prior, half-t, maximised in its logarithm (see `PRIORS`). None is ever zero, and few visits do not
let one grow without bound. The posterior may have several modes: much scatter of heights, or little
and a larger gain per visit. The covariance is then the mean over them, so that no trial decides
between them. Trials beyond `CLIP` standard deviations from all others are winsorised. Sources:
Patterson & Thompson 1971, Biometrika 58, 545 (restricted likelihood); Gilmour, Thompson & Cullis
1995, Biometrics 51, 1440 (average information); Gelman 2006, Bayesian Anal. 1, 515 (half-t priors
on standard deviations).
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.covariance import LEAST_VARIANCE, Covariance
from nearlift.likelihood.subspace import orthonormal
from nearlift.likelihood.variance_components import (
    MIN_REVISITS,
    MODE_DEVIANCE,
    VarianceComponents,
    ages,
    winsorise,
)
from nearlift.results import IntArray, Noise, Observations

#: Degrees of freedom from which they are printed as infinite: Student's t is then normal to 1e-6.
ENDLESS = 1e6
#: Source of a noise that was estimated from repeats.
REPEATS = "scatter of repeats"
#: Size of a family of structure, as a fraction of lift; the scatter about the model where that is
#: larger. Ours: generous, so that structure never counts as noise.
STRUCTURE = 0.01
#: Variance, relative to the largest, below which a combination of unknowns is rounding.
NEGLIGIBLE = 1e-13
#: Number of smooth curves of distance; fewest trials of a free mean, and the most means. Ours: a
#: mean of fewer leaves hardly any scatter, and more means cost time.
SHAPES, REPEATED, MOST_MEANS = 6, 3, 400
#: Factor on the usual size of heights and short drifts for a second start of the search.
#: Ours: a mode at large sizes is then reached too; the likelihood decides.
FAR = 30.0
#: Number of times that outliers are winsorised (docs/decisions.md#one-noise-likelihood).
PASSES = 2
#: Last step in the logarithm of a size, before and after outliers are winsorised. Ours: the
#: first is only a start of the second.
ROUGH_STEP, LAST_STEP = 0.1, 1e-6


def trial_variance(data: Observations, noise: Noise) -> FloatArray:
    """Variance of log lift that trials do not share, (n,): within the record, and of repeats."""
    return np.asarray(
        (data.u_lift_N / data.lift_N) ** 2 + noise.relative**2 + (noise.force_N / data.lift_N) ** 2,
        dtype=np.float64,
    )


def trial_covariance(
    data: Observations,
    noise: Noise,
    slope: FloatArray,
    shared: FloatArray | None = None,
    extra: FloatArray | float = 0.0,
) -> Covariance:
    """The covariance of log lift that a `Noise` implies; `slope` is d log ratio / dz per metre,
    `extra` a further variance.
    """
    return Covariance(
        variance=np.maximum(trial_variance(data, noise) + extra, LEAST_VARIANCE),
        visit=data.visit,
        per_visit=noise.height_m * slope,
        shared=np.zeros((data.n, 0)) if shared is None else shared,
        common=noise.common,
        drift=np.array(noise.drift),
        age=ages(data)[:, : len(noise.drift)],
    )


def cells(data: Observations) -> IntArray:
    """Index of each trial's (distance, throttle) cell."""
    both = np.stack([data.z_hat, data.levels[data.level]])
    cell: IntArray = np.unique(both, axis=1, return_inverse=True)[1].astype(np.int64)
    return cell


def estimate(
    data: Observations,
    log_lift: FloatArray,
    mean: FloatArray,
    structure: list[FloatArray],
    slope: FloatArray,
    shared: FloatArray | None = None,
    extra: FloatArray | float = 0.0,
    start: Noise | None = None,
    source: str = "trials with every family and effect",
) -> tuple[Noise, FloatArray]:
    """Variance components, and the log lift with outliers winsorised.

    Parameters
    ----------
    data : Observations
        Trials in run order.
    log_lift : (n,)
        Log lift less the model's prediction.
    mean : (n, q)
        Free columns: levels and model Jacobian.
    structure : list of (n, k)
        Structure that the model may lack, one entry for each family.
    slope : (n,)
        d log ratio / dz per metre, which carries a visit's height error.
    shared, extra
        Stated errors, as in `trial_covariance`: scatter that they explain is not counted again.
    start : Noise or None
        Noise of nearly the same trials about a similar model. It is a starting value that saves
        steps, if it has the same sizes.
    source : str
        First part of `Noise.source`; the degrees of freedom of a typical trial's variance follow.

    Returns
    -------
    Noise, (n,) array

    Raises
    ------
    NotConverged
        The trials' variances are too different in size for floating-point arithmetic.
    """
    mean = orthonormal(mean)
    left = log_lift - mean @ (mean.T @ log_lift)
    rms = float(np.sqrt(np.mean(left**2)))
    generous = max(STRUCTURE, rms)
    scaled = (
        s * (generous * np.sqrt(data.n) / norm)
        for s in structure
        if (norm := float(np.linalg.norm(s))) > 0
    )
    stated = np.zeros((data.n, 0)) if shared is None else shared
    lacking = _condensed(np.hstack([stated, *scaled]))
    model = VarianceComponents(data, slope, np.hstack([mean, lacking]), mean.shape[1], extra)
    del lacking
    typical_N = float(np.median(data.lift_N))
    unit = np.array([typical_N if name == "force_N" else 1.0 for name in model.priors])
    if start is None or not start.modes or start.sizes != tuple(model.priors):
        # neighbours differ by their noise whatever the model lacks
        near = float(np.median(np.abs(np.diff(left)))) if data.n > 1 else rms
        usual = np.log(
            [
                max(min(0.7 * rms, near), 1e-7) if name == "relative" else scale
                for name, (scale, _) in model.priors.items()
            ]
        )
        # of heights, short drifts and what else visits share, one could have taken another's part
        # before that is looked for
        starts = [
            usual + np.log([FAR if name in far else 1.0 for name in model.priors])
            for far in ((), ("height_m",), ("drift0", "drift1"))
        ]
        starts = [mode.x for mode in model.modes(starts, log_lift, ROUGH_STEP)[0]]
    else:
        starts = [np.array(x) for x in start.modes]
    y = log_lift
    for _ in range(PASSES):
        modes, weight = model.modes(starts, y, ROUGH_STEP)
        starts = [mode.x for mode in modes]
        y = weight @ np.array([winsorise(y, mode) for mode in modes])
    modes, weight = model.modes(starts, y, LAST_STEP, MODE_DEVIANCE)
    squares = np.exp(2 * np.array([mode.x for mode in modes]))
    size2 = weight @ squares
    # half the relative change of a square is that of its logarithm
    apart = (squares / size2 - 1) / 2
    spread = apart.T @ (weight[:, None] * apart)
    for mode, share, one in zip(modes, weight, squares / size2, strict=True):
        spread += share * np.linalg.inv(mode.curvature) * np.outer(one, one)
    # of the variance of a trial like the others, of which its own record or a published standard
    # deviation determines a part
    parts = size2 * model.diagonals
    whole = model.known_variance + parts.sum(axis=1)
    dof = float(np.median(whole**2 / (2 * np.einsum("ij,jk,ik->i", parts, spread, parts))))
    sizes = dict(zip(model.priors, np.sqrt(size2) * unit, strict=True))
    noise = Noise(
        **{name: float(size) for name, size in sizes.items() if not name.startswith("drift")},
        drift=tuple(float(size) for name, size in sizes.items() if name.startswith("drift")),
        source=f"{source} ({f'{dof:.0f}' if dof < ENDLESS else 'infinite'} degrees of freedom)",
        dof=dof,
        sizes=tuple(model.priors),
        log_covariance=tuple(tuple(row) for row in spread.tolist()),
        modes=tuple(tuple(mode.x.tolist()) for mode in modes),
    )
    return noise, y


def _condensed(columns: FloatArray) -> FloatArray:
    """Reduced columns B (n, r) with the same ``B B'``.

    Families overlap, and time grows with the square of their number.
    """
    if not columns.shape[1]:
        return columns
    energy, turn = np.linalg.eigh(columns.T @ columns)
    kept = energy > NEGLIGIBLE * max(energy[-1], 1e-300)
    return np.asarray(columns @ turn[:, kept], dtype=np.float64)


def saturated_mean_columns(data: Observations) -> tuple[list[FloatArray], str]:
    """Saturated mean columns of distance and throttle, and the label of the scatter about them.

    They are free means of distances and of (distance, throttle) cells, where distances were
    revisited often enough to estimate a visit's common error. Otherwise the model gives the
    differences between distances. Throttles are then free to differ from each other at a distance,
    smoothly where trials repeat too rarely for means.
    """
    _, distance = np.unique(data.z_hat, return_inverse=True)
    label, level = cells(data), np.eye(len(data.levels))[data.level]
    few = [x.max() + 1 <= min(data.n / REPEATED, MOST_MEANS) for x in (distance, label)]
    if len(np.unique(data.visit)) - len(np.unique(distance)) >= MIN_REVISITS and all(few):
        return [np.eye(x.max() + 1)[x] for x in (distance, label)], f"{REPEATS} about cell means"
    near = data.nearness
    shapes = np.cos(np.pi * np.outer(near / max(near.max(), 1e-300), np.arange(1, SHAPES + 1)))
    columns = (np.eye(distance.max() + 1)[distance] if few[1] else shapes)[:, :, None] * level[
        :, None, :
    ]
    columns = columns - columns.mean(axis=2, keepdims=True)
    return [columns.reshape(data.n, -1)], "scatter about the fitted model (too few revisits)"


def floor(data: Observations, noise: Noise, slope: FloatArray) -> float:
    """Root mean square over trials of the relative scatter that no model could remove."""
    return float(np.sqrt(np.mean(trial_covariance(data, noise, slope).sigma ** 2)))
