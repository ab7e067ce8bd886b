"""Power of planned trials, at the noise floor estimated from simulated campaigns."""

from __future__ import annotations

import dataclasses

import numpy as np

from nearlift.declare import Effect, FloatArray, LiftModel
from nearlift.likelihood import budget
from nearlift.likelihood.noise import trial_covariance
from nearlift.likelihood.problem import lift_ratio, usable
from nearlift.loop.admission import problem_of_trials, require_enough_trials
from nearlift.loop.noise_floor import prepare
from nearlift.loop.power import DesignPower
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.randomness import generator
from nearlift.results import Noise, Observations
from nearlift.results.outlook import UntestableEffect

#: Campaigns simulated to estimate a plan's noise floor.
REHEARSALS = 3


def planned(
    data: Observations,
    base: LiftModel,
    parts: tuple[budget.Component, ...],
    noise: Noise,
    options: Options,
    theta: FloatArray,
    effects: tuple[Effect, ...] | None = None,
) -> tuple[DesignPower, tuple[Effect, ...], tuple[UntestableEffect, ...]]:
    """Power of planned trials.

    Simulated campaigns give the noise floor. A variance component that is hardly identified is not
    estimated as zero, so the floor slightly exceeds the noise.

    Parameters
    ----------
    data : Observations
        Their `lift_N` is L_inf of the throttle; lift is predicted by `base` at `theta`.
    base, parts, options, effects
        See `diagnose.set_up`.
    noise : Noise
        Expected noise.
    theta : (p,)
        Expected coefficients.

    Returns
    -------
    Its `DesignPower`, the testable effects, and the untestable ones with their remedies.

    Raises
    ------
    NotConverged
        See `admission.require_enough_trials`.
    """
    kept = data.take(usable(base, data))
    require_enough_trials(f"design of the {data.boundary}", kept, base)
    lift_inf_N = kept.level_medians(kept.lift_N)[kept.level]
    problem, known, untestable = problem_of_trials(
        kept, base, parts, noise, options, theta, lift_inf_N, effects
    )
    lift_N = lift_inf_N * lift_ratio(base, kept, base.named(theta))
    data = dataclasses.replace(problem.data, lift_N=lift_N)
    problem = dataclasses.replace(problem, data=data, log_lift=np.log(lift_N))
    return _rehearsed(problem), known, untestable


def _rehearsed(problem: SearchProblem) -> DesignPower:
    """Power at the root mean square of the noise floors of simulated campaigns."""
    root = np.linalg.cholesky(trial_covariance(problem.data, problem.noise, problem.slope).dense())
    floors, quiet = [], []
    for i in range(REHEARSALS):
        rng = generator(problem.options.seed, "rehearsal", str(i))
        log_lift = problem.log_lift + root @ rng.standard_normal(problem.data.n)
        data = dataclasses.replace(problem.data, lift_N=np.exp(log_lift))
        drawn = prepare(dataclasses.replace(problem, data=data, log_lift=log_lift))
        freedom = data.n - data.unknown_levels - len(problem.theta)
        floors.append(drawn.noise)
        quiet.append(drawn.base_fit.chi2 / freedom)

    def typical(name: str) -> float:
        return float(np.sqrt(np.mean([getattr(n, name) ** 2 for n in floors])))

    noise = dataclasses.replace(
        problem.noise,
        relative=typical("relative"),
        force_N=typical("force_N"),
        height_m=typical("height_m"),
        common=typical("common"),
        drift=tuple(np.sqrt(np.mean([np.square(n.drift) for n in floors], axis=0)).tolist()),
        dof=float(np.mean([n.dof for n in floors])),
    )
    return DesignPower(
        problem=dataclasses.replace(problem, noise=noise),
        quiet=float(np.sqrt(np.mean(quiet))),
    )
