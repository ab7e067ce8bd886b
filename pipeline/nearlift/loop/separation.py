"""Discrimination between explanations: the session that would separate the best from its rivals."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nearlift.likelihood.noise import trial_covariance
from nearlift.likelihood.problem import Likelihood
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.candidate_fit import Point
from nearlift.loop.evidence import PLAIN_2LNB
from nearlift.loop.search import Answer
from nearlift.loop.search_problem import SearchProblem
from nearlift.results import Observations
from nearlift.results.outlook import NextSession

#: Non-centrality at which a rival drops out of the answer: the bound for rivals, and a margin for
#: scatter.
SEPARATED = PLAIN_2LNB + 4.0
#: Rivals for which a session is proposed, at most.
MOST_RIVALS = 4
#: Trials in a proposed session.
SESSION = 160
#: Weight on the evidence of a session that may not be feasible, where sessions are ranked.
IF_FEASIBLE = 0.8
#: Expected evidence per trial below which no session is proposed.
POINTLESS = 1e-6


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A session that could be measured, in words and as the trials it would add; `weight` weighs
    its evidence in the ranking.
    """

    text: str
    added: Observations
    weight: float = 1.0


def menu(
    data: Observations, not_feasible: tuple[str, ...] = (), contact_z_hat: float = 0.0
) -> list[Proposal]:
    """Sessions of about equal cost: near, middle and far distances, closer than now, and approaches
    from both directions.

    `not_feasible` names what the bench cannot do: "closer", "farther", "both directions". The
    vehicle touches the boundary at `contact_z_hat`, 0 where that is unknown.
    """
    finite = data.z_hat[np.isfinite(data.z_hat)]
    near, far = float(finite.min()), float(finite.max())
    places: dict[str, tuple[float, ...]] = {}
    if "closer" not in not_feasible and 0.75 * near > contact_z_hat:
        closer = f"go closer than now, to z_hat = {0.75 * near:.2g}"
        if not contact_z_hat:
            closer += ", if nothing touches there (else state not_feasible)"
        places[closer] = (0.75 * near,)
    places |= {
        f"more visits at the closest distance, z_hat = {near:.2g}": (near,),
        f"visits between z_hat = {near:.2g} and {1.6 * near:.2g}": (near, 1.3 * near, 1.6 * near),
        "visits between z_hat = 3 and 6": (3.0, 4.0, 5.0, 6.0),
        f"visits beyond z_hat = 10, and at {max(far, 10.0):.3g}": (10.0, max(far, 10.0)),
        "the closest, a middle and the farthest distance in turn": (near, 2.5 * near, far),
    }
    if "farther" in not_feasible:
        places = {text: z for text, z in places.items() if max(z) <= far}
    proposals = [
        Proposal(text=text, added=session(data, z), weight=IF_FEASIBLE if min(z) < near else 1.0)
        for text, z in places.items()
    ]
    if "approach" in data.covariates and "both directions" not in not_feasible:
        both = session(data, (near, 1.3 * near))
        direction = np.where(np.arange(both.n) // len(data.levels) % 2 == 0, 1.0, -1.0)
        both = dataclasses.replace(both, covariates={**both.covariates, "approach": direction})
        proposals.append(
            Proposal(
                text="the closest distances, each approached from both directions in turn",
                added=both,
            )
        )
    return proposals


def session(data: Observations, places: tuple[float, ...], trials: int = SESSION) -> Observations:
    """Trials at these distances as part of the last session, with every throttle at each visit.

    Of more than eight throttles four quantiles are used; all other covariates are at their medians.
    """
    levels = (
        data.levels
        if len(data.levels) <= 8
        else np.quantile(data.levels, [0.1, 0.4, 0.7, 1.0], method="nearest")
    )
    visits = max(trials // len(levels), 1)
    z = np.repeat(np.resize(np.asarray(places), visits), len(levels))
    throttle = np.tile(levels, visits)
    n = len(z)
    which = np.searchsorted(data.levels, levels)
    lift = data.level_medians(data.lift_N)[which]
    middle = {
        k: np.full(n, np.nanmedian(v) if np.isfinite(v).any() else np.nan)
        for k, v in data.covariates.items()
    }
    far = data.level_medians(data.covariates["lift_inf_N"])[which]
    middle["lift_inf_N"] = np.tile(far, visits)
    return Observations(
        boundary=data.boundary,
        trial=np.array([f"proposed-{i}" for i in range(n)], dtype=object),
        z_hat=z,
        lift_N=np.tile(lift, visits),
        u_lift_N=np.full(n, float(np.median(data.u_lift_N))),
        n_eff=np.full(n, float(np.median(data.n_eff))),
        throttle=throttle,
        visit=np.repeat(np.arange(visits), len(levels)) + int(data.visit.max()) + 1,
        session=np.full(n, int(data.session.max())),
        radius_m=data.radius_m,
        geometry=data.geometry,
        covariates=middle,
        record=None if data.record is None else np.full(n, int(data.record.max()) + 1),
        u_zero_N=None if data.u_zero_N is None else np.zeros(n),
        curve=data.curve,
    )


def join(a: Observations, b: Observations) -> Observations:
    """The trials of both, one after the other."""
    arrays: dict[str, Any] = {
        f.name: np.concatenate([getattr(a, f.name), getattr(b, f.name)])
        for f in dataclasses.fields(a)
        if isinstance(getattr(a, f.name), np.ndarray)
    }
    return dataclasses.replace(
        a,
        **arrays,
        covariates={k: np.concatenate([v, b.covariates[k]]) for k, v in a.covariates.items()},
    )


def parted(problem: SearchProblem, data: Observations, one: Point, other: Point) -> float:
    """Non-centrality with which the trials `data` discriminate `one` explanation, fitted or
    assumed, from the `other`, whose parameters are free.
    """
    slope = problem.height_slope(data)
    space = Likelihood(
        model=problem.base, data=data, covariance=trial_covariance(data, problem.noise, slope)
    )
    mine, theirs = (
        dataclasses.replace(problem.candidate(*effects), data=data) for effects, _ in (one, other)
    )
    difference = np.nan_to_num(mine.log_ratio(one[1]) - theirs.log_ratio(other[1]))
    white = space.project(difference)
    basis = orthonormal(space.project(theirs.jacobian(other[1]).T).T)
    left = white - basis @ (basis.T @ white)
    return float(left @ left)


def next_experiment(answer: Answer) -> tuple[NextSession, ...]:
    """For each of up to four rivals, the session that discriminates it best from the first
    explanation, by expected evidence per trial.

    If structure is unexplained, the two likeliest explanations take their place.
    """
    problem, compared = answer.problem, answer.accepted
    if answer.verdict == "unexplained":
        tried = [e for e in answer.tried if np.isfinite(e.log_evidence) and e.over_none > 0]
        compared = tuple(sorted(tried, key=lambda e: -e.log_evidence)[:2])
    experiments = []
    for best, rival in zip(compared[:1] * MOST_RIVALS, compared[1:], strict=False):
        points = best.fitted.point, rival.fitted.point
        now = parted(problem, problem.data, *points)
        ranked = []
        for proposal in menu(
            problem.data, problem.options.not_feasible, problem.options.contact_z_hat
        ):
            whole = join(problem.data, proposal.added)
            gain = parted(problem, whole, *points) - now
            ranked.append((gain / proposal.added.n, proposal))
        rate, proposal = max(ranked, key=lambda item: item[0] * item[1].weight)
        if rate < POINTLESS:
            continue
        experiments.append(
            NextSession(
                separates=(best.name, rival.name),
                measure=proposal.text,
                trials=proposal.added.n,
                expected_evidence=rate * proposal.added.n,
                trials_to_separate=int(np.ceil(max(SEPARATED - now, 0.0) / rate)),
            )
        )
    return tuple(experiments)
