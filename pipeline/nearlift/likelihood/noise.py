"""How trials scatter: variance components of log lift, estimated once for each mean model by
penalised restricted maximum likelihood.

A trial's noise has a part within its record (known), one in proportion to lift and one of force;
the trials of a visit share an error of height, which acts through the slope of the curve, and
whatever else a stop may bring; and slow drift ties neighbours in time: four Ornstein-Uhlenbeck
processes that forget over fixed numbers of trials, so that only their sizes are unknown.

What the mean model may lack (structure) is no noise. It takes part as unknowns of a generous size,
so that neither hides in the other and nothing runs out of degrees of freedom. Every size has a weak
prior, half-t, maximised in its logarithm (see `PRIORS`): none is ever zero, and few visits do not
let one grow without bound. Trials that stand beyond `CLIP` standard deviations from all others are
pulled in to there. Sources: Patterson & Thompson 1971, Biometrika 58, 545 (restricted likelihood);
Gilmour, Thompson & Cullis 1995, Biometrics 51, 1440 (average information); Gelman 2006, Bayesian
Anal. 1, 515 (half-t priors on standard deviations).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.likelihood import semiseparable
from nearlift.likelihood.covariance import LEAST_VARIANCE, Covariance
from nearlift.likelihood.subspace import orthonormal
from nearlift.results import IntArray, Noise, Observations

#: Trials over which the drifts forget; a drift is looked for where a boundary has four times as
#: many.
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
#: What the source of noise says that repeats tell.
REPEATS = "scatter of repeats"
#: What a family of structure may amount to, as a fraction of lift; where trials scatter more about
#: the model, as much as that.
STRUCTURE = 0.01
CLIP = 3.5
#: A combination of unknowns with less than this part of the largest one's variance adds nothing but
#: rounding.
NEGLIGIBLE = 1e-13
#: A trial that keeps less than this part of its precision beside what is free cannot be foretold
#: from the rest.
DETERMINED = 1e-8
#: Smooth curves of distance; trials that a free mean must rest on, and the most means.
SHAPES, REPEATED, MOST_MEANS = 6, 3, 400
#: Revisits that tell what visits share beside distance, and visits that tell it from a drift.
ENOUGH = 20
#: Heights and short drifts are also looked for from so many times their usual size on.
FAR = 30.0
#: How often outliers are pulled in.
PASSES = 2
#: A step in the logarithm of a size that is a last one, before outliers are in place and after, and
#: the most of them.
ROUGH_STEP, LAST_STEP, MOST_STEPS = 0.1, 1e-6, 40


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
    own = (
        (data.u_lift_N / data.lift_N) ** 2
        + noise.relative**2
        + (noise.force_N / data.lift_N) ** 2
        + extra
    )
    return Covariance(
        variance=np.maximum(own, LEAST_VARIANCE),
        visit=data.visit,
        per_visit=noise.height_m * slope,
        shared=np.zeros((data.n, 0)) if shared is None else shared,
        common=noise.common,
        drift=np.array(noise.drift),
        age=ages(data)[:, : len(noise.drift)],
    )


def elapsed_trials(order: FloatArray) -> FloatArray:
    """Time since the first trial in units of the median spacing of trials, from start times or any
    other order (n,).
    """
    spacing = float(np.median(np.diff(np.sort(order)))) if len(order) > 1 else 0.0
    return (order - order.min()) / spacing if spacing > 0 else np.arange(len(order), dtype=float)


def ages(data: Observations) -> FloatArray:
    """When each trial was run, in units of the time over which each drift forgets, (n, drifts)."""
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
    return elapsed[:, None] / lengths


def cells(data: Observations) -> IntArray:
    """Index of each trial's (distance, throttle) cell."""
    cell: IntArray = np.unique(np.stack([data.z_hat, data.throttle]), axis=1, return_inverse=True)[
        1
    ].astype(np.int64)
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
    source: str = "trials beside every family and effect",
) -> tuple[Noise, FloatArray]:
    """Variance components, and the log lift with outliers pulled in.

    Parameters
    ----------
    data : Observations
        Trials in run order.
    log_lift : (n,)
        Log lift less the model's prediction.
    mean : (n, q)
        Levels and model Jacobian: what is free.
    structure : list of (n, k)
        What the model may lack, one entry for each family.
    slope : (n,)
        d log ratio / dz per metre, which carries a visit's height error.
    shared, extra
        What the budget declares, as in `trial_covariance`: scatter that it accounts for is not
        counted again.
    start : Noise or None
        Of nearly the same trials, about a model much like this one: where the search begins, which
        saves steps, if it has the same sizes.
    source : str
        What `Noise.source` is to say, before the degrees of freedom of a typical trial's variance.

    Returns
    -------
    Noise, (n,) array

    Raises
    ------
    NotConverged
        Variances of trials that no arithmetic can hold beside one another.
    """
    mean = orthonormal(mean)
    rms = float(np.sqrt(np.mean((log_lift - mean @ (mean.T @ log_lift)) ** 2)))
    generous = max(STRUCTURE, rms)
    unknown = [np.zeros((data.n, 0)) if shared is None else shared]
    unknown += [
        s * (generous * np.sqrt(data.n) / norm)
        for s in structure
        if (norm := float(np.linalg.norm(s))) > 0
    ]
    model = _Components.of(
        data, slope, np.hstack([mean, _condensed(np.hstack(unknown))]), mean.shape[1], extra
    )
    typical_N = float(np.median(data.lift_N))
    unit = np.array([typical_N if name == "force_N" else 1.0 for name in model.priors])
    if start is None or start.sizes != tuple(model.priors):
        # neighbours differ by their noise whatever the model lacks
        near = (
            float(np.median(np.abs(np.diff(log_lift - mean @ (mean.T @ log_lift)))))
            if data.n > 1
            else rms
        )
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
        x = min(
            (model.maximise(x, log_lift, ROUGH_STEP) for x in starts),
            key=lambda end: end[1].deviance,
        )[0]
    else:
        x = np.log(
            np.array(
                [
                    *(
                        getattr(start, name)
                        for name in model.priors
                        if not name.startswith("drift")
                    ),
                    *start.drift,
                ]
            )
            / unit
        )
    y = log_lift
    for last in (ROUGH_STEP,) * PASSES + (LAST_STEP,):
        x, found = model.maximise(x, y, last)
        if last == ROUGH_STEP:
            y = _pulled_in(y, found)
    sizes = np.exp(x)
    spread = np.linalg.inv(found.curvature)
    # of the variance of a trial like the others, of which its own record or a published standard
    # deviation tells a part
    parts = sizes**2 * np.stack(model.diagonals, axis=1)
    whole = model.own + parts.sum(axis=1)
    dof = float(np.median(whole**2 / (2 * np.einsum("ij,jk,ik->i", parts, spread, parts))))
    sizes = sizes * unit
    noise = Noise(
        **{
            name: float(size)
            for name, size in zip(model.priors, sizes, strict=True)
            if not name.startswith("drift")
        },
        drift=tuple(
            float(size)
            for name, size in zip(model.priors, sizes, strict=True)
            if name.startswith("drift")
        ),
        source=f"{source} ({dof:.0f} degrees of freedom)",
        dof=dof,
        sizes=tuple(model.priors),
        log_covariance=tuple(tuple(float(v) for v in row) for row in spread),
    )
    return noise, y


