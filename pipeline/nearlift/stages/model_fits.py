"""Lift models that suit each boundary, fitted by least squares, and their posteriors."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary
from nearlift.errors import InputRefused, NotConverged
from nearlift.fit import assumptions, inputs, profiles
from nearlift.fit.base_result import base_result
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.fit.predictive import VisitScores, leave_visit_out, score
from nearlift.fit.profiles import Profile
from nearlift.fit.summary import summary
from nearlift.likelihood import budget
from nearlift.likelihood.noise import REPEATS
from nearlift.likelihood.problem import height_slope
from nearlift.observed import boundaries, choice, observe
from nearlift.results.fit import FitResults, ModelComparison, ModelFit
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.run.engine import Say, subprogress
from nearlift.run.tables import Table
from nearlift.stages import screening
from nearlift.stages.posteriors import Posteriors

#: A chi² that would be exceeded in all but so small a share of campaigns says that the declared
#: errors are not there.
SURELY_LESS = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Fits:
    """Fits of a campaign, what is quoted of them, and rows of profiles and posterior draws."""

    results: FitResults
    quoted: Results
    profiles: list[Table]
    draws: list[Table]
    notes: tuple[str, ...]


def fit_boundaries(
    trials: Table, campaign: Campaign, seed: int, data_sha256: str, say: Say
) -> Fits:
    """Fit base and rivals of every boundary; a rival that fails is noted.

    Raises
    ------
    NotConverged
        A base model fails.
    """
    parts = budget.components(campaign)
    present = boundaries(trials)
    if not present:
        raise InputRefused(
            campaign.name,
            "no trial was accepted, so there is nothing to fit",
            "trials.parquet gives the reason for each",
        )
    results, notes, rows = FitResults(), list[str](), list[Table]()
    quoted: dict[Boundary, BoundaryResult] = {}
    posteriors = Posteriors(campaign=campaign, seed=seed, data_sha256=data_sha256)
    choices = {boundary: choice(campaign, boundary) for boundary in present}
    count, done = sum(1 + len(rivals) for _, rivals in choices.values()), itertools.count()
    for boundary in present:
        data = observe(trials, campaign, boundary)
        base, rivals = choices[boundary]
        fits, failed = dict[str, ModelFit](), dict[str, str]()
        held_out: dict[str, VisitScores] = {}
        scatter = slope = offset_m = None
        carried = parts
        for model in (base, *rivals):
            step = subprogress(say, next(done), count)
            step(f"fit {boundary}: {model.name}")
            try:
                result = fit(model, data, carried, scatter, slope, offset_m, quoted=model is base)
            except NotConverged as fault:
                if model is base:
                    raise
                failed[model.name] = fault.what
                notes.append(f"{boundary}: {model.name} was not fitted: {fault.what}")
                continue
            # one covariance for all models, or their likelihoods could not be compared
            if scatter is None:
                scatter, offset_m = result.noise, result.problem.offset_m
                slope = height_slope(model, data, model.named(result.theta), offset_m)
                carried = inputs.acting(parts, model, result.theta)
            profiled = profiles.likelihood_profiles(result)
            rows += [profile_rows(boundary, model.name, p) for p in profiled]
            held_out[model.name] = leave_visit_out(result)
            fits[model.name] = summary(result, profiled)
            if model is base:
                (
                    results.throttle_collapse[boundary],
                    results.held_quantity[boundary],
                    results.rotor_coefficient[boundary],
                ) = assumptions.check(campaign, result)
                screened = screening.screen(result, parts, trials)
                results.influence[boundary] = screened
                notes += screening.notes(boundary, screened)
            fits[model.name], more = posteriors.added(result, fits[model.name], model is base, step)
            notes += more
            if model is base:
                notes += overdeclared(result)
                # after its posterior, whose shape may be a doubt
                quoted[boundary] = base_result(result, fits[base.name])
        assert scatter is not None
        if not scatter.source.startswith(REPEATS):
            notes.append(f"{boundary}: the noise is the {scatter.source}")
        results.base[boundary], results.noise[boundary] = base.name, scatter
        results.boundaries[boundary] = fits
        results.comparison[boundary] = compare(base.name, fits, held_out)
        if failed:
            results.failed[boundary] = failed
    return Fits(
        results=results,
        quoted=Results(boundaries=quoted),
        profiles=rows,
        draws=posteriors.parts,
        notes=tuple(notes),
    )


def profile_rows(boundary: str, model: str, profile: Profile) -> Table:
    """One coefficient's profile as rows of the product."""
    names = {"boundary": boundary, "model": model, "parameter": profile.parameter}
    return {k: np.full(len(profile.value), v, dtype=object) for k, v in names.items()} | {
        "value": profile.value,
        "rise": profile.rise,
        "quadratic": profile.quadratic,
    }


def compare(
    base: str, fits: Mapping[str, ModelFit], held_out: Mapping[str, VisitScores]
) -> ModelComparison:
    """How the models of one boundary compare, each against the base."""
    return ModelComparison(
        reference=base,
        models={
            name: replace(
                score(held, held_out[base]),
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
