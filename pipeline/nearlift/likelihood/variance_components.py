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
from nearlift.results import IntArray, Observations

#: Correlation lengths of the drifts, in trials, a factor of four apart. A drift is estimated if a
#: boundary has four times as many trials (docs/decisions.md#one-noise-likelihood).
DRIFT_LENGTHS = (1.5, 6.0, 24.0, 96.0)
#: Scale and degrees of freedom of the half-t prior on each size: a fraction of lift, of the median
#: lift, metres, a fraction of lift. Converters and propellers repeat to half a percent, screw
#: traverses to a tenth of a millimetre. What else a stop brings (a settling flow, a cable) is
#: likelier than a drift that fades within a stop and passes for it; the slow drifts of a bench's
#: gain stay below a part in a thousand. A size far above its scale is pulled down as if so many
#: more visits had shown none of it: that counts where visits are few, so `common` has a quarter.
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
    """The penalised restricted likelihood at given sizes.

    `weighed` is P y, and `precision` P's diagonal, infinite where the other trials do not say what
    a trial should be; (n,).
    """

    deviance: float
    gradient: FloatArray
    curvature: FloatArray
    weighed: FloatArray
    precision: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Mode:
    """Likeliest sizes `x`, as logarithms, and the posterior's share around them."""

    x: FloatArray
    at: SizesAt
    weight: float


