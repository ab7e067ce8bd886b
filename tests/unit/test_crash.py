"""Nothing lost: whatever fails, and whenever, old products or new ones stand, and a rerun ends in
the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from nearlift.errors import ProductError
from nearlift.run import graph, lock, store
from nearlift.run.lock import locked, settled
from nearlift.run.transaction import Homes

from . import small_run
from .faulty import (
    Book,
    Fault,
    Faulty,
    Outputs,
    Scene,
    book,
    calls,
    copied,
    failing,
    homes,
    litter,
    outputs,
    own,
    run,
    stands,
    written,
)
from .small_run import nearlift, state
from .test_graph import EVERY

ROOT = Path(__file__).parents[2]
BEFORE_REPORT = EVERY[:-1]
#: One model, by the sampler that keeps blocks of its chain for whoever goes on; a second of work.
ONE_FIT = '[fit]\nsampler = "emcee"\ness = 100\nground = { rivals = [] }\n'


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return Scene(tmp_path_factory.mktemp("crash"), ("ingest", "reduce"))


@pytest.mark.parametrize("fault", ["once", "lasting"])
def test_a_failing_call_at_every_place_in_turn(scene, fault):
    """The n-th write (torn in half), sync, rename or removal fails, for every n, and with it all
    that follow: as on a full disk.
    """
    for at in range(1, scene.calls + 1):
        place = scene.fresh()
        failing(lambda place=place: run(scene.raw, place, scene.stages), at, fault)
        scene.check(place)


def killed(scene: Scene, place: Path, at: int) -> None:
    words = [
        sys.executable,
        "-m",
        "tests.unit.faulty",
        str(scene.raw),
        str(place),
        str(at),
        ",".join(scene.stages),
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "pipeline")])}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()[-400:]


@pytest.mark.parametrize("part", [0.4, 0.8])
def test_kill_9_of_a_real_process(scene, part):
    place = scene.fresh()
    killed(scene, place, round(part * scene.calls))
    assert [p for p in place.rglob("*") if p.name == ".lock"], "a killed process cleans nothing up"
    scene.check(place)


@pytest.mark.calibration
def test_kill_9_at_every_place_of_a_run_up_to_its_report(tmp_path):
    whole = Scene(tmp_path, BEFORE_REPORT, ONE_FIT)
    for at in range(1, whole.calls + 1):
        place = whole.fresh()
        failing(lambda place=place: run(whole.raw, place, whole.stages), at, "kill")
        whole.check(place)
    print(f"killed at {whole.calls} places of {', '.join(whole.stages)}")


def strata(kinds: Sequence[str]) -> list[int]:
    """First, middle and last place of every kind of call, before the journal takes its name and
    from then on.
    """
    journal, found = kinds.index("rename"), set()
    for part in (range(journal), range(journal, len(kinds))):
        for kind in set(kinds):
            places = [i + 1 for i in part if kinds[i] == kind]
            found |= {places[k] for k in (0, len(places) // 2, -1) if places}
    return sorted(found)


@pytest.mark.calibration
def test_kill_9_within_the_report(tmp_path):
    """Its files are many, slow to draw and written alike: some places of each kind stand for all,
    and the book below takes every one.
    """
    whole = Scene(tmp_path, (*BEFORE_REPORT, "report"), ONE_FIT)
    assert set(whole.new["report"]) <= book("old")["report"].keys(), (
        "the book has every file that the report writes"
    )
    # from here on all but the report is new
    run(whole.raw, whole.folder / "old", BEFORE_REPORT)
    kinds = calls(lambda: run(whole.raw, whole.fresh(), whole.stages))
    for at in strata(kinds):
        place = whole.fresh()
        failing(lambda place=place: run(whole.raw, place, whole.stages), at, "kill")
        whole.check(place)
    print(f"killed at {len(strata(kinds))} of {len(kinds)} places of report")


class Bookkeeping:
    """Every stage with its true files, written and removed as it does, without what it computes."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.folder, self.patch = folder, patch
        self.raw = small_run.write_means(folder / "raw", 4)
        self.old, self.new = book("old"), book("new")
        self.write(folder / "old", self.old, self.old, [s.name for s in graph.STAGES])

    def write(self, place: Path, of: Book, before: Book, stages: Sequence[str]) -> None:
        self.patch.setattr(graph.Stage, "run", written(of, before))
        for _ in graph.run(
            small_run.job(self.raw, place), [graph.stage(name) for name in stages], force=True
        ):
            pass

    def ended(self, of: Book) -> Outputs:
        return own(
            {
                stage: {n: hashlib.sha256(c).hexdigest() for n, c in sorted(files.items())}
                for stage, files in of.items()
            }
        )

    def places(self, stage: str) -> int:
        return len(calls(lambda: self.write(copied(self.folder), self.new, self.old, [stage])))

    def fails(self, stage: str, at: int, fault: Fault) -> bool:
        """Whether the stage stands as new after a fault; that a mixture is never seen, nor kept,
        and that a rerun mends it.
        """
        place = copied(self.folder)
        failing(lambda: self.write(place, self.new, self.old, [stage]), at, fault)
        old, new = self.ended(self.old), self.ended(self.old | {stage: self.new[stage]})
        if not homes(place).journal.is_file():
            # who looks at committed files only sees one or the other without anybody's help
            stands(place, old, new)
        settled(homes(place))
        done = stands(place, old, new)[stage]
        self.write(place, self.new, self.old, [stage])
        assert outputs(place) == new
        assert all(stands(place, old, new).values())
        assert litter(place) == []
        return done


