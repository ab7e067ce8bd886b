"""Posterior of each model, and how it was sampled."""

from __future__ import annotations

from markupsafe import Markup

from nearlift.declare import Boundary
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.results.posterior import PosteriorSummary
from nearlift.rounding import plain
from nearlift.stages.fit import FIT

HEADS = ("model", "of", "prior", "prior, 90 %", "median", "posterior, 90 %")


def facts(evidence: Evidence) -> Markup:
    """A table and its words for each boundary."""
    return blocks.join(
        blocks.paragraph(
            "The prior times the likelihood of the base fit, marginalised over <i>L</i><sub>∞</sub>"
            " and the noise scale. Quote the number of the first screen."
        ),
        *(part for b in evidence.boundaries for part in _table(evidence, b)),
    )


def _table(evidence: Evidence, boundary: Boundary) -> list[Markup]:
    base, first = evidence.base(boundary)[1], evidence.fits.base[boundary]
    fits = sorted(evidence.fits.boundaries[boundary].items(), key=lambda named: named[0] != first)
    place = Place(evidence, FIT, ("boundaries", boundary))
    rows, remarks = [], []
    for name, fit in fits:
        if not fit.posterior:
            continue
        for p in place.every(name, "posterior", "parameters"):
            u, drawn = p.content["u"], fit.posterior.parameters[str(p.key)]
            rows.append(
                (
                    f"{fit.title} (base)" if fit is base else fit.title,
                    p.quote().symbol,
                    drawn.prior.text,
                    p.at("prior").ends(digits=3),
                    p.number("median", like_u=u),
                    p.ends(like_u=u),
                    p.percent("width_ratio", digits=2),
                    p.number("ess", places=0),
                )
            )
            remarks += [f"{fit.title}: {drawn.words}."] if drawn.words else []
    heads = (*HEADS, "posterior width, % of prior", "ESS")
    return [
        blocks.table(boundary.capitalize(), heads, rows),
        blocks.paragraph("{}: {}.", base.title, how(base.posterior)),
        blocks.items(remarks),
    ]


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
