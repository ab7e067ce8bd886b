"""SHA256SUMS: what was changed between the rig and the first ingest is told, and costs no more than
it must.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from nearlift.errors import InputRefused
from nearlift.products import TRIALS
from nearlift.stages import ingest, sums

from .bench_campaign import run_ingest, small_campaign
from .manifests import UNITS, manifest

GIVEN: dict[str, Any] = {"trials": {"units": {**UNITS, "supply": "V"}}}


def line(path: Path, name: str | None = None, mark: str = "  ") -> str:
    return f"{hashlib.sha256(path.read_bytes()).hexdigest()}{mark}{name or path.name}\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "raw"
    folder.mkdir()
    small_campaign(folder)
    (folder / "campaign.toml").touch()
    (folder / "trials" / "SHA256SUMS").write_text(
        "".join(line(path) for path in sorted((folder / "trials").iterdir()))
    )
    (folder / "SHA256SUMS").write_text(
        line(folder / "campaign.toml") + line(folder / "trials.csv", mark=" *")
    )
    return folder


def edit(root: Path, name: str, change: Callable[[str], str]) -> None:
    path = root / name / "SHA256SUMS"
    path.write_text(change(path.read_text()))


def test_files_that_are_what_is_stated_pass_in_silence_and_the_lists_are_inputs(
    root: Path, tmp_path: Path
) -> None:
    outcome, _ = run_ingest(root, tmp_path, manifest(**GIVEN))
    assert (outcome.rejected, outcome.notes) == ((), ())
    assert {"SHA256SUMS", "trials/SHA256SUMS"} < set(ingest.inputs(root, manifest(**GIVEN)))


def test_a_record_that_is_not_what_was_stated_costs_its_trial(root: Path, tmp_path: Path) -> None:
    path = root / "trials" / "t03.csv"
    path.write_bytes(path.read_bytes().replace(b"5", b"6", 1))
    outcome, job = run_ingest(root, tmp_path, manifest(**GIVEN))
    ((trial, reason),) = outcome.rejected
    assert trial == "t03"
    assert (
        "trials/t03.csv is not what trials/SHA256SUMS states; copy it anew from the rig" in reason
    )
    assert [i for i, text in enumerate(job.read(TRIALS)["quality"]) if text] == [3]


def test_most_records_changed_alike_are_a_refusal(root: Path, tmp_path: Path) -> None:
    for path in (root / "trials").glob("*.csv"):
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    with pytest.raises(
        InputRefused,
        match=(
            r"states other sums for 8 of 8 records, such as trials/t00\.csv\n  were they copied as"
            r" text"
        ),
    ):
        run_ingest(root, tmp_path, manifest(**GIVEN))


@pytest.mark.parametrize("name", ["trials.csv", "campaign.toml"])
def test_a_changed_schedule_or_manifest_is_a_refusal(root: Path, tmp_path: Path, name: str) -> None:
    (root / name).write_bytes((root / name).read_bytes() + b"\n")
    with pytest.raises(
        InputRefused,
        match=(
            f"{name}: is not what SHA256SUMS states\n  copy it anew from the rig; if it was changed"
            " on purpose, write"
        ),
    ):
        run_ingest(root, tmp_path, manifest(**GIVEN))


def test_what_is_missing_and_what_is_not_listed_is_noted(root: Path, tmp_path: Path) -> None:
    (root / "trials" / "t02.csv").unlink()
    edit(root, "trials", lambda text: "".join(text.splitlines(keepends=True)[:-1]))
    outcome, _ = run_ingest(root, tmp_path, manifest(**GIVEN))
    assert [trial for trial, _ in outcome.rejected] == ["t02"]
    assert (
        "trials/SHA256SUMS lists trials/t02.csv: missing: copy anew from the rig" in outcome.notes
    )
    assert (
        "trials/SHA256SUMS does not list trials/t13.csv: read all the same, and unchecked"
        in outcome.notes
    )


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "link"])
def test_names_outside_the_folder_are_refused(root: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "secret").write_text("x")
    (root / "link").symlink_to(tmp_path / "secret")
    edit(root, "", lambda text: text + f"{'0' * 64}  {name}\n")
    with pytest.raises(
        InputRefused, match=r"SHA256SUMS, line 3 = .*leads outside the campaign's folder"
    ):
        run_ingest(root, tmp_path, manifest(**GIVEN))


@pytest.mark.parametrize(
    "bad",
    [
        "SHA256 (trials.csv) = " + "0" * 64,
        "0" * 63 + "  trials.csv",
        "g" * 64 + "  trials.csv",
        "0" * 64 + " trials.csv",
        "0" * 64 + "  ",
        "0" * 64 + "  a\0",
    ],
)
def test_a_line_of_another_form_is_named(root: Path, tmp_path: Path, bad: str) -> None:
    edit(root, "", lambda text: text + bad + "\n")
    with pytest.raises(InputRefused, match=r"SHA256SUMS, line 3: is no line of sha256sum"):
        run_ingest(root, tmp_path, manifest(**GIVEN))


def test_one_file_with_two_sums_is_refused(root: Path, tmp_path: Path) -> None:
    edit(root, "", lambda text: text + f"{'0' * 64}  ./trials.csv\n")
    with pytest.raises(InputRefused, match=r"line 3: states another sum for trials\.csv"):
        run_ingest(root, tmp_path, manifest(**GIVEN))


@pytest.mark.parametrize(
    "name", ["plain", "two words", "back\\slash", "line\nend", "return\rcarriage", "\\n", " blank "]
)
@pytest.mark.parametrize("binary", [False, True])
def test_names_are_read_as_coreutils_writes_them(tmp_path: Path, name: str, binary: bool) -> None:
    (tmp_path / name).write_bytes(b"x")
    escaped = name.replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "\\r")
    text = ("\\" if escaped != name else "") + line(
        tmp_path / name, escaped, " *" if binary else "  "
    )
    (tmp_path / "SHA256SUMS").write_text(text, newline="")
    assert sums.stated(tmp_path, tmp_path / "SHA256SUMS") == {
        name: hashlib.sha256(b"x").hexdigest()
    }
    if shutil.which("sha256sum"):
        made = subprocess.run(
            ["sha256sum", *(["-b"] if binary else []), name],
            cwd=tmp_path,
            capture_output=True,
            check=True,
        ).stdout
        assert made.decode() == text


def test_a_list_that_lists_itself_as_it_was_empty_is_as_the_shell_writes_it(
    root: Path, tmp_path: Path
) -> None:
    edit(root, "", lambda text: text + f"{hashlib.sha256(b'').hexdigest()}  SHA256SUMS\n")
    assert run_ingest(root, tmp_path, manifest(**GIVEN))[0].notes == ()


def test_lines_may_end_as_on_windows(root: Path, tmp_path: Path) -> None:
    path = root / "SHA256SUMS"
    path.write_bytes(
        b"\xef\xbb\xbf"
        + path.read_bytes()
        .upper()
        .replace(b"CAMPAIGN.TOML", b"campaign.toml")
        .replace(b"TRIALS.CSV\n", b"trials.csv\r\n")
    )
    assert run_ingest(root, tmp_path, manifest(**GIVEN))[0].notes == ()
