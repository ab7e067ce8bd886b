"""Whatever a schedule holds, a fit and a diagnosis of it answer, or say what is missing and how
much would be enough.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.simulated import GROUND, campaign

from nearlift.errors import NearliftError
from nearlift.fit import profiles
from nearlift.fit.deletion import influence
from nearlift.fit.least_squares import fit
from nearlift.loop.diagnose import Options, diagnose

#: Everything logged that any effect asks for: least value, range.
LOGGED = {
    "pressure_Pa": (1e5, 200),
    "humidity": (0.4, 0.1),
    "current_A": (2, 1),
    "speed_Hz": (100, 1),
    "power_W": (8, 1),
}


def logged(data, numeric=0):
    """The trials with `LOGGED` columns and so many numeric ones of no meaning."""
    rng = np.random.default_rng(data.n + numeric)
    more = {name: low + size * rng.random(data.n) for name, (low, size) in LOGGED.items()}
    more |= {f"column_{i}": rng.normal(size=data.n) for i in range(numeric)}
    return replace(data, covariates=data.covariates | more)


def with_gaps(data):
    rng = np.random.default_rng(8)
    return {k: np.where(rng.random(data.n) < 0.1, np.nan, v) for k, v in data.covariates.items()}


WHOLE = logged(campaign(11, visits=3))
N, Z, LIFT = WHOLE.n, WHOLE.z_hat, WHOLE.lift_N
ZEROS, ONE_EACH = np.zeros(N, dtype=np.int64), np.arange(N)
#: What is changed of a usual schedule.
CHANGES = {
    "one throttle": {"throttle": np.full(N, 0.5)},
    "a throttle for every two trials": {"throttle": 0.2 + 0.001 * (ONE_EACH // 2)},
    "one distance": {"z_hat": np.full(N, 1.5)},
    "a distance for every trial": {"z_hat": np.geomspace(1.1, 12, N), "visit": ONE_EACH},
    "free air alone": {"z_hat": np.full(N, np.inf)},
    "half of it in free air": {"z_hat": np.where(WHOLE.visit % 2, Z, np.inf)},
    "all the same": {
        "z_hat": np.full(N, 1.5),
        "throttle": np.full(N, 0.5),
        "lift_N": np.full(N, 0.3),
    },
    "no scatter of lift": {"lift_N": np.full(N, 0.3), "u_lift_N": np.zeros(N)},
    "lift of 1e12 N": {"lift_N": 1e12 * LIFT},
    "lift of 1e-100 N": {"lift_N": 1e-100 * LIFT, "u_lift_N": 1e-100 * WHOLE.u_lift_N},
    "lift over eleven decades": {"lift_N": np.geomspace(1e-6, 1e5, N)},
    "one session": {"session": ZEROS},
    "a session for every visit": {"session": WHOLE.visit},
    "a session for every trial": {"session": ONE_EACH},
    "visits of one": {"visit": ONE_EACH},
    "two visits": {"visit": ONE_EACH * 2 // N},
    "one visit": {"visit": ZEROS},
    "covariates that never change": {
        "covariates": {k: np.full(N, v[0]) for k, v in WHOLE.covariates.items()}
    },
    "covariates with gaps": {"covariates": with_gaps(WHOLE)},
    "nothing logged": {"covariates": {}},
    "order unknown": {"ordered": False},
    "no effective samples": {"n_eff": np.zeros(N)},
}
ODD = {name: replace(WHOLE, **change) for name, change in CHANGES.items()} | {
    "fourteen more columns": logged(WHOLE, numeric=14),
    **{f"{n} trials": WHOLE.take(np.arange(n)) for n in (1, 2, 5, 7, 12, 30, 45, 60, 80, 96)},
}


def refusal(work, *given):
    """The refusal, or None; anything else that is raised is a fault."""
    try:
        work(*given)
    except NearliftError as refused:
        return refused
    return None


def fitted(data):
    made = fit(GROUND, data)
    profiles.likelihood_profiles(made)
    influence(made)


#: With pairs a search takes three times as long; half of the drawn schedules are searched so anyway.
@pytest.mark.parametrize(
    "pairs", [False, pytest.param(True, marks=pytest.mark.calibration)], ids=["singles", "pairs"]
)
@pytest.mark.parametrize("name", ODD)
def test_an_odd_schedule_is_fitted_and_diagnosed_or_refused_in_words(name, pairs):
    refusal(fitted, ODD[name])
    refused = refusal(diagnose, ODD[name], GROUND, (), Options(pairs=pairs))
    if refused is not None:
        assert re.search(r"\d+|two|would not help|leave out|look for", refused.remedy)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.nightly
def test_drawn_schedules_are_answered(seed):
    rng = np.random.default_rng([3, seed])
    n = int(rng.integers(8, N))
    some = WHOLE.take(np.sort(rng.choice(N, n, replace=False)))
    kept = rng.choice(sorted(some.covariates), int(rng.integers(0, 11)), replace=False)
    odd = replace(
        some,
        covariates={k: some.covariates[k] * 10.0 ** rng.integers(-3, 4) for k in kept},
        throttle=rng.choice(some.levels[: rng.integers(1, 5)], n),
        session=np.sort(rng.integers(0, rng.integers(1, 9), n)),
        lift_N=some.lift_N * 10.0 ** rng.integers(-9, 9),
    )
    refusal(fitted, odd)
    refusal(diagnose, odd, GROUND, (), Options(pairs=seed % 2 == 0))


@pytest.mark.parametrize("n", [48, 72, 96])
def test_a_few_trials_with_many_covariates_get_a_verdict(n):
    data = logged(campaign(11, visits=8)).take(np.arange(n))
    answer = diagnose(data, GROUND, (), Options()).findings.content
    assert answer["verdict"] in ("adequate", "effect", "unexplained")
    assert answer["noise_floor"]["dof"] > 1
