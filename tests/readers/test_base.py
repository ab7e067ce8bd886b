"""Readers: every road to the same bits, damage named, nothing read outside the folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.unit.manifests import manifest

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import BUILT_IN, reader, readers


def test_the_plan_leaves_out_what_is_not_there(tmp_path: Path) -> None:
    for trial in "ac":
        (tmp_path / f"{trial}.csv").write_text("force\n1\n")
    given = manifest(records={"files": "{trial}.csv"})
    assert [r.trial for r in reader("csv").read(given, tmp_path, ["a", "b", "c"])] == ["a", "c"]
    assert [p.name for p in reader("csv").files(given, tmp_path, ["a", "b", "c"])] == [
        "a.csv",
        "c.csv",
    ]


# ---- what may be read at all


def test_nothing_outside_the_folder_is_read(tmp_path: Path) -> None:
    root = tmp_path / "campaign"
    root.mkdir()
    (tmp_path / "secret.csv").write_text("force\n1\n")
    (root / "linked.csv").symlink_to(tmp_path / "secret.csv")
    (root / "loop.csv").symlink_to(root / "loop.csv")
    (root / "folder.csv").mkdir()
    os.mkfifo(root / "pipe.csv")
    given = manifest(records={"files": "{trial}.csv"})
    for trial, match in (
        ("linked", "leads outside"),
        ("loop", "loop of symbolic links"),
        ("folder", "not a regular file"),
        ("pipe", "not a regular file"),
    ):
        with pytest.raises(InputRefused, match=match):
            reader("csv").files(given, root, [trial])
    with pytest.raises(InputRefused, match="leads outside"):
        reader("csv").files(manifest(records={"files": "../{trial}.csv"}), root, ["secret"])
    with pytest.raises(ManifestError, match="cannot be part of a file name"):
        reader("csv").files(given, root, ["../secret"])


def test_a_link_within_the_folder_is_followed(tmp_path: Path) -> None:
    (tmp_path / "real.csv").write_text("force\n1\n")
    (tmp_path / "a.csv").symlink_to(tmp_path / "real.csv")
    assert (
        len(reader("csv").files(manifest(records={"files": "{trial}.csv"}), tmp_path, ["a"])) == 1
    )


@pytest.mark.parametrize(
    "pattern",
    [
        "trials/{trial}.csv",
        "{trial}.csv",
        "{trial}/force.csv",
        "{trial}/{trial}.csv",
        "[{trial}].csv",
    ],
)
@pytest.mark.parametrize("name", ["csv", "text"])
def test_a_record_without_a_row_is_told(tmp_path: Path, pattern: str, name: str) -> None:
    for trial in ("a", "b", "c-1", "d"):
        path = tmp_path / pattern.replace("{trial}", trial)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("t,force\n0,1\n1,2\n")
    chosen = manifest(
        records={
            "reader": name,
            "files": pattern,
            "force": {"column": "force", "unit": "mN", "sign": 1},
        }
    )
    (note,) = reader(name).plan(chosen, tmp_path, ["b", "d", "elsewhere"]).notes
    assert note.startswith(f"{pattern.replace('{trial}', 'a')} and 1 more are no trial's record")
    assert reader(name).plan(chosen, tmp_path, ["a", "b", "c-1", "d"]).notes == ()


def test_a_pattern_without_the_trial_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ManifestError, match=r"write \{trial\} in it"):
        reader("csv").files(manifest(records={"files": "all.csv"}), tmp_path, ["a"])


def test_an_unknown_reader_gets_the_nearest_name() -> None:
    with pytest.raises(ManifestError, match="did you mean 'parquet'"):
        reader("parket")
    assert [r.name for r in readers()[: len(BUILT_IN)]] == list(BUILT_IN)
