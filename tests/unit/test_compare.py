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
    line = {"source": SHARED, "type": "B", "u_without": u, "scope": "campaign"}
    if linearity is not None:
        line |= {"u": abs(linearity), "sensitivity": linearity}
    own = {"value": value, "u": u, "dof": 40.0, "unit": "1", **ends}
    own |= {"holds": "Allows for everything.", "budget": [line] if "u" in line else []}
    found = {"verdict": verdict, "base_model": "sanchez_cuevas", "coefficients": {"K_b": own}}
    folder = out / "processed" / name
    folder.mkdir(parents=True)
    (folder / "results.json").write_text(
        json.dumps({"schema": "nearlift.results/1", "boundaries": {boundary: found}})
    )


def compare(out, *words):
    told = small_run.nearlift("compare", "--out", out, *words)
    assert told.exit_code == 0, told.output
    return json.loads((out / "reports" / "comparison" / "comparison.json").read_text()), told.output


@pytest.fixture
def four(tmp_path):
    for i, value in enumerate((1.9, 2.0, 2.1, 2.0)):
        write(tmp_path, f"c{i}", value, 0.1, linearity=0.08)
    return tmp_path


def test_campaigns_of_one_coefficient_make_a_population(four):
    content, text = compare(four)
    (group,) = content["groups"]
    assert [own["campaign"] for own in group["campaigns"]] == ["c0", "c1", "c2", "c3"]
    assert group["population"]["mean"]["value"] == pytest.approx(2.0, abs=0.01)
    assert group["population"]["p_value"] > 0.1
    assert "population mean" in text
    assert "forest.pdf" in text


def test_what_all_share_does_not_average_down(four):
    apart = compare(four)[0]["groups"][0]["population"]["mean"]
    together = compare(four, "--shared", SHARED)[0]["groups"][0]["population"]["mean"]
    assert together["u"] > 1.2 * apart["u"]
    assert together["u"] > 0.08


def test_what_pulls_two_campaigns_apart_is_told_from_what_pulls_them_along(tmp_path):
    """The sign of a sensitivity counts: two that err against each other leave their mean alone."""
    for i, sign in enumerate((1, 1, -1, -1)):
        write(tmp_path, f"c{i}", 2.0, 0.1, linearity=0.08 * sign)
    apart, together = (
        compare(tmp_path, *words)[0]["groups"][0]["population"]["mean"]["u"]
        for words in ((), ("--shared", SHARED))
    )
    assert together < apart


def test_a_finished_run_names_what_may_be_shared(tmp_path):
    """The file is read as the stage writes it, not only as this test does."""
    raw = small_run.write(tmp_path / "raw", form="parquet", visits=2)
    assert (
        small_run.nearlift("fit", raw, "--out", tmp_path, "-q").exit_code == 4
    )  # nothing ingested yet
    for stage in ("ingest", "fit"):
        assert small_run.nearlift(stage, raw, "--out", tmp_path, "-q").exit_code == 0
    told = small_run.nearlift("compare", "--out", tmp_path, "--shared", "the moon")
    assert "there are: 'distance datum', 'load cell linearity'" in told.output


def test_what_is_pooled_is_what_is_quoted(tmp_path):
    for i, value in enumerate((1.8, 2.0, 2.3)):
        write(
            tmp_path, f"c{i}", value, 0.05 * (i + 1), verdict="effect" if i == 0 else "unexplained"
        )
    (group,) = compare(tmp_path)[0]["groups"]
    assert [own["quoted"]["value"] for own in group["campaigns"]] == [1.8, 2.0, 2.3]
    assert [own["quoted"]["u"] for own in group["campaigns"]] == pytest.approx([0.05, 0.1, 0.15])
    assert [own["verdict"] for own in group["campaigns"]] == ["effect", *2 * ["unexplained"]]


def test_campaigns_that_are_one_and_the_same_are_said(tmp_path):
    for name, value in (("a", 2.0), ("b", 2.0), ("c", 2.1)):
        write(tmp_path, name, value, 0.1)
    content, text = compare(tmp_path)
    told = "a, b agree to the last digit: if they are the same trials, compare only one of them"
    assert told in content["groups"][0]["remarks"]
    assert told in text


def test_that_a_spread_of_three_hangs_on_its_prior_is_said_and_of_many_it_is_not(tmp_path):
    rng = np.random.default_rng(3)
    few, many = tmp_path / "few", tmp_path / "many"
    for i, value in enumerate(rng.normal(2.0, 0.3, 24).tolist()):
        write(many, f"c{i}", value, 0.1)
        if i < 3:
            write(few, f"c{i}", value, 0.1)
    (three,), (all_of_them,) = (compare(out)[0]["groups"] for out in (few, many))
    assert any("its prior counts" in remark for remark in three["remarks"])
    wider = three["population"]["spread_prior"]["mean_if_doubled"]
    assert (
        wider["hi90"] - wider["lo90"]
        > three["population"]["mean"]["hi90"] - three["population"]["mean"]["lo90"]
    )
    assert all_of_them["remarks"] == []


def test_boundaries_are_not_mixed_and_two_campaigns_are_only_listed(four):
    write(four, "d0", 0.1, 0.01, boundary="ceiling")
    content, _ = compare(four)
    assert [(g["boundary"], len(g["campaigns"]), "population" in g) for g in content["groups"]] == [
        ("ceiling", 1, False),
        ("ground", 4, True),
    ]


def test_the_table_of_the_picture_is_what_the_file_says(four):
    content, _ = compare(four, "c1", "c2", "c3")
    with (four / "reports" / "comparison" / "forest.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["label"] for row in rows] == ["c1", "c2", "c3", "population mean", "next campaign"]
    assert float(rows[3]["hi90"]) == pytest.approx(
        content["groups"][0]["population"]["mean"]["hi90"], rel=1e-8
    )
    for kind in ("pdf", "png"):
        assert (four / "reports" / "comparison" / f"forest.{kind}").stat().st_size > 5000


def test_the_same_campaigns_give_the_same_bytes(four):
    compare(four)
    before = {p: p.read_bytes() for p in (four / "reports").rglob("*") if p.is_file()}
    compare(four)
    assert before == {p: p.read_bytes() for p in (four / "reports").rglob("*") if p.is_file()}


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
    told = small_run.nearlift("compare", "--out", four, *words)
    assert told.exit_code == 2
    assert why in told.output
