"""Rows of the harness and their tables."""

import argparse

import numpy as np
import pytest
from tests.calibration import figures, oracle
from tests.calibration.assess import assess
from tests.calibration.kinds import chosen


def test_a_growing_campaign_is_analysed_until_something_is_claimed():
    analysed = []

    def answer(campaign):
        analysed.append(campaign)
        verdict = "unexplained" if campaign.data.n == 268 else "adequate"
        return {"verdict": verdict, "effects": [], "quoted": {"K_b": (-9.0, 9.0)}}

    made = assess("growing", "ground", 6, answer)
    assert [c.data.n for c in analysed] == [160, 216, 268]
    early, later = analysed[0], analysed[1]
    assert len(early.truth.log_lift) == early.keep.sum() == early.jacobian.shape[0] == 160
    assert np.array_equal(early.data.lift_N, later.data.lift_N[:160])
    assert np.isfinite(oracle.fit(early).theta["K_b"])
    wanted = {"claimed": True, "trials": 268, "cover_quoted": True, "failed": ""}
    assert made.items() >= wanted.items()
    data = figures.frame([made])
    assert figures.by_kind(data)["null: any claim"][0] == "1 of 1 (3-100)"
    assert figures.by_verdict(data)["adequate"][0] == "-"


def test_kinds_are_chosen_by_name_and_by_group():
    assert chosen("t3,records")[:2] == ("t3", "null")
    assert "ar_95" in chosen("violations")
    with pytest.raises(argparse.ArgumentTypeError, match="nonsense: no kind"):
        chosen("nonsense")


def test_figures_are_judged_by_their_interval():
    null = {"kind": "null", "boundary": "ground", "truth": [], "verdict": "adequate", "failed": ""}
    null |= {"cpu_s": 1.0, "cover_quoted": True, "width_quoted": 3.0, "oracle_width": 2.0}
    null |= {"rho": 0.0, "claimed": False, "named": False}
    for claims, passed in ((12, True), (40, False)):
        rows = [{**null, "claimed": i < claims} for i in range(160)]
        found = figures.figures(rows).loc["null"]
        assert (found["k"], found["n"], found["passed"]) == (claims, 160, passed)
    assert "**fails**" in figures.markdown(rows)
    [line, _] = figures.by_verdict(figures.frame(rows)).to_dict("records")
    assert [line["campaign"], line["adequate"]] == ["null", "160 of 160 (98-100), 1.50"]
    rows[0] = {"kind": "null", "boundary": "ground", "failed": "ValueError: no"}
    assert figures.figures(rows).loc["failed", "passed"] is False
