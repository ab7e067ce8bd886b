"""Comparison of many campaigns: shared errors stay shared; table, file and picture agree."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from . import small_run

SHARED = "load cell linearity"


def write(out, name, value, u, verdict="adequate", boundary="ground", linearity=None):
    """What a finished run leaves of its headline coefficient."""
    ends = {
        f"{end}{level}": value + sign * k * u
        for level, k in ((68, 1.0), (90, 1.645), (95, 1.96))
        for end, sign in (("lo", -1), ("hi", 1))
    }
    own = {"value": value, "u": u, "dof": 40.0, "unit": "1", "holds": "All.", "budget": [], **ends}
    if linearity is not None:
        line = {"source": SHARED, "type": "B", "u_without": u, "scope": "campaign"}
        own["budget"] = [line | {"u": abs(linearity), "sensitivity": linearity}]
    found = {"verdict": verdict, "base_model": "sanchez_cuevas", "coefficients": {"K_b": own}}
    folder = out / "processed" / name
    folder.mkdir(parents=True)
    content = {"schema": "nearlift.results/1", "boundaries": {boundary: found}}
    (folder / "results.json").write_text(json.dumps(content))


def compare(out, *words):
    """The groups of comparison.json, and what was printed."""
    answer = small_run.nearlift("compare", "--out", out, *words)
    assert answer.exit_code == 0, answer.output
    content = json.loads((out / "reports" / "comparison" / "comparison.json").read_text())
    return content["groups"], answer.output


def mean(out, *words):
    [group], _ = compare(out, *words)
    return group["population"]["mean"]


@pytest.fixture
def four(tmp_path):
    for i, value in enumerate((1.9, 2.0, 2.1, 2.0)):
        write(tmp_path, f"c{i}", value, 0.1, linearity=0.08)
    return tmp_path


def test_campaigns_of_one_coefficient_make_a_population(four):
    [group], text = compare(four)
    assert [own["campaign"] for own in group["campaigns"]] == ["c0", "c1", "c2", "c3"]
    assert group["population"]["mean"]["value"] == pytest.approx(2.0, abs=0.01)
    assert group["population"]["p_value"] > 0.1
    assert "population mean" in text
    assert "forest.pdf" in text


def test_what_all_share_does_not_average_down(four, tmp_path_factory):
    together = mean(four, "--shared", SHARED)["u"]
    assert together > 1.2 * mean(four)["u"]
    assert together > 0.08
    # the sign of a sensitivity counts: two that err against each other leave their mean alone
    other = tmp_path_factory.mktemp("signs")
    for i, sign in enumerate((1, 1, -1, -1)):
        write(other, f"c{i}", 2.0, 0.1, linearity=0.08 * sign)
    assert mean(other, "--shared", SHARED)["u"] < mean(other)["u"]


def test_a_finished_run_names_what_may_be_shared(tmp_path):
    """The file is read as the stage writes it, not only as this test does."""
    raw = small_run.write(tmp_path / "raw", form="parquet", visits=2)
    for stage in ("ingest", "fit"):
        assert small_run.nearlift(stage, raw, "--out", tmp_path, "-q").exit_code == 0
    answer = small_run.nearlift("compare", "--out", tmp_path, "--shared", "the moon")
    assert "there are: 'distance datum', 'load cell linearity'" in answer.output


def test_what_is_pooled_is_what_is_quoted_and_equal_campaigns_are_said(tmp_path):
    verdicts = ("effect", "unexplained", "unexplained")
    for i, value in enumerate((1.8, 2.0, 2.0)):
        write(tmp_path, f"c{i}", value, 0.05 * (i + 1 - i // 2), verdict=verdicts[i])
    [group], text = compare(tmp_path)
    assert [own["quoted"]["value"] for own in group["campaigns"]] == [1.8, 2.0, 2.0]
    assert [own["quoted"]["u"] for own in group["campaigns"]] == pytest.approx([0.05, 0.1, 0.1])
    assert [own["verdict"] for own in group["campaigns"]] == [*verdicts]
    told = "c1, c2 agree to the last digit: if they are the same trials, compare only one of them"
    assert told in group["remarks"]
    assert told in text


def test_a_spread_of_three_depends_on_its_prior_and_of_many_it_does_not(tmp_path):
    values = np.random.default_rng(3).normal(2.0, 0.3, 24).tolist()
    groups = []
    for n in (3, 24):
        for i, value in enumerate(values[:n]):
            write(tmp_path / str(n), f"c{i}", value, 0.1)
        groups += compare(tmp_path / str(n))[0]
    three, many = groups
    assert any("its prior counts" in remark for remark in three["remarks"])
    doubled, plain = (
        three["population"]["spread_prior"]["mean_if_doubled"],
        three["population"]["mean"],
    )
    assert doubled["hi90"] - doubled["lo90"] > plain["hi90"] - plain["lo90"]
    assert many["remarks"] == []


def test_boundaries_are_not_mixed_and_two_campaigns_are_only_listed(four):
    write(four, "d0", 0.1, 0.01, boundary="ceiling")
    groups, _ = compare(four)
    assert [(g["boundary"], len(g["campaigns"]), "population" in g) for g in groups] == [
        ("ceiling", 1, False),
        ("ground", 4, True),
    ]


def test_the_table_of_the_picture_is_what_the_file_says_each_time(four):
    [group], _ = compare(four, "c1", "c2", "c3")
    folder = four / "reports" / "comparison"
    with (folder / "forest.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["label"] for row in rows] == ["c1", "c2", "c3", "population mean", "next campaign"]
    upper = group["population"]["mean"]["hi90"]
    assert float(rows[3]["hi90"]) == pytest.approx(upper, rel=1e-8)
    for kind in ("pdf", "png"):
        assert (folder / f"forest.{kind}").stat().st_size > 5000
    before = {p: p.read_bytes() for p in folder.iterdir()}
    compare(four, "c1", "c2", "c3")
    assert before == {p: p.read_bytes() for p in folder.iterdir()}


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("c9",), "is not fitted (1 of 1 campaigns)"),
        (("--shared", "the moon"), f"there are: '{SHARED}'"),
        (("--out", "{empty}"), "holds no fitted campaign"),
    ],
)
def test_what_is_not_there_is_refused(four, tmp_path_factory, words, why):
    words = [word.format(empty=tmp_path_factory.mktemp("empty")) for word in words]
    answer = small_run.nearlift("compare", "--out", four, *words)
    assert answer.exit_code == 2
    assert why in answer.output
