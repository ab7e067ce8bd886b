"""Lift models that suit each boundary, fitted by least squares, and their posteriors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit import (
    collapse,
    deletion,
    held_quantity,
    influence,
    inputs,
    rotor,
)
from nearlift.fit.estimator import base_result
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.fit.posterior import Table
from nearlift.fit.summary import add_posterior, summary
from nearlift.likelihood import budget, student
from nearlift.likelihood.noise import REPEATS
from nearlift.likelihood.problem import height_slope
from nearlift.results import Observations
from nearlift.results.fit import FitResults, ModelComparison, ModelFit
from nearlift.results.quotation import BoundaryResult

Progress = Callable[[str, float], None]
#: Probability of a smaller chi² below which the declared errors are noted as too large. Ours: one
#: false note in a million boundaries.
OVERSTATED_CHI2_LEVEL = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Fits:
    """All fits of a campaign: fit.json, results.json before a diagnosis, rows of
    posterior.parquet, and notes for the console.
    """

    results: FitResults = field(default_factory=FitResults)
    quoted: dict[Boundary, BoundaryResult] = field(default_factory=dict)
    draws: list[Table] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def fit_boundary(
    fits: Fits,
    data: Observations,
    models: Sequence[LiftModel],
    campaign: Campaign,
    seed: int,
    data_sha256: str,
    *,
    outlying: Collection[str] = (),
    say: Mapping[str, Progress],
) -> None:
    """Add to `fits` the base model of a boundary, which comes first, and its rivals; a rival that
    fails is noted.

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
    boundary, base, results = data.boundary, models[0], fits.results
    parts = budget.components(campaign)

    def entry(model: LiftModel, fitted: LeastSquaresFit) -> ModelFit:
        entry, draws, notes = add_posterior(
            fitted,
            summary(fitted),
            campaign.fit,
            seed,
            data_sha256,
            base=model is base,
            say=say[model.name],
        )
        fits.draws.extend(draws)
        fits.notes.extend(notes)
        return entry

    say[base.name](f"fit {boundary}: {base.name}", 0.0)
    first = fit(base, data, parts, quoted=True)
    # one covariance for all models, or their likelihoods could not be compared
    offset_m = first.problem.offset_m
    slope = height_slope(base, data, base.named(first.theta), offset_m)
    carried = inputs.acting(parts, base, first.theta)
    _check_assumptions(results, campaign, first)
    results.base[boundary], results.noise[boundary] = base.name, first.noise
    results.influence[boundary] = influence.screen(first, parts, outlying)
    fits.notes.extend(influence.notes(boundary, results.influence[boundary]))
    entries, held_out = {base.name: entry(base, first)}, {base.name: deletion.influence(first)}
    fits.notes.extend(overdeclared(first))
    # after its posterior, whose shape may be a doubt
    fits.quoted[boundary] = base_result(first, entries[base.name])
    failed = {}
    for model in models[1:]:
        say[model.name](f"fit {boundary}: {model.name}", 0.0)
        try:
            rival = fit(model, data, carried, first.noise, slope, offset_m)
        except NotConverged as fault:
            failed[model.name] = fault.what
            fits.notes.append(f"{boundary}: {model.name} was not fitted: {fault.what}")
            continue
        held_out[model.name], entries[model.name] = deletion.influence(rival), entry(model, rival)
    results.boundaries[boundary] = entries
    if failed:
        results.failed[boundary] = failed
    scores = {
        name: replace(deletion.score(held, held_out[base.name]), aic=e.aic, bic=e.bic, r2=e.r2)
        for (name, held), e in zip(held_out.items(), entries.values(), strict=True)
    }
    results.comparison[boundary] = ModelComparison(reference=base.name, models=scores)
    if not first.noise.source.startswith(REPEATS):
        fits.notes.append(f"{boundary}: the noise is the {first.noise.source}")


def _check_assumptions(results: FitResults, campaign: Campaign, fitted: LeastSquaresFit) -> None:
    """Test one curve for all throttles, the held quantity, and a constant C_L."""
    problem, theta, boundary = fitted.problem, fitted.theta, fitted.problem.data.boundary
    responses: tuple[held_quantity.Response, ...] = ()
    results.held_quantity[boundary] = None
    if len(theta):
        # the exponent is confounded with the coefficients and takes their degrees of freedom
        reach90 = student.quantile(0.95, fitted.effective[0])
        results.held_quantity[boundary], responses = held_quantity.examine(
            problem, theta, reach90, campaign.rig.held
        )

    results.throttle_collapse[boundary] = collapse.examine(fitted)
    results.rotor_coefficient[boundary] = rotor.examine(campaign, fitted, responses)


def overdeclared(result: LeastSquaresFit) -> list[str]:
    """A note where trials scatter far less than the stated uncertainties imply; else none."""
    from scipy.stats import chi2

    if not result.dof or chi2.cdf(result.chi2, result.dof) > OVERSTATED_CHI2_LEVEL:
        return []
    note = (
        f"{result.problem.data.boundary}: trials scatter far less than the stated"
        f" uncertainties imply (chi² = {result.chi2:.3g} for {result.dof} degrees of freedom): an"
        " [[uncertainty]] is too large for its scope, and intervals are too wide"
    )
    return [note]
