"""fit: the lift models that suit each boundary, by least squares and as a posterior, on trials."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from nearlift import catalogue
from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, LiftModel
from nearlift.errors import InputRefused, ManifestError, NotConverged
from nearlift.fit import assumptions, inputs, profiles
from nearlift.fit.base_result import base_result
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.fit.predictive import VisitScores, leave_visit_out, score
from nearlift.fit.profiles import Profile
from nearlift.fit.summary import summary
from nearlift.likelihood import budget
from nearlift.likelihood.noise import REPEATS
from nearlift.likelihood.problem import height_slope
from nearlift.products import PROFILES, TRIALS
from nearlift.results.fit import FitResults, ModelComparison, ModelFit
from nearlift.results.quotation import BoundaryResult, Results
from nearlift.run import expense
from nearlift.run.job import Job, Outcome, part
from nearlift.run.store import Table, stacked
from nearlift.stages import screening
from nearlift.stages.observe import boundaries, observe
from nearlift.stages.posteriors import Posteriors

#: What of the manifest gives a model the geometry that it needs; the rest is columns of trials.
GIVEN_BY = {
    **dict.fromkeys(("spacing_hat", "diagonal_hat", "layout_hat"), "rotor_spacing in [vehicle]"),
    "gap_hat": "gap in [rig]",
    "edge_hat": "edge in [rig]",
}


def choice(campaign: Campaign, boundary: Boundary) -> tuple[LiftModel, tuple[LiftModel, ...]]:
    """Base model and rivals of one boundary: the manifest's, else the vehicle's defaults."""
    chosen = campaign.fit.choice(boundary)
    vehicle, geometry = campaign.vehicle, campaign.geometry()
    base = catalogue.model(
        chosen.base if chosen and chosen.base else catalogue.default_base(boundary, vehicle.rotors)
    )
    names: Iterable[str] | None = chosen.rivals if chosen else None
    if names is None:
        names = catalogue.default_rivals(boundary, vehicle.rotors, geometry)
    rivals = tuple(catalogue.model(name) for name in names)
    for model in (base, *rivals):
        if model.boundary != boundary:
            raise ManifestError(
                f"fit.{boundary}",
                f"{model.name} is a {model.boundary} model",
                f"`nearlift describe` lists those of the {boundary}",
            )
        lacking = [n for n in model.needs if n in GIVEN_BY and n not in geometry]
        if lacking:
            raise ManifestError(
                f"fit.{boundary}",
                f"{model.name} needs {', '.join(lacking)}",
                f"give {', '.join(dict.fromkeys(GIVEN_BY[n] for n in lacking))}, or another model",
            )
    return base, tuple(m for m in rivals if m.name != base.name)


#: A chi² that would be exceeded in all but so small a share of campaigns says that the declared
#: errors are not there.
SURELY_LESS = 1e-6


def run(job: Job) -> Outcome:
    """Fit base and rivals of every boundary; a rival that fails is noted, a base that
    fails ends the run with exit code 5.
    """
    trials = job.read(TRIALS)
    parts = budget.components(job.campaign)
    present = boundaries(trials)
    if not present:
        raise InputRefused(
            job.campaign.name,
            "no trial was accepted, so there is nothing to fit",
            "trials.parquet gives the reason for each",
        )
    results, notes, rows = FitResults(), list[str](), list[Table]()
    quoted: dict[Boundary, BoundaryResult] = {}
    posteriors = Posteriors(job=job)
    choices = {boundary: choice(job.campaign, boundary) for boundary in present}
    count, done = sum(1 + len(rivals) for _, rivals in choices.values()), itertools.count()
    for boundary in present:
        data = observe(trials, job.campaign, boundary)
        expense.announce(job.announce, f"fit {boundary}", expense.FIT, data)
        base, rivals = choices[boundary]
        fits, failed = dict[str, ModelFit](), dict[str, str]()
        held_out: dict[str, VisitScores] = {}
        scatter = slope = plan = None
        carried = parts
        for model in (base, *rivals):
            say = part(job.say, next(done), count)
            say(f"fit {boundary}: {model.name}")
            try:
                result = fit(model, data, carried, scatter, slope, plan)
            except NotConverged as fault:
                if model is base:
                    raise
                failed[model.name] = fault.what
                notes.append(f"{boundary}: {model.name} was not fitted: {fault.what}")
                continue
            # one covariance for all models, or their likelihoods could not be compared
            if scatter is None:
                scatter, plan = result.noise, result.plan
                slope = height_slope(
                    model, data, dict(zip(result.names, result.theta, strict=True))
                )
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
                ) = assumptions.check(job.campaign, result)
                screened = screening.screen(result, parts, trials)
                results.influence[boundary] = screened
                notes += screening.notes(boundary, screened)
            fits[model.name], more = posteriors.added(result, fits[model.name], model is base, say)
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
    posteriors.write()
    job.write(PROFILES, stacked(PROFILES, rows))
    job.save(results)
    job.save(Results(boundaries=quoted))
    if job.campaign.fit.netcdf:
        from nearlift.stages import netcdf

        netcdf.write(job)
    else:
        # draws of an earlier fit beside those of this one would be taken for its own
        job.remove("processed/posterior.nc")
    return Outcome(notes=tuple(notes))


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
