"""A boundary's result without a diagnosis: the base fit with the scatter of repeats as noise, and
doubts from the shape of its likelihood.
"""

from __future__ import annotations

import math

from nearlift.fit import information
from nearlift.fit.estimator import Estimator
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood import budget
from nearlift.results.fit import ModelFit
from nearlift.results.quotation import BoundaryResult, Correlation, Doubt

#: `reason` until `diagnose` has run.
NOT_LOOKED_AT = "`nearlift diagnose` has not run"
#: Intervals agree where their ends differ by at most this many standard uncertainties. Ours: it
#: moves a 90 % interval's coverage by less than 4 %.
SAME_END = 0.25


def base_result(
    fit: LeastSquaresFit, entry: ModelFit, reason: str = NOT_LOOKED_AT, wanted: str = ""
) -> BoundaryResult:
    """A boundary's result before or without the loop; `entry` is the model's in fit.json."""
    estimator = Estimator.from_fit(fit)
    noise = fit.noise.source.partition(" (")[0]
    errors = " and ".join([f"the {noise}", *budget.stated(fit.parts)])
    holds = f"Includes {errors}, but no effect: the residuals were not diagnosed"
    doubts, shapes = estimator.doubts(), shape_doubts(entry)
    correlation = information.correlation(fit.covariance)
    return BoundaryResult(
        verdict="not_diagnosed",
        reason=reason,
        wanted=wanted,
        base_model=fit.model.name,
        coefficients={
            name: estimator.quoted(
                i,
                [((1.0, float(fit.theta[i]), float(estimator.u[i])),)],
                holds,
                [*doubts[i], *shapes[name]],
            )
            for i, name in enumerate(fit.names)
        },
        correlation=Correlation(
            parameters=fit.names, values=tuple(tuple(row) for row in correlation.tolist())
        ),
    )


def shape_doubts(entry: ModelFit) -> dict[str, list[Doubt]]:
    """Profile and posterior intervals that differ from the fit's by `SAME_END`, by coefficient."""
    doubts: dict[str, list[Doubt]] = {}
    for name, e in entry.parameters.items():
        doubts[name] = []
        drawn = entry.posterior.parameters.get(name) if entry.posterior else None
        if not e.u or not math.isfinite(e.lo90):
            continue
        low, high = drawn.prior.bounds if drawn else (-math.inf, math.inf)
        others = []
        if profile := entry.profiles.get(name):
            ends = (
                low if math.isnan(profile.lo90) else profile.lo90,
                high if math.isnan(profile.hi90) else profile.hi90,
            )
            others.append(("interval from the profile likelihood", e.value, *ends))
        if drawn:
            others.append(
                (
                    "posterior, with the declared prior",
                    drawn.median,
                    drawn.lo90,
                    drawn.hi90,
                )
            )
        plain_low, plain_high = max(e.lo90, low), min(e.hi90, high)
        for condition, value, lo90, hi90 in others:
            apart = max(abs(lo90 - plain_low), abs(hi90 - plain_high))
            if apart > SAME_END * e.u and math.isfinite(lo90) and math.isfinite(hi90):
                doubts[name].append(Doubt(condition=condition, value=value, lo90=lo90, hi90=hi90))
    return doubts
