"""Several campaigns in one command: each as it would be alone, wherever it runs, and one refused
does not stop the others.
"""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from . import small_run


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two campaigns of another name each."""
    home = tmp_path_factory.mktemp("many")
    first = small_run.write(home / "one", form="parquet", visits=2)
    second = home / "two"
    shutil.copytree(first, second)
    manifest = second / "campaign.toml"
    manifest.write_text(manifest.read_text().replace(f'"{small_run.NAME}"', '"other"', 1))
    return first, second


@pytest.fixture(scope="module")
def alone(folders, tmp_path_factory):
    out = tmp_path_factory.mktemp("alone")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nearlift.report.figures.files.render", small_run.undrawn)
        told = small_run.nearlift("run", *folders, "--out", out, "--executor", "serial", "--json")
    return out, told


KEPT = {"trials.parquet", "lift.parquet", "fit.json", "diagnosis.json"}


def products(out):
    return {
        p.relative_to(out): p.read_bytes()
        for p in sorted((out / "processed").rglob("*"))
        if p.name in KEPT
    }


def test_each_ends_as_it_would_alone(alone):
    _, told = alone
    assert told.exit_code == 0, told.output
    ends = json.loads(told.output.splitlines()[-1])["campaigns"]
    assert [end["campaign"] for end in ends] == [small_run.NAME, "other"]
    assert all(end["ran"] and end["exit_code"] == 0 for end in ends)
    assert all(end["cpu_s"] > 0 and end["wall_s"] > 0 for end in ends)


def test_whole_campaigns_in_processes_give_the_same_products(alone, folders, tmp_path):
    told = small_run.nearlift("run", *folders, "--out", tmp_path, "--executor", "processes:2")
    assert told.exit_code == 0, told.output
    assert len(products(tmp_path)) == 2 * len(KEPT)
    assert products(tmp_path) == products(alone[0])


def everything(out):
    """All but the wall times in provenance.json and the stamps of the inputs."""
    files = [
        p
        for p in sorted(out.rglob("*"))
        if p.is_file() and not p.name.startswith(("provenance", "inputs-cache", "."))
    ]
    return {p.relative_to(out).as_posix(): p.read_bytes() for p in files}


def test_a_cluster_gives_the_same_bytes(
    alone, folders, tmp_path, monkeypatch, cluster, plain_pictures
):
    """Scheduler and workers stand in other folders than the command; whole campaigns, then the
    records of one, go to them.
    """
    address, _ = cluster
    (tmp_path / "desk").mkdir()
    monkeypatch.chdir(tmp_path / "desk")
    given = [os.path.relpath(folder) for folder in folders]
    told = small_run.nearlift("run", *given, "--executor", f"dask:{address}")
    assert told.exit_code == 0, told.output
    assert everything(Path()).keys() == everything(alone[0]).keys()
    assert [
        name
        for name, content in everything(Path()).items()
        if content != everything(alone[0])[name]
    ] == []
    told = small_run.nearlift("ingest", given[0], "--out", "one", "--executor", f"dask:{address}")
    assert told.exit_code == 0, told.output
    trials = Path("processed", small_run.NAME, "trials.parquet")
    assert Path("one", trials).read_bytes() == (alone[0] / trials).read_bytes()


def test_again_there_is_nothing_to_do(alone, folders):
    told = small_run.nearlift("run", *folders, "--out", alone[0])
    assert told.exit_code == 0
    assert told.output.count("up to date") == 2


def test_a_refused_campaign_does_not_stop_the_others(alone, folders, tmp_path):
    told = small_run.nearlift("run", tmp_path / "nowhere", folders[0], "--out", alone[0])
    assert told.exit_code == 2
    assert "exit code 2" in told.output
    assert small_run.NAME in told.output


def test_two_campaigns_of_one_name_are_refused(folders, tmp_path):
    shutil.copytree(folders[0], tmp_path / "twin")
    told = small_run.nearlift("run", folders[0], tmp_path / "twin", "--out", tmp_path)
    assert told.exit_code == 2
    assert "has the same name as" in told.output
    assert not (tmp_path / "processed").exists()
