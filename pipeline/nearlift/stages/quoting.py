"""What is quoted where the loop has nothing to say: the base fit at the scatter of repeats; and
what the shape of its likelihood would say.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nearlift.fit.estimator import Estimator
from nearlift.fit.least_squares import Fit
from nearlift.products import NOT_DIAGNOSED
from nearlift.quotation import BoundaryResult, Correlation, Doubt

#: `reason` until `diagnose` has run.
UNASKED = "the residuals were not looked at: `nearlift diagnose` does"
#: Ends of a posterior or profile that stand off those of the fit by less than this part of its
#: uncertainty are the same.
SAME = 0.25


def base_result(fit: Fit, entry: Mapping[str, Any], reason: str = UNASKED) -> BoundaryResult:
    """A boundary's part of results.json before or without the loop; `entry` is the model's in
    fit.json.
    """
    estimator = Estimator.of(fit)
    holds = (
        f"Holds the {fit.noise.source.partition(' (')[0]} and the declared errors; an effect of any"
        " size may be in it"
    )
    doubts, shapes = estimator.doubts(), shape(entry)
    scale = np.sqrt(np.diag(fit.covariance))
    safe = np.where(scale > 0, scale, 1.0)
    correlation = fit.covariance / np.outer(safe, safe)
    np.fill_diagonal(correlation, 1.0)
    return BoundaryResult(
        verdict=NOT_DIAGNOSED,
        reason=reason,
        base_model=fit.model.name,
        coefficients={
            name: estimator.quoted(
                i,
                [(float(fit.theta[i]), float(estimator.u[i]))],
                holds,
                [*doubts[i], *shapes[name]],
            )
            for i, name in enumerate(fit.names)
        },
        correlation=Correlation(
            parameters=fit.names, values=tuple(tuple(row) for row in correlation.tolist())
        ),
    )


def shape(entry: Mapping[str, Any]) -> dict[str, list[Doubt]]:
    """What profile and posterior of a model's entry in fit.json say where their ends stand off the
    fit's own interval.
    """
    found: dict[str, list[Doubt]] = {}
    for name, e in entry["parameters"].items():
        found[name] = []
        drawn = (entry.get("posterior") or {}).get("parameters", {}).get(name)
        if not e["u"] or e["lo90"] is None:
            continue
        low, high = drawn["prior"]["bounds"] if drawn else (-np.inf, np.inf)
        others = []
        if profile := entry.get("profiles", {}).get(name):
            ends = (
                low if profile["lo90"] is None else profile["lo90"],
                high if profile["hi90"] is None else profile["hi90"],
            )
            others.append(
                ("the likelihood is followed to where it falls off (profile)", e["value"], *ends)
            )
        if drawn and drawn["lo90"] is not None:
            others.append(
                (
                    "the declared prior is believed as well (posterior)",
                    drawn["median"],
                    drawn["lo90"],
                    drawn["hi90"],
                )
            )
        own = max(e["lo90"], low), min(e["hi90"], high)
        for condition, value, lo90, hi90 in others:
            apart = max(abs(lo90 - own[0]), abs(hi90 - own[1]))
            if apart > SAME * e["u"] and np.isfinite([lo90, hi90]).all():
                found[name].append(Doubt(condition=condition, value=value, lo90=lo90, hi90=hi90))
    return found
