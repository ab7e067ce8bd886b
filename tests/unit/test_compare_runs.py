"""Two runs side by side: nothing where nothing changed; what changed is named, and the shift is in
units of u.
"""

from __future__ import annotations

import json
import shutil

import pytest

from .small_run import nearlift, write_means


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    campaign = write_means(folder / "campaign", 24, quick=True)
    (folder / "a").mkdir()
    for stage in ("ingest", "reduce", "fit"):
        done = nearlift(stage, campaign, "--out", folder / "a", "--executor", "serial", "-q")
        assert done.exit_code in (0, 3), done.output
    return folder, campaign


def compare(*words):
    return json.loads(nearlift("compare-runs", *words, "--json").output)


def test_the_same_run_twice_differs_in_nothing(runs, tmp_path):
    folder, _ = runs
    shutil.copytree(folder / "a", tmp_path / "b")
    found = compare(folder / "a", tmp_path / "b" / "processed" / "means")
    assert [
        len(found[p])
        for p in ("inputs", "manifest", "options", "versions", "code", "products", "trials")
    ] == [0] * 7
    assert all(c["shift"] == 0 for c in found["coefficients"])
    assert found["coefficients"]
    text = nearlift("compare-runs", folder / "a", tmp_path / "b").output
    assert "inputs: the same" in text
    assert "manifest: the same values" in text
    assert "->" not in text


def test_what_changed_is_named_and_the_shift_is_in_units_of_u(runs, tmp_path):
    folder, campaign = runs
    other = tmp_path / "campaign"
    shutil.copytree(campaign, other)
    lines = (other / "trials.csv").read_text().splitlines()
    name, boundary, z, throttle, lift = lines[3].split(",")
    lines[3] = ",".join((name, boundary, z, throttle, f"{1.01 * float(lift):.3f}"))
    (other / "trials.csv").write_text("\n".join(lines) + "\n")
    manifest = other / "campaign.toml"
    manifest.write_text(manifest.read_text().replace('mass = "27 g"', 'mass = "28 g"'))
    for stage in ("ingest", "reduce", "fit"):
        nearlift(stage, other, "--out", tmp_path / "b", "--executor", "serial", "--seed", "3", "-q")
    found = compare(folder / "a", tmp_path / "b")
    assert set(found["inputs"]) == {"campaign.toml", "trials.csv"}
    assert list(found["manifest"]) == ["[vehicle]"]
    assert found["options"] == {"seed": [0, 3]}
    assert found["versions"] == {}
    assert {"trials.parquet", "lift.parquet", "fit.json"} <= set(found["products"])
    before, after = (
        json.loads((f / "processed/means/fit.json").read_text())
        for f in (folder / "a", tmp_path / "b")
    )
    own = next(c for c in found["coefficients"] if c["name"] == "K_b")
    one, two = (
        f["boundaries"]["ground"]["sanchez_cuevas"]["parameters"]["K_b"] for f in (before, after)
    )
    assert own["shift"] == pytest.approx(two["value"] - one["value"])
    assert own["shift"] != 0
    assert own["shift_in_u"] == pytest.approx(own["shift"] / one["u"])
    text = nearlift("compare-runs", folder / "a", tmp_path / "b").output
    assert "seed: 0 -> 3" in text
    assert "ground K_b  " in text
    assert " u\n" in text
    assert found["manifest_values"] == {"vehicle.mass": ["'27 g'", "'28 g'"]}
    assert "  vehicle.mass: '27 g' -> '28 g'" in text
    assert "inputs: 2 differ, 0 the same: campaign.toml, trials.csv (--digests)" in text
    assert text.index("ground K_b") < text.index("vehicle.mass") < text.index("inputs:")
    sha = found["inputs"]["trials.csv"][0][:12]
    assert sha not in text
    whole = nearlift("compare-runs", folder / "a", tmp_path / "b", "--digests").output
    assert f"  trials.csv: {sha} -> " in whole
    assert found["errors"] == {"ground": [None, None]}


def test_a_kept_run_is_set_beside_a_finished_one(runs, tmp_path):
    folder, _ = runs
    shutil.copytree(folder / "a", tmp_path / "a")
    (kept,) = (tmp_path / "a/processed/means/history").iterdir()
    found = compare(kept, tmp_path / "a")
    assert [c["shift"] for c in found["coefficients"]] == [0]
    assert found["manifest_values"] == {}
    assert found["inputs"] == {}
    text = nearlift("compare-runs", kept, tmp_path / "a").output
    assert "(kept)" in text
    assert "a kept run has no digests" in text
    shutil.rmtree(kept)
    found = compare(folder / "a", tmp_path / "a")
    assert found["manifest_values"] is None
    (tmp_path / "a/processed/means/results.json").write_text('{"schema": "nearlift.results/1"')
    damaged = nearlift("compare-runs", folder / "a", tmp_path / "a")
    assert damaged.exit_code == 4
    assert "is damaged" in damaged.output


def test_a_folder_without_a_run_or_with_several_is_refused(runs, tmp_path):
    folder, _ = runs
    empty = nearlift("compare-runs", folder / "a", tmp_path)
    assert empty.exit_code == 2
    assert "holds no finished run" in empty.output
    shutil.copytree(folder / "a", tmp_path / "two")
    shutil.copytree(
        tmp_path / "two" / "processed" / "means", tmp_path / "two" / "processed" / "again"
    )
    several = nearlift("compare-runs", folder / "a", tmp_path / "two")
    assert several.exit_code == 2
    assert "holds 2 finished runs" in several.output
