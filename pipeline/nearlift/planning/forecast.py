"""Forecast of measured trials, by the search that would diagnose them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, Effect
from nearlift.errors import NotConverged
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.likelihood.problem import usable
from nearlift.loop.admission import problem_of_trials
from nearlift.loop.diagnose import set_up
from nearlift.loop.power import DesignPower
from nearlift.loop.search_problem import SearchProblem
from nearlift.observed import Trials, choice, observe, search_options
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.outlook import UntestableEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """Power of trials at one boundary, the effects that could act, and those that cannot be tested
    with what to log.
    """

    design: DesignPower
    effects: tuple[Effect, ...]
    untestable: tuple[UntestableEffect, ...]
    notes: tuple[str, ...] = ()

    @property
    def problem(self) -> SearchProblem:
        """Trials, base model and noise."""
        return self.design.problem


def of_trials(
    trials: Trials,
    campaign: Campaign,
    boundary: Boundary,
    diagnosis: BoundaryDiagnosis | None,
    seed: int,
    *,
    few: bool = False,
) -> Forecast:
    """Forecast of measured trials, at the noise that the diagnosis found.

    Raises
    ------
    NotConverged
        The trials are too few for a diagnosis; unless `few` are allowed, then also for a fit.
    """
    data, base = observe(trials, campaign, boundary), choice(campaign, boundary)[0]
    parts, options = budget.components(campaign), search_options(campaign, boundary, seed)
    notes: tuple[str, ...] = ()
    try:
        problem, effects, untestable = set_up(data, base, parts, options, first_order=True)
        if diagnosis is not None:
            # with a large effect the noise is known only after the search
            problem = replace(problem, noise=diagnosis.noise)
    except NotConverged as lack:
        if not few:
            raise
        kept = data.take(usable(base, data))
        first = fit(base, kept, parts)
        far_N = kept.lift_inf_N(first.level_coefficients)
        problem, effects, untestable = problem_of_trials(
            kept, base, parts, first.noise, options, first.theta, far_N
        )
        notes = (f"{lack.what} for a diagnosis; the noise is the {first.noise.source}",)
    return Forecast(
        design=DesignPower(problem=problem), effects=effects, untestable=untestable, notes=notes
    )
