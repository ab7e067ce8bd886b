"""Names that lead astray: escape sequences, case, accents."""

from __future__ import annotations

import unicodedata
from pathlib import Path

from tests.unit import written
from tests.unit.small_run import nearlift

from nearlift.printing import printable

ESCAPE = "\x1b[2J\x1b]0;gone\x07"


def test_what_a_terminal_would_obey_is_shown_as_escapes() -> None:
    assert printable(f"a{ESCAPE}b") == "a\\x1b[2J\\x1b]0;gone\\x07b"
    assert printable("a\u202eb\u2028c\x9bd\udc80") == "a\\u202eb\\u2028c\\x9bd\\udc80"
    harmless = "5 \u00b5m\tc\u0301\nnext \u2581\u2588"
    assert printable(harmless) == harmless


def test_escapes_in_names_of_channels_units_and_files_reach_no_terminal(tmp_path: Path) -> None:
    rows = "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(60))
    header = f"t_s,Thrust{ESCAPE} (N),other{ESCAPE} (q{ESCAPE})\n"
    path = written.put(tmp_path, f"r{ESCAPE}.csv", (header + rows).encode())
    for words in (
        ("inspect", path),
        ("new", tmp_path / "c", "--from", path),
        ("inspect", "no\x1b"),
    ):
        answer = nearlift(*words)
        assert not {"\x1b", "\x07"} & {*answer.stdout, *answer.stderr}
    assert "\x1b" not in (tmp_path / "c" / "campaign.toml").read_text()


def ingested(root: Path, ids: list[str], files: list[str], pattern: str) -> str:
    """What `ingest` says of records with these ids, and files of these names."""
    force = "".join(f"{0.1 + (i % 5) / 1000 if i < 100 else 200 + i % 7}\n" for i in range(500))
    for name in files:
        written.put(root, pattern.replace("{trial}", name), f"force\n{force}".encode())
    manifest = written.MANIFEST.replace("trials/{trial}.csv", pattern)
    manifest = manifest.replace(', record = "2.5 s"', "").replace('supply = "V"', "")
    rows = "".join(f"{trial},ground,{30 + k},50\n" for k, trial in enumerate(ids))
    (root / "campaign.toml").write_text(manifest, encoding="utf-8")
    (root / "trials.csv").write_text(f"trial,boundary,distance,throttle\n{rows}", encoding="utf-8")
    return nearlift("ingest", root, "--out", root.parent).stderr


def test_ids_that_differ_in_case_or_accents_are_said(tmp_path: Path) -> None:
    accent = unicodedata.normalize("NFC", "h\u00f6he")
    files = ["a", "R2", unicodedata.normalize("NFD", accent)]
    said = ingested(tmp_path / "raw", ["a", "r2", accent], files, "trials/{trial}.csv")
    assert "trials/r2.csv is missing, but trials/R2.csv is there" in said
    assert "differs only in case" in said
    assert "differs only in case or in the Unicode form of its accents" in said
    assert "no trial's record" not in said


def test_the_schedule_beside_the_records_is_no_lost_record(tmp_path: Path) -> None:
    said = ingested(tmp_path / "raw", ["a", "b"], ["a", "b", "c"], "{trial}.csv")
    assert "c.csv is no trial's record" in said
    assert "trials.csv" not in said