@pytest.fixture
def bookkeeping(tmp_path, monkeypatch):
    return Bookkeeping(tmp_path, monkeypatch)


#: Every so many-th place of a stage is tried in the ordinary suite, every one by `make calibrate`.
SAMPLE = {"reduce": 1, "fit": 1, "report": 23}


@pytest.mark.parametrize("stage", [s.name for s in graph.STAGES])
def test_a_stage_is_old_or_new_wherever_it_is_killed(bookkeeping, stage):
    places = bookkeeping.places(stage)
    ends = [
        bookkeeping.fails(stage, at, "kill") for at in range(1, places + 1, SAMPLE.get(stage, 4))
    ]
    assert ends == sorted(ends), "once new, never old again"
    assert set(ends) == {False, True}


@pytest.mark.calibration
@pytest.mark.parametrize("fault", ["once", "lasting", "kill"])
@pytest.mark.parametrize("stage", [s.name for s in graph.STAGES])
def test_a_stage_is_old_or_new_whatever_happens_at_every_place(bookkeeping, stage, fault):
    places = bookkeeping.places(stage)
    ends = [bookkeeping.fails(stage, at, fault) for at in range(1, places + 1)]
    assert ends == sorted(ends)
    print(f"{stage}, {fault}: {places} places, new after {sum(ends)}")


def test_what_reads_products_first_completes_a_commit_that_was_cut(bookkeeping):
    """run --dry-run, run --check and all that opens the campaign find it whole; while its lock is held they wait,
    then say whose it is.
    """
    place = copied(bookkeeping.folder)
    before = stands(place, *2 * [bookkeeping.ended(bookkeeping.old)])
    for at in range(bookkeeping.places("fit") - 4, 0, -1):
        place = copied(bookkeeping.folder)
        failing(
            lambda here=place: bookkeeping.write(here, bookkeeping.new, bookkeeping.old, ["fit"]),
            at,
            "kill",
        )
        if homes(place).journal.is_file():
            break
    assert homes(place).journal.is_file()
    with (
        pytest.MonkeyPatch.context() as patch,
        locked(Homes(processed=place / "other", reports=place / "other")),
    ):
        patch.setattr(lock, "PATIENCE_S", 0.05)
        patch.setattr(lock, "_flock", lambda descriptor: False)
        found = nearlift("run", "--dry-run", bookkeeping.raw, "--out", place)
    assert found.exit_code == 4
    assert "another run works on these products" in found.stderr
    assert homes(place).journal.is_file()
    found = nearlift("run", "--check", bookkeeping.raw, "--out", place)
    assert found.exit_code == 0, found.output
    assert litter(place) == []
    after = stands(
        place,
        bookkeeping.ended(bookkeeping.old),
        bookkeeping.ended(bookkeeping.old | {"fit": bookkeeping.new["fit"]}),
    )
    assert after["fit"]
    assert before["fit"]


def test_a_journal_that_names_other_files_is_refused(tmp_path):
    there = Homes.within(tmp_path, "c")
    there.processed.mkdir(parents=True)
    for name in ("processed/../../stray", "stray", "/etc/stray", "processed", "processed/stray\0"):
        there.journal.write_text(
            json.dumps({"schema": "nearlift.commit/1", "put": [name], "remove": []})
        )
        with pytest.raises(ProductError, match="which is no product"):
            settled(there)


