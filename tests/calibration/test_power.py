"""Predictions of `nearlift design` against the loop's answers to simulated campaigns of that plan.

``python -m tests.calibration.test_power --count N --effects EFFECT,EFFECT`` prints the rows of
docs/stages/design.md for N campaigns each.
"""

import dataclasses
import functools
import json
from collections import Counter

import numpy as np
import pytest
from tests.calibration import programs
from tests.calibration.figures import clopper_pearson
from tests.unit.manifests import CRAZYFLIE, RIG

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.loop.diagnose import diagnose
from nearlift.loop.expected_noise import planned
from nearlift.loop.power import size_parameters
from nearlift.loop.search_problem import Options
from nearlift.observed import observe
from nearlift.planning.plans import plan, scatter
from nearlift.run.workers import ordered

K_B = 2.0
#: Sizes, in units of the detection limit.
SIZES = (0.6, 1.0, 1.6)
EFFECTS = ("supply_sag", "height_offset", "session_gain", "reynolds")
MANIFEST = {
    "schema": "nearlift.campaign/1",
    "name": "planned",
    "vehicle": CRAZYFLIE,
    "rig": RIG,
    "records": {"reader": "means"},
    "design": {
        "distances": {"ground": [f"{mm} mm" for mm in (26, 30, 35, 42, 52, 66, 92, 138, 207, 265)]},
        "throttles": ["25 percent", "50 percent", "75 percent", "92 percent"],
        "lift": ["10.9 gf", "24.4 gf", "41.7 gf", "56.2 gf"],
        "visits": 8,
        "sessions": 5,
        "supply": ["4.05 V", "3.75 V"],
        "temperature": ["293 K", "296 K"],
        "noise": {"relative": "0.4 percent", "force": "0.3 mN", "height": "0.05 mm"},
    },
}


class Bench:
    """A plan, its forecast, and campaigns of it: 320 trials near the ground, noise as planned,
    drawn here and not by the forecast.
    """

    def __init__(self):
        campaign = manifests.parse(MANIFEST)
        self.data = observe(plan(campaign, None, 1).table, campaign, "ground")
        self.base = catalogue.model("sanchez_cuevas")
        self.noise, theta = scatter(campaign), np.array([K_B])
        self.design, _, _ = planned(self.data, self.base, (), self.noise, Options(), theta)

    def draw(self, size_parameter, size, seed):
        rng, searched = np.random.default_rng([seed, 77]), self.design.problem
        data, effect = searched.data, size_parameter.effect
        candidate = searched.candidate(effect)
        if candidate.by_session.any():
            draw = rng.normal(size=int(data.session.max()) + 1)
            signal = np.log1p(size * (draw - draw.mean()) / draw.std())[data.session]
        else:
            signal = candidate.contribution(self.design.vector(size_parameter, size), effect)
        jitter_m = rng.normal(0, self.noise.height_m, data.visit.max() + 1)[data.visit]
        geometry = {k: data.geometry[k] for k in self.base.needs}
        ratio = self.base(data.z_hat + jitter_m / data.radius_m, K_b=K_B, **geometry)
        lift = data.covariates["lift_inf_N"] * ratio * np.exp(signal)
        lift = lift * (1 + self.noise.relative * rng.normal(size=data.n))
        lift = lift + self.noise.force_N * rng.normal(size=data.n)
        return dataclasses.replace(self.data, lift_N=lift)

    def row(self, executor, name, factor, count, confirm):
        """The forecast for one size, and what the loop said of `count` campaigns."""
        size_parameter = size_parameters(catalogue.effect(name))[0]
        size = factor * self.design.limit(size_parameter)
        contest = self.design.contest(size_parameter, size)
        got, rivals = Counter(seen=0, within=0, alone=0), Counter()
        jobs = [(name, size, seed, confirm) for seed in range(count)]
        for answer in ordered(executor, said, jobs):
            named = {e["name"] for e in answer["effects"]}
            others = {r for e in answer["effects"] for r in e["rivals"]}
            got["seen"] += answer["verdict"] != "adequate"
            got["within"] += name in named | others
            got["alone"] += named == {name} and not others
            rivals.update((named | others) - {name})
        return {
            "effect": name,
            "unit": size_parameter.parameter.unit,
            "factor": factor,
            "size": size,
            "n": count,
            "predicted": {k: getattr(contest, k) for k in got},
            "counted": got,
            "rivals_predicted": dict(Counter(contest.rivals).most_common()),
            "rivals_counted": dict(rivals.most_common()),
        }


@functools.cache
def bench():
    """The one bench, made once in every process."""
    return Bench()


def said(job):
    """What the loop says of one campaign: effect, size, seed, and whether to confirm."""
    name, size, seed, confirm = job
    drawn = bench().draw(size_parameters(catalogue.effect(name))[0], size, 1000 + seed)
    return diagnose(drawn, bench().base, (), Options(seed=seed), confirm=confirm).findings.content


@pytest.mark.calibration
@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("factor", SIZES)
def test_the_chance_to_see_is_as_predicted(executor, name, factor):
    """60 campaigns: the forecast within the 99.5 % interval, widened by 5 % since each campaign has
    to estimate its noise floor.
    """
    found = bench().row(executor, name, factor, 60, confirm=False)
    low, high = clopper_pearson(found["counted"]["seen"], found["n"], 0.995)
    assert low - 0.05 <= found["predicted"]["seen"] <= high + 0.05


@pytest.mark.calibration
def test_predicted_rivals_are_the_ones_that_come(executor):
    """At 1.6 limits: an effect predicted in half the campaigns or more comes in a fifth or more,
    and no other in half.
    """
    for name in EFFECTS:
        found = bench().row(executor, name, 1.6, 60, confirm=False)
        for rival, chance in found["rivals_predicted"].items():
            if chance > 0.5:
                assert found["rivals_counted"].get(rival, 0) > 12, (name, rival)
        for rival, count in found["rivals_counted"].items():
            if count > 30:
                assert found["rivals_predicted"].get(rival, 0.0) > 0.2, (name, rival)


def main():
    """Print the rows."""
    parser = programs.parser(__doc__, 0, 60)
    parser.add_argument("--effects", default=",".join(EFFECTS))
    parser.add_argument(
        "--confirm", action="store_true", help="with held-out visits, as `nearlift diagnose` does"
    )
    given = parser.parse_args()
    with programs.opened(given.executor) as executor:
        for name in given.effects.split(","):
            for factor in SIZES:
                row = bench().row(executor, name, factor, given.count, given.confirm)
                print(json.dumps(row), flush=True)


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.test_power import main as run_main

    run_main()
