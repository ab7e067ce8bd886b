"""`nearlift run --check`: what is not what it was is named."""

from __future__ import annotations

import json
import shutil

import pytest
from tests.unit import small_run
from tests.unit.small_run import nearlift


def test_check_finds_what_is_not_what_it_was(tmp_path):
    raw = small_run.write_means(tmp_path / "raw", 24)
    assert nearlift("ingest", raw, "--out", tmp_path, "-q").exit_code == 0
    whole = nearlift("run", "--check", raw, "--out", tmp_path)
    assert (whole.exit_code, whole.stdout) == (0, "3 of 3 files are what they were\n")
    product = tmp_path / "processed" / "means" / "trials.parquet"
    content = bytearray(product.read_bytes())
    content[200] ^= 1
    product.write_bytes(bytes(content))
    (raw / "trials.csv").write_bytes((raw / "trials.csv").read_bytes() + b"\n")
    spoilt = nearlift("run", "--check", raw, "--out", tmp_path)
    assert spoilt.exit_code == 4
    assert "trials.csv: is not what it was" in spoilt.stdout
    assert "trials.parquet: is not what it was" in spoilt.stdout
    shutil.rmtree(tmp_path / "processed")
    assert nearlift("run", "--check", raw, "--out", tmp_path).exit_code == 4


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"schema": "nearlift.provenance/1", "inputs": {"a": 1}},
        {"schema": "nearlift.provenance/1", "stages": {"fit": 3}},
    ],
)
def test_check_refuses_a_provenance_that_nearlift_does_not_write(tmp_path, content):
    raw = small_run.write_means(tmp_path / "raw", 24)
    (tmp_path / "processed" / "means").mkdir(parents=True)
    (tmp_path / "processed" / "means" / "provenance.json").write_text(json.dumps(content))
    answer = nearlift("run", "--check", raw, "--out", tmp_path)
    assert (answer.exit_code, "provenance.json: " in answer.stderr) == (4, True)
