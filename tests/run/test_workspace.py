"""Products are written next to raw/, from any folder in it; a campaign's folder is never written."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.unit import small_run
from tests.unit.small_run import nearlift, state


@pytest.fixture
def raw(tmp_path) -> Path:
    """A folder ``raw`` with a campaign in it, and one in a folder of its own."""
    (tmp_path / "lab" / "raw" / "june").mkdir(parents=True)
    small_run.write_means(tmp_path / "lab" / "raw" / "june" / "means", 24)
    return tmp_path / "lab" / "raw"


@pytest.mark.parametrize("inside", [".", "june", "june/means"])
def test_within_raw_products_go_beside_it(raw, monkeypatch, inside):
    before = state(raw)
    monkeypatch.chdir(raw / inside)
    campaign = Path("june/means").relative_to(inside) if inside != "june/means" else "."
    assert nearlift("ingest", campaign, "-q").exit_code == 0
    assert state(raw) == before
    assert (raw.parent / "processed" / "means" / "trials.parquet").is_file()
    assert nearlift("run", "--check", campaign).exit_code == 0


def test_elsewhere_they_go_to_the_current_folder(raw, tmp_path, monkeypatch):
    (tmp_path / "desk").mkdir()
    monkeypatch.chdir(tmp_path / "desk")
    assert nearlift("ingest", raw / "june" / "means", "-q").exit_code == 0
    assert Path("processed", "means", "trials.parquet").is_file()


@pytest.mark.parametrize("given", [[], ["--out", "."], ["--out", "deeper/down"], ["--out", "link"]])
def test_a_campaigns_folder_is_never_written(raw, tmp_path, monkeypatch, given):
    alone = shutil.copytree(raw / "june" / "means", tmp_path / "alone")
    (alone / "link").symlink_to(alone)
    before = state(alone)
    monkeypatch.chdir(alone)
    told = nearlift("run", ".", *given)
    assert told.exit_code == 2
    assert (
        "lies in the campaign's folder, where nothing is written\n  name a folder outside it"
        in told.stderr
    )
    assert state(alone) == before
    told = nearlift("ingest", ".", "--out", "..", "-q")
    assert told.exit_code == 0, told.output
