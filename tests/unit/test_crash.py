"""Nothing lost: whatever fails, and whenever, old products or new ones stand, and a rerun ends in the same bytes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nearlift import store

from . import small_run
from .faulty import QUICK, Faulty, Scene, run
from .small_run import nearlift, state

ROOT = Path(__file__).parents[2]
BEFORE_REPORT = (*QUICK[:3], "diagnose", "ledger")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return Scene(tmp_path_factory.mktemp("crash"), ("ingest", "reduce"))


def test_a_failing_call_at_every_place_in_turn(scene, monkeypatch):
    """The n-th write (torn in half), sync or rename fails, for every n: as on a full disk."""
    assert scene.calls == 20, "trials, lift, covariance and two ledgers, four calls each"
    for at in range(1, scene.calls + 1):
        place = scene.fresh()
        with monkeypatch.context() as patch:
            patch.setattr(store, "disk", Faulty(at))
            with pytest.raises(OSError, match="No space left"):
                run(scene.raw, place, scene.stages)
        scene.check(place)


def killed(scene: Scene, place: Path, at: int) -> None:
    words = [sys.executable, "-m", "tests.unit.faulty", str(scene.raw), str(place), str(at), ",".join(scene.stages)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "pipeline")])}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()[-400:]


@pytest.mark.parametrize("at", [1, 7, 12])
def test_kill_9_within_a_write_a_rename_and_a_sync(scene, at):
    place = scene.fresh()
    killed(scene, place, at)
    assert [p for p in place.rglob("*") if p.name == ".lock"], "a killed process cleans nothing up"
    scene.check(place)


@pytest.mark.calibration
def test_kill_9_at_every_place_of_a_run_up_to_its_report(tmp_path):
    whole = Scene(tmp_path, BEFORE_REPORT)
    for at in range(1, whole.calls + 1):
        place = whole.fresh()
        killed(whole, place, at)
        whole.check(place)


@pytest.mark.calibration
def test_kill_9_within_the_report(tmp_path):
    """Its files are many, slow to draw and written alike: five places stand for all."""
    whole = Scene(tmp_path, (*BEFORE_REPORT, "report"))
    for at in range(whole.calls // 2, whole.calls + 1, whole.calls // 8):
        place = whole.fresh()
        killed(whole, place, at)
        whole.check(place)


def test_a_full_disk_ends_with_4_and_old_products(tmp_path, monkeypatch):
    raw = small_run.write_means(tmp_path / "raw", 24)
    assert nearlift("ingest", raw, "--out", tmp_path, "-q").exit_code == 0
    before = state(tmp_path / "processed")
    monkeypatch.setattr(store, "disk", Faulty(1))
    found = nearlift("ingest", raw, "--out", tmp_path)
    assert found.exit_code == 4
    assert "no space left on device" in found.stderr.lower()
    assert state(tmp_path / "processed") == before


def test_too_little_room_is_told_before_anything_is_written(tmp_path, monkeypatch):
    import shutil

    raw = small_run.write_means(tmp_path / "raw", 24)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10, 9, 1))
    found = nearlift("ingest", raw, "--out", tmp_path / "out")
    assert found.exit_code == 4
    assert "the disk has 1 bytes left" in found.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_real_run_with_130_and_without_a_trace(tmp_path, sent):
    raw = small_run.write(tmp_path / "raw")
    words = [sys.executable, "-c", "from nearlift.cli import main; main()", "run", str(raw), "--out", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "pipeline")}
    process = subprocess.Popen(words, env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    assert process.stderr is not None
    # the first line tells that the run has begun
    first = process.stderr.readline()
    time.sleep(0.3)
    process.send_signal(sent)
    rest = process.communicate(timeout=60)[1]
    assert process.returncode == 130, first + rest
    assert "interrupted; finished products stand" in rest
    assert "Traceback" not in rest
    assert not [p for p in (tmp_path / "processed").rglob("*") if p.name.endswith((".tmp", ".lock"))]


def test_a_flipped_bit_in_a_raw_file_that_was_ingested_stops_the_run(tmp_path):
    raw = small_run.write(tmp_path / "raw", visits=2)
    for path in raw.rglob("*.*"):
        os.utime(path, (1e9, 1e9))
    assert nearlift("ingest", raw, "--out", tmp_path, "-q").exit_code == 0
    record = next((raw / "trials").glob("*.csv"))
    content = bytearray(record.read_bytes())
    content[-3] ^= 1
    record.write_bytes(bytes(content))
    os.utime(record, (1e9, 1e9))
    found = nearlift("ingest", raw, "--out", tmp_path)
    assert found.exit_code == 4
    assert "is not what was ingested before, though its size and its time stamp are as they were" in found.stderr
    assert "restore it from a copy" in found.stderr
    os.utime(record, (1e9 + 1, 1e9 + 1))
    assert nearlift("ingest", raw, "--out", tmp_path, "-q").exit_code == 0


def test_two_runs_at_once_one_is_told_whose_turn_it_is(tmp_path):
    from nearlift.lock import locked

    raw = small_run.write_means(tmp_path / "raw", 24)
    with locked(tmp_path / "processed" / "means"):
        # flock is per open file: this process can stand in its own way
        found = nearlift("ingest", raw, "--out", tmp_path)
    assert found.exit_code == 4
    assert f"another run works on these products: process {os.getpid()} on" in found.stderr
