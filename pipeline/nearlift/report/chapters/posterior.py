"""What is believed after the data: each model's posterior, how it was sampled, and what it does not
say.
"""

from __future__ import annotations

from nearlift.declare import Boundary
from nearlift.products import FIT
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.results.fit import ModelFit
from nearlift.results.posterior import PosteriorSummary
from nearlift.rounding import plain


def facts(evidence: Evidence) -> dict[str, object]:
    """A table and its words for each boundary."""
    return {"tables": [_table(evidence, b) for b in evidence.boundaries]}


def _table(evidence: Evidence, boundary: Boundary) -> dict[str, object]:
    base = evidence.base(boundary)[1]
    fits = sorted(evidence.fits.boundaries[boundary].values(), key=lambda f: f.model != base.model)
    sampled = [(f, f.posterior) for f in fits if f.posterior]
    rows = [
        _row(evidence, boundary, f, drawn, name, f.model == base.model)
        for f, drawn in sampled
        for name in drawn.parameters
    ]
    words = [
        (f.title, p.words) for f, drawn in sampled for p in drawn.parameters.values() if p.words
    ]
    return {
        "boundary": boundary,
        "rows": rows,
        "words": words,
        "how": how(base.posterior),
        "base": base.title,
        "chains": any(r["r_hat"] for r in rows),
    }


def _row(
    evidence: Evidence,
    boundary: Boundary,
    fit: ModelFit,
    drawn: PosteriorSummary,
    parameter: str,
    base: bool,
) -> dict[str, object]:
    after = Place(
        evidence, FIT, ("boundaries", boundary, fit.model, "posterior", "parameters", parameter)
    )
    return {
        "model": fit.title,
        "base": base,
        "of": after.quote(),
        "prior": drawn.parameters[parameter].prior.text,
        "prior_low": after.number("prior", "lo90", digits=3),
        "prior_high": after.number("prior", "hi90", digits=3),
        "ratio": after.percent("width_ratio", digits=2),
        "ess": after.number("ess", places=0),
        "r_hat": (after.number("r_hat", places=3) if drawn.sampler == "emcee" else None),
    }


def how(drawn: PosteriorSummary | None) -> str:
    """How a posterior was sampled and what its judges said, in words."""
    if drawn is None:
        return "it has no posterior"
    if drawn.sampler == "none":
        return "it has no free parameter, and nothing had to be sampled"
    n = drawn.chains * drawn.draws
    if drawn.sampler == "emcee":
        sampling = (
            f"emcee took {drawn.steps} steps of {drawn.chains} walkers (differential"
            f" evolution and snooker moves, {100 * drawn.acceptance:.0f} % accepted, τ ="
            f" {plain(drawn.tau or 0.0, 3)}); {n} draws are kept, worth {drawn.ess or 0.0:.0f}"
            " independent ones"
        )
    else:
        sampling = (
            f"{n} independent draws by importance sampling from the peak (Pareto k ="
            f" {plain(drawn.pareto_k, 2)}; below 0.7 it can be used)"
        )
    judged = [
        f"the {c.by} agrees, within {plain(c.apart, 2)} Monte Carlo standard errors"
        for c in drawn.checks
        if not c.unfit
    ]
    unfit = [f"the {c.by} could not judge ({c.unfit})" for c in drawn.checks if c.unfit]
    return "; ".join([sampling, *judged, *unfit])
