"""doctor: a machine that lacks something is told what, and what to do."""

from __future__ import annotations

import json
from importlib import metadata

import pytest

from nearlift.commands import doctor

from . import small_run


def test_this_machine_is_fit(tmp_path):
    told = small_run.nearlift("doctor", "--out", tmp_path)
    assert told.exit_code == 0, told.output
    assert "bad" not in told.output
    assert f"{len(doctor.EXTRAS) + 9}" == str(len(told.output.splitlines()))


def test_a_package_that_is_missing_or_too_old_is_bad(tmp_path, monkeypatch):
    real = metadata.version

    def version(name: str) -> str:
        if name == "lmfit":
            raise metadata.PackageNotFoundError
        return "0.1" if name == "pint" else real(name)

    monkeypatch.setattr(metadata, "version", version)
    told = small_run.nearlift("doctor", "--out", tmp_path, "--json")
    assert told.exit_code == 2
    found = {f["what"]: f for f in json.loads(told.output)}
    assert found["packages"]["state"] == "bad"
    assert "lmfit is missing" in found["packages"]["found"]
    assert "pint 0.1 is not" in found["packages"]["found"]


def test_an_extra_that_is_missing_is_only_noted(tmp_path, monkeypatch):
    real = metadata.version

    def version(name: str) -> str:
        if name == "nptdms":
            raise metadata.PackageNotFoundError
        return real(name)

    monkeypatch.setattr(metadata, "version", version)
    told = small_run.nearlift("doctor", "--out", tmp_path)
    assert told.exit_code == 0
    assert 'no reading TDMS files  (pip install "nearlift[tdms]")' in told.output


def test_many_blas_threads_are_noted(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    (finding,) = (f for f in doctor.examine(tmp_path) if f.what == "BLAS threads")
    assert finding.state == "note"
    assert "OMP_NUM_THREADS=8" in finding.found


@pytest.mark.parametrize("entries", ["/plugins:", "lib:/plugins", "."])
def test_an_entry_of_the_path_that_means_the_current_folder_is_noted(
    tmp_path, monkeypatch, entries
):
    monkeypatch.setenv("PYTHONPATH", "/plugins")
    (finding,) = (f for f in doctor.examine(tmp_path) if f.what == "PYTHONPATH")
    assert finding.state == "good"
    monkeypatch.setenv("PYTHONPATH", entries)
    (finding,) = (f for f in doctor.examine(tmp_path) if f.what == "PYTHONPATH")
    assert finding.state == "note"


def test_code_that_cannot_be_kept_is_noted(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    (finding,) = (f for f in doctor.examine(tmp_path) if f.what == "compiled code")
    assert finding.state == "note"


def test_a_folder_that_does_not_exist_yet_is_judged_by_the_one_above(tmp_path):
    (finding,) = (f for f in doctor.examine(tmp_path / "a" / "b") if f.what == "output folder")
    assert finding.found.startswith(str(tmp_path))


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_script_names_the_command(shell):
    told = small_run.nearlift("completion", shell)
    assert told.exit_code == 0
    assert "_NEARLIFT_COMPLETE" in told.output