def _condensed(columns: FloatArray) -> FloatArray:
    """As few columns B (n, r) as have the same ``B B'``: families overlap, and time goes with the
    square of their number.
    """
    if not columns.shape[1]:
        return columns
    energy, turn = np.linalg.eigh(columns.T @ columns)
    kept = energy > NEGLIGIBLE * max(energy[-1], 1e-300)
    return np.asarray(columns @ turn[:, kept], dtype=np.float64)


def curves(data: Observations) -> tuple[list[FloatArray], str]:
    """What a model of distance and throttle may lack, and in words what trials scatter about beside
    it.

    Free means of distances and of (distance, throttle) cells, where distances were visited again
    often enough to tell what a visit's trials share. Else how far distances lie apart is left to
    the model, and throttles alone are free to differ from each other at a distance, smoothly where
    trials repeat too rarely for means.
    """
    _, distance = np.unique(data.z_hat, return_inverse=True)
    label, level = cells(data), np.eye(len(data.levels))[data.level]
    few = [x.max() + 1 <= min(data.n / REPEATED, MOST_MEANS) for x in (distance, label)]
    if len(np.unique(data.visit)) - len(np.unique(distance)) >= ENOUGH and all(few):
        return [np.eye(x.max() + 1)[x] for x in (distance, label)], f"{REPEATS} about cell means"
    near = np.where(np.isfinite(data.z_hat), 1 / np.maximum(data.z_hat, 1e-3), 0.0)
    shapes = np.cos(np.pi * np.outer(near / max(near.max(), 1e-300), np.arange(1, SHAPES + 1)))
    columns = (np.eye(distance.max() + 1)[distance] if few[1] else shapes)[:, :, None] * level[
        :, None, :
    ]
    columns = columns - columns.mean(axis=2, keepdims=True)
    return [columns.reshape(data.n, -1)], "scatter about the fitted model (too few revisits)"


