"""Noise floor of a search: variance components with every family and effect as a nuisance."""

from __future__ import annotations

import dataclasses
from collections import defaultdict

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood import budget, noise
from nearlift.loop.candidate import Candidate, library_columns
from nearlift.loop.families import families
from nearlift.loop.search_problem import SearchProblem
from nearlift.results import Noise

#: Covariates of time, whose families are no nuisances here: the drift components stand for them.
TIME = ("start", "session")
#: Alternation of noise and coefficients: largest last step in standard uncertainties, most
#: iterations, and under-relaxation of a step.
SETTLED, ROUNDS, DAMPING = 0.1, 5, 0.62
#: Trials from which a diagnosis saves time: the first of them give the starting value of the noise
#: floor, and folds do not search again (36,000 trials then take 38 s).
LARGE_CAMPAIGN = 6000


def prepare(
    problem: SearchProblem,
    about: tuple[Candidate, FloatArray] | None = None,
    start: Noise | None = None,
) -> SearchProblem:
    """The search problem at its noise floor, by penalised restricted maximum likelihood.

    Noise and coefficients are estimated in turn, beginning with the problem's `theta`. They are
    estimated about the base model or about an explanation (a candidate at a vector). The latter
    serves where an effect is many times the noise: there, the base model's slope and the families'
    curvature cannot distinguish noise from outliers. `start` is the noise of nearly the same
    trials, as a starting value.
    """
    p, noise_floor = len(problem.theta), start
    base, data, parts = problem.base, problem.data, problem.linear_parts
    if about is not None:
        about = dataclasses.replace(about[0], data=data), about[1]
    candidate, vector = about or (problem.candidate(), problem.start)
    # structure that the candidate may lack: families, and every effect to first order
    shapes = defaultdict(list)
    for effect, columns in library_columns(base, problem.effects, data, vector[:p]):
        shapes[effect.name].append(columns)
    lacking = [f.columns for f in families(data) if f.covariate not in TIME]
    lacking += [np.hstack(each) for each in shapes.values()]
    for _ in range(ROUNDS):
        log_ratio = candidate.log_ratio(vector)
        # a large effect is part of the curve, and the base model may be far steeper
        slope = dataclasses.replace(problem, about=about, theta=vector[:p]).slope
        rest, shared = np.log(data.lift_N) - log_ratio, budget.shared(data, parts, slope)
        mean = np.hstack([data.level_design, candidate.jacobian(vector)])
        variance = budget.own_variance(data, parts, slope)
        first = noise_floor is None and data.n > LARGE_CAMPAIGN
        for n in (LARGE_CAMPAIGN, data.n) if first else (data.n,):
            noise_floor, target = noise.estimate(
                data.take(np.arange(n)),
                rest[:n],
                mean[:n],
                [columns[:n] for columns in lacking],
                slope[:n],
                shared[:n],
                variance[:n],
                noise_floor,
            )
        problem = dataclasses.replace(
            problem,
            noise=noise_floor or problem.noise,
            log_lift=target + log_ratio,
            theta=vector[:p],
            about=about,
            drawn=None,
        )
        if about is not None or not p:
            break
        moved, jacobian = problem.base_fit.vector - vector, problem.base_fit.jacobian
        u = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)))
        if np.all(np.abs(moved) < SETTLED * u):
            break
        vector = vector + DAMPING * moved
    return problem
