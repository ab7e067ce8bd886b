"""Posterior of one model: sampled, kept as rows, and summarised."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.campaign.choices import FitOptions
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import posterior
from nearlift.fit.density import Density, TruncatedPrior
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.results.estimate import Estimate
from nearlift.results.fit import (
    DeclaredPrior,
    ModelFit,
    PosteriorParameter,
    PosteriorSummary,
    level_name,
)

Table = dict[str, NDArray[Any]]
QUANTILES = (0.05, 0.5, 0.95)
#: Ratio of 90 % widths, posterior over prior, above which the data say nothing, and above which the
#: prior still matters. Ours, for normals: the data then weigh half as much as the prior,
#: and ten times.
SAME, SHAPED = 0.8, 0.3
#: Fraction of the bounded range that counts as at a bound, and the least share of draws there to be
#: reported. Ours: four times what a flat density would leave there.
EDGE, CROWD = 0.005, 0.02


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
    density = Density(problem=fitted.problem, centre=fitted.theta, dof=fitted.dof_of_all)
    try:
        drawn = posterior.sample(
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
        low, median, high = drawn.quantiles(i, QUANTILES)
        prior = density.priors[i]
        ratio, words = compare_with_prior(prior, draws.ravel())
        before, parameter = prior.quantile([0.05, 0.95]).tolist(), prior.parameter
        # without degrees of freedom the draws know only what trials of one visit do not share
        known = bool(fitted.effective[i])
        parameters[n] = PosteriorParameter(
            value=mean,
            u=sd,
            median=median,
            lo90=low if known else -math.inf,
            hi90=high if known else math.inf,
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
        low, median, high = np.quantile(draws, QUANTILES)
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
    rows = [draw_rows(data.boundary, name, n, x, drawn.log_prob) for n, x in columns.items()]
    return replace(entry, log_evidence=evidence, posterior=summary), rows, []


def draw_rows(
    boundary: str, model: str, name: str, values: FloatArray, log_prob: FloatArray
) -> Table:
    """Rows of a table of draws for one parameter; `values` and `log_prob` are (chains, draws)."""
    chain, draw = np.indices(values.shape)
    labels = {"boundary": boundary, "model": model, "parameter": name}
    return {k: np.full(values.size, label, dtype=object) for k, label in labels.items()} | {
        "chain": chain.ravel(),
        "draw": draw.ravel(),
        "value": values.ravel(),
        "log_prob": log_prob.ravel(),
    }


def compare_with_prior(prior: TruncatedPrior, draws: FloatArray) -> tuple[float, str]:
    """Ratio of 90 % widths, draws (n,) over prior, with remarks where prior or bounds matter."""
    parameter, name = prior.parameter, prior.parameter.name
    low, high = parameter.bounds
    ratio = float(np.ptp(np.quantile(draws, [0.05, 0.95]))) / prior.width90
    edge, words = EDGE * (high - low), []
    if ratio > SAME:
        words.append(
            f"the data say nothing about {name}: its interval is the prior's"
            f" ({parameter.prior}), not a result"
        )
    elif ratio > SHAPED:
        words.append(
            f"the prior still shapes {name}: the data left {100 * ratio:.0f} % of its width"
            f" ({parameter.prior})"
        )
    for near, bound in ((draws < low + edge, low), (draws > high - edge, high)):
        if (share := float(near.mean())) > CROWD:
            words.append(
                f"{100 * share:.0f} % of the posterior of {name} lies against its bound {bound:g}"
            )
    return ratio, "; ".join(words)
