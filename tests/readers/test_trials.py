"""Ingest: every trial has its row, refusals write nothing, raw stays as it is."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.bench_campaign import (
    run_ingest,
    small_campaign,
    write_record,
    write_schedule,
)
from tests.unit.manifests import HEAD, LIVE, UNITS, manifest

from nearlift.errors import InputRefused, ManifestError, NearliftError
from nearlift.readers import rows as rows_module
from nearlift.readers.rows import Task, reduce_piece
from nearlift.readers.text import CSV
from nearlift.run import workers
from nearlift.run.engine import Job
from nearlift.run.tables import sha256
from nearlift.stages import ingest
from nearlift.stages.ingest import TRIALS

GIVEN: dict[str, Any] = {"trials": {"units": {**UNITS, "supply": "V"}}}


def snapshot(folder: Path) -> dict[str, tuple[int, int, str]]:
    return {
        str(p): (p.stat().st_mtime_ns, p.stat().st_mode, sha256(p))
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "raw"
    folder.mkdir()
    small_campaign(folder)
    (folder / "campaign.toml").touch()
    return folder


def test_trials_have_their_columns_and_numbers(root: Path, tmp_path: Path) -> None:
    before = snapshot(root)
    outcome, job = run_ingest(root, tmp_path, manifest(**GIVEN))
    table = job.read(TRIALS)
    assert outcome.rejected == ()
    assert outcome.notes == ()
    np.testing.assert_allclose(
        table["lift_N"],
        np.concatenate([[0.11, 0.275, 0.44, 0.55], [0.1, 0.25, 0.4, 0.5]]),
        atol=5e-4,
    )
    np.testing.assert_allclose(table["u_lift_N"], 1e-3 * np.sqrt(1 / HEAD + 1 / LIVE), rtol=0.5)
    assert set(table["n"]) == {LIVE}
    assert set(table["quality"]) == {""}
    assert list(table["visit"]) == [0, 0, 0, 0, 1, 1, 1, 1]
    np.testing.assert_allclose(table["supply_V"], [4, 3.9, 3.8, 3.7] * 2)
    assert table["source_sha256"][3] == sha256(root / "trials" / "t03.csv")
    assert snapshot(root) == before


@pytest.mark.parametrize("text", ["serial", "threads:2", "processes:2"])
def test_the_executor_changes_nothing(root: Path, tmp_path: Path, text: str) -> None:
    _, job = run_ingest(root, tmp_path / "one", manifest(**GIVEN))
    with workers.open_executor(text) as executor:
        other = Job(
            root=root,
            campaign=manifest(**GIVEN),
            processed=tmp_path / "two",
            reports=tmp_path,
            executor=executor,
        )
        ingest.run(other)
    assert (job.processed / TRIALS.file).read_bytes() == (
        other.processed / TRIALS.file
    ).read_bytes()


def test_inputs_are_what_the_product_is_made_from(root: Path) -> None:
    (root / "trials" / "t01.csv").unlink()
    names = list(ingest.inputs(root, manifest(**GIVEN)))
    assert names[:3] == ["trials.csv", "trials/t00.csv", "trials/t02.csv"]
    assert "trials/t01.csv" not in names
    assert len(names) == 1 + 7


def refused(
    root: Path, tmp_path: Path, kind: type[NearliftError], match: str, **changes: Any
) -> None:
    before = snapshot(root)
    with pytest.raises(kind, match=match):
        run_ingest(root, tmp_path / "out", manifest(**{**GIVEN, **changes}))
    assert not (tmp_path / "out").exists()
    assert snapshot(root) == before


def test_a_record_that_is_refused_is_a_row_and_most_of_them_are_a_refusal(
    root: Path, tmp_path: Path
) -> None:
    """One is damaged; where more than half are, the manifest does not fit them."""
    for k in (0, 1):
        for j in range(4) if k else (3,):
            path = root / "trials" / f"t{k}{j}.csv"
            path.write_text(path.read_text().replace("\n", "\nx", 3).replace("x", "", 2))
        if k == 0:
            outcome, _ = run_ingest(root, tmp_path / "one", manifest(**GIVEN))
            [(trial, why)] = outcome.rejected
            assert trial == "t03"
            assert re.search(r"MALFORMED \(.*\): trials/t03\.csv, line 4: 'x.*is not a number", why)
    refused(root, tmp_path, InputRefused, r"t03\.csv, line 4: 'x.*is not a number")


@pytest.mark.parametrize(
    ("kept", "match"),
    [
        (
            None,
            r"none of the 8 trials has a record\n  the first, 't00', .*: did you mean '.*/T00.csv'",
        ),
        ("force\n", r"all 8 trials are rejected \(NO_DATA 8\)"),
    ],
)
def test_no_record_and_no_good_one_are_refused(
    root: Path, tmp_path: Path, kept: str | None, match: str
) -> None:
    for path in (root / "trials").iterdir():
        path.rename(path.with_stem(path.stem.upper())) if kept is None else path.write_text(kept)
    refused(root, tmp_path, InputRefused, match)


def task_of(root: Path) -> Task:
    """The task that reads three trials."""
    given = manifest(**GIVEN)
    [piece], _ = CSV.plan(given, root, ["t00", "t01", "t02"])
    return Task(root=root, campaign=given, piece=piece, tare_after_N={}, digests={})


@pytest.mark.parametrize("text", ["serial", "processes:2"])
def test_whatever_is_raised_over_a_record_is_its_row(root: Path, text: str) -> None:
    whole = reduce_piece(task_of(root))
    (root / "trials" / "t01.csv").write_bytes(b"force\n1\n\x1b[2J\n")
    with workers.open_executor(text) as executor:
        [rows] = workers.ordered(executor, reduce_piece, [task_of(root)])
    assert [row.record for row in rows] == ["t00", "t01", "t02"]
    assert (rows[0], rows[2]) == (whole[0], whole[2])
    [bad] = rows[1].rows
    assert bad["codes"] == ("MALFORMED",)
    assert bad["fault"].isprintable()
    assert bad["source_sha256"] == sha256(root / "trials" / "t01.csv")


@pytest.mark.parametrize(
    ("fault", "row"),
    [
        (ZeroDivisionError("x"), True),
        (OSError("page is corrupt"), True),
        (OSError(24, "too many files"), False),
        (MemoryError(), False),
        (ManifestError("a", "b"), False),
        (KeyboardInterrupt(), False),
    ],
)
def test_the_machines_faults_and_the_manifests_are_no_rows(
    root: Path, monkeypatch: pytest.MonkeyPatch, fault: BaseException, row: bool
) -> None:
    def reduced(*_: Any, **__: Any) -> Any:
        raise fault

    monkeypatch.setattr(rows_module, "reduce_record", reduced)
    if row:
        codes = [r.rows[0]["codes"] for r in reduce_piece(task_of(root))]
        assert codes == [("MALFORMED",)] * 3
        return
    with pytest.raises(type(fault)):
        reduce_piece(task_of(root))


@pytest.mark.parametrize(("tare", "note"), [("none", "no tare"), ("0.04 s", "have 8 samples")])
def test_no_tares_and_short_ones_are_noted(
    root: Path, tmp_path: Path, tare: str, note: str
) -> None:
    outcome, job = run_ingest(root, tmp_path, manifest(**GIVEN, load_cell={"tare": tare}))
    assert any(note in text for text in outcome.notes)
    if tare == "none":
        # rotors at rest are no part of a mean, whatever the manifest says of a tare
        assert set(job.read(TRIALS)["n"]) < set(range(LIVE - 10, LIVE + 1))
        assert set(job.read(TRIALS)["quality"]) == {"unsettled"}


@pytest.mark.parametrize(
    ("exclude", "why"), [(["t02"], ""), ({"t02": "cable touched"}, " (cable touched)")]
)
def test_an_excluded_trial_keeps_its_row_and_is_rejected_for_its_own_fault_alone(
    root: Path, tmp_path: Path, exclude: Any, why: str
) -> None:
    given = manifest(**GIVEN, quality={"exclude": exclude})
    outcome, job = run_ingest(root, tmp_path / "a", given)
    table = job.read(TRIALS)
    assert list(table["quality"]) == ["", "", "EXCLUDED", "", "", "", "", ""]
    assert table["lift_N"][2] == pytest.approx(0.44, rel=0.01)
    assert outcome.rejected == ()
    assert f"left out as [quality] exclude asks: t02{why}" in outcome.notes
    write_record(root, "t02", np.zeros(HEAD + 2))
    outcome, job = run_ingest(root, tmp_path / "b", given)
    assert job.read(TRIALS)["quality"][2].endswith("EXCLUDED")
    assert [trial for trial, _ in outcome.rejected] == ["t02"]


@pytest.mark.parametrize(
    ("name", "remedy"), [("t2", "did you mean 't12', 't02'?"), (2, "the schedule's first is 't00'")]
)
def test_an_excluded_trial_that_is_not_in_the_schedule_is_refused(
    root: Path, tmp_path: Path, name: Any, remedy: str
) -> None:
    match = f"exclude: no trial of the schedule is called '{name}'\n  {re.escape(remedy)}"
    refused(root, tmp_path, ManifestError, match, quality={"exclude": [name]})


# ---- means

MEANS: dict[str, Any] = {
    "records": {"reader": "means", "files": None, "force": None},
    "trials": {"units": {**UNITS, "lift": "gf", "lift_sd": "gf"}},
}


def means(tmp_path: Path, text: str) -> tuple[Any, dict[str, Any]]:
    root = tmp_path / "raw"
    root.mkdir()
    write_schedule(root, text)
    outcome, job = run_ingest(root, tmp_path, manifest(**MEANS))
    return outcome, job.read(TRIALS)


def test_means_take_their_lift_from_the_schedule(tmp_path: Path) -> None:
    _, table = means(
        tmp_path,
        "trial,boundary,distance,throttle,lift,lift_sd,n\na,ground,43,25,10,0.4,16\nb,ground,43,50,24,,\n",
    )
    np.testing.assert_allclose(table["lift_N"], [0.0980665, 0.2353596])
    np.testing.assert_allclose(table["u_lift_N"], [9.80665e-4, 0.0])
    assert list(table["n"]) == [16, 1]
    assert table["source_sha256"][0] == sha256(tmp_path / "raw" / "trials.csv")


def test_means_need_a_lift(tmp_path: Path) -> None:
    with pytest.raises(ManifestError, match="has no column 'lift'"):
        means(tmp_path, "trial,boundary,distance,throttle\na,ground,43,25\n")
    write_schedule(tmp_path, "trial,boundary,distance,throttle,lift\na,ground,43,25,\n")
    with pytest.raises(ManifestError, match="line 2, column 'lift': is empty"):
        run_ingest(tmp_path, tmp_path / "out", manifest(**MEANS))
