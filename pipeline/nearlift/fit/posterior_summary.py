"""Posterior of one model: sampled, kept as rows, and summarised."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import posterior
from nearlift.fit.density import Density
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.fit.posterior import Posterior, Settings
from nearlift.fit.prior import compare_with_fit, compare_with_prior
from nearlift.results.estimate import Estimate
from nearlift.results.fit import ModelFit
from nearlift.results.posterior import (
    PosteriorParameter,
    PosteriorSummary,
    level_name,
)

Table = dict[str, NDArray[Any]]


def add_posterior(
    fitted: LeastSquaresFit,
    entry: ModelFit,
    settings: Settings,
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
    boundary, name = fitted.problem.data.boundary, fitted.model.name
    what = f"fit {boundary}: posterior of {name}"

    def count(steps: int) -> None:
        say(f"{what}, {steps} steps", 0.5)

    say(what, 0.5)
    try:
        density = Density(problem=fitted.problem, centre=fitted.theta, dof=fitted.dof_of_all)
        drawn = posterior.sample(
            density, settings, seed, boundary, name, chain=base, progress=count
        )
    except NotConverged as fault:
        if base:
            raise
        note = f"{boundary}: {name} has no posterior: {fault.what}; {fault.remedy}"
        return entry, [], [note]
    columns = {n: drawn.theta[:, :, i] for i, n in enumerate(drawn.names)}
    if base:
        throttles = enumerate(fitted.problem.data.levels)
        columns |= {level_name(t): drawn.levels_N[:, :, i] for i, t in throttles}
    rows = [draw_rows(boundary, name, n, values, drawn.log_prob) for n, values in columns.items()]
    summary = _summary(density, drawn, fitted, data_sha256)
    evidence = Estimate(value=drawn.log_evidence, u=drawn.u_log_evidence)
    unlike = [p.unlike_fit for p in summary.parameters.values() if base and p.unlike_fit]
    entry = replace(entry, log_evidence=evidence, posterior=summary)
    return entry, rows, [f"{boundary}: {text}" for text in unlike]


def draw_rows(
    boundary: str, model: str, name: str, values: FloatArray, log_prob: FloatArray
) -> Table:
    """Rows of a table of draws for one parameter; `values` and `log_prob` are (chains, draws)."""
    chains, draws = values.shape
    n = values.size
    return {
        "boundary": np.full(n, boundary, dtype=object),
        "model": np.full(n, model, dtype=object),
        "chain": np.repeat(np.arange(chains), draws),
        "draw": np.tile(np.arange(draws), chains),
        "parameter": np.full(n, name, dtype=object),
        "value": values.ravel(),
        "log_prob": log_prob.ravel(),
    }


QUANTILES = np.array([0.05, 0.5, 0.95])
Moments = tuple[float, float, FloatArray]


def _moments(draws: FloatArray) -> Moments:
    """Mean, standard deviation and `QUANTILES`."""
    return draws.mean(), draws.std(), np.quantile(draws, QUANTILES)


def _marginal(drawn: Posterior, i: int) -> Moments:
    """One parameter's moments, by the grid, which has no Monte Carlo error; else by the draws."""
    if drawn.exact:
        return *drawn.exact.moments(i), drawn.exact.quantiles(i, QUANTILES)
    return _moments(drawn.theta[:, :, i].ravel())


def _parameter(
    density: Density, drawn: Posterior, fitted: LeastSquaresFit, i: int
) -> PosteriorParameter:
    prior, draws = density.prior.each[i], drawn.theta[:, :, i].ravel()
    parameter = prior.parameter
    change, estimate = compare_with_prior(prior, draws), fitted.estimates[parameter.name]
    over_fit, why = compare_with_fit(prior, draws, estimate.lo90, estimate.hi90)
    mean, sd, (low, median, high) = _marginal(drawn, i)
    # without degrees of freedom the draws know only what trials of one visit do not share
    ends = (low, high) if fitted.effective[i] else (-math.inf, math.inf)
    return PosteriorParameter(
        value=mean,
        u=sd,
        median=median,
        lo90=ends[0],
        hi90=ends[1],
        unit=parameter.unit,
        ess=drawn.ess[i],
        ess_tail=drawn.ess_tail[i],
        tau=drawn.tau[i],
        prior=change.prior,
        width_ratio=change.ratio,
        at_low=change.at_low,
        at_high=change.at_high,
        width_over_fit=over_fit,
        words="; ".join(filter(None, (change.words, why))),
        unlike_fit=why,
    )


def _level(draws: FloatArray) -> Estimate:
    mean, sd, (low, median, high) = _moments(draws.ravel())
    return Estimate(value=mean, u=sd, median=median, lo90=low, hi90=high, unit="N")


def _summary(
    density: Density, drawn: Posterior, fitted: LeastSquaresFit, data: str
) -> PosteriorSummary:
    return PosteriorSummary(
        model=fitted.model.name,
        data_sha256=data,
        sampler=drawn.sampler,
        chains=drawn.log_prob.shape[0],
        draws=drawn.log_prob.shape[1],
        ess=drawn.ess.min() if len(drawn.ess) else None,
        tau=drawn.tau.max() if len(drawn.tau) else None,
        acceptance=drawn.acceptance,
        steps=drawn.steps,
        noise_dof=density.dof,
        checks=drawn.checks,
        parameters={n: _parameter(density, drawn, fitted, i) for i, n in enumerate(drawn.names)},
        L_inf_N={
            t: _level(drawn.levels_N[:, :, i]) for i, t in enumerate(fitted.problem.data.levels)
        },
    )
