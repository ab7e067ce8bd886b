"""fit: every lift model that suits each boundary and the vehicle, by least squares and as a
posterior, on trials.
"""

from __future__ import annotations

from typing import Any

from nearlift import catalogue
from nearlift.declare import Boundary, LiftModel
from nearlift.errors import InputRefused, ManifestError, NotConverged
from nearlift.fit import inputs, profiles
from nearlift.fit.least_squares import Fit, fit
from nearlift.fit.predictive import HeldOut, leave_visit_out
from nearlift.likelihood import budget
from nearlift.likelihood.noise import REPEATS
from nearlift.likelihood.problem import height_slope
from nearlift.manifest.campaign import Campaign
from nearlift.products import FIT, PROFILES, RESULTS, TRIALS
from nearlift.quotation import BoundaryResult, Results
from nearlift.results import Estimate, Observations
from nearlift.run import expense
from nearlift.run.job import Job, Outcome
from nearlift.stages import accounts, beside, quoting, screening
from nearlift.stages.observe import boundaries, observe
from nearlift.stages.posteriors import Posteriors


def choice(campaign: Campaign, boundary: Boundary) -> tuple[LiftModel, tuple[LiftModel, ...]]:
    """Base model and rivals of one boundary: the manifest's, else the vehicle's defaults."""
    chosen = campaign.fit.of(boundary)
    vehicle, geometry = campaign.vehicle, campaign.vehicle.geometry()
    base = catalogue.model(
        chosen.base if chosen and chosen.base else catalogue.default_base(boundary, vehicle.rotors)
    )
    if chosen and chosen.rivals is not None:
        rivals = tuple(catalogue.model(name) for name in chosen.rivals)
    else:
        rivals = tuple(
            catalogue.model(name)
            for name in catalogue.default_rivals(boundary, vehicle.rotors, geometry)
        )
    for model in (base, *rivals):
        if model.boundary != boundary:
            raise ManifestError(
                f"fit.{boundary}",
                f"{model.name} is a {model.boundary} model",
                f"`nearlift describe` lists those of the {boundary}",
            )
        lacking = [n for n in model.needs if n not in geometry]
        if lacking and model is base:
            raise ManifestError(
                f"fit.{boundary}",
                f"{model.name} needs {', '.join(lacking)}",
                "give rotor_spacing in [vehicle], or another `base`",
            )
    return base, tuple(m for m in rivals if m.name != base.name)


#: A chi² that would be exceeded in all but so small a share of campaigns says that the declared
#: errors are not there.
SURELY_LESS = 1e-6


