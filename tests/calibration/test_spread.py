"""Where simulated campaigns run decides nothing but the time."""

import json
from functools import partial

from tests.calibration import coverage, harness
from tests.calibration.assess import engine

from nearlift.run.workers import SerialExecutor, open_executor

TIMES = ("wall_s", "cpu_s")


def test_a_diagnosis_is_the_same_wherever_it_runs():
    """A campaign from records to verdict."""
    jobs = [("null", "ceiling", 12)]
    found = {}
    for name in ("serial", "processes:1"):
        with open_executor(name) as executor:
            rows = list(harness.run(executor, jobs, partial(engine, confirm=False)))
        found[name] = [{k: v for k, v in r.items() if k not in TIMES} for r in rows]
    assert [r["failed"] for r in found["serial"]] == [""]
    assert repr(found["serial"]) == repr(found["processes:1"])


def test_intervals_are_the_same_wherever_they_are_made():
    with open_executor("threads:2") as executor:
        assert coverage.run(executor, 1, 3) == coverage.run(SerialExecutor(), 1, 3)


def test_kept_rows_are_not_run_again(tmp_path):
    """An interrupted run goes on with another executor, and ends with the rows of an undisturbed
    one.
    """
    log = tmp_path / "rows.jsonl"
    whole = coverage.run(SerialExecutor(), 1, 5, ("ground",))
    log.write_text(whole[1].write() + "\n")
    with open_executor("processes:1") as executor:
        assert coverage.run(executor, 1, 5, ("ground",), log) == whole
    assert [coverage.Row.read(line) for line in log.read_text().splitlines()] == [
        whole[1],
        whole[0],
    ]
    with open_executor("serial") as nothing_left:
        nothing_left.submit = None
        assert coverage.run(nothing_left, 1, 5, ("ground",), log) == whole


def test_the_command_writes_rows_and_goes_on(tmp_path):
    """Peers and yardstick alone, which take a second."""
    out = tmp_path / "found.json"
    given = [
        "null",
        "--boundaries",
        "ground",
        "--only-peers",
        "--out",
        str(out),
        "--executor",
        "threads:2",
    ]
    harness.main([*given, "--count", "1"])
    first = out.with_suffix(".jsonl").read_text()
    harness.main([*given, "--count", "2", "--resume"])
    log = out.with_suffix(".jsonl").read_text()
    assert log.startswith(first)
    assert [json.loads(line)["seed"] for line in log.splitlines()] == [600_000, 600_001]
    assert json.loads(out.read_text())["command"]["executor"] == "threads:2"
