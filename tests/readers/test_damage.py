"""The bad inputs that laboratories make, one after another: the damage is made, and the reaction
seen at the command line, or in a record.

The numbers are those of the table in docs/formats.md. Disks, signals and locks (27 to 29) have
tests of their own, as have fields of velocity (25).
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.readers.reading import records
from tests.unit import written
from tests.unit.bench_campaign import force_mN, small_campaign, write_record
from tests.unit.manifests import HEAD, LIVE, RATE
from tests.unit.small_run import nearlift

from nearlift.errors import InputRefused
from nearlift.onboarding.inspection import inspect
from nearlift.readers import rows as reading
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT, LIFT_COVARIANCE

#: The trial that is damaged: near the ground at half throttle, 275 mN.
TRIAL = "t01"


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good") / "raw"
    folder.mkdir()
    small_campaign(folder)
    (folder / "campaign.toml").write_text(written.MANIFEST)
    for path in folder.rglob("*.*"):
        os.utime(path, (1e9, 1e9))
    return folder


@pytest.fixture
def raw(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "raw"))


def ingest(raw: Path) -> tuple[int, str, dict[str, str]]:
    """Exit code, what was said, and the quality of every trial (none where nothing was written)."""
    found = nearlift("ingest", raw, "--out", raw.parent)
    assert "Traceback" not in found.output
    path = raw.parent / "processed" / "bench" / TRIALS.file
    if not path.is_file():
        return found.exit_code, found.stderr, {}
    table = tables.read_table(path, TRIALS)
    return found.exit_code, found.stderr, dict(zip(table["trial"], table["quality"], strict=True))


def record(raw: Path, trial: str = TRIAL) -> Path:
    return raw / "trials" / f"{trial}.csv"


def lines(raw: Path) -> list[bytes]:
    return record(raw).read_bytes().splitlines(keepends=True)


def edit(raw: Path, file: str, old: str, new: str) -> None:
    text = (raw / file).read_text()
    assert old in text
    (raw / file).write_text(text.replace(old, new))


def put(content: bytes, age_s: float = 1e6) -> Callable[[Path], None]:
    def damage(raw: Path) -> None:
        record(raw).write_bytes(content)
        os.utime(record(raw), (time.time() - age_s,) * 2)

    return damage


def cut(share: float, *, at_line: bool = False) -> Callable[[Path], None]:
    def damage(raw: Path) -> None:
        content = record(raw).read_bytes()
        content = content[: int(share * len(content))]
        put(content[: content.rfind(b"\n") + 1] if at_line else content.rstrip(b"\n"))(raw)

    return damage


def series(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    return lambda raw: write_record(raw, TRIAL, change(force_mN(275.0, seed=99)))


def words(raw: Path) -> None:
    rows = lines(raw)
    for i in range(HEAD + 10, HEAD + LIVE, 20):
        rows[i] = (b"OVER\n", b"#NV\n", b"1.#INF\n", b"nan\n")[i % 4]
    record(raw).write_bytes(b"".join(rows))


def clock(
    change: Callable[[np.ndarray], np.ndarray], *, others: bool = False
) -> Callable[[Path], None]:
    """Every record with a clock, the damaged one (or all) with a changed one."""

    def damage(raw: Path) -> None:
        edit(
            raw,
            "campaign.toml",
            "sign = 1 } }",
            'sign = 1 }, time = { column = "t", unit = "s" } }',
        )
        for path in (raw / "trials").iterdir():
            force = path.read_text().split()[1:]
            t = np.arange(len(force)) / RATE
            t = change(t) if others or path.stem == TRIAL else t
            path.write_text(
                "t,force\n" + "".join(f"{a:.6f},{b}\n" for a, b in zip(t, force, strict=False))
            )

    return damage


def cut_row(raw: Path) -> None:
    record(raw).write_bytes(b"".join([*lines(raw)[:50], b"1.5,\n", *lines(raw)[50:]]))


def wrong_check_sum(raw: Path) -> None:
    """Turn all records into HDF5 with check sums, one of them with a flipped bit."""
    edit(
        raw,
        "campaign.toml",
        'reader = "csv", files = "trials/{trial}.csv"',
        'reader = "hdf5", files = "trials/{trial}.h5"',
    )
    edit(raw, "campaign.toml", 'column = "force", unit = "mN"', 'column = "/daq/force", unit = "N"')
    edit(raw, "campaign.toml", "sign = 1 } }", "sign = 1 }, dialect = { ignore_rate = true } }")
    for path in list((raw / "trials").iterdir()):
        force = [float(x) / 1000 for x in path.read_text().split()[1:]]
        content = bytearray(written.hdf5(force, fletcher=True))
        if path.stem == TRIAL:
            content[content.find(np.float64(force[50]).tobytes())] ^= 1
        path.with_suffix(".h5").write_bytes(bytes(content))
        path.unlink()


def doubled(raw: Path) -> None:
    record(raw).write_bytes(record(raw, "t00").read_bytes())


def reached(raw: Path) -> None:
    edit(raw, "campaign.toml", 'supply = "V"', 'supply = "V"\nreached = "mm"')
    rows = (raw / "trials.csv").read_text().split()
    # the traverse stood 3 mm off, more than 2 % of the rotor's radius
    text = [
        rows[0] + ",reached",
        *(f"{r},{float(r.split(',')[2]) + (3 if r.startswith(TRIAL) else 0.1)}" for r in rows[1:]),
    ]
    (raw / "trials.csv").write_text("\n".join(text) + "\n")


def tare_after(raw: Path) -> None:
    edit(raw, "campaign.toml", 'supply = "V"', 'supply = "V"\ntare_after = "mN"')
    rows = (raw / "trials.csv").read_text().split()
    (raw / "trials.csv").write_text(
        "\n".join(
            [
                rows[0] + ",tare_after",
                *(f"{r},{40 if r.startswith(TRIAL) else 5}" for r in rows[1:]),
            ]
        )
        + "\n"
    )


#: Row of the table, damage, codes that the trial must carry, and whether the record itself is
#: whole.
CODED: list[tuple[str, Callable[[Path], None], set[str], str]] = [
    ("1 empty file", put(b""), {"EMPTY"}, "truncated"),
    ("2 header only", put(b"force\n"), {"NO_DATA"}, "truncated"),
    ("3 number cut, nearly all there", cut(0.99), {"truncated", "short"}, "truncated"),
    ("3 less than 95 %", cut(0.9), {"truncated", "SHORT"}, "truncated"),
    (
        "3 cut between two lines, seen by the planned length",
        cut(0.98, at_line=True),
        {"short"},
        "truncated",
    ),
    ("3 a row cut in the middle of the file", cut_row, {"MALFORMED"}, "malformed"),
    ("7 wrong check sum", wrong_check_sum, {"MALFORMED"}, "malformed"),
    ("8 words for no number", words, {"OUT_OF_RANGE"}, "complete"),
    (
        "9 beyond the capacity",
        series(lambda f: np.minimum(f * 50, 9806.0)),
        {"SATURATED"},
        "complete",
    ),
    (
        "9 clipped at one code",
        series(lambda f: np.minimum(f, np.sort(f)[-60])),
        {"SATURATED"},
        "complete",
    ),
    (
        "10 stands still",
        series(lambda f: np.where(np.arange(len(f)) < HEAD, f, f[HEAD])),
        {"STUCK"},
        "complete",
    ),
    (
        "11 spikes",
        series(lambda f: f + 80.0 * (np.arange(len(f)) % 97 == 50)),
        {"spikes"},
        "complete",
    ),
    (
        "14 header repeated",
        lambda raw: record(raw).write_bytes(record(raw).read_bytes() * 2),
        {"MALFORMED"},
        "malformed",
    ),
    ("16 drift of the zero", tare_after, {"DRIFT"}, "complete"),
    ("18 the same record twice", doubled, {"DUPLICATE"}, "complete"),
    (
        "19 clock backwards",
        clock(lambda t: np.where(np.arange(len(t)) == 1, t - 0.02, t)),
        {"clock"},
        "complete",
    ),
    (
        "19 duplicate stamps",
        clock(lambda t: np.where(np.arange(len(t)) == 9, t[8], t)),
        {"clock"},
        "complete",
    ),
    ("19 a gap", clock(lambda t: t + 0.06 * (np.arange(len(t)) > 200)), {"gaps"}, "truncated"),
    (
        "19 summer time begins",
        clock(lambda t: t + 3600.0 * (np.arange(len(t)) > 200)),
        {"clock"},
        "complete",
    ),
    (
        "19 summer time ends",
        clock(lambda t: t - 3600.0 * (np.arange(len(t)) > 200)),
        {"clock"},
        "complete",
    ),
    (
        "19 a great gap",
        clock(lambda t: t + 1000.0 * (np.arange(len(t)) > 200)),
        {"GAPS"},
        "truncated",
    ),
    ("20 a wrong rate", clock(lambda t: 2 * t), {"MALFORMED"}, "malformed"),
    (
        "21 two throttles in a trial",
        series(lambda f: f + 60.0 * (np.arange(len(f)) > HEAD + LIVE // 2)),
        {"MIXED"},
        "complete",
    ),
    ("22 the traverse did not arrive", reached, {"HEIGHT"}, "complete"),
    (
        "23 aborted",
        lambda raw: write_record(raw, TRIAL, force_mN(275.0)[: HEAD + 3]),
        {"TOO_SHORT", "SHORT"},
        "truncated",
    ),
    (
        "30 NUL tail",
        lambda raw: record(raw).write_bytes(b"".join(lines(raw)[:-3]) + b"\0" * 64),
        {"truncated", "short"},
        "truncated",
    ),
    ("missing", lambda raw: record(raw).unlink(), {"MISSING"}, "missing"),
]


@pytest.mark.parametrize(
    ("damage", "codes", "whole"), [row[1:] for row in CODED], ids=[row[0] for row in CODED]
)
def test_a_bad_record_gets_its_code_and_costs_no_other_trial(
    raw: Path, damage: Any, codes: set[str], whole: str
) -> None:
    damage(raw)
    for path in (raw / "trials").iterdir():
        # long since written
        os.utime(path, (1e9, 1e9))
    code, said, quality = ingest(raw)
    own = set(quality[TRIAL].split())
    assert codes <= own, own
    assert all(not text for trial, text in quality.items() if trial != TRIAL), quality
    rejects = any(c.isupper() for c in own)
    assert code == (3 if rejects else 0)
    if rejects:
        assert f"{TRIAL}: " in said
        assert f"{next(c for c in quality[TRIAL].split() if c.isupper())} (" in said
    else:
        assert "1 accepted trial carries a remark: " in said
    table = tables.read_table(raw.parent / "processed" / "bench" / TRIALS.file, TRIALS)
    assert dict(zip(table["trial"], table["completeness"], strict=True))[TRIAL] == whole


def test_11_spikes_leave_the_uncertainty(raw: Path) -> None:
    quiet = dict(zip(*(read(raw)[k] for k in ("trial", "u_lift_N")), strict=True))[TRIAL]
    series(lambda f: f + 80.0 * (np.arange(len(f)) % 97 == 50))(raw)
    loud = dict(zip(*(read(raw)[k] for k in ("trial", "u_lift_N")), strict=True))[TRIAL]
    assert 0.5 < loud / quiet < 2


def read(raw: Path) -> Any:
    ingest(raw)
    return tables.read_table(raw.parent / "processed" / "bench" / TRIALS.file, TRIALS)


def test_18_whose_record_it_is_is_told(raw: Path) -> None:
    doubled(raw)
    assert "note: the record of t01 is that of t00, byte for byte" in ingest(raw)[1]


def test_21_a_drift_is_no_step(raw: Path) -> None:
    series(lambda f: f + 60.0 * np.clip((np.arange(len(f)) - HEAD) / LIVE, 0, 1))(raw)
    assert "MIXED" not in ingest(raw)[2][TRIAL].split()


def test_3_what_is_wrong_with_a_record_is_told_with_its_place(raw: Path) -> None:
    cut_row(raw)
    _, said, _ = ingest(raw)
    assert "t01: MALFORMED (" in said
    assert "): trials/t01.csv, line 51: has 2 cells under 1 column names" in said
    table = tables.read_table(raw.parent / "processed" / "bench" / TRIALS.file, TRIALS)
    assert {t: f for t, f in zip(table["trial"], table["fault"], strict=True) if f} == {
        TRIAL: "trials/t01.csv, line 51: has 2 cells under 1 column names"
    }


# ---- 4, 5: half-written, and still being written


def test_4_a_half_written_tdms_is_flagged_and_counted(raw: Path) -> None:
    edit(
        raw,
        "campaign.toml",
        'reader = "csv", files = "trials/{trial}.csv"',
        'reader = "tdms", files = "trials/{trial}.tdms"',
    )
    edit(
        raw,
        "campaign.toml",
        '"force", unit = "mN", sign = 1 } }',
        '"daq/force", unit = "mN", sign = 1 }, dialect = { ignore_rate = true } }',
    )
    for path in list((raw / "trials").iterdir()):
        content = written.tdms([float(x) for x in path.read_text().split()[1:]]).replace(
            b"unit_string", b"unit_xxxxxx"
        )
        if path.stem == TRIAL:
            content = content[: int(0.7 * len(content))]
        if path.stem == "t02":
            # exactly between two segments: no flag, only the count tells
            content = content[: content.rfind(b"TDSm")]
        path.with_suffix(".tdms").write_bytes(content)
        os.utime(path.with_suffix(".tdms"), (1e9, 1e9))
        path.unlink()
    code, _, quality = ingest(raw)
    assert code == 3
    assert (quality[TRIAL], quality["t02"], quality["t03"]) == ("SHORT truncated", "SHORT", "")


def test_5_a_file_that_is_still_being_written_is_left_for_later(raw: Path) -> None:
    content = record(raw).read_bytes()
    put(content[: len(content) // 2], age_s=0.0)(raw)
    code, said, quality = ingest(raw)
    assert code == 3
    assert "PENDING" in quality[TRIAL].split()
    assert (
        f"{TRIAL}: PENDING (the file was still being written; the next run reads it again)" in said
    )
    # nothing has changed, but it is looked at again
    planned = nearlift("run", raw, "--dry-run", "--out", raw.parent)
    assert "ingest   run: 1 record was still being written" in planned.stdout
    put(content)(raw)
    assert ingest(raw)[::2] == (0, dict.fromkeys(quality, ""))


def test_5_a_file_that_changes_while_it_is_read(raw: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = reading._mark_pending

    def meanwhile(*given: Any) -> Any:
        with record(raw).open("ab") as file:
            file.write(b"270.1\n")
        return real(*given)

    monkeypatch.setattr(reading, "_mark_pending", meanwhile)
    code, _, quality = ingest(raw)
    assert (code, quality[TRIAL]) == (3, "PENDING")


def test_5_a_schedule_that_changes_while_it_is_read_stops(
    raw: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = reading._mark_pending

    def meanwhile(*given: Any) -> Any:
        (raw / "trials.csv").touch()
        return real(*given)

    monkeypatch.setattr(reading, "_mark_pending", meanwhile)
    code, said, quality = ingest(raw)
    assert (code, quality) == (4, {})
    assert "trials.csv: was changed while it was being read" in said


# ---- what stops the run: exit code and words


def everywhere(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def damage(raw: Path) -> None:
        for path in (raw / "trials").iterdir():
            path.write_bytes(change(path.read_bytes()))

    return damage


def by_text(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def damage(raw: Path) -> None:
        edit(raw, "campaign.toml", 'reader = "csv"', 'reader = "text"')
        everywhere(change)(raw)

    return damage


def manifest(old: str, new: str) -> Callable[[Path], None]:
    return lambda raw: edit(raw, "campaign.toml", old, new)


def schedule(old: str, new: str) -> Callable[[Path], None]:
    return lambda raw: edit(raw, "trials.csv", old, new)


def outside(raw: Path) -> None:
    away = raw.parent / "away.csv"
    shutil.move(record(raw), away)
    record(raw).symlink_to(away)


def loop(raw: Path) -> None:
    record(raw).unlink()
    record(raw).symlink_to(record(raw))


def fifo(raw: Path) -> None:
    record(raw).unlink()
    os.mkfifo(record(raw))


def device(raw: Path) -> None:
    record(raw).unlink()
    record(raw).symlink_to("/dev/zero")


def unit_of_header(raw: Path) -> None:
    edit(raw, "campaign.toml", 'reader = "csv"', 'reader = "rcbenchmark"')
    edit(raw, "campaign.toml", 'column = "force", unit = "mN"', 'column = "Thrust", unit = "N"')
    for path in (raw / "trials").iterdir():
        path.write_bytes(
            written.rcbenchmark([float(x) / 9.80665 for x in path.read_text().split()[1:]])
        )


STOPPED: list[tuple[str, Callable[[Path], None], int, str]] = [
    ("12 gram-force read as newton", manifest('unit = "mN"', 'unit = "N"'), 4, "times the weight"),
    (
        "12 a unit that the header contradicts",
        unit_of_header,
        4,
        "states 'Thrust (gf)' in gf, the manifest says N: a factor of 0.009807",
    ),
    (
        "12 the impossible cm",
        manifest('distance = "mm"', 'distance = "cm"'),
        4,
        "300 cm is outside the 1.5 m arena; mm?",
    ),
    (
        "13 decimal commas in a csv",
        everywhere(lambda c: c.replace(b".", b",")),
        4,
        "has 2 cells under 1 column names",
    ),
    (
        "13 ambiguous commas",
        by_text(lambda c: b"force\n" + b"1,234\n" * 500),
        4,
        "'1,234' may be 1.234 or 1234\n  say which",
    ),
    (
        "14 duplicate column names",
        everywhere(lambda c: b"force,force\n1,2\n"),
        4,
        "has more than one column 'force'",
    ),
    (
        "14 header repeated",
        everywhere(lambda c: c * 2),
        4,
        "repeats the header: two records are in one file",
    ),
    ("15 no tare", manifest('tare = "0.5 s", ', ""), 2, "[load_cell] needs tare"),
    (
        "18 one id, two trials",
        schedule("t02,", "t01,"),
        2,
        "trial 't01' is already in trials.csv, line 3",
    ),
    (
        "20 a wrong rate",
        clock(lambda t: 2 * t, others=True),
        4,
        "the clock column runs at 100 Hz, the manifest says 200 Hz",
    ),
    (
        "20 a wrong rate, by the planned length",
        manifest('"200 Hz"', '"250 Hz"'),
        4,
        "where 2.5 s at 250 Hz are 625\n  is the rate 200 Hz?",
    ),
    ("20 too low a rate", manifest('"200 Hz"', '"160 Hz"'), 4, "the records hold 500 samples"),
    (
        "24 on the boundary",
        schedule("t01,ground,30", "t01,ground,0"),
        4,
        "0 mm with an offset of 0 mm puts the rotor on the ground itself",
    ),
    ("24 inside the boundary", schedule(",30,", ",-3,"), 4, "-3 mm"),
    (
        "26 no gravity",
        manifest(', gravity = "9.8 m/s^2"', ""),
        2,
        "rig.gravity: is missing\n  `nearlift new DIR` writes",
    ),
    (
        "26 no radius",
        manifest('rotor_radius = "23 mm", ', ""),
        2,
        "vehicle.rotor_radius: is missing",
    ),
    ("32 a link out of the folder", outside, 4, "leads outside the campaign's folder"),
    ("32 a link to itself", loop, 4, "is a loop of symbolic links"),
    ("32 a pipe", fifo, 4, "is not a regular file"),
    ("32 a device", device, 4, "leads outside the campaign's folder"),
    (
        "32 a path upwards",
        manifest("trials/{trial}.csv", "../raw/trials/{trial}.csv"),
        4,
        "leads outside the campaign's folder",
    ),
    (
        "32 an absolute path",
        manifest("trials/{trial}.csv", "/dev/{trial}"),
        4,
        "leads outside the campaign's folder, to /dev/t00",
    ),
    (
        "33 a later manifest",
        manifest("nearlift.campaign/1", "nearlift.campaign/2"),
        2,
        "schema: is 'nearlift.campaign/2', and this nearlift reads 'nearlift.campaign/1'",
    ),
]


@pytest.mark.parametrize(
    ("damage", "code", "text"), [row[1:] for row in STOPPED], ids=[row[0] for row in STOPPED]
)
def test_what_cannot_be_true_stops_the_run_and_writes_nothing(
    raw: Path, damage: Any, code: int, text: str
) -> None:
    damage(raw)
    found, said, quality = ingest(raw)
    assert (found, quality) == (code, {}), said
    assert text in said
    assert code == 2 or "\n  " in said, "it says what to do"


# ---- what is read all the same


def plain(raw: Path) -> bytes:
    assert ingest(raw)[0] == 0
    table = tables.read_table(raw.parent / "processed" / "bench" / TRIALS.file, TRIALS)
    return bytes(table["lift_N"].tobytes())


def latin_1(content: bytes) -> bytes:
    """A second column whose name only an 8-bit encoding spells in so many bytes."""
    head, *rows = content.decode().splitlines()
    return "\n".join([head + ",Gr\u00f6\u00dfe", *(row + ",1" for row in rows), ""]).encode(
        "latin-1"
    )


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("13 decimal commas", lambda c: c.replace(b".", b",")),
        ("13 UTF-16", lambda c: c.decode().encode("utf-16")),
        ("13 byte order mark", lambda c: b"\xef\xbb\xbf" + c),
        ("13 Latin-1", latin_1),
        (
            "14 trailing comma",
            lambda c: (
                c.replace(b"force\n", b"force,n\n", 1)
                .replace(b"\n", b",7,\n")
                .replace(b"n,7,\n", b"n,\n", 1)
            ),
        ),
        ("14 trailing comma behind one column", lambda c: c.replace(b"\n", b",\n")),
        (
            "14 trailing comma in rows only",
            lambda c: c.replace(b"\n", b",\n").replace(b"force,", b"force"),
        ),
        ("14 units row", lambda c: c.replace(b"force\n", b"force\nmN\n", 1)),
        (
            "33 an unknown column",
            lambda c: (
                c.replace(b"force\n", b"force,new\n", 1)
                .replace(b"\n", b",1\n")
                .replace(b"new,1\n", b"new\n", 1)
            ),
        ),
    ],
)
def test_13_14_33_dialects_give_the_same_numbers(raw: Path, kind: str, change: Any) -> None:
    before = plain(raw)
    by_text(change)(raw)
    assert plain(raw) == before


def test_15_no_tare_enters_the_budget_when_that_is_said(raw: Path) -> None:
    edit(raw, "campaign.toml", 'tare = "0.5 s"', 'tare = "none"')
    edit(raw, "campaign.toml", ', record = "2.5 s"', "")
    for path in (raw / "trials").iterdir():
        rows = path.read_bytes().splitlines(keepends=True)
        path.write_bytes(b"".join([rows[0], *rows[HEAD + 1 :]]))
    code, said, _ = ingest(raw)
    assert (code, "the records have no tare" in said) == (0, True)


def test_17_a_throttle_without_a_far_station_has_no_delta_L_unless_asked(raw: Path) -> None:
    """L_inf of such a group would be a lift that the boundary changes; the others have theirs as
    before.
    """
    rows = (raw / "trials.csv").read_text().split()
    (raw / "trials.csv").write_text("\n".join(r for r in rows if not r.startswith("t12")) + "\n")
    assert ingest(raw)[0] == 0

    def reduced() -> tuple[str, dict[float, set[bool]], int]:
        said = nearlift("reduce", raw, "--out", raw.parent)
        assert said.exit_code == 0, said.stderr
        folder = next((raw.parent / "processed").iterdir())
        cells, covariance = (
            tables.read_table(folder / LIFT.file, LIFT),
            tables.read_table(folder / LIFT_COVARIANCE.file, LIFT_COVARIANCE),
        )
        for name in ("delta_L", "u_delta_L"):
            known = {
                float(t): set(np.isfinite(cells[name][cells["throttle"] == t]).tolist())
                for t in np.unique(cells["throttle"])
            }
        finite = np.isfinite(np.stack(list(covariance.values())))
        assert (
            finite == np.outer(np.isfinite(cells["delta_L"]), np.isfinite(cells["delta_L"]))
        ).all()
        assert np.isfinite(cells["lift_N"]).all()
        return said.stderr, known, int(finite.sum())

    said, known, _ = reduced()
    assert (
        "note: ground: at 75 % throttle no trial is farther than z_hat = 1.3, where others reach"
        " 13: it has no L_inf, hence no Delta L" in said
    )
    assert "near_reference = true under [quality]" in said
    assert known == {t: {t != 0.75} for t in known}
    assert 0.75 in known
    text = (raw / "campaign.toml").read_text()
    (raw / "campaign.toml").write_text(text + "\n[quality]\nnear_reference = true\n")
    said, known, _ = reduced()
    assert "its Delta L rests on a lift that the boundary changes, as asked" in said
    assert known == {t: {True} for t in known}


def test_6_and_31_names_with_blanks_and_umlauts_work(raw: Path) -> None:
    name = "Pr\u00fcfling 7 (b)"
    record(raw).rename(raw / "trials" / f"{name}.csv")
    edit(raw, "trials.csv", "t01,", f"{name},")
    code, _, quality = ingest(raw)
    assert (code, quality[name]) == (0, "")
    # two names that differ in case only are two trials
    edit(raw, "trials.csv", "t02,", "T03,")
    record(raw, "t02").rename(raw / "trials" / "T03.csv")
    assert set(ingest(raw)[2]) >= {"T03", "t03"}


def test_31_an_id_longer_than_any_file_name_is_a_missing_record(raw: Path) -> None:
    edit(raw, "trials.csv", "t01,", "t" * 300 + ",")
    code, said, _ = ingest(raw)
    assert code in (3, 4)
    assert "Traceback" not in said


def test_33_an_unknown_column_of_the_schedule_is_kept(raw: Path) -> None:
    rows = (raw / "trials.csv").read_text().split()
    (raw / "trials.csv").write_text(
        "\n".join([rows[0] + ",moon", *(f"{r},{i}" for i, r in enumerate(rows[1:]))]) + "\n"
    )
    assert ingest(raw)[0] == 0
    assert tables.read_table(raw.parent / "processed" / "bench" / TRIALS.file, TRIALS)[
        "moon"
    ].tolist() == list(range(8))


# ---- what must not matter, and what must


def test_the_order_of_files_and_trials_changes_nothing_but_run_order(raw: Path) -> None:
    first = read(raw)
    rows = (raw / "trials.csv").read_text().split()
    (raw / "trials.csv").write_text("\n".join([rows[0], *rows[:0:-1]]) + "\n")
    other = read(raw)
    order = [list(other["trial"]).index(name) for name in first["trial"]]
    for column in first:
        if column != "visit":
            np.testing.assert_array_equal(other[column][order], first[column])


def test_scaling_all_forces_leaves_delta_l(raw: Path) -> None:
    from nearlift.stages.reduce import LIFT

    def delta() -> Any:
        assert nearlift("ingest", raw, "--out", raw.parent, "-q").exit_code == 0
        assert nearlift("reduce", raw, "--out", raw.parent, "-q").exit_code == 0
        return tables.read_table(raw.parent / "processed" / "bench" / LIFT.file, LIFT)

    first = delta()
    edit(raw, "campaign.toml", 'unit = "mN"', 'unit = "gf"')
    edit(raw, "campaign.toml", '"1 kgf"', '"10 kgf"')
    edit(raw, "campaign.toml", '"27 g"', '"265 g"')
    other = delta()
    np.testing.assert_allclose(other["lift_N"], 9.80665 * first["lift_N"])
    np.testing.assert_allclose(other["delta_L"], first["delta_L"], rtol=1e-12, atol=1e-15)


def test_32_the_size_is_told_before_anything_is_read(raw: Path) -> None:
    length = sum(path.stat().st_size for path in raw.rglob("*.*"))
    assert f"(has not run yet; 10 files with {length / 1e3:.3g} kB)" in ingest(raw)[1]


def test_json_speaks_of_rejections_too(raw: Path) -> None:
    put(b"")(raw)
    found = json.loads(nearlift("ingest", raw, "--out", raw.parent, "--json").stdout)
    assert found["exit_code"] == 3
    assert found["stages"][0]["rejected"][0][0] == TRIAL


# ---- binary files


@pytest.mark.parametrize(("name", "suffix"), [("hdf5", "h5"), ("mat", "mat"), ("tdms", "tdms")])
def test_garbage_costs_its_trial_only(tmp_path: Path, name: str, suffix: str) -> None:
    write, column, unit, _ = written.WRITERS[name]
    written.put(tmp_path, f"a.{suffix}", b"\x89HDF garbage " * 50)
    written.put(tmp_path, f"b.{suffix}", write([1.0, 2.0, 3.0]))
    a, b = records(tmp_path, name, column, unit, f"{{trial}}.{suffix}")
    assert a.codes == ("MALFORMED",)
    assert a.fault.startswith(f"a.{suffix}: ")
    assert len(b.force_N) == 3


def test_a_dataflash_log_is_named_as_what_it_is(tmp_path: Path) -> None:
    path = written.put(tmp_path, "00000012.BIN", b"\xa3\x95\x80\x80\x59FMT\0" + bytes(80))
    with pytest.raises(InputRefused, match=r"is a DataFlash log \(\.BIN\) of ArduPilot"):
        inspect(path)