@pytest.mark.parametrize(
    "lists",
    [
        {"put": []},
        {"put": "reports", "remove": []},
        {"put": [1], "remove": []},
        {"put": [], "remove": None},
    ],
)
def test_a_journal_that_lists_nothing_is_refused_and_nothing_moves(tmp_path, lists):
    there = Homes.within(tmp_path, "c")
    there.processed.mkdir(parents=True)
    there.journal.write_text(json.dumps({"schema": "nearlift.commit/1", **lists}))
    with pytest.raises(ProductError, match="does not list what is to be put and removed"):
        settled(there)


def test_a_full_disk_ends_with_4_and_old_products(tmp_path, monkeypatch):
    raw = small_run.write_means(tmp_path / "raw", 24)
    assert nearlift("ingest", raw, "--out", tmp_path, "-q").exit_code == 0
    before = state(tmp_path / "processed")
    monkeypatch.setattr(store, "disk", Faulty(1))
    found = nearlift("ingest", raw, "--out", tmp_path)
    assert found.exit_code == 4
    assert (
        f"{tmp_path / 'processed' / 'means' / 'trials.parquet'}: no space left on device"
        in found.stderr
    )
    assert state(tmp_path / "processed") == before


def test_too_little_room_is_told_before_anything_is_written(tmp_path, monkeypatch):

    raw = small_run.write_means(tmp_path / "raw", 24)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10, 9, 1))
    found = nearlift("ingest", raw, "--out", tmp_path / "out")
    assert found.exit_code == 4
    assert "the disk has 1 bytes left" in found.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_real_run_with_130_and_without_a_trace(tmp_path, sent):
    raw = small_run.write(tmp_path / "raw")
    # what a shell starts in the background ignores SIGINT, and so do its children
    start = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
        " from nearlift.console import main; main()"
    )
    words = [sys.executable, "-c", start, "run", str(raw), "--out", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "pipeline")}
    process = subprocess.Popen(
        words, env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    assert process.stderr is not None
    # the first line tells that the run has begun
    first = process.stderr.readline()
    time.sleep(0.3)
    process.send_signal(sent)
    rest = process.communicate(timeout=60)[1]
    assert process.returncode == 130, first + rest
    assert "interrupted; finished products remain" in rest
    assert "Traceback" not in rest
    assert not [
        p
        for p in (tmp_path / "processed").rglob("*")
        if p.name.endswith((".tmp", ".lock", ".staged", ".commit.json"))
    ]


def test_an_interrupt_that_lands_in_a_callback_from_c_is_not_lost(tmp_path):
    """Of the just-in-time compiler's, say, in which nothing can be raised."""
    script = (
        "import ctypes, signal, sys, time, types\n"
        "from nearlift import console\n"
        # what a shell starts in the background ignores SIGINT, and so do its children
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def heavy():\n"
        "    call = ctypes.CFUNCTYPE(None)(lambda: interrupted())\n"
        "    call()\n"
        "    time.sleep(200)\n"
        "def interrupted(): raise KeyboardInterrupt\n"
        "sys.modules['nearlift.cli'] = types.SimpleNamespace(main=heavy)\n"
        "import nearlift; nearlift.cli = sys.modules['nearlift.cli']\n"
        "console.main()\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "pipeline")}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=180
    )
    assert (done.returncode, done.stderr) == (130, "interrupted; nothing was begun\n")


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
    assert (
        "is not what was ingested before, though its size and its time stamp are as they were"
        in found.stderr
    )
    assert "restore it from a copy" in found.stderr
    os.utime(record, (1e9 + 1, 1e9 + 1))
    assert nearlift("ingest", raw, "--out", tmp_path, "-q").exit_code == 0


def test_two_runs_at_once_one_is_told_whose_turn_it_is(tmp_path):
    raw = small_run.write_means(tmp_path / "raw", 24)
    with locked(Homes.within(tmp_path, "means")):
        # flock is per open file: this process can stand in its own way
        found = nearlift("ingest", raw, "--out", tmp_path)
    assert found.exit_code == 4
    assert f"another run works on these products: process {os.getpid()} on" in found.stderr
