"""Lift models that suit each boundary, fitted by least squares, and their posteriors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.campaign.manifest import Campaign
from nearlift.declare import FloatArray, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit import (
    collapse,
    deletion,
    held_quantity,
    influence,
    information,
    inputs,
    profiles,
    rotor,
)
from nearlift.fit.base_result import base_result
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.fit.posterior import Settings
from nearlift.fit.posterior_summary import add_posterior
from nearlift.fit.profiles import Profile
from nearlift.fit.summary import summary
from nearlift.likelihood import budget, student
from nearlift.likelihood.noise import REPEATS
from nearlift.likelihood.problem import height_slope
from nearlift.results import Noise, Observations
from nearlift.results.assumptions import HeldQuantity, RotorCoefficient, ThrottleCollapse
from nearlift.results.fit import Influence, ModelComparison, ModelFit
from nearlift.results.quotation import BoundaryResult

Table = dict[str, NDArray[Any]]
Say = Callable[[str, float], None]
#: A chi² that would be exceeded in all but so small a share of campaigns says that the declared
#: errors are not there.
SURELY_LESS = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryFits:
    """Base and rival models fitted to one boundary.

    Attributes
    ----------
    fits : mapping of str to ModelFit
        By model, the base first.
    failed : mapping of str to str
        Reason for which a rival was not fitted.
    quoted : BoundaryResult
        The base fit's coefficients, not diagnosed.
    profiles, draws : list of Table
        Rows of profiles.parquet and posterior.parquet.
    """

    base: str
    noise: Noise
    fits: Mapping[str, ModelFit]
    failed: Mapping[str, str]
    comparison: ModelComparison
    throttle_collapse: ThrottleCollapse
    held_quantity: HeldQuantity | None
    rotor_coefficient: RotorCoefficient
    influence: Influence
    quoted: BoundaryResult
    profiles: list[Table]
    draws: list[Table]
    notes: list[str]


def fit_boundary(
    data: Observations,
    models: Sequence[LiftModel],
    campaign: Campaign,
    seed: int,
    data_sha256: str,
    *,
    outlying: Collection[str] = (),
    say: Mapping[str, Say],
) -> BoundaryFits:
    """Fit the base model, which comes first, and its rivals; a rival that fails is noted.

    Parameters
    ----------
    data_sha256 : str
        Digest of trials.parquet, for the posterior's provenance.
    outlying : collection of str
        Trials that their repeats contradict.
    say : mapping of str to callable
        Hears what is being done, and the share that is done, of each model.

    Raises
    ------
    NotConverged
        The base model fails.
    """
    boundary, base = data.boundary, models[0]
    settings = Settings(ess=campaign.fit.ess, steps=campaign.fit.steps)
    parts = budget.components(campaign)

    def fitted(
        model: LiftModel, result: LeastSquaresFit
    ) -> tuple[ModelFit, list[Table], list[Table], list[str]]:
        profiled = profiles.likelihood_profiles(result)
        rows = [_profile_rows(boundary, model.name, p) for p in profiled]
        entry, draws, notes = add_posterior(
            result,
            summary(result, profiled),
            settings,
            seed,
            data_sha256,
            base=model is base,
            say=say[model.name],
        )
        return entry, rows, draws, notes

    say[base.name](f"fit {boundary}: {base.name}", 0.0)
    result = fit(base, data, parts, quoted=True)
    # one covariance for all models, or their likelihoods could not be compared
    offset_m = result.problem.offset_m
    slope = height_slope(base, data, base.named(result.theta), offset_m)
    carried = inputs.acting(parts, base, result.theta)
    collapsed, held, coefficient = _assumptions(campaign, result)
    influential = influence.screen(result, parts, outlying)
    notes = list(influence.notes(boundary, influential))
    entry, rows, draws, more = fitted(base, result)
    notes += [*more, *overdeclared(result)]
    # after its posterior, whose shape may be a doubt
    quoted = base_result(result, entry)
    fits, failed = {base.name: entry}, dict[str, str]()
    held_out = {base.name: deletion.influence(result)}
    for model in models[1:]:
        say[model.name](f"fit {boundary}: {model.name}", 0.0)
        try:
            rival = fit(model, data, carried, result.noise, slope, offset_m)
        except NotConverged as fault:
            failed[model.name] = fault.what
            notes.append(f"{boundary}: {model.name} was not fitted: {fault.what}")
            continue
        held_out[model.name] = deletion.influence(rival)
        fits[model.name], more_rows, more_draws, more = fitted(model, rival)
        rows, draws, notes = rows + more_rows, draws + more_draws, notes + more
    if not result.noise.source.startswith(REPEATS):
        notes.append(f"{boundary}: the noise is the {result.noise.source}")
    return BoundaryFits(
        base=base.name,
        noise=result.noise,
        fits=fits,
        failed=failed,
        comparison=_compare(base.name, fits, held_out),
        throttle_collapse=collapsed,
        held_quantity=held,
        rotor_coefficient=coefficient,
        influence=influential,
        quoted=quoted,
        profiles=rows,
        draws=draws,
        notes=notes,
    )


def _assumptions(
    campaign: Campaign, fitted: LeastSquaresFit
) -> tuple[ThrottleCollapse, HeldQuantity | None, RotorCoefficient]:
    """Tests of one curve for all throttles, of the held quantity, and of a constant C_L."""
    problem, theta = fitted.problem, fitted.theta
    # the exponent is confounded with the coefficients and takes their degrees of freedom
    reach90 = student.quantile(0.95, fitted.effective[0]) if len(theta) else student.NORMAL_90
    held: HeldQuantity | None = None
    responses: tuple[held_quantity.Response, ...] = ()
    if len(theta):
        held, responses = held_quantity.examine(problem, theta, reach90, campaign.rig.held)

    def freedom(g: FloatArray) -> FloatArray:
        return information.freedom(problem, g, fitted.parts, fitted.noise, fitted.slope)

    return (
        collapse.examine(problem, theta, freedom),
        held,
        rotor.examine(campaign, problem, theta, fitted.covariance, responses),
    )


def _profile_rows(boundary: str, model: str, profile: Profile) -> Table:
    """One coefficient's profile as rows of the product."""
    names = {"boundary": boundary, "model": model, "parameter": profile.parameter}
    return {k: np.full(len(profile.value), v, dtype=object) for k, v in names.items()} | {
        "value": profile.value,
        "rise": profile.rise,
        "quadratic": profile.quadratic,
    }


def _compare(
    base: str, fits: Mapping[str, ModelFit], held_out: Mapping[str, deletion.DeletionDiagnostics]
) -> ModelComparison:
    """Scores of the models of one boundary, each against the base."""
    return ModelComparison(
        reference=base,
        models={
            name: replace(
                deletion.score(held, held_out[base]),
                aic=fits[name].aic,
                bic=fits[name].bic,
                r2=fits[name].r2,
            )
            for name, held in held_out.items()
        },
    )


def overdeclared(result: LeastSquaresFit) -> list[str]:
    """A note where trials scatter far less than was declared of what repeats show; else none."""
    from scipy.stats import chi2

    if not result.dof or chi2.cdf(result.chi2, result.dof) > SURELY_LESS:
        return []
    note = (
        f"{result.problem.data.boundary}: trials scatter far less than the stated"
        f" uncertainties imply (chi² = {result.chi2:.3g} for {result.dof} degrees of freedom): an"
        " [[uncertainty]] is too large for its scope, and intervals are too wide"
    )
    return [note]
