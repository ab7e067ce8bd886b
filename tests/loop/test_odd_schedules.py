"""Whatever a schedule holds, a fit and a diagnosis of it answer, or say what is missing and how
much would be enough.
"""

import dataclasses
import re

import numpy as np
import pytest
from tests.unit.simulated import campaign

from nearlift import catalogue
from nearlift.errors import NearliftError
from nearlift.fit import profiles
from nearlift.fit.deletion import influence
from nearlift.fit.least_squares import fit
from nearlift.loop.diagnose import Options, diagnose

GROUND = catalogue.model("sanchez_cuevas")


def logged(data, numeric=0):
    """The trials with everything logged that any effect asks for, and so many numeric columns of no
    meaning.
    """
    rng = np.random.default_rng(data.n + numeric)
    more = {
        "pressure_Pa": 1e5 + 200 * rng.random(data.n),
        "humidity": 0.4 + 0.1 * rng.random(data.n),
    }
    more |= {
        "current_A": 2 + rng.random(data.n),
        "speed_Hz": 100 + rng.random(data.n),
        "power_W": 8 + rng.random(data.n),
    }
    more |= {f"column_{i}": rng.normal(size=data.n) for i in range(numeric)}
    return dataclasses.replace(data, covariates={**data.covariates, **more})


def first(data, n):
    return data.take(np.arange(n))


def changed(data, **columns):
    return dataclasses.replace(data, **columns)


def with_gaps(data):
    rng = np.random.default_rng(8)
    return changed(
        data,
        covariates={
            k: np.where(rng.random(data.n) < 0.1, np.nan, v) for k, v in data.covariates.items()
        },
    )


WHOLE = logged(campaign(11, visits=3))
LONG = logged(campaign(11, visits=8))
N = WHOLE.n
ODD = {
    "one throttle": changed(WHOLE, throttle=np.full(N, 0.5)),
    "a throttle for every two trials": changed(WHOLE, throttle=0.2 + 0.001 * (np.arange(N) // 2)),
    "one distance": changed(WHOLE, z_hat=np.full(N, 1.5)),
    "a distance for every trial": changed(
        WHOLE, z_hat=np.geomspace(1.1, 12, N), visit=np.arange(N)
    ),
    "free air alone": changed(WHOLE, z_hat=np.full(N, np.inf)),
    "half of it in free air": changed(WHOLE, z_hat=np.where(WHOLE.visit % 2, WHOLE.z_hat, np.inf)),
    "all the same": changed(
        WHOLE, z_hat=np.full(N, 1.5), throttle=np.full(N, 0.5), lift_N=np.full(N, 0.3)
    ),
    "no scatter of lift": changed(WHOLE, lift_N=np.full(N, 0.3), u_lift_N=np.zeros(N)),
    "lift of 1e12 N": changed(WHOLE, lift_N=1e12 * WHOLE.lift_N),
    "lift of 1e-100 N": changed(
        WHOLE, lift_N=1e-100 * WHOLE.lift_N, u_lift_N=1e-100 * WHOLE.u_lift_N
    ),
    "lift over eleven decades": changed(WHOLE, lift_N=np.geomspace(1e-6, 1e5, N)),
    "one session": changed(WHOLE, session=np.zeros(N, dtype=np.int64)),
    "a session for every visit": changed(WHOLE, session=WHOLE.visit),
    "a session for every trial": changed(WHOLE, session=np.arange(N)),
    "visits of one": changed(WHOLE, visit=np.arange(N)),
    "two visits": changed(WHOLE, visit=np.arange(N) * 2 // N),
    "one visit": changed(WHOLE, visit=np.zeros(N, dtype=np.int64)),
    "covariates that never change": changed(
        WHOLE, covariates={k: np.full(N, v[0]) for k, v in WHOLE.covariates.items()}
    ),
    "covariates with gaps": with_gaps(WHOLE),
    "nothing logged": changed(WHOLE, covariates={}),
    "fourteen more columns": logged(WHOLE, numeric=14),
    "order unknown": changed(WHOLE, ordered=False),
    "no effective samples": changed(WHOLE, n_eff=np.zeros(N)),
    **{f"{n} trials": first(WHOLE, n) for n in (1, 2, 5, 7, 12, 30, 45, 48, 60, 72, 80, 96)},
}


def answers(work):
    """The refusal, or None; anything else that is raised is a fault."""
    try:
        work()
    except NearliftError as refusal:
        return refusal
    return None


def fitted(data):
    found = fit(GROUND, data)
    profiles.likelihood_profiles(found)
    influence(found)


#: With pairs a search takes three times as long; half of the drawn schedules are searched so anyway.
PAIRS = [False, pytest.param(True, marks=pytest.mark.calibration)]


@pytest.mark.parametrize("pairs", PAIRS, ids=["singles", "pairs"])
@pytest.mark.parametrize("name", ODD)
def test_an_odd_schedule_is_fitted_and_diagnosed_or_refused_in_words(name, pairs):
    answers(lambda: fitted(ODD[name]))
    refusal = answers(lambda: diagnose(ODD[name], GROUND, (), Options(pairs=pairs)))
    if refusal is not None:
        assert re.search(r"\d+|two|would not help|leave out|look for", refusal.remedy), (
            refusal.remedy
        )


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.nightly
def test_drawn_schedules_are_answered(seed):
    rng = np.random.default_rng([3, seed])
    n = int(rng.integers(8, N))
    some = WHOLE.take(np.sort(rng.choice(N, n, replace=False)))
    kept = rng.choice(sorted(some.covariates), int(rng.integers(0, 11)), replace=False)
    odd = changed(
        some,
        covariates={k: some.covariates[k] * 10.0 ** rng.integers(-3, 4) for k in kept},
        throttle=rng.choice(some.levels[: rng.integers(1, 5)], n),
        session=np.sort(rng.integers(0, rng.integers(1, 9), n)),
        lift_N=some.lift_N * 10.0 ** rng.integers(-9, 9),
    )
    answers(lambda: fitted(odd))
    answers(lambda: diagnose(odd, GROUND, (), Options(pairs=seed % 2 == 0)))


@pytest.mark.parametrize("n", [48, 60, 72, 80, 96])
def test_a_few_trials_with_many_covariates_get_a_verdict(n):
    found = diagnose(first(LONG, n), GROUND, (), Options()).findings.content
    assert found["verdict"] in ("adequate", "effect", "unexplained")
    assert found["noise_floor"]["dof"] > 1
