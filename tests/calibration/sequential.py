"""Campaigns that choose their visits while they are run: how many it takes by `loop.next_visits`, by
all stations equally often, and by a plan with 35 % far off fixed beforehand.

    python -m tests.calibration.sequential --count 99 --seed 820000 --out rows.jsonl

Visits until u of the first coefficient is that of the full plan at `FULL` visits; then its 90 %
interval, and claims halfway and at the stop. A row per campaign; then medians, quartiles and exact
binomial intervals.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tests.calibration import forms
from tests.calibration.bench import stream
from tests.calibration.figures import brief
from tests.calibration.simulator import Campaign, Errors, Spec, Unreachable, simulate

from nearlift import catalogue
from nearlift.likelihood.covariates import derive
from nearlift.loop import coefficients, next_visits
from nearlift.loop.diagnose import decide, set_up
from nearlift.loop.interim import InterimLook
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.planning.question import ROUNDS
from nearlift.results import Noise, Observations

#: The full plan's visits whose uncertainty is asked for, most of any plan, and visits of a batch and
#: of a session.
FULL, MOST, BATCH, SESSION = 300, 600, 10, 50
#: Visits before the first that is planned.
FIRST = 5
#: Supply of a full battery, and its fall over a session.
VOLTS, FALLS_V = 4.0, 0.3


class Pool:
    """A simulated campaign from which visits are taken in any order: `MOST` or more of each
    station, every one with errors of its own.
    """

    def __init__(self, spec: Spec, seed: int) -> None:
        self.campaign: Campaign = simulate(spec, seed)
        self.data = self.campaign.data
        first = np.unique(self.data.visit, return_index=True)[1]
        self.z_hat = np.unique(self.data.z_hat)
        station = np.searchsorted(self.z_hat, self.data.z_hat[first])
        self.of = [np.flatnonzero(station == s) for s in range(len(self.z_hat))]
        self.per = self.data.n // len(first)
        self.battery = stream(seed, "battery").normal(0, 0.02, 1000)

    def run(self, stations: np.ndarray) -> Observations:
        """Trials of these visits, one after the other on batteries of `SESSION` visits."""
        used = np.zeros(len(self.of), dtype=int)
        taken = []
        for s in stations:
            taken.append(self.of[s][used[s] % len(self.of[s])])
            used[s] += 1
        rows = (np.array(taken)[:, None] * self.per + np.arange(self.per)).ravel()
        n, visits = len(rows), len(stations)
        trial, visit = np.arange(n), np.repeat(np.arange(visits), self.per)
        session = visit // SESSION
        charge = (trial % (SESSION * self.per)) / (SESSION * self.per)
        supply = VOLTS - FALLS_V * charge + self.battery[session]
        supply = supply + 0.003 * np.sin(1e3 * trial)
        z = self.z_hat[stations]
        away = np.where(np.diff(z, prepend=z[-1]) >= 0, 1.0, -1.0)
        return dataclasses.replace(
            self.data.take(rows),
            trial=np.array([f"t{i:05d}" for i in trial], dtype=object),
            visit=visit,
            session=session,
            covariates={
                "start_s": 21.0 * trial + 900.0 * session,
                "approach": np.repeat(away, self.per),
                "supply_V": supply,
            },
        )


def full(stations: int, visits: int, rng: np.random.Generator) -> np.ndarray:
    """Rounds over all stations, each in random order."""
    rounds = -(-visits // stations)
    return np.concatenate([rng.permutation(stations) for _ in range(rounds)])[:visits]


def begun(stations: int, rng: np.random.Generator) -> np.ndarray:
    """The nearest, the farthest and others between, in random order."""
    between = 1 + rng.permutation(stations - 2)[: FIRST - 2]
    return rng.permutation(np.r_[0, stations - 1, between])


def fixed(stations: int, visits: int, rng: np.random.Generator) -> np.ndarray:
    """35 % far off, the rest all stations in turn."""
    far = rng.permutation(np.arange(visits) % 20 < 7)
    order = full(stations, visits, rng)
    return np.where(far, stations - 1, order)


def known(data: Observations, pool: Pool) -> SearchProblem:
    """The trials as a search problem at their true noise: the curve is estimated again."""
    base = catalogue.model(catalogue.default_base(data.boundary, 4))
    true = pool.campaign.truth
    scatter = Noise(**{k: getattr(true.scatter, k) for k in ("relative", "force_N", "height_m")})
    levels = true.levels_N[np.searchsorted(data.levels, data.throttle)]
    problem = SearchProblem(
        data=derive(data, levels),
        base=base,
        effects=(),
        parts=(),
        noise=scatter,
        log_lift=np.log(data.lift_N),
        theta=np.array([p.value for p in base.parameters]),
        options=Options(),
    )
    # noise of height goes by the slope of the fitted curve
    return dataclasses.replace(problem, theta=problem.base_fit.vector)


def u_of(problem: SearchProblem) -> float:
    return float(coefficients.spread(problem, problem.base_fit)[1][0])


def counted(pool: Pool, seed: int) -> tuple[np.ndarray, dict[str, int]]:
    """Visits until u of the first coefficient is what the full plan has after `FULL`: their order,
    how many it took, was predicted, and takes by the fixed plan.
    """
    rng, stations = stream(seed, "plan"), len(pool.z_hat)
    target = u_of(known(pool.run(full(stations, FULL, stream(seed, "full"))), pool))

    def takes(order: np.ndarray) -> int:
        return _first(lambda n: u_of(known(pool.run(order[:n]), pool)) <= target, len(order))

    order = begun(stations, rng)
    told = 0
    while u_of(problem := known(pool.run(order), pool)) > target and len(order) < MOST:
        plan = planned(problem, pool.z_hat)
        if not told:
            ahead = plan.until(target, BATCH, np.random.default_rng(seed))
            told = MOST if ahead is None else len(order) + len(ahead)
        order = np.append(order, plan.menu.station[plan.batch(BATCH, rng)])
    order = order[: takes(order)]
    by_fixed = takes(fixed(stations, MOST, stream(seed, "fixed")))
    return order, {"next": len(order), "fixed": by_fixed, "told": told}


def coefficient(boundary: str, seed: int) -> dict[str, Any]:
    """Visits until u of the first coefficient is what the full plan has after `FULL`."""
    pool = Pool(Spec(boundary=boundary, visits=MOST // 3, sessions=1, errors=Errors()), seed)
    order, counts = counted(pool, seed)
    # what the loop says halfway, where a claim pays for the look, and at the stop
    half = len(order) // 2 // BATCH * BATCH
    rate = InterimLook(trials=half, scheduled=len(order)).level(Options().false_alarm_rate)
    early = decide(_set_up(pool.run(order[:half])), False, rate).answer
    answer = decide(_set_up(pool.run(order)), False, Options().false_alarm_rate).answer
    quoted = coefficients.answers(answer).estimates().after
    name, true = next(iter(pool.campaign.truth.theta.items()))
    return {
        **counts,
        "covered": bool(quoted[name].lo90 <= true <= quoted[name].hi90),
        "claim_at_look": early.verdict != "adequate",
        "claim_at_end": answer.verdict != "adequate",
    }


def _set_up(data: Observations) -> SearchProblem:
    base = catalogue.model(catalogue.default_base(data.boundary, 4))
    return set_up(data, base, (), Options())[0]


def planned(problem: SearchProblem, z_hat: np.ndarray) -> next_visits.Plan:
    menu = next_visits.menu(problem.data, z_hat)
    return next_visits.plan(problem, next_visits.of_coefficient(problem.base_fit, 0), menu, ROUNDS)


def _first(reached: Callable[[int], bool], most: int) -> int:
    """The least number of visits that reaches it; `most` where none does."""
    low, high = 2, most
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if reached(middle) else (middle, high)
    return high


def main() -> None:
    """Append a row per campaign, boundaries in turn; then medians with quartiles, and shares with
    their exact 95 % intervals, by boundary.
    """
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=99)
    parser.add_argument("--seed", type=int, default=820_000)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    rows = pd.read_json(given.out, lines=True) if given.out.exists() else pd.DataFrame()
    for i in range(given.count):
        seed, boundary = given.seed + i, forms.BOUNDARIES[i % 3]
        if len(rows) and seed in rows["seed"].to_numpy():
            continue
        with contextlib.suppress(Unreachable):
            row = pd.DataFrame(
                [{"seed": seed, "boundary": boundary, **coefficient(boundary, seed)}]
            )
            rows = pd.concat([rows, row], ignore_index=True)
            rows.to_json(given.out, orient="records", lines=True)
    for boundary, mine in rows.groupby("boundary"):
        counts, facts = mine.select_dtypes("number"), mine.select_dtypes("bool")
        print(boundary, len(mine), *(f"{name}: {brief(facts[name])}" for name in facts), sep="\n")
        print(counts.drop(columns="seed").quantile([0.25, 0.5, 0.75]).to_string())


if __name__ == "__main__":
    main()
