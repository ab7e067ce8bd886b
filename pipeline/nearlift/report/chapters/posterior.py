"""Posterior of each model, and how it was sampled."""

from __future__ import annotations

from nearlift.declare import Boundary
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.results.posterior import PosteriorSummary
from nearlift.rounding import plain
from nearlift.stages.fit import FIT


def facts(evidence: Evidence) -> dict[str, object]:
    """A table and its words for each boundary."""
    return {"tables": [_table(evidence, b) for b in evidence.boundaries]}


def _table(evidence: Evidence, boundary: Boundary) -> dict[str, object]:
    base = evidence.base(boundary)[1]
    first = evidence.fits.base[boundary]
    fits = sorted(evidence.fits.boundaries[boundary].items(), key=lambda named: named[0] != first)
    place = Place(evidence, FIT, ("boundaries", boundary))
    drawn = [(f, f.posterior, place.at(name, "posterior")) for name, f in fits if f.posterior]
    return {
        "boundary": boundary,
        "base": base,
        "drawn": drawn,
        "words": [
            (f.title, p.words) for f, d, _ in drawn for p in d.parameters.values() if p.words
        ],
        "how": how(base.posterior),
        "chains": any(p.sampler == "emcee" and p.parameters for _, p, _ in drawn),
    }


def how(drawn: PosteriorSummary | None) -> str:
    """How a posterior was sampled, and how that was checked, in words."""
    if drawn is None:
        return "no posterior"
    if drawn.sampler == "none":
        return "no free parameter"
    n = drawn.chains * drawn.draws
    if drawn.sampler == "emcee":
        sampling = (
            f"{n} draws by emcee, equal to {drawn.ess or 0.0:.0f} independent ones. It took"
            f" {drawn.steps} steps of {drawn.chains} walkers, {100 * drawn.acceptance:.0f} %"
            f" accepted, τ = {plain(drawn.tau or 0.0, 3)}"
        )
    else:
        sampling = f"{n} independent draws from a grid"
    judged = [
        f"The {c.by} agrees within {plain(c.apart, 2)} Monte Carlo standard errors"
        for c in drawn.checks
        if not c.unfit
    ]
    unfit = [f"The {c.by} was no check: {c.unfit}" for c in drawn.checks if c.unfit]
    return ". ".join([sampling, *judged, *unfit])
