"""Rows of the harness and their tables."""

import argparse

import numpy as np
import pytest
from scipy.stats import binom
from tests.calibration import figures, oracle
from tests.calibration.assess import assess
from tests.calibration.kinds import chosen


def row(**facts):
    null = {"kind": "null", "boundary": "ground", "truth": [], "verdict": "adequate", "failed": ""}
    widths = {"cpu_s": 1.0, "cover_quoted": True, "width_quoted": 3.0, "oracle_width": 2.0}
    return null | widths | {"rho": 0.0, "claimed": False, "named": False} | facts


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


def test_clopper_pearson_is_exact():
    assert figures.clopper_pearson(0, 10) == (0.0, pytest.approx(1 - 0.025**0.1))
    assert figures.clopper_pearson(10, 10)[1] == 1.0
    low, high = figures.clopper_pearson(12, 160)
    assert binom.sf(11, 160, low) == pytest.approx(0.025)
    assert binom.cdf(12, 160, high) == pytest.approx(0.025)


def test_figures_are_judged_by_their_interval():
    rows = [row(claimed=i < 12) for i in range(160)]
    null = figures.figures(rows).loc["null"]
    assert (null["k"], null["n"], null["passed"]) == (12, 160, True)
    rows = [row(claimed=i < 40) for i in range(160)]
    assert figures.figures(rows).loc["null", "passed"] is False
    assert "**fails**" in figures.markdown(rows)
    rows[0] = {"kind": "null", "boundary": "ground", "failed": "ValueError: no"}
    assert figures.figures(rows).loc["failed", "passed"] is False


def test_intervals_are_counted_by_campaign_and_verdict():
    strange = {"kind": "lost_steps", "truth": ["lost_steps"], "verdict": "unexplained"}
    data = figures.frame([row(), row(cover_quoted=False), row(**strange, width_quoted=8.0)])
    null, odd, every = figures.by_verdict(data).to_dict("records")
    assert [*null.values()] == ["null", "1 of 2 (1-99), 1.50", "-", "-", "1 of 2 (1-99), 1.50"]
    assert odd["unexplained"] == "1 of 1 (3-100), 4.00"
    assert every["all"] == "2 of 3 (9-99), 1.50"


def test_a_table_takes_the_place_of_its_own(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Title\n\n<!-- one -->\nold\n<!-- end of one -->\n\nText.\n")
    figures.write(page, "one", "new \\1 one")
    assert page.read_text() == (
        "# Title\n\n<!-- one -->\nnew \\1 one\n<!-- end of one -->\n\nText.\n"
    )
    with pytest.raises(AssertionError, match="has no place for two"):
        figures.write(page, "two", "second")
