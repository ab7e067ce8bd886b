"""Agreement of two computations of one posterior, measured in Monte Carlo standard errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit.grid import PosteriorGrid
from nearlift.fit.importance import Weighted
from nearlift.fit.pareto import LIMIT
from nearlift.results.posterior import APART, SamplerCheck

#: Cumulative probabilities at which two computations are compared.
PROBABILITIES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, slots=True, kw_only=True)
class Judge:
    """A second computation of a posterior: `below` gives the cumulative probability of a parameter
    at a value, with an effective sample size `ess` and a numerical error of at most `error`.
    """

    name: str
    below: Callable[[int, float], float]
    ess: float = math.inf
    error: float = 0.0
    unfit: str = ""


def grid_judge(lattice: PosteriorGrid) -> Judge:
    """A grid as judge."""
    unfit = (
        ""
        if lattice.resolved
        else f"too coarse for this shape: half the resolution moves shares by {lattice.error:.3f}"
    )
    return Judge(name="grid", below=lattice.below, error=lattice.error, unfit=unfit)


def importance_judge(weighted: Weighted) -> Judge:
    """Importance sampling as judge."""
    k = weighted.pareto_k
    unfit = "" if k < LIMIT else f"its weights cannot be trusted: Pareto k = {k:.2f}, above {LIMIT}"
    return Judge(name="importance sampling", below=weighted.below, ess=weighted.ess, unfit=unfit)


def compare(
    names: Sequence[str], values: FloatArray, ess: FloatArray, judge: Judge
) -> SamplerCheck:
    """Largest disagreement of quantiles `values` (p, 5), worth `ess` (p, 5) draws, with a judge."""
    worst, where = 0.0, ""
    for i, name in enumerate(names):
        for probability, value, worth in zip(PROBABILITIES, values[i], ess[i], strict=True):
            error = (
                math.sqrt(probability * (1 - probability) * (1 / worth + 1 / judge.ess))
                + judge.error / APART
            )
            share = judge.below(i, float(value))
            if abs(share - probability) > worst * error:
                worst = abs(share - probability) / error
                where = (
                    f"{100 * probability:.0f} % of {name} lie below {value:.5g} by one,"
                    f" {100 * share:.1f} % by the other"
                )
    return SamplerCheck(by=judge.name, apart=worst, where=where, unfit=judge.unfit)


def insist(model: str, sampler: str, checks: Sequence[SamplerCheck], remedy: str) -> None:
    """Raise `NotConverged` with this remedy if any judge disagrees."""
    for check in checks:
        if check.failed:
            raise NotConverged(
                f"posterior of {model}",
                f"{sampler} and the {check.by} disagree: {check.where}, {check.apart:.1f} Monte"
                f" Carlo standard errors apart (at most {APART:g})",
                remedy,
            )
