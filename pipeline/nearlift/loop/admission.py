"""Admission to the diagnosis: the trials that a boundary needs, and the effects they can test."""

from __future__ import annotations

import numpy as np

from nearlift import catalogue
from nearlift.declare import Effect, FloatArray, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit import inputs
from nearlift.likelihood import budget
from nearlift.likelihood.covariates import derive, missing, unlogged
from nearlift.likelihood.problem import lift_ratio
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.results import Noise, Observations
from nearlift.results.outlook import UntestableEffect

#: Trials beyond the unknowns (levels and coefficients) whose scatter alone distinguishes
#: noise from structure.
LEAST_TRIALS = 40
#: Fewest cells of a published table (order unknown, each with a standard deviation), and fewest
#: beyond the unknowns.
LEAST_CELLS, LEAST_FREEDOM = 15, 8
#: Most sessions with which effects of one size per session are tested: their columns, trials by
#: sessions, have to fit into memory.
MOST_SESSIONS = 400


def is_small_table(data: Observations, base: LiftModel) -> bool:
    """Whether trials are so few that their own scatter does not distinguish noise from
    structure.
    """
    return data.n < LEAST_TRIALS + data.unknown_levels + len(base.parameters)


def require_enough_trials(where: str, data: Observations, base: LiftModel) -> None:
    """Refuse usable trials that cannot be diagnosed; `where` names the step in the message.

    Raises
    ------
    NotConverged
        Too few trials, or few without a standard deviation of each.
    """
    if not is_small_table(data, base):
        return
    unknowns = data.unknown_levels + len(base.parameters)
    if data.ordered:
        # ordered trials may drift, and the false-alarm rate of so few has not been measured
        least = LEAST_TRIALS + unknowns
        remedy = f"at least {least} trials are needed, {least - data.n} more"
        if np.all(data.n_eff <= 1):
            # means without records may come from a published table
            remedy += f" (of a published table {LEAST_CELLS} in all, with lift_sd for each)"
        raise NotConverged(where, f"{data.n} usable trials are too few", remedy)
    wanted = max(LEAST_CELLS, LEAST_FREEDOM + unknowns)
    if data.n < wanted:
        raise NotConverged(
            where,
            f"{data.n} usable trials are too few",
            f"at least {wanted} trials are needed ({unknowns} levels and coefficients are unknown),"
            " each with its standard deviation",
        )
    bare = int(np.sum(~(data.u_lift_N > 0)))
    if bare:
        raise NotConverged(
            where,
            f"{data.n} usable trials, {bare} of them without a standard deviation",
            f"give lift_sd for each, or at least {LEAST_TRIALS + unknowns} trials, to tell a noise"
            " floor from structure",
        )


def problem_of_trials(
    data: Observations,
    base: LiftModel,
    parts: tuple[budget.Component, ...],
    noise: Noise,
    options: Options,
    theta: FloatArray,
    lift_inf_N: FloatArray,
    effects: tuple[Effect, ...] | None = None,
) -> tuple[SearchProblem, tuple[Effect, ...], tuple[UntestableEffect, ...]]:
    """Search problem of trials with their derived covariates, testable effects, and untestable
    ones; `lift_inf_N` (n,) is L_inf at each trial, the others as in `diagnose.set_up`.

    Effects within a trial leave no mark on trial means and are not part of the problem.
    """
    data = derive(data, lift_inf_N, lift_ratio(base, data, base.named(theta)))
    known, untestable = effects_to_test(data, base, effects)
    problem = SearchProblem(
        data=data,
        base=base,
        effects=tuple(e for e in known if not e.within_trial),
        parts=inputs.acting(parts, base, theta),
        noise=noise,
        log_lift=np.log(data.lift_N),
        theta=theta,
        options=options,
    )
    return problem, known, untestable


def effects_to_test(
    data: Observations, base: LiftModel, effects: tuple[Effect, ...] | None = None
) -> tuple[tuple[Effect, ...], tuple[UntestableEffect, ...]]:
    """Testable effects, and untestable ones with what to log next time, of those that can occur at
    this boundary.

    `data` has its derived covariates; `effects` is the catalogue if None.
    """
    library = catalogue.effects() if effects is None else effects
    taken = {p.name for p in base.parameters}
    lift_N = float(np.median(data.lift_N))
    library = tuple(
        e.at_lift(lift_N)
        for e in library
        if data.boundary in e.boundaries
        and not taken & {p.name for p in e.parameters}
        # campaigns without the special experiment do not miss its columns
        and (not e.by_experiment or not missing(e, data))
        # a single rotor has no interactions, and lacks no information on them
        and ("spacing_hat" in data.geometry or "spacing_hat" not in e.needs)
    )
    many = len(np.unique(data.session)) > MOST_SESSIONS
    needs = {
        e.name: (
            ("session",)
            if many and any(p.per == "session" for p in e.parameters)
            else missing(e, data)
        )
        for e in library
    }
    untestable = tuple(
        UntestableEffect(
            effect=e.name,
            needs=needs[e.name],
            # a covariate that was logged did not vary, or has gaps
            log_next_time=unlogged(e, data) or e.log_next_time,
        )
        for e in library
        if needs[e.name]
    )
    return tuple(e for e in library if not needs[e.name]), untestable
