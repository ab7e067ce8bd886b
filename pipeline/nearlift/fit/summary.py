"""A fit's entry in fit.json: estimates, goodness of fit, profiles, what would halve each
uncertainty, and the posterior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nearlift.campaign.choices import FitOptions
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import height_error, information, inputs
from nearlift.fit.density import Density, TruncatedPrior
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.fit.posterior import Table, sample
from nearlift.fit.profiles import likelihood_profiles
from nearlift.likelihood import noise
from nearlift.likelihood.level_curve import held_out_rms
from nearlift.results import Estimate, IntArray
from nearlift.results.fit import (
    DeclaredPrior,
    LevelFit,
    ModelFit,
    ParameterCovariance,
    PosteriorParameter,
    PosteriorSummary,
    level_name,
)

#: Degrees of freedom below which an uncertainty is flagged. Ours: u is then known to 30 %.
MIN_DOF = 5.0
#: Range of z_hat, ends excluded, of the trials in `r2_near`, of Carter, Bouchard and Quinn 2021.
NEAR_GROUND_Z_HAT = (1.0, 3.0)
#: Cumulative probabilities of a posterior's summary: the 90 % interval and the median.
SUMMARY_PROBABILITIES = (0.05, 0.5, 0.95)
#: Ratio of 90 % widths, posterior over prior, above which the data say nothing, and above which the
#: prior still matters. Ours, for normals: the data then weigh half as much as the prior,
#: and ten times.
PRIOR_ONLY_RATIO, PRIOR_SHAPED_RATIO = 0.8, 0.3
#: Fraction of the bounded range that counts as at a bound, and the least share of draws there to be
#: reported. Ours: four times what a flat density would leave there.
EDGE_SHARE, MIN_DRAWS_AT_EDGE = 0.005, 0.02


def summary(fit: LeastSquaresFit) -> ModelFit:
    """One model's entry, without its posterior."""
    data, problem = fit.problem.data, fit.problem
    unknown = len(fit.theta) + data.unknown_levels
    rmse, r2, r2_near = closeness(fit)
    levels = height = None
    if data.curve is not None:
        levels = LevelFit(
            curve=data.curve,
            coefficients=tuple(fit.level_coefficients.tolist()),
            covariance=tuple(tuple(row) for row in fit.level_covariance.tolist()),
            held_out=held_out_rms(data),
        )
    if problem.offset_m:
        standard = height_error.standard_m(height_error.common(fit.parts, data))
        u = height_error.u_m(problem, fit.theta, fit.slope, standard)
        height = Estimate(value=problem.offset_m, u=u, unit="m")
    return ModelFit(
        title=fit.model.title,
        parameters={
            name: replace(e, dof=float(dof), warning=_warning(float(dof)))
            for (name, e), dof in zip(fit.estimates.items(), fit.effective, strict=True)
        },
        covariance=ParameterCovariance.named(fit.names, fit.covariance),
        chi2=fit.chi2,
        dof=fit.dof,
        n_trials=data.n,
        rmse=rmse,
        r2=r2,
        r2_near=r2_near,
        log_likelihood=fit.log_likelihood,
        aic=2 * unknown - 2 * fit.log_likelihood,
        bic=unknown * float(np.log(data.n)) - 2 * fit.log_likelihood,
        L_inf_N=fit.levels,
        levels=levels,
        degeneracies=information.degeneracies(fit),
        excluded=fit.excluded,
        profiles={name: profile.ends for name, profile in likelihood_profiles(fit).items()},
        would_halve=information.halvings(fit),
        undeclared=inputs.undeclared(problem, fit.theta, fit.gain, fit.parts, fit.slope),
        height_error=height,
    )


def closeness(fit: LeastSquaresFit) -> tuple[float, float, float | None]:
    """Root mean square of residuals of log lift over trials; R² of cell means of Delta L.

    At the ground also R² of the cells in `NEAR_GROUND_Z_HAT`, nan where these are too few.
    """
    data = fit.problem.data
    log_ratio = replace(fit.problem, shift=0.0).log_ratio(fit.theta)
    log_lift = np.log(data.lift_N) - data.of_trials(fit.level_coefficients)
    measured, predicted, cell = np.exp(log_lift) - 1, np.exp(log_ratio) - 1, noise.cells(data)
    near = (data.z_hat > NEAR_GROUND_Z_HAT[0]) & (data.z_hat < NEAR_GROUND_Z_HAT[1])
    rmse = float(np.sqrt(np.mean((log_lift - log_ratio) ** 2)))
    close = None
    if data.boundary == "ground":
        close = _r2(measured[near], predicted[near], cell[near]) if near.any() else float("nan")
    return rmse, _r2(measured, predicted, cell), close


def _r2(measured: FloatArray, predicted: FloatArray, cell: IntArray) -> float:
    """Coefficient of determination of cell means, as papers quote it."""
    _, label = np.unique(cell, return_inverse=True)
    count = np.bincount(label)
    means, model = np.bincount(label, measured) / count, np.bincount(label, predicted) / count
    total = float(((means - means.mean()) ** 2).sum())
    return 1.0 - float(((means - model) ** 2).sum()) / total if total > 0 else float("nan")