@dataclass(frozen=True, slots=True, kw_only=True)
class _At:
    """The penalised restricted likelihood at given sizes.

    `weighed` is P y, and `precision` P's diagonal, infinite where the other trials do not say what
    a trial should be; (n,).
    """

    deviance: float
    gradient: FloatArray
    curvature: FloatArray
    weighed: FloatArray
    precision: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Components:
    """A covariance linear in the squares of its sizes: `own` + sum of size^2 times a diagonal, or
    times what trials pass on.

    `unknown` (n, q + k) are columns of the mean (q, free) and of structure (k, unit variance).
    """

    priors: dict[str, tuple[float, float]]
    own: FloatArray
    diagonals: list[FloatArray]
    amplitude: FloatArray
    memory: FloatArray
    order: IntArray
    unknown: FloatArray
    free: int

    @classmethod
    def of(
        cls,
        data: Observations,
        slope: FloatArray,
        unknown: FloatArray,
        free: int,
        extra: FloatArray | float,
    ) -> _Components:
        """The components that these trials can show."""
        priors = {name: PRIORS[name] for name in ("relative", "force_N")}
        per_visit, common, drifts = np.zeros(data.n), 0.0, 0
        if np.any(slope):
            priors["height_m"], per_visit = PRIORS["height_m"], slope
        if len(np.unique(data.visit)) < data.n:
            priors["common"], common = PRIORS["common"], 1.0
        if data.ordered and len(np.unique(data.visit)) >= ENOUGH:
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
        own = np.maximum((data.u_lift_N / data.lift_N) ** 2 + extra, LEAST_VARIANCE)
        # force in units of the median lift: no lift is too small for a square
        diagonals = [
            np.ones(data.n),
            (np.median(data.lift_N) / data.lift_N) ** 2,
            *(amplitude**2).T,
        ]
        return cls(
            priors=priors,
            own=own[order],
            diagonals=[diagonals[0], diagonals[1][order], *diagonals[2:]],
            amplitude=amplitude,
            memory=memory,
            order=order,
            unknown=np.ascontiguousarray(unknown[order]),
            free=free,
        )

    def at(self, x: FloatArray, y: FloatArray) -> _At:
        """Minus twice the log posterior of the sizes (up to a constant), its gradient and curvature
        in their logarithms; y in `order`.
        """
        size2 = np.exp(2 * x)
        variance = self.own + size2[0] * self.diagonals[0] + size2[1] * self.diagonals[1]
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
                f" {variance.max() / variance.min():.0e} and more: beside some, others count for"
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
        taken, weighed = np.ascontiguousarray(back[:, :-1]), back[:, -1]
        precision = semiseparable.near_inverse(*parts, np.zeros(len(d), dtype=np.int64))[:, 0]
        count = len(x)
        trace, acted = np.zeros(count), np.zeros((len(d), count))
        left = np.sum(taken**2, axis=1)
        for i in range(2):
            trace[i] = self.diagonals[i] @ (precision - left)
            acted[:, i] = self.diagonals[i] * weighed
        for i in range(2, count):
            one, memory = (
                np.ascontiguousarray(self.amplitude[:, i - 2 : i - 1]),
                np.ascontiguousarray(self.memory[:, i - 2 : i - 1]),
            )
            # the determinant's derivative by a step along the imaginary axis, which cancels nothing
            turned = amplitude.astype(complex)
            turned[:, i - 2] *= 1 + 1e-30j
            log_det_slope = (
                float(
                    np.log(
                        semiseparable.factor(
                            variance.astype(complex), turned, self.memory.astype(complex)
                        )[0]
                    )
                    .sum()
                    .imag
                )
                * 1e30
            )
            together = semiseparable.product(one, memory, back)
            trace[i] = log_det_slope / (2 * size2[i]) - float(np.vdot(together[:, :-1], taken))
            acted[:, i] = together[:, -1]
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
        return _At(
            deviance=value,
            gradient=gradient,
            curvature=0.5 * curvature,
            weighed=weighed,
            precision=left,
        )

    def maximise(self, x: FloatArray, y: FloatArray, last: float) -> tuple[FloatArray, _At]:
        """The likeliest sizes by average-information steps from `x` until one is smaller than
        `last`, y as the trials stand.
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


def _pulled_in(y: FloatArray, at: _At) -> FloatArray:
    """The data with trials that stand beyond `CLIP` standard deviations from what all others say of
    them moved to it.
    """
    root = np.sqrt(at.precision)
    z = at.weighed / root
    return y - (z - np.clip(z, -CLIP, CLIP)) / root


def floor(data: Observations, noise: Noise, slope: FloatArray) -> float:
    """Root mean square over trials of the relative scatter that no model could remove."""
    return float(np.sqrt(np.mean(trial_covariance(data, noise, slope).sigma ** 2)))
