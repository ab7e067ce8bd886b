"""Two rivals under a ceiling, parted by visits that are chosen as they come: how many it takes by
`loop.next_visits`, and by all stations equally often.

    python -m tests.calibration.rivals --design mm --count 120 --seed 830000 --out rivals.jsonl

The truth is a height_offset of rho 0.5, of the sign that near_wall_saturation can imitate (of the
other, the first round parts the two); a campaign ends where 2 ln B between them exceeds `APART`, or
after `MOST` visits. All visits of a station are alike but for their errors, so that the mean of its
visits says all that they say: a campaign takes a second. A row per campaign, by how the evidence is
had (`Forms`) and by plan: `full`, `next` by the share that goes round, `known` (half, chosen by who
knows the truth: what no choosing betters); visits taken, and 2 ln B then.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tests.calibration.bench import DESIGNS, stream
from tests.calibration.sequential import APART, BATCH, SHARES, begun, evidence, full
from tests.calibration.simulator import Errors, Spec, Unreachable, simulate

from nearlift import catalogue
from nearlift.declare import FloatArray
from nearlift.likelihood.covariance import Covariance
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import Problem
from nearlift.loop import next_visits
from nearlift.loop.candidate_fit import Fitted, fit, search
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.loop.starts import Starts
from nearlift.results import IntArray, Noise
from nearlift.results.diagnosis import FORM_SD

MOST = 600
#: Visits that a station without any counts as: errors 1e4 times as large.
UNSEEN = 1e-8
NAMES = ("height_offset", "near_wall_saturation")
#: Share that goes round all stations, and whether the truth is known, of each plan.
PLANS = {
    "full": (1.0, False),
    **{f"next{100 * share:.0f}": (share, False) for share in SHARES},
    "known": (0.5, True),
}


class Forms(NamedTuple):
    """How evidence is had: `sd` of the forms; or at the best fits alone, `plain`."""

    sd: float
    plain: bool


#: As the diagnosis has it; and as textbooks do, forms certain.
FORMS = {"uncertain": Forms(FORM_SD, False), "certain": Forms(0.0, True)}


@dataclass(frozen=True, kw_only=True)
class Bench:
    """One visit of every station without error, as a search problem at its true noise (`stage`),
    the errors of visits to come, (s, visits, k), and the true vector: coefficients, offset in m.
    """

    stage: SearchProblem
    errors: FloatArray
    truth: FloatArray

    @classmethod
    def of(cls, design: str, seed: int, form_sd: float) -> Bench:
        """That of a seed."""
        spec = Spec(
            boundary="ceiling",
            design=design,
            effects=((NAMES[0], 0.5),),
            visits=2,
            sessions=1,
            errors=Errors(),
        )
        made = simulate(spec, seed)
        first = [made.data.visit[made.data.z_hat == z][0] for z in np.unique(made.data.z_hat)]
        rows = np.concatenate([_by_throttle(made.data.visit, made.data.throttle, v) for v in first])
        data, scatter, stations = made.data.take(rows), made.truth.scatter, len(first)
        k = data.n // stations
        log_lift = made.truth.log_lift[rows]
        data = dataclasses.replace(
            data, visit=np.repeat(np.arange(stations), k), lift_N=np.exp(log_lift)
        )
        base = catalogue.model(catalogue.default_base("ceiling", 4))
        theta = np.array([made.truth.theta[p.name] for p in base.parameters])
        levels = made.truth.levels_N[np.searchsorted(data.levels, data.throttle)]
        stage = SearchProblem(
            data=derive(data, levels),
            base=base,
            effects=tuple(map(catalogue.effect, NAMES)),
            parts=(),
            noise=Noise(
                relative=scatter.relative, force_N=scatter.force_N, height_m=scatter.height_m
            ),
            log_lift=log_lift,
            theta=theta,
            options=Options(form_sd=form_sd),
        )
        errors = stream(seed, "visits")
        own = stage.space.covariance
        each = errors.standard_normal((stations, MOST, k)) * np.sqrt(
            own.variance.reshape(stations, 1, k)
        )
        height = errors.standard_normal((stations, MOST, 1)) * own.per_visit.reshape(stations, 1, k)
        return cls(
            stage=stage,
            errors=each + height,
            truth=np.append(theta, made.truth.amplitudes[NAMES[0]]),
        )

    @cached_property
    def summed(self) -> FloatArray:
        """Of the first so many visits, (s, visits + 1, k)."""
        return np.pad(np.cumsum(self.errors, axis=1), ((0, 0), (1, 0), (0, 0)))

    def after(self, made: IntArray) -> tuple[Problem, FloatArray]:
        """The means of so many visits of each station, (s,), and how they err."""
        n = np.maximum(np.repeat(made, self.errors.shape[2]), UNSEEN)
        own = self.stage.space.covariance
        covariance = Covariance(
            variance=own.variance / n,
            visit=own.visit,
            per_visit=own.per_visit / np.sqrt(n),
            shared=own.shared,
        )
        mean = self.summed[np.arange(len(made)), made] / np.maximum(made, 1)[:, None]
        problem = Problem(model=self.stage.base, data=self.stage.data, covariance=covariance)
        return problem, self.stage.log_lift + mean.ravel()


def _by_throttle(visit: IntArray, throttle: FloatArray, wanted: int) -> IntArray:
    rows = np.flatnonzero(visit == wanted)
    return rows[np.argsort(throttle[rows])]


def parted(
    bench: Bench, forms: Forms, rotating: float, truth: bool, seed: int
) -> tuple[int, float]:
    """Visits that a plan takes, and 2 ln B of the truth over its rival then."""
    stage, stations = bench.stage, len(bench.errors)
    rng = stream(seed, "parted")
    whole = full(stations, MOST, rng)
    candidates = [stage.candidate(e) for e in stage.effects]
    order = whole[:stations] if rotating == 1 else begun(stations, rng)
    fits: list[Fitted] = []
    while True:
        made = np.bincount(order, minlength=stations)
        space, y = bench.after(made)
        fits = [
            fit(c, space, y, f.vector)
            if f
            else search(c, Starts(space, stage.candidate(), stage.theta), y)
            for c, f in zip(candidates, fits or (None, None), strict=True)
        ]
        apart = 2 * (_evidence(fits[0], forms, len(order)) - _evidence(fits[1], forms, len(order)))
        # before that, trials are too few for a diagnosis
        if (abs(apart) > APART and len(order) >= stations) or len(order) >= MOST:
            return len(order), apart
        if rotating == 1:
            order = whole[: len(order) + BATCH]
            continue
        one, other = (f.vector for f in fits)
        if truth:
            one = bench.truth
            other = fit(candidates[1], space, stage.log_lift, other).vector
        question = next_visits.of_rivals(
            stage, (stage.effects[:1], one), (stage.effects[1:], other)
        )
        menu = next_visits.menu(stage.data, np.unique(stage.data.z_hat))
        plan = next_visits.plan(stage, question, menu, rotating)
        plan = dataclasses.replace(
            plan,
            now=plan.now + np.tensordot(made - 1, plan.added, axes=(0, 0)),
            made=made,
            last=int(order[-1]),
        )
        order = np.append(order, menu.station[plan.batch(BATCH, rng)])


def _evidence(fitted: Fitted, forms: Forms, visits: int) -> float:
    if forms.plain:
        return -0.5 * (fitted.chi2 + fitted.penalty)
    # every unknown costs by the number of trials, of which the means stand for many
    of_effects = len(fitted.vector) - len(fitted.candidate.entries_of(""))
    stations = len(np.unique(fitted.candidate.data.visit))
    return evidence(fitted, forms.sd) - 0.5 * of_effects * float(np.log(visits / stations))


def rows(design: str, count: int, seed: int, out: Path) -> None:
    """Append a row per campaign whose offset can be imitated."""
    done = (
        {json.loads(line)["seed"] for line in out.read_text().splitlines()} if out.exists() else ()
    )
    for own in range(seed, seed + count):
        try:
            if own in done or Bench.of(design, own, 0.0).truth[-1] < 0:
                continue
        except Unreachable:
            continue
        row: dict[str, object] = {"seed": own, "design": design}
        for forms, had in FORMS.items():
            bench = Bench.of(design, own, had.sd)
            for plan, (rotating, truth) in PLANS.items():
                row[f"{forms} {plan}"] = parted(bench, had, rotating, truth, own)
        with out.open("a") as sink:
            sink.write(json.dumps(row) + "\n")


def tabulate(path: Path) -> str:
    """Medians with quartiles, their ratio to the full plan's with a bootstrap's 95 % interval, how
    many are open at the end and how many parted wrongly.
    """
    read = [json.loads(line) for line in path.read_text().splitlines()]
    rng, lines = np.random.default_rng(0), [f"{len(read)} campaigns"]
    for forms in FORMS:
        whole = np.array([r[f"{forms} full"][0] for r in read])
        for plan in PLANS:
            visits, apart = np.array([r[f"{forms} {plan}"] for r in read]).T
            picks = rng.integers(len(read), size=(4000, len(read)))
            ratio = np.median(visits[picks], axis=1) / np.median(whole[picks], axis=1)
            low, high = np.quantile(ratio, (0.025, 0.975))
            quartiles = " ".join(f"{q:.0f}" for q in np.quantile(visits, (0.25, 0.5, 0.75)))
            lines.append(
                f"{forms} {plan}: {quartiles}; {np.median(visits) / np.median(whole):.2f}"
                f" ({low:.2f} to {high:.2f}); open {np.sum(np.abs(apart) <= APART)},"
                f" wrong {np.sum(apart < -APART)}"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--design", choices=DESIGNS, default="mm")
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--seed", type=int, default=830_000)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tabulate", action="store_true")
    given = parser.parse_args()
    if not given.tabulate:
        rows(given.design, given.count, given.seed, given.out)
    print(tabulate(given.out))
