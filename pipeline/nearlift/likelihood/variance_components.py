"""The penalised restricted likelihood of a covariance that is linear in the squares of its sizes,
with its gradient and average information in their logarithms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.likelihood import semiseparable
from nearlift.likelihood.covariance import LEAST_VARIANCE, Covariance
from nearlift.results import Observations

#: Correlation lengths of the drifts, in trials, a factor of four apart. A drift is estimated if a
#: boundary has four times as many trials (docs/decisions.md#one-noise-likelihood).
DRIFT_LENGTHS = (1.5, 6.0, 24.0, 96.0)
#: Scale and degrees of freedom of the half-t prior on each size: a fraction of lift, of the median
#: lift, metres, a fraction of lift. Converters and propellers repeat to half a percent, screw
#: traverses to a tenth of a millimetre. What else a stop brings (a settling flow, a cable) is
#: likelier than a drift that fades within a stop and passes for it; the slow drifts of a bench's
#: gain stay below a part in a thousand. A size far above its scale is pulled down as if so many
#: more visits had shown none of it. That matters where visits are few, so `common` has a quarter
#: (docs/decisions.md#one-noise-likelihood).
PRIORS = {
    "relative": (5e-3, 1.0),
    "force_N": (2e-3, 1.0),
    "height_m": (1e-4, 2.0),
    "common": (2e-3, 0.25),
}
DRIFT_PRIORS = ((2e-4, 2.0), (2e-4, 2.0), (6e-4, 1.0), (6e-4, 1.0))
#: Standard deviations beyond which a trial is winsorised (docs/decisions.md#one-noise-likelihood).
CLIP = 3.5
#: Share of its precision, after projecting out the free columns, below which a trial cannot be
#: predicted from the rest: the square root of the floating-point precision, 1.5e-8.
DETERMINED = 1e-8
#: Maximum number of average-information steps. Ours: it ends a search along a flat ridge.
MOST_STEPS = 40
#: Deviance above the least up to which a mode is averaged: below exp(-9/2) = 1 % of the weight
#: (docs/decisions.md#one-noise-likelihood).
MODE_DEVIANCE = 9.0
#: Fewest revisits of distances that estimate a visit's common error, and fewest visits that
#: distinguish it from a drift. Ours: their root mean square is then known to 16 %.
MIN_REVISITS = 20


def elapsed_trials(order: FloatArray) -> FloatArray:
    """Time since the first trial in units of the median spacing of trials, from start times or any
    other order (n,).
    """
    spacing = float(np.median(np.diff(np.sort(order)))) if len(order) > 1 else 0.0
    return (order - order.min()) / spacing if spacing > 0 else np.arange(len(order), dtype=float)


def ages(data: Observations) -> FloatArray:
    """Time of each trial in units of each drift's correlation length, (n, drifts)."""
    known = data.covariates
    if "elapsed_trials" in known:
        # of the whole campaign, where these trials are a part of it
        elapsed = known["elapsed_trials"]
    else:
        start = known.get("start_s", np.full(data.n, np.nan))
        elapsed = elapsed_trials(
            start if np.isfinite(start).all() else np.arange(data.n, dtype=float)
        )
    lengths: FloatArray = np.array(DRIFT_LENGTHS)
    return np.asarray(elapsed[:, None] / lengths, dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class SizesAt:
    """The penalised restricted likelihood at the sizes whose logarithms are `x`.

    `weighed` is P y, and `precision` P's diagonal, infinite where the other trials do not say what
    a trial should be; (n,).
    """

    x: FloatArray
    deviance: float
    gradient: FloatArray
    curvature: FloatArray
    weighed: FloatArray
    precision: FloatArray


class VarianceComponents:
    """The components of covariance that trials can show: known variance + sum of size^2 times a
    diagonal, or times what trials pass on.

    Parameters
    ----------
    slope : (n,)
        d log ratio / dz, which carries a visit's height error.
    unknown : (n, q + k)
        Columns of the mean (q, free) and of structure (k, unit variance).
    free : int
        q.
    extra : (n,)
        Variance stated besides that within records.

    Attributes
    ----------
    priors : dict of (float, float)
        Scale and degrees of freedom of each size's prior.
    diagonals : (n, sizes)
        Variance of each trial by a component of unit size.
    """

    def __init__(
        self,
        data: Observations,
        slope: FloatArray,
        unknown: FloatArray,
        free: int,
        extra: FloatArray | float,
    ) -> None:
        self.priors = {name: PRIORS[name] for name in ("relative", "force_N")}
        per_visit, common, drifts, visits = np.zeros(data.n), 0.0, 0, len(np.unique(data.visit))
        if np.any(slope):
            self.priors["height_m"], per_visit = PRIORS["height_m"], slope
        if visits < data.n:
            self.priors["common"], common = PRIORS["common"], 1.0
        if data.ordered and visits >= MIN_REVISITS:
            drifts = sum(length <= data.n / 4 for length in DRIFT_LENGTHS)
            self.priors |= {f"drift{k}": DRIFT_PRIORS[k] for k in range(drifts)}
        # of unit sizes: what there is of the rest is set by the sizes
        whole = Covariance(
            variance=np.ones(data.n),
            visit=data.visit,
            per_visit=per_visit,
            shared=np.zeros((data.n, 0)),
            common=common,
            drift=np.ones(drifts),
            age=ages(data)[:, :drifts],
        )
        (self.amplitude, self.memory), self.order = whole.processes, whole.order
        known = np.maximum((data.u_lift_N / data.lift_N) ** 2 + extra, LEAST_VARIANCE)
        # in units of the median lift: no lift is too small for a square
        force = (np.median(data.lift_N) / data.lift_N) ** 2
        self.known_variance = known[self.order]
        self.diagonals = np.column_stack([np.ones(data.n), force[self.order], self.amplitude**2])
        self.unknown, self.free = np.ascontiguousarray(unknown[self.order]), free
        scale, self.prior_dof = np.array(list(self.priors.values())).T
        self.prior_scale2 = self.prior_dof * scale**2

    def at(self, x: FloatArray, y: FloatArray) -> SizesAt:
        """Minus twice the log posterior of the sizes (up to a constant), its gradient and curvature
        in their logarithms; y in `order`.

        Raises
        ------
        NotConverged
            The trials' variances are too different in size for floating-point arithmetic.
        """
        from scipy.linalg import solve_triangular

        size2, nu = np.exp(2 * x), self.prior_dof
        variance = self.known_variance + self.diagonals[:, :2] @ size2[:2]
        amplitude = np.ascontiguousarray(self.amplitude * np.sqrt(size2[2:]))
        d, w = semiseparable.factor(variance, amplitude, self.memory)
        parts = (d, w, amplitude, self.memory)
        white = semiseparable.forward(*parts, self.unknown)
        y_white = semiseparable.forward(*parts, y[:, None])[:, 0]
        information = white.T @ white
        information += np.diag(np.arange(len(information)) >= self.free)
        try:
            triangle = np.linalg.cholesky(information)
        except np.linalg.LinAlgError as fault:
            raise NotConverged(
                "noise floor",
                "the variances of trials differ by a factor of"
                f" {variance.max() / variance.min():.0e} and more: some trials count for nothing",
                "look for lifts in another unit, near zero, or with a wrong standard error",
            ) from fault
        # overwrites `white`: arrays of n x (q + k) set the peak of a fit's memory
        u = solve_triangular(triangle, white.T, lower=True, overwrite_b=True, check_finite=False)
        explained = u @ y_white
        value = float(
            np.log(d).sum()
            + 2 * np.log(np.diag(triangle)).sum()
            + y_white @ y_white
            - explained @ explained
            + np.sum((nu + 1) * np.log1p(size2 / self.prior_scale2) - 2 * x)
        )
        weighed = semiseparable.backward(*parts, (y_white - explained @ u)[:, None])[:, 0]
        precision, log_det_slopes = semiseparable.log_det_slopes(*parts)
        taken = semiseparable.backward(*parts, u.T)
        squares = semiseparable.squares(self.amplitude, self.memory, taken)
        left = precision - np.sum(np.square(taken, out=taken), axis=1)
        trace = np.r_[left @ self.diagonals[:, :2], log_det_slopes / (2 * size2[2:]) - squares]
        acted = self.diagonals * weighed[:, None]
        for i in range(len(size2) - 2):
            one = [np.ascontiguousarray(a[:, i : i + 1]) for a in (self.amplitude, self.memory)]
            acted[:, i + 2] = semiseparable.product(*one, weighed[:, None])[:, 0]
        of_acted = semiseparable.forward(*parts, acted)
        along = u @ of_acted
        slope = size2 * (trace - weighed @ acted)
        share = size2 / (self.prior_scale2 + size2)
        curvature = 2 * np.outer(size2, size2) * (of_acted.T @ of_acted - along.T @ along)
        # below its likeliest size the likelihood is flat, and above it as steep as its gradient
        # says
        curvature += np.diag(2 * (nu + 1) * share * (1 - share) + np.maximum(2 * slope, 0))
        return SizesAt(
            x=x,
            deviance=value,
            # twice: by the logarithm of a size, of minus twice the logarithm
            gradient=2 * slope + 2 * ((nu + 1) * share - 1),
            curvature=curvature,
            weighed=weighed,
            precision=np.where(left > DETERMINED * precision, left, np.inf),
        )

    def maximise(self, x: FloatArray, y: FloatArray, last: float) -> SizesAt:
        """Most probable sizes for the data `y`, by average-information steps from `x` until one is
        smaller than `last`.
        """
        y = y[self.order]
        here = self.at(x, y)
        for _ in range(MOST_STEPS):
            step = -np.linalg.solve(here.curvature, here.gradient) / 2
            step *= min(1.0, 2.0 / np.abs(step).max())
            for _ in range(12):
                there = self.at(here.x + step, y)
                if there.deviance <= here.deviance + 1e-9 * abs(here.deviance):
                    break
                step = step / 2
            here = there
            if np.abs(step).max() < last:
                break
        back = np.argsort(self.order)
        return replace(here, weighed=here.weighed[back], precision=here.precision[back])

    def modes(
        self, starts: list[FloatArray], y: FloatArray, last: float, beyond: float = np.inf
    ) -> tuple[list[SizesAt], FloatArray]:
        """The modes that the search from each of `starts` finds, the likeliest first, and their
        weights by Laplace's approximation. Modes whose deviance exceeds the least by `beyond` are
        left out.
        """
        ends = sorted((self.maximise(x, y, last) for x in starts), key=lambda end: end.deviance)
        kept = ends[:1]
        for end in ends[1:]:
            off = [end.x - known.x for known in kept]
            other = all(z @ known.curvature @ z > 1 for z, known in zip(off, kept, strict=True))
            if other and end.deviance - ends[0].deviance < beyond:
                kept.append(end)
        mass = -np.array([m.deviance + np.linalg.slogdet(m.curvature)[1] for m in kept]) / 2
        weight = np.exp(mass - mass.max())
        return kept, weight / weight.sum()


def winsorise(y: FloatArray, at: SizesAt) -> FloatArray:
    """The data, with trials beyond `CLIP` standard deviations from their prediction by all others
    moved to that limit.
    """
    root = np.sqrt(at.precision)
    z = at.weighed / root
    return y - (z - np.clip(z, -CLIP, CLIP)) / root
