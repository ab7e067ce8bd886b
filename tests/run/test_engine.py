"""What makes a stage stale: content and nothing else; and what a run leaves behind."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit import small_run
from tests.unit.small_run import job, ran, state

from nearlift.errors import InputRefused, ProductError
from nearlift.run import engine, tables, workers
from nearlift.run.engine import Busy, Outcome, Stage, ordered_stages, stage_of
from nearlift.run.tables import Product, real
from nearlift.stages import PRODUCTS, STAGES
from nearlift.stages.ingest import TRIALS

#: A campaign without grids of velocity, and for whose vehicle nothing is flown.
EVERY = [stage.name for stage in STAGES if stage.name not in ("flow", "simulate", "detect")]
#: Stages of the tests that need no fit.
FIRST = STAGES[:2]


@pytest.fixture
def place(small_campaign, tmp_path, monkeypatch) -> Path:
    """A folder with raw/ and up-to-date products of all stages, to spoil."""
    monkeypatch.setattr("nearlift.report.figures.files.render", small_run.undrawn)
    shutil.copytree(small_campaign, tmp_path / "copy")
    return tmp_path / "copy"


def stale(place: Path, **changes) -> dict[str, str]:
    """Name and reason of every stage that `plan` would run."""
    return {
        stage.name: why for stage, why in engine.plan(job(place / "raw", place, **changes)) if why
    }


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def product(place: Path, name: str) -> Path:
    return place / "processed" / small_run.NAME / name


def test_nothing_is_stale_after_a_run_and_a_second_run_writes_nothing(place):
    before = state(place)
    for path in (place / "raw").rglob("*"):
        os.utime(path, (2e9, 2e9))
    assert stale(place) == {}
    assert ran(job(place / "raw", place)) == []
    assert {k: v[0] for k, v in state(place).items()} == {k: v[0] for k, v in before.items()}


def test_a_changed_trial_runs_all_that_depends_on_it(place):
    record = next((place / "raw" / "trials").glob("*.csv"))
    lines = record.read_text().splitlines()
    record.write_text("\n".join([*lines[:-1], f"{float(lines[-1]) + 5:.4f}"]) + "\n")
    why = stale(place)
    assert list(why) == EVERY
    assert why["ingest"] == f"trials/{record.name} has changed"
    assert why["fit"] == "ingest will run"
    edit(place / "raw" / "trials.csv", ",25,", ",25.0,")
    assert stale(place)["ingest"].endswith(" has changed and 1 more")


def test_a_stage_whose_product_comes_out_as_it_was_stops_the_run(place):
    edit(place / "raw" / "trials.csv", ",25,", ",25.0,")
    assert stale(place)["ingest"] == "trials.csv has changed"
    # the page prints the schedule's digest
    assert ran(job(place / "raw", place)) == ["ingest", "report"]


@pytest.mark.parametrize(
    ("old", "new", "first"),
    [
        ("# SIMULATED.", "# Simulated.", "report"),
        ('"0.1 mm"', '"0.3 mm"', "fit"),
        ("[vehicle]", "[diagnose]\nfalse_alarm_rate = 0.01\n\n[vehicle]", "diagnose"),
        ("[vehicle]", "[quality]\ndrift = 0.04\n\n[vehicle]", "ingest"),
    ],
)
def test_an_edited_manifest_runs_what_the_edit_concerns(place, old, new, first):
    edit(place / "raw" / "campaign.toml", old, new)
    assert next(iter(stale(place))) == first
    assert "report" in stale(place)


@pytest.mark.parametrize(
    ("file", "deleted", "stages"),
    [
        ("trials.parquet", True, ["ingest"]),
        ("lift.parquet", False, ["reduce"]),
        ("results.json", False, ["diagnose"]),
        # it overwrites what diagnose quotes
        ("fit.json", True, ["fit", "diagnose"]),
    ],
)
def test_a_product_that_is_not_what_was_written_is_made_again(place, file, deleted, stages):
    path = product(place, file)
    content = path.read_bytes()
    path.unlink()
    if not deleted:
        path.write_bytes(content[:90] + bytes([content[90] ^ 1]) + content[91:])
    why = "is missing" if deleted else "was changed after it was written"
    assert stale(place)[stages[0]] == f"processed/{file} {why}"
    assert ran(job(place / "raw", place)) == stages
    assert path.read_bytes() == content


def test_a_product_that_somebody_edited_is_not_read(place):
    path = product(place, TRIALS.file)
    table = tables.read_table(path, TRIALS)
    table["lift_N"] = table["lift_N"] * 1.01
    path.write_bytes(tables.table_bytes(table, TRIALS))
    one = job(place / "raw", place)
    with pytest.raises(ProductError, match="was changed after it was written"):
        list(engine.run(one, (stage_of(STAGES, "fit"),), force=True))
    assert ran(one) == ["ingest"]


def test_another_seed_another_code_another_version_make_all_stale(place, monkeypatch):
    assert set(stale(place, seed=1).values()) == {"the seed has changed"}
    with monkeypatch.context() as patch:
        patch.setattr(engine, "code_digest", lambda: "another")
        assert stale(place) == dict.fromkeys(EVERY, "nearlift itself has changed")
    with monkeypatch.context() as patch:
        patch.setattr(engine.plugins, "digests", lambda: {"my-model": "another"})
        assert stale(place) == dict.fromkeys(EVERY, "package my-model has changed")
    versions = {**engine.versions(), "numpy": "1.0"}
    monkeypatch.setattr(engine, "versions", lambda: versions)
    assert stale(place) == dict.fromkeys(EVERY, "version of numpy has changed")


@pytest.mark.parametrize("content", [None, "{ not json", '{"schema": "nearlift.provenance/99"}'])
def test_without_a_ledger_everything_is_stale(place, content):
    ledger = product(place, tables.LEDGER)
    ledger.unlink() if content is None else ledger.write_text(content)
    assert stale(place) == dict.fromkeys(EVERY, "has not run yet")


def test_what_a_finished_stage_said_is_said_again(place):
    """Rejections and notes of a stage that need not run come from the ledger."""
    record = sorted((place / "raw" / "trials").glob("*.csv"))[5]
    record.unlink()
    first = [(s.stage.name, s.outcome) for s in engine.run(job(place / "raw", place), FIRST)]
    second = [(s.stage.name, s.outcome) for s in engine.run(job(place / "raw", place), FIRST)]
    assert first == second
    (rejected,) = first[0][1].rejected
    assert rejected[0] == record.stem


def test_the_ledger_says_what_made_the_products(place):
    ledger = json.loads(product(place, tables.LEDGER).read_text())
    assert ledger["options"] == {"seed": 0}
    assert list(ledger["stages"]) == EVERY
    assert ledger["inputs"]["trials.csv"]["sha256"] == tables.sha256(place / "raw" / "trials.csv")
    assert set(ledger["versions"]) >= {"python", "numpy", "scipy", "lmfit"}


def test_raw_files_are_hashed_again_only_where_size_or_time_has_changed(tmp_path, monkeypatch):
    root, hashed = small_run.write_means(tmp_path / "raw", 24), []
    for file in root.iterdir():
        os.utime(file, (2e8, 2e8))
    with engine.open_job(root, tmp_path, FIRST, "serial", 0) as first:
        list(engine.run(first))
    monkeypatch.setattr(tables, "sha256", lambda path: hashed.append(Path(path).name) or "")
    with engine.open_job(root, tmp_path, FIRST, "serial", 0) as second:
        assert second.inputs == first.inputs
    os.utime(root / "trials.csv", (5e8, 5e8))
    with engine.open_job(root, tmp_path, FIRST, "serial", 0):
        assert hashed == ["trials.csv"]


def test_processes_load_what_they_need_while_new_files_are_hashed(tmp_path, monkeypatch):
    root, order = small_run.write_means(tmp_path / "raw", 24), []
    for file in root.iterdir():
        os.utime(file, (2e8, 2e8))
    monkeypatch.setattr(workers.Processes, "load", lambda _, names: order.append([*names]))
    monkeypatch.setattr(tables, "sha256", lambda path: order.append("hashed") or "")
    for _ in range(2):
        with engine.open_job(root, tmp_path, FIRST, "processes:1", 0) as job:
            job.processed.mkdir(parents=True, exist_ok=True)
    assert order == [[*FIRST[0].workers], "hashed", "hashed"]


# ---- stages of the tests

HEIGHTS = Product(
    file="heights.parquet", title="Heights", row="a trial", columns=(real("z_m", "m", "z"),)
)


def stage(run, **more) -> Stage:
    return Stage(name="weigh", summary="weighs", run=run, writes=(HEIGHTS,), **more)


def one_stage(place: Path, run):
    made = stage(run)
    return job(place / "raw", place, stages=(made,))


def test_files_of_a_stage_appear_when_it_is_done(place):
    home = product(place, HEIGHTS.file)

    def run(job):
        job.write(HEIGHTS, {"z_m": [1.0]})
        job.put("reports/heights.txt", b"one")
        assert not home.exists()
        return Outcome()

    assert ran(one_stage(place, run)) == ["weigh"]
    assert tables.read_table(home, HEIGHTS)["z_m"] == [1.0]
    (old,) = place.rglob("heights.txt")

    def next_time(job):
        job.write(HEIGHTS, {"z_m": [2.0]})
        job.put("reports/heights.txt", None)
        assert old.exists()
        return Outcome()

    again = one_stage(place, next_time)
    list(engine.run(again, force=True))
    assert not old.exists()


@pytest.mark.parametrize("fault", [KeyboardInterrupt, InputRefused("a", "b"), None])
def test_a_stage_that_fails_changes_nothing(place, fault):
    """None: it does not write what it declares."""
    before = {k: v for k, v in state(place).items() if not k.endswith(engine.LOCK)}

    def run(job):
        job.put("reports/heights.txt", b"one")
        if fault is None:
            return Outcome()
        job.write(HEIGHTS, {"z_m": [1.0]})
        raise fault

    with pytest.raises((KeyboardInterrupt, InputRefused, ProductError)):
        ran(one_stage(place, run))
    assert {k: v for k, v in state(place).items() if not k.endswith(engine.LOCK)} == before


def test_a_run_that_ends_between_two_files_leaves_its_stage_stale(place, monkeypatch):
    edit(place / "raw" / "campaign.toml", "[vehicle]", "[quality]\ndrift = 0.04\n\n[vehicle]")
    write = tables.write_whole

    def ends(path, content):
        write(path, content)
        if path.name == TRIALS.file:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(tables, "write_whole", ends)
        with pytest.raises(KeyboardInterrupt):
            ran(job(place / "raw", place))
    assert stale(place)["ingest"] == "has not run yet"
    assert ran(job(place / "raw", place))[0] == "ingest"
    assert stale(place) == {}


def test_one_run_at_a_time(place):
    one = job(place / "raw", place)
    product(place, "trials.parquet").unlink()
    (one.processed / f".fit.json.7{tables.UNFINISHED}").write_bytes(b"half")
    (one.processed / ".mine.tmp").write_bytes(b"another's")
    with engine.locked(one):
        assert not list(one.processed.glob(".fit.json.*"))
        assert (one.processed / ".mine.tmp").exists()
        with pytest.raises(Busy, match=f"another run .* process {os.getpid()}\n"):
            ran(one)
    assert ran(one) == ["ingest"]


def test_a_report_reads_every_product_of_the_stages_before_it():
    *before, report = STAGES
    weigh = stage(lambda job: Outcome(), reads=(TRIALS,))
    made = ordered_stages((*before, weigh, report))
    assert made[-1].reads == (*report.reads, HEIGHTS)
    assert report.reads == PRODUCTS[:-1]
    assert not replace(weigh, where="piv").configured(type("", (), {"piv": None}))


# ---- killed runs

RUN = """
import sys
from pathlib import Path
from nearlift.run import engine
from nearlift.stages import STAGES
with engine.open_job(Path(sys.argv[1]), Path(sys.argv[2]), STAGES, "threads:2", 0) as job:
    print("ready", flush=True)
    list(engine.run(job, STAGES[:2]))
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_a_killed_run_is_resumed_to_the_same_products(tmp_path, number):
    """At random moments; 40 kills of whole runs take minutes and are not among the tests."""
    root = small_run.write(tmp_path / "raw", visits=2)
    list(engine.run(job(root, tmp_path / "whole"), FIRST))
    rng = random.Random(int(number))
    for _ in range(2):
        process = subprocess.Popen(
            [sys.executable, "-c", RUN, str(root), str(tmp_path / "killed")],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        assert process.stdout.readline() == b"ready\n"
        time.sleep(rng.uniform(0, 0.3))
        process.send_signal(number)
        process.communicate(timeout=60)
    list(engine.run(job(root, tmp_path / "killed"), FIRST))
    for name in ("trials.parquet", "lift.parquet", "lift_covariance.parquet"):
        whole, killed = (
            tmp_path / out / "processed" / small_run.NAME / name for out in ("whole", "killed")
        )
        assert whole.read_bytes() == killed.read_bytes()
    assert not list((tmp_path / "killed").rglob(f".*{tables.UNFINISHED}"))