@dataclass(frozen=True, kw_only=True)
class VarianceComponents:
    """A covariance linear in the squares of its sizes: `known_variance` + sum of size^2 times a
    diagonal, or times what trials pass on.

    `unknown` (n, q + k) are columns of the mean (q, free) and of structure (k, unit variance).
    """

    priors: dict[str, tuple[float, float]]
    known_variance: FloatArray
    diagonals: list[FloatArray]
    amplitude: FloatArray
    memory: FloatArray
    order: IntArray
    unknown: FloatArray
    free: int

    @classmethod
    def from_trials(
        cls,
        data: Observations,
        slope: FloatArray,
        unknown: FloatArray,
        free: int,
        extra: FloatArray | float,
    ) -> VarianceComponents:
        """The components that these trials can show."""
        priors = {name: PRIORS[name] for name in ("relative", "force_N")}
        per_visit, common, drifts = np.zeros(data.n), 0.0, 0
        if np.any(slope):
            priors["height_m"], per_visit = PRIORS["height_m"], slope
        if len(np.unique(data.visit)) < data.n:
            priors["common"], common = PRIORS["common"], 1.0
        if data.ordered and len(np.unique(data.visit)) >= MIN_REVISITS:
            drifts = sum(length <= data.n / 4 for length in DRIFT_LENGTHS)
            priors |= {f"drift{k}": DRIFT_PRIORS[k] for k in range(drifts)}
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
        amplitude, memory = whole.processes
        order = whole.order
        known_variance = np.maximum((data.u_lift_N / data.lift_N) ** 2 + extra, LEAST_VARIANCE)
        # in units of the median lift: no lift is too small for a square
        force = (np.median(data.lift_N) / data.lift_N) ** 2
        return cls(
            priors=priors,
            known_variance=known_variance[order],
            diagonals=[np.ones(data.n), force[order], *(amplitude**2).T],
            amplitude=amplitude,
            memory=memory,
            order=order,
            unknown=np.ascontiguousarray(unknown[order]),
            free=free,
        )

    def at(self, x: FloatArray, y: FloatArray) -> SizesAt:
        """Minus twice the log posterior of the sizes (up to a constant), its gradient and curvature
        in their logarithms; y in `order`.
        """
        size2 = np.exp(2 * x)
        variance = self.known_variance + size2[0] * self.diagonals[0] + size2[1] * self.diagonals[1]
        amplitude = np.ascontiguousarray(self.amplitude * np.sqrt(size2[2:]))
        d, w = semiseparable.factor(variance, amplitude, self.memory)
        parts = (d, w, amplitude, self.memory)
        both = semiseparable.forward(
            *parts, np.ascontiguousarray(np.column_stack([self.unknown, y]))
        )
        white, y_white = np.ascontiguousarray(both[:, :-1]), both[:, -1]
        information = white.T @ white
        information[
            np.arange(self.free, len(information)), np.arange(self.free, len(information))
        ] += 1.0
        try:
            triangle = np.linalg.cholesky(information)
        except np.linalg.LinAlgError as fault:
            what = (
                "the variances of trials differ by a factor of"
                f" {variance.max() / variance.min():.0e} and more: some trials count for"
                " nothing"
            )
            raise NotConverged(
                "noise floor",
                what,
                "look for lifts in another unit, near zero, or with a wrong standard error",
            ) from fault
        from scipy.linalg import solve_triangular

        explained = solve_triangular(triangle, white.T @ y_white, lower=True, check_finite=False)
        value = float(
            np.log(d).sum()
            + 2 * np.log(np.diag(triangle)).sum()
            + y_white @ y_white
            - explained @ explained
        )
        scale2, nu = (
            np.array(v) for v in zip(*((s**2, nu) for s, nu in self.priors.values()), strict=True)
        )
        share = size2 / (nu * scale2 + size2)
        value += float(np.sum((nu + 1) * np.log1p(size2 / (nu * scale2)) - 2 * x))
        u = solve_triangular(triangle, white.T, lower=True, check_finite=False)
        weighed_white = y_white - explained @ u
        back = semiseparable.backward(
            *parts, np.ascontiguousarray(np.column_stack([u.T, weighed_white]))
        )
        taken, weighed = np.ascontiguousarray(back[:, :-1]), np.ascontiguousarray(back[:, -1])
        precision, log_det_slopes = semiseparable.log_det_slopes(*parts)
        count = len(x)
        left = np.sum(taken**2, axis=1)
        trace = np.empty(count)
        trace[:2] = [diagonal @ (precision - left) for diagonal in self.diagonals[:2]]
        trace[2:] = log_det_slopes / (2 * size2[2:]) - semiseparable.squares(
            self.amplitude, self.memory, taken
        )
        acted = np.empty((len(d), count))
        for i in range(2):
            acted[:, i] = self.diagonals[i] * weighed
        for i in range(2, count):
            one, memory = (
                np.ascontiguousarray(each[:, i - 2 : i - 1])
                for each in (self.amplitude, self.memory)
            )
            acted[:, i] = semiseparable.product(one, memory, weighed[:, None])[:, 0]
        quadratic = weighed @ acted
        of_acted = semiseparable.forward(*parts, np.ascontiguousarray(acted))
        along = u @ of_acted
        average = 0.5 * (of_acted.T @ of_acted - along.T @ along)
        slope = size2 * (trace - quadratic)
        # twice: by the logarithm of a size, of minus twice the logarithm
        gradient = 2 * slope + 2 * ((nu + 1) * share - 1)
        curvature = 2 * (4 * np.outer(size2, size2) * average)
        prior = 4 * (nu + 1) * share * (1 - share)
        # below its likeliest size the likelihood is flat, and above it as steep as its gradient
        # says
        curvature[np.diag_indices(count)] += prior + 2 * np.maximum(2 * slope, 0)
        left = np.where(precision - left > DETERMINED * precision, precision - left, np.inf)
        return SizesAt(
            deviance=value,
            gradient=gradient,
            curvature=0.5 * curvature,
            weighed=weighed,
            precision=left,
        )

    def maximise(self, x: FloatArray, y: FloatArray, last: float) -> tuple[FloatArray, SizesAt]:
        """Most probable sizes for the data `y`, by average-information steps from `x` until one is
        smaller than `last`.
        """
        y = y[self.order]
        here = self.at(x, y)
        for _ in range(MOST_STEPS):
            step = -np.linalg.solve(here.curvature, here.gradient) / 2
            step *= min(1.0, 2.0 / np.abs(step).max())
            for _ in range(12):
                there = self.at(x + step, y)
                if there.deviance <= here.deviance + 1e-9 * abs(here.deviance):
                    break
                step = step / 2
            x, here = x + step, there
            if np.abs(step).max() < last:
                break
        back = np.argsort(self.order)
        return x, replace(here, weighed=here.weighed[back], precision=here.precision[back])

    def modes(
        self, starts: list[FloatArray], y: FloatArray, last: float, beyond: float = np.inf
    ) -> list[Mode]:
        """The modes that the search from each of `starts` finds, the likeliest first, weighed by
        Laplace's approximation; none whose deviance exceeds the least by `beyond`.
        """
        ends = sorted((self.maximise(x, y, last) for x in starts), key=lambda end: end[1].deviance)
        kept = ends[:1]
        for x, at in ends[1:]:
            other = all((x - z) @ known.curvature @ (x - z) > 1 for z, known in kept)
            if other and at.deviance - ends[0][1].deviance < beyond:
                kept.append((x, at))
        mass = np.array([-at.deviance - np.linalg.slogdet(at.curvature)[1] for _, at in kept]) / 2
        weight = np.exp(mass - mass.max())
        return [
            Mode(x=x, at=at, weight=float(w))
            for (x, at), w in zip(kept, weight / weight.sum(), strict=True)
        ]


def winsorise(y: FloatArray, at: SizesAt) -> FloatArray:
    """The data, with trials beyond `CLIP` standard deviations from their prediction by all others
    moved to that limit.
    """
    root = np.sqrt(at.precision)
    z = at.weighed / root
    return y - (z - np.clip(z, -CLIP, CLIP)) / root
