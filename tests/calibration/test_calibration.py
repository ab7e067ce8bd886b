"""The promises of docs/calibration.md on simulated records. Slow: `make calibrate`, or pytest -m
calibration.

NEARLIFT_CALIBRATION_N campaigns of each kind (201), boundaries in turn. A promise counts as broken
only where the whole 95 % interval of its figure lies on the wrong side, so an engine that just
keeps it fails here once in forty.
"""

from __future__ import annotations

import os
from functools import partial

import pytest
from scipy.stats import binomtest
from tests.calibration.assess import engine
from tests.calibration.figures import figures, markdown
from tests.calibration.harness import score
from tests.calibration.kinds import KINDS, REPORTED

pytestmark = pytest.mark.calibration
N = int(os.environ.get("NEARLIFT_CALIBRATION_N", "201"))
SEEDS = range(REPORTED, REPORTED + N)
PROMISED = {
    "null": "null worse",
    "weak": "weak_seen worse",
    "one": "one_right one_inside one_wrong foreign_right foreign_inside gain worse cover_quoted",
    "two": "two_inside worse",
    "outside": "outside_faint outside_loud worse",
    "within": "worse",
    **{k.name: " ".join(f"{k.name}_{a}" for a in k.asks) for k in KINDS.values() if k.asks},
}


@pytest.mark.parametrize("kind", PROMISED)
def test_promises_hold(executor, kind):
    rows = score(executor, kind, SEEDS)
    print(markdown(rows))
    made = figures(rows)
    assert made.loc["failed", "k"] == 0, [r["failed"] for r in rows if r["failed"]]
    assert {*PROMISED[kind].split(), "time"} <= {*made.index}
    broken = made[made["passed"].eq(False)]
    assert broken.empty, broken[["title", "value", "lo95", "hi95", "n"]].to_string()


def test_heating_is_found_in_records(executor):
    made = figures(score(executor, "within", SEEDS[: max(N // 3, 12)]))
    assert made.loc["within_seen", "hi95"] >= 0.8


def test_at_a_level_of_one_half_nulls_are_accused(executor):
    """The test must notice a broken engine."""
    broken = partial(engine, false_alarm_rate=0.5, confirm=False)
    made = figures(score(executor, "null", SEEDS[: max(N // 3, 30)], broken))
    assert made.loc["null", "passed"] is False


def test_without_form_uncertainty_strange_forms_are_missed(executor):
    """Paired: same campaigns, all of foreign form; kept means truth within the set and the
    coefficient within its interval.
    """
    seeds = [s for s in range(REPORTED, REPORTED + 9 * N) if s // 3 % 3 == 2][:N]
    granted, denied = (
        [r["inside"] and r["cover_quoted"] for r in score(executor, "one", seeds, diagnose)]
        for diagnose in (
            partial(engine, confirm=False),
            partial(engine, confirm=False, form_sd=0.0),
        )
    )
    pairs = list(zip(granted, denied, strict=True))
    lost, won = pairs.count((True, False)), pairs.count((False, True))
    assert binomtest(lost, lost + won, alternative="greater").pvalue < 0.05, (lost, won)
