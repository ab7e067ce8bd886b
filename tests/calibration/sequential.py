"""Campaigns that choose their visits while they are run: how many a question takes by
`loop.next_visits`, by all stations equally often, and by a plan with 35 % far off fixed beforehand.

    python -m tests.calibration.sequential coefficient --count 99 --seed 820000 --out rows.jsonl

Kinds: `coefficient` (no effect; visits until u of the first coefficient is that of the full plan
at `FULL` visits; then its 90 % interval, and claims at a look and at the stop), `stations` (ground;
the same visits at the stations of each design, by what goes round), `supply` (supply_sag that a
falling battery hides behind gain_drift; visits until 2 ln B > 9). For rivals by stations see
`rivals`. A row per campaign; with --tabulate medians, quartiles and exact binomial intervals.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import binomtest
from tests.calibration.bench import DESIGNS, stream
from tests.calibration.simulator import Campaign, Errors, Spec, Unreachable, simulate

from nearlift import catalogue
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.subspace import framed, orthonormal
from nearlift.loop import coefficients, next_visits
from nearlift.loop.candidate_fit import Fitted, search
from nearlift.loop.diagnose import decide, set_up
from nearlift.loop.evidence import LinearFit, Linearised
from nearlift.loop.interim import InterimLook
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.planning.question import ROUNDS
from nearlift.results import Noise, Observations
from nearlift.results.diagnosis import FORM_SD

#: The full plan's visits whose uncertainty is asked for, most of any plan, and visits of a batch and
#: of a session.
FULL, MOST, BATCH, SESSION = 300, 600, 10, 50
#: Visits before the first that is planned, shares that go round, p at which structure is seen.
FIRST, SHARES, SEEN_AT = 5, (0.5, 0.4, 0.3, 0.2, 0.0), 1e-3
APART = 9.0
#: Of the supply: visits before the first that is planned, and between looks.
FEW, EVERY = 4, 2
#: A true exponent, what a battery loses over a session, and by how much a visit's supply is moved.
EXPONENT, FALLS_V, VOLTS = 2.0, 0.3, 4.0


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

    def run(self, stations: np.ndarray, moved: np.ndarray | None = None) -> Observations:
        """The trials of these visits, run one after the other on batteries of `SESSION` visits, or
        on a supply that each visit moves by a fraction of it.
        """
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
        if moved is not None:
            set_to = np.repeat(moved, self.per)
            supply = np.where(np.isfinite(set_to), VOLTS * (1 + np.nan_to_num(set_to)), supply)
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


def known(data: Observations, pool: Pool, names: tuple[str, ...] = ()) -> SearchProblem:
    """The trials as a search problem at their true noise: what is estimated anew is the curve."""
    base = catalogue.model(catalogue.default_base(data.boundary, 4))
    true = pool.campaign.truth
    scatter = Noise(**{k: getattr(true.scatter, k) for k in ("relative", "force_N", "height_m")})
    levels = true.levels_N[np.searchsorted(data.levels, data.throttle)]
    stage = SearchProblem(
        data=derive(data, levels),
        base=base,
        effects=tuple(catalogue.effect(name) for name in names),
        parts=(),
        noise=scatter,
        log_lift=np.log(data.lift_N),
        theta=np.array([p.value for p in base.parameters]),
        options=Options(),
    )
    # noise of height goes by the slope of the fitted curve
    return dataclasses.replace(stage, theta=stage.base_fit.vector)


def u_of(stage: SearchProblem) -> float:
    return float(coefficients.spread(stage, stage.base_fit)[1][0])


def counted(pool: Pool, seed: int, rounds: float) -> tuple[np.ndarray, dict[str, int]]:
    """Visits until u of the first coefficient is what the full plan has after `FULL`: their order,
    how many it took, was foretold, and takes by the fixed plan.
    """
    rng, stations = stream(seed, "plan"), len(pool.z_hat)
    target = u_of(known(pool.run(full(stations, FULL, stream(seed, "full"))), pool))

    def takes(order: np.ndarray) -> int:
        return _first(lambda n: u_of(known(pool.run(order[:n]), pool)) <= target, len(order))

    order = begun(stations, rng)
    told = 0
    while u_of(stage := known(pool.run(order), pool)) > target and len(order) < MOST:
        plan = planned(stage, pool.z_hat, rounds)
        if not told:
            ahead = plan.until(target, BATCH, np.random.default_rng(seed))
            told = MOST if ahead is None else len(order) + len(ahead)
        order = np.append(order, plan.menu.station[plan.batch(BATCH, rng)])
    order = order[: takes(order)]
    by_fixed = takes(fixed(stations, MOST, stream(seed, "fixed")))
    return order, {"next": len(order), "fixed": by_fixed, "told": told}


def stations(design: str, seed: int) -> dict[str, Any]:
    """The same near the ground, at the stations of that design, by what goes round (in percent);
    the least that any choice of the others takes, made beforehand; and the chance left to see a
    structure in distance that the full plan sees with 0.9.
    """
    spec = Spec(boundary="ground", design=design, visits=MOST // 3, sessions=1, errors=Errors())
    pool, row = Pool(spec, seed), {}
    for rounds in SHARES:
        order, counts = counted(pool, seed, rounds)
        stage = known(pool.run(order), pool)
        plan = planned(stage, pool.z_hat, rounds)
        held = next_visits.of_coefficient(stage.base_fit, 0).held
        nothing = np.diag(np.pad(held, (0, len(plan.now) - len(held))))
        whole = nothing + FULL * plan.of_round
        other = fixed(len(pool.z_hat), counts["fixed"], stream(seed, "fixed"))
        row |= {
            f"next{100 * rounds:.0f}": counts["next"],
            f"least{100 * rounds:.0f}": least(plan, nothing, rounds),
            f"sees{100 * rounds:.0f}": plan.sees(
                nothing + plan.added[order].sum(axis=0), whole, SEEN_AT
            ),
            "fixed": counts["fixed"],
            "fixed_sees": plan.sees(nothing + plan.added[other].sum(axis=0), whole, SEEN_AT),
        }
    return row


def least(plan: next_visits.Plan, nothing: np.ndarray, rounds: float) -> float:
    """The fewest visits to the u of the full plan's `FULL` where that share of them goes round: by
    multiplicative steps of the c-optimal design of the others.
    """
    own, chosen = slice(plan.q), np.full(len(plan.added), 1 / len(plan.added))
    for _ in range(1000):
        each = rounds * plan.of_round + (1 - rounds) * np.tensordot(chosen, plan.added, axes=(0, 0))
        information = (nothing + FULL * each)[own, own]
        size = np.sqrt(np.maximum(np.diag(information), 1e-300))
        unit = information / np.outer(size, size) + next_visits.RIDGE * np.eye(plan.q)
        along = np.linalg.solve(unit, np.eye(plan.q)[plan.target] / size) / size
        chosen *= np.sqrt([along @ a[own, own] @ along for a in plan.added])
        chosen /= chosen.sum()
    wanted = float(plan.u(nothing + FULL * plan.of_round))
    return float(brentq(lambda n: float(plan.u(nothing + n * each)) - wanted, 1.0, 1e5))


def coefficient(boundary: str, seed: int) -> dict[str, Any]:
    """Visits until u of the first coefficient is what the full plan has after `FULL`."""
    pool = Pool(Spec(boundary=boundary, visits=MOST // 3, sessions=1, errors=Errors()), seed)
    order, counts = counted(pool, seed, ROUNDS)
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


def planned(stage: SearchProblem, z_hat: np.ndarray, rounds: float) -> next_visits.Plan:
    menu = next_visits.menu(stage.data, z_hat)
    return next_visits.plan(stage, next_visits.of_coefficient(stage.base_fit, 0), menu, rounds)


def _first(reached: Callable[[int], bool], most: int) -> int:
    """The least number of visits that reaches it; `most` where none does."""
    low, high = 2, most
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if reached(middle) else (middle, high)
    return high


def supply(boundary: str, seed: int) -> dict[str, Any]:
    """Visits until supply_sag stands beyond gain_drift, on one battery that falls: of the full
    plan, and of one planned anew every batch.
    """
    del boundary
    spec = Spec(boundary="ground", visits=100, sessions=1, errors=Errors(), every=2)
    pool, most = Pool(spec, seed), 300
    row: dict[str, Any] = {}
    for how in ("full", "next"):
        rng = stream(seed, "parted")
        whole = full(len(pool.z_hat), most, rng)
        order, settings = whole[:FEW], np.full(FEW, np.nan)
        ahead, volts = np.zeros(0, dtype=int), np.zeros(0)
        while True:
            data = pool.run(order, settings)
            factor = (data.covariates["supply_V"] / VOLTS) ** EXPONENT
            data = dataclasses.replace(data, lift_N=data.lift_N * factor)
            stage = known(data, pool, ("supply_sag", "gain_drift"))
            one, other = (
                search(stage.candidate(e), stage.starts, stage.log_lift) for e in stage.effects
            )
            apart = 2 * (evidence(one) - evidence(other))
            if abs(apart) > APART or len(order) >= most:
                break
            if how == "full":
                order = whole[: len(order) + EVERY]
                settings = np.full(len(order), np.nan)
                continue
            if not len(ahead):
                question = next_visits.of_rivals(
                    stage,
                    (one.candidate.effects, one.vector),
                    (other.candidate.effects, other.vector),
                )
                menu = next_visits.menu(stage.data, pool.z_hat, move_supply=True)
                picks = next_visits.plan(stage, question, menu, ROUNDS).batch(BATCH, rng)
                ahead, volts = menu.station[picks], menu.supply_V[picks] / VOLTS - 1
            order, ahead = np.append(order, ahead[:EVERY]), ahead[EVERY:]
            settings, volts = np.r_[settings, volts[:EVERY]], volts[EVERY:]
        row |= {how: len(order), f"{how}_wrong": apart < -APART, f"{how}_open": abs(apart) <= APART}
    return row


def evidence(fitted: Fitted, form_sd: float = FORM_SD) -> float:
    """Log evidence of a fit with its form uncertain, as the search has it."""
    form_discrepancy = fitted.space.project(
        fitted.candidate.form_discrepancy(fitted.vector, form_sd).T
    ).T
    basis = framed(orthonormal(np.hstack([fitted.jacobian, form_discrepancy])))
    here = Linearised(
        fitted=fitted,
        jacobian=basis.T @ fitted.jacobian,
        form_discrepancy=basis.T @ form_discrepancy,
    )
    return LinearFit(here=here, basis=basis, rest=basis[:, :0], random_walk_gain=0.0).log


KINDS = {"coefficient": coefficient, "stations": stations, "supply": supply}


def rows(kind: str, count: int, seed: int, out: Path) -> None:
    """Append a row per campaign, boundaries in turn; what stands there already is not run again."""
    done = (
        {json.loads(line)["seed"] for line in out.read_text().splitlines()} if out.exists() else ()
    )
    for i in range(count):
        if seed + i in done:
            continue
        boundary = (DESIGNS if kind == "stations" else ("ground", "ceiling", "sidewall"))[i % 3]
        try:
            row = KINDS[kind](boundary, seed + i)
        except Unreachable:
            continue
        with out.open("a") as sink:
            sink.write(
                json.dumps({"kind": kind, "seed": seed + i, "boundary": boundary} | row) + "\n"
            )


def tabulate(path: Path) -> str:
    """Medians with quartiles, and shares with their exact 95 % intervals, by boundary."""
    read = [json.loads(line) for line in path.read_text().splitlines()]
    lines = []
    for boundary in (
        dict.fromkeys(r["boundary"] for r in read) if read[0]["kind"] != "supply" else ("",)
    ):
        mine = [r for r in read if boundary in ("", r["boundary"])]
        parts = []
        for name in read[0]:
            values = [r[name] for r in mine if r[name] is not None]
            if isinstance(values[0], bool):
                k = binomtest(sum(values), len(values)).proportion_ci(0.95)
                parts.append(f"{name} {sum(values)} of {len(values)} ({k.low:.3f} to {k.high:.3f})")
            elif not isinstance(values[0], str) and name != "seed":
                low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
                parts.append(f"{name} {middle:.4g} ({low:.4g} to {high:.4g})")
        lines.append(f"{boundary} n={len(mine)}: " + "; ".join(parts))
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("kind", choices=tuple(KINDS))
    parser.add_argument("--count", type=int, default=99)
    parser.add_argument("--seed", type=int, default=820_000)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tabulate", action="store_true")
    given = parser.parse_args()
    if not given.tabulate:
        rows(given.kind, given.count, given.seed, given.out)
    print(tabulate(given.out))