def _warning(dof: float) -> str | None:
    """Warning for a coefficient whose uncertainty is itself hardly known."""
    if dof >= MIN_DOF:
        return None
    return (
        f"the uncertainty itself is known with {dof:.1f} degrees of freedom only: measure more"
        " visits"
    )


def add_posterior(
    fitted: LeastSquaresFit,
    entry: ModelFit,
    options: FitOptions,
    seed: int,
    data_sha256: str,
    *,
    base: bool,
    say: Callable[[str, float], None],
) -> tuple[ModelFit, list[Table], list[str]]:
    """Entry of fit.json with its posterior, the draws as rows, and notes.

    The draws of a base model are emcee's, those of L_inf among them; a rival's come from a grid. A
    rival whose posterior does not converge has none, with a note.

    Raises
    ------
    NotConverged
        A base model's posterior does not converge.
    """
    data, name = fitted.problem.data, fitted.model.name
    what = f"fit {data.boundary}: posterior of {name}"
    say(what, 0.5)
    dof = float(fitted.effective.min(initial=np.inf))
    density = Density(problem=fitted.problem, centre=fitted.theta, dof=dof)
    try:
        drawn = sample(
            density,
            seed,
            data.boundary,
            name,
            ess=options.ess,
            steps=options.steps,
            chain=base,
            progress=lambda steps: say(f"{what}, {steps} steps", 0.5),
        )
    except NotConverged as fault:
        if base:
            raise
        note = f"{data.boundary}: {name} has no posterior: {fault.what}; {fault.remedy}"
        return entry, [], [note]
    parameters, levels = {}, {}
    columns = {n: drawn.theta[:, :, i] for i, n in enumerate(drawn.names)}
    for i, (n, draws) in enumerate(columns.items()):
        mean, sd = drawn.exact.moments(i) if drawn.exact else (draws.mean(), draws.std())
        low, median, high = drawn.quantiles(i, SUMMARY_PROBABILITIES)
        prior = density.priors[i]
        ratio, words = compare_with_prior(prior, draws.ravel())
        before, parameter = prior.quantile([0.05, 0.95]).tolist(), prior.parameter
        parameters[n] = PosteriorParameter(
            value=mean,
            u=sd,
            median=median,
            lo90=low,
            hi90=high,
            unit=parameter.unit,
            ess=drawn.ess[i],
            ess_tail=drawn.ess_tail[i],
            tau=drawn.tau[i],
            prior=DeclaredPrior(
                text=str(parameter.prior), lo90=before[0], hi90=before[1], bounds=parameter.bounds
            ),
            width_ratio=ratio,
            words=words,
        )
    for throttle, draws in zip(
        data.levels.tolist(), np.moveaxis(drawn.levels_N, 2, 0), strict=True
    ):
        low, median, high = np.quantile(draws, SUMMARY_PROBABILITIES)
        levels[throttle] = Estimate(
            value=draws.mean(), u=draws.std(), median=median, lo90=low, hi90=high, unit="N"
        )
        if base:
            columns[level_name(throttle)] = draws
    summary = PosteriorSummary(
        model=name,
        data_sha256=data_sha256,
        sampler=drawn.sampler,
        chains=drawn.log_prob.shape[0],
        draws=drawn.log_prob.shape[1],
        ess=min(drawn.ess, default=None),
        tau=max(drawn.tau, default=None),
        acceptance=drawn.acceptance,
        steps=drawn.steps,
        noise_dof=density.dof,
        checks=drawn.checks,
        parameters=parameters,
        L_inf_N=levels,
    )
    evidence = Estimate(value=drawn.log_evidence, u=drawn.u_log_evidence)
    rows = [drawn.rows(data.boundary, name, n, x) for n, x in columns.items()]
    return replace(entry, log_evidence=evidence, posterior=summary), rows, []


def compare_with_prior(prior: TruncatedPrior, draws: FloatArray) -> tuple[float, str]:
    """Ratio of 90 % widths, draws (n,) over prior, with remarks where prior or bounds matter."""
    parameter, name = prior.parameter, prior.parameter.name
    low, high = parameter.bounds
    ratio = float(np.ptp(np.quantile(draws, [0.05, 0.95]))) / prior.width90
    edge, words = EDGE_SHARE * (high - low), []
    if ratio > PRIOR_ONLY_RATIO:
        words.append(
            f"the data say nothing about {name}: its interval is the prior's"
            f" ({parameter.prior}), not a result"
        )
    elif ratio > PRIOR_SHAPED_RATIO:
        words.append(
            f"the prior still shapes {name}: the data left {100 * ratio:.0f} % of its width"
            f" ({parameter.prior})"
        )
    for near, bound in ((draws < low + edge, low), (draws > high - edge, high)):
        if (share := float(near.mean())) > MIN_DRAWS_AT_EDGE:
            words.append(
                f"{100 * share:.0f} % of the posterior of {name} lies against its bound {bound:g}"
            )
    return ratio, "; ".join(words)