def run(job: Job) -> Outcome:
    """Fit base and rivals of every boundary; a rival that fails is noted, a base that fails ends
    the run with exit code 5.
    """
    trials = job.read(TRIALS)
    parts = budget.components(job.campaign)
    content: dict[str, Any] = {
        "schema": FIT.schema,
        "base": {},
        "noise": {},
        "boundaries": {},
        "comparison": {},
        "failed": {},
    }
    notes, rows = [], []
    quoted: dict[Boundary, BoundaryResult] = {}
    posteriors = Posteriors(job=job)
    present = boundaries(trials)
    if not present:
        raise InputRefused(
            job.campaign.name,
            "no trial was accepted, so there is nothing to fit",
            "trials.parquet gives the reason for each",
        )
    for boundary in present:
        data = observe(trials, job.campaign, boundary)
        expense.announce(job.announce, f"fit {boundary}", expense.FIT, data)
        base, rivals = choice(job.campaign, boundary)
        fits: dict[str, Any] = {}
        held_out: dict[str, HeldOut] = {}
        scatter = slope = plan = None
        carried = parts
        for model in (base, *rivals):
            job.say(f"fit {boundary}: {model.name}")
            try:
                result = fit(model, data, carried, scatter, slope, plan)
            except NotConverged as fault:
                if model is base:
                    raise
                content["failed"].setdefault(boundary, {})[model.name] = fault.what
                notes.append(f"{boundary}: {model.name} was not fitted: {fault.what}")
                continue
            # one covariance for all models, or their likelihoods could not be compared
            if scatter is None:
                scatter, plan = result.noise, result.plan
                slope = height_slope(
                    model, data, dict(zip(result.names, result.theta, strict=True))
                )
                carried = inputs.acting(parts, model, result.theta)
            profiled = profiles.of(result)
            rows += accounts.profile_rows(boundary, result, profiled)
            held_out[model.name] = leave_visit_out(result)
            fits[model.name] = record(result, data) | accounts.entry(result, profiled)
            job.say(f"posterior {boundary}: {model.name}")
            if model is base:
                for key, entry in beside.ask(job.campaign, result).items():
                    content.setdefault(key, {})[boundary] = entry
                screened = screening.ask(result, parts, trials)
                content.setdefault("influence", {})[boundary] = screened
                notes += screening.notes(boundary, screened)
            try:
                found = posteriors.add(result, base=model is base)
            except NotConverged as fault:
                if model is base:
                    raise
                notes.append(
                    f"{boundary}: {model.name} has no posterior: {fault.what}; {fault.remedy}"
                )
                continue
            if model is base:
                notes += [
                    f"{boundary}: {p['unlike_fit']}"
                    for p in found["parameters"].values()
                    if p["unlike_fit"]
                ]
                notes += overdeclared(result)
            fits[model.name] |= {"log_evidence": found.pop("log_evidence"), "posterior": found}
            if model is base:
                # after its posterior, whose shape may be a doubt
                quoted[boundary] = quoting.base_result(result, fits[base.name])
        content["base"][boundary] = base.name
        content["boundaries"][boundary] = fits
        content["comparison"][boundary] = accounts.comparison(base.name, fits, held_out)
        assert scatter is not None
        if not scatter.source.startswith(REPEATS):
            notes.append(f"{boundary}: the noise is the {scatter.source}")
        content["noise"][boundary] = scatter.record()
    posteriors.write()
    job.write(PROFILES, accounts.profile_table(rows))
    job.write_json(FIT, content)
    job.write_json(RESULTS, Results(boundaries=quoted).content())
    if job.campaign.fit.netcdf:
        from nearlift.stages import netcdf

        netcdf.write(job)
    else:
        # draws of an earlier fit beside those of this one would be taken for its own
        job.remove("processed/posterior.nc")
    return Outcome(notes=tuple(notes))


def overdeclared(result: Fit) -> list[str]:
    """A note where trials scatter far less than the manifest declares of what repeats would show;
    empty where they do not.
    """
    from scipy.stats import chi2

    if not result.dof or chi2.cdf(result.chi2, result.dof) > SURELY_LESS:
        return []
    found = f"chi² = {result.chi2:.3g} for {result.dof} degrees of freedom"
    where = result.problem.data.boundary
    note = (
        f"{where}: trials scatter far less than the declared errors would have them ({found}): an"
        " [[uncertainty]] is too large for its scope"
    )
    return [f"{note}, and intervals are too wide"]


def record(result: Fit, data: Observations) -> dict[str, Any]:
    """One model's entry in fit.json."""
    return {
        "title": result.model.title,
        "parameters": {
            name: _estimate(e) | {"dof": dof} | _warned(float(dof))
            for (name, e), dof in zip(result.estimates.items(), result.effective, strict=True)
        },
        "covariance": {"names": list(result.names), "values": result.covariance},
        "chi2": result.chi2,
        "dof": result.dof,
        "n_trials": result.n,
        "rmse": result.rmse,
        "r2": result.r2,
        **(
            {"r2_near": result.r2_near, "r2_near_range": [1.0, 3.0]}
            if data.boundary == "ground"
            else {}
        ),
        "log_likelihood": result.log_likelihood,
        "aic": result.aic,
        "bic": result.bic,
        "L_inf_N": {f"{t:g}": _estimate(e) for t, e in result.levels.items()},
        "degeneracies": [
            {
                "pair": list(d.pair),
                "r": d.r,
                "text": d.text,
                "u_if_free": d.u_if_free,
                "known_to": d.known_to,
            }
            for d in result.degeneracies
        ],
        "excluded": [{"trial": t, "reason": why} for t, why in result.excluded],
    }


#: An uncertainty known with fewer degrees of freedom than this is flagged.
FEW = 5.0


def _warned(dof: float) -> dict[str, str]:
    """What to say of a coefficient whose uncertainty is itself hardly known."""
    if dof < FEW:
        return {
            "warning": (
                f"the uncertainty itself is known with {dof:.1f} degrees of freedom only: measure"
                " more visits"
            )
        }
    return {}


def _estimate(e: Estimate) -> dict[str, Any]:
    return {
        "value": e.value,
        "u": e.u,
        "lo90": e.lo90,
        "hi90": e.hi90,
        "unit": e.unit,
        "at_bound": e.at_bound,
    }
