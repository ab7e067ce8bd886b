"""The bad inputs that laboratories make: the damage is made, and the reaction seen in a record, or
at the command line.

The numbers are those of the table in docs/formats.md. Disks, signals and locks (27 to 29) have
tests of their own, as have fields of velocity (25), and dialects that are read all the same (13,
14, 33).
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
from tests.unit.bench_campaign import force_mN, small_campaign, write_schedule
from tests.unit.manifests import HEAD, LIVE, RATE
from tests.unit.small_run import nearlift

from nearlift.errors import InputRefused
from nearlift.onboarding.inspection import inspect
from nearlift.readers import rows as reading
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

#: A trial near the ground at half throttle, 275 mN.
TRIAL = "t01"
Edit = Callable[[Path], None]
#: The end of a manifest's force, with a clock.
TIMED = 'sign = 1 }, time = { column = "t", unit = "s" } }'


def ingest(raw: Path) -> tuple[int, str, dict[str, str]]:
    """Exit code, what was said, and the quality of every trial (none where nothing was written)."""
    given = nearlift("ingest", raw, "--out", raw.parent)
    assert "Traceback" not in given.output
    if not (raw.parent / "processed" / "bench" / TRIALS.file).is_file():
        return given.exit_code, given.stderr, {}
    table = product(raw)
    return given.exit_code, given.stderr, dict(zip(table["trial"], table["quality"], strict=True))


def product(raw: Path, which: Any = TRIALS) -> Any:
    return tables.read_table(raw.parent / "processed" / "bench" / which.file, which)


def edit(raw: Path, file: str, old: str, new: str) -> None:
    text = (raw / file).read_text()
    assert old in text
    (raw / file).write_text(text.replace(old, new))


def long_since_written(raw: Path) -> None:
    for path in raw.rglob("*.*"):
        os.utime(path, (1e9, 1e9))


# ---- records, one damage each, in one campaign


def record(t: Any, force: Any) -> bytes:
    rows = (f"{a:.6f},{b:.4f}\n" for a, b in zip(t, force, strict=True))
    return ("t,force\n" + "".join(rows)).encode()


FORCE = force_mN(275.0, seed=99)
PLACE = np.arange(HEAD + LIVE)
WHOLE = record(PLACE / RATE, FORCE)
LINES = WHOLE.splitlines(keepends=True)
LATER = PLACE > 200


def series(force: Any) -> bytes:
    return record(PLACE[: len(force)] / RATE, force)


def clock(t: Any) -> bytes:
    return record(t, FORCE)


def words() -> bytes:
    lines = list(LINES)
    for i in range(HEAD + 10, HEAD + LIVE, 20):
        word = (b"OVER", b"#NV", b"1.#INF", b"nan")[i % 4]
        lines[i] = lines[i].split(b",")[0] + b"," + word + b"\n"
    return b"".join(lines)


def cut(share: float) -> bytes:
    return WHOLE[: int(share * len(WHOLE))].rstrip(b"\n")


#: Row of the table and damage, the file's content, codes that the trial must carry, and what the
#: record itself is.
CODED: dict[str, tuple[bytes | None, str, str]] = {
    "1 empty file": (b"", "EMPTY", "truncated"),
    "2 header only": (b"t,force\n", "NO_DATA", "truncated"),
    "3 a number cut": (cut(0.99), "truncated short", "truncated"),
    "3 less than 95 %": (cut(0.9), "truncated SHORT", "truncated"),
    "3 cut between two lines": (b"".join(LINES[:-5]), "short", "truncated"),
    "3 a row cut within": (b"".join([*LINES[:50], b"0.25\n", *LINES[50:]]), "MALFORMED", "malformed"),
    "8 words for no number": (words(), "OUT_OF_RANGE", "complete"),
    "9 beyond the capacity": (series(np.minimum(FORCE * 50, 9806.0)), "SATURATED", "complete"),
    "9 clipped at one code": (series(np.minimum(FORCE, np.sort(FORCE)[-60])), "SATURATED", "complete"),
    "10 stands still": (series(np.where(PLACE < HEAD, FORCE, FORCE[HEAD])), "STUCK", "complete"),
    "11 spikes": (series(FORCE + 80.0 * (PLACE % 97 == 50)), "spikes", "complete"),
    "14 header repeated": (WHOLE * 2, "MALFORMED", "malformed"),
    "16 drift of the zero": (WHOLE, "DRIFT", "complete"),
    "18 the same record twice": (WHOLE, "DUPLICATE", "complete"),
    "19 clock backwards": (clock((PLACE - 4 * (PLACE == 1)) / RATE), "clock", "complete"),
    "19 duplicate stamps": (clock((PLACE - (PLACE == 9)) / RATE), "clock", "complete"),
    "19 a gap": (clock(PLACE / RATE + 0.06 * LATER), "gaps", "truncated"),
    "19 summer time begins": (clock(PLACE / RATE + 3600.0 * LATER), "clock", "complete"),
    "19 summer time ends": (clock(PLACE / RATE - 3600.0 * LATER), "clock", "complete"),
    "19 a great gap": (clock(PLACE / RATE + 1000.0 * LATER), "GAPS", "truncated"),
    "20 a wrong rate": (clock(2 * PLACE / RATE), "MALFORMED", "malformed"),
    "21 two throttles": (series(FORCE + 60.0 * (PLACE > HEAD + LIVE // 2)), "MIXED", "complete"),
    "22 the traverse did not arrive": (series(force_mN(275.0, seed=7)), "HEIGHT", "complete"),
    "23 aborted": (series(FORCE[: HEAD + 3]), "TOO_SHORT SHORT", "truncated"),
    "30 NUL tail": (b"".join(LINES[:-3]) + b"\0" * 64, "truncated short", "truncated"),
    "missing": (None, "MISSING", "missing"),
}  # fmt: skip


@pytest.fixture(scope="module")
def damaged(tmp_path_factory: pytest.TempPathFactory) -> tuple[int, str, Any]:
    """Exit code, words and table of a campaign with a trial for each damage."""
    raw = tmp_path_factory.mktemp("damaged") / "raw"
    raw.mkdir()
    small_campaign(raw)
    for path in (raw / "trials").iterdir():
        path.write_bytes(series([float(f) for f in path.read_text().split()[1:]]))
    rows = [row + ",,5" for row in (raw / "trials.csv").read_text().split()]
    rows[0] = rows[0].replace(",,5", ",reached,tare_after")
    for name, (content, *_) in CODED.items():
        # the traverse stood 3 mm off, more than 2 % of the rotor's radius
        reached, after = 33 if name.startswith("22") else 30.1, 40 if name.startswith("16") else 5
        rows.append(f"{name},ground,30,50,3.9,{reached},{after}")
        if content is not None:
            (raw / "trials" / f"{name}.csv").write_bytes(content)
    write_schedule(raw, "\n".join(rows) + "\n")
    timed = written.MANIFEST.replace("sign = 1 } }", TIMED)
    (raw / "campaign.toml").write_text(timed + 'reached = "mm"\ntare_after = "mN"\n')
    long_since_written(raw)
    code, said, _ = ingest(raw)
    return code, said, product(raw)


@pytest.mark.parametrize("name", CODED)
def test_a_bad_record_gets_its_codes(damaged: tuple[int, str, Any], name: str) -> None:
    _, _, table = damaged
    at = table["trial"].tolist().index(name)
    codes = table["quality"][at].split()
    assert set(CODED[name][1].split()) <= set(codes)
    assert table["completeness"][at] == CODED[name][2]


def test_bad_records_cost_no_other_trial(damaged: tuple[int, str, Any]) -> None:
    code, said, table = damaged
    assert code == 3
    assert "1 empty file: EMPTY (the file is empty)" in said
    assert {q for t, q in zip(table["trial"], table["quality"], strict=True) if t[0] == "t"} == {""}
    same = "the record of 18 the same record twice is that of 16 drift of the zero, byte for byte"
    assert f"note: {same}" in said
    at = table["trial"].tolist().index("3 a row cut within")
    place = "trials/3 a row cut within.csv, line 51: has 1 cells under 2 column names"
    assert table["fault"][at] == place
    assert f"): {place}" in said


def fletcher_flipped(force: list[float]) -> bytes:
    content = bytearray(written.hdf5(force, fletcher=True))
    content[content.find(np.float64(force[1]).tobytes())] ^= 1
    return bytes(content)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("mat", b"\x89HDF garbage " * 50),
        ("tdms", b"\x89HDF garbage " * 50),
        ("hdf5", fletcher_flipped([1.1, 2.3, 3.7])),
    ],
)
def test_7_garbage_costs_its_trial_only(tmp_path: Path, name: str, content: bytes) -> None:
    write, column, unit, suffix = written.WRITERS[name]
    written.put(tmp_path, f"a.{suffix}", content)
    written.put(tmp_path, f"b.{suffix}", write([1.0, 2.0, 3.0]))
    a, b = records(tmp_path, name, column, unit, f"{{trial}}.{suffix}")
    assert a.codes == ("MALFORMED",)
    assert a.fault.startswith(f"a.{suffix}: ")
    assert len(b.force_N) == 3


# ---- campaigns at the command line


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good") / "raw"
    folder.mkdir()
    small_campaign(folder)
    (folder / "campaign.toml").write_text(written.MANIFEST)
    long_since_written(folder)
    return folder


@pytest.fixture
def raw(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "raw"))


def path_of(raw: Path, trial: str = TRIAL) -> Path:
    return raw / "trials" / f"{trial}.csv"


def test_5_a_file_that_is_still_being_written_is_left_for_later(raw: Path) -> None:
    content, path = path_of(raw).read_bytes(), path_of(raw)
    path.write_bytes(content[: len(content) // 2])
    code, said, quality = ingest(raw)
    assert code == 3
    assert "PENDING" in quality[TRIAL].split()
    assert (
        f"{TRIAL}: PENDING (the file was still being written; the next run reads it again)" in said
    )
    # nothing has changed, but it is looked at again
    planned = nearlift("run", raw, "--dry-run", "--out", raw.parent)
    assert "ingest   run: 1 record was still being written" in planned.stdout
    path.write_bytes(content)
    os.utime(path, (time.time() - 1e6,) * 2)
    assert ingest(raw)[::2] == (0, dict.fromkeys(quality, ""))


@pytest.mark.parametrize("file", ["trials/t01.csv", "trials.csv"])
def test_5_a_file_that_changes_while_it_is_read(
    raw: Path, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    real = reading._mark_pending

    def meanwhile(*given: Any) -> None:
        (raw / file).touch()
        real(*given)

    monkeypatch.setattr(reading, "_mark_pending", meanwhile)
    code, said, quality = ingest(raw)
    if file == "trials.csv":
        assert (code, quality) == (4, {})
        assert "trials.csv: was changed while it was being read" in said
    else:
        assert (code, quality[TRIAL]) == (3, "PENDING")


def everywhere(change: Callable[[bytes], bytes], reader: str = "csv") -> Edit:
    def damage(raw: Path) -> None:
        edit(raw, "campaign.toml", 'reader = "csv"', f'reader = "{reader}"')
        for path in (raw / "trials").iterdir():
            path.write_bytes(change(path.read_bytes()))

    return damage


def manifest(old: str, new: str) -> Edit:
    return lambda raw: edit(raw, "campaign.toml", old, new)


def schedule(old: str, new: str) -> Edit:
    return lambda raw: edit(raw, "trials.csv", old, new)


def link(target: str) -> Edit:
    def damage(raw: Path) -> None:
        path_of(raw).rename(raw.parent / "away.csv")
        path_of(raw).symlink_to(target)

    return damage


def fifo(raw: Path) -> None:
    path_of(raw).unlink()
    os.mkfifo(path_of(raw))


def unit_of_header(raw: Path) -> None:
    edit(raw, "campaign.toml", 'column = "force", unit = "mN"', 'column = "Thrust", unit = "N"')
    everywhere(
        lambda c: written.rcbenchmark([float(x) / 9.80665 for x in c.decode().split()[1:]]),
        "rcbenchmark",
    )(raw)


def doubled_clock(raw: Path) -> None:
    edit(raw, "campaign.toml", "sign = 1 } }", TIMED)
    everywhere(lambda c: record(2 * PLACE / RATE, [float(x) for x in c.decode().split()[1:]]))(raw)


def wrapping_counter(raw: Path) -> None:
    """Counts whose tare is just below the end of a converter of 24 bits."""
    counts = '"count", sign = 1, calibration = { gain = "1e-4 mN/count", offset = "0 count" }'
    edit(raw, "campaign.toml", '"mN", sign = 1', counts)
    for path in (raw / "trials").iterdir():
        force = np.array(path.read_text().split()[1:], dtype=float)
        wrapped = (np.round(1e4 * force) + (1 << 24) - 1_000_000) % (1 << 24) - (1 << 23)
        path.write_text("force\n" + "".join(f"{c:.0f}\n" for c in wrapped))


OUT = "leads outside the campaign's folder"
STOPPED: dict[str, tuple[Edit, int, str]] = {
    "12 gram-force read as newton": (manifest('unit = "mN"', 'unit = "N"'), 4, "times the weight"),
    "12 a unit that the header contradicts": (unit_of_header, 4, "states 'Thrust (gf)' in gf, the manifest says N: a factor of 0.009807"),
    "12 the impossible cm": (manifest('distance = "mm"', 'distance = "cm"'), 4, "300 cm is outside the 1.5 m arena; mm?"),
    "12 a counter that wraps": (wrapping_counter, 4, "from one sample to the next: the converter's counter wraps"),
    "13 Parquet called csv": (everywhere(lambda c: b"PAR1\0\0" + c), 4, "is no file for reader = 'csv'\n  [records] reader = \"parquet\" reads one long Parquet table"),
    "13 HDF5 called txt": (everywhere(lambda c: b"\x89HDF\r\n\x1a\n\0" + c, "text"), 4, '[records] reader = "hdf5" reads HDF5'),
    "13 decimal commas in a csv": (everywhere(lambda c: c.replace(b".", b",")), 4, "has 2 cells under 1 column names"),
    "13 ambiguous commas": (everywhere(lambda c: b"force\n" + b"1,234\n" * 500, "text"), 4, "'1,234' may be 1.234 or 1234\n  say which"),
    "14 duplicate column names": (everywhere(lambda c: b"force,force\n1,2\n"), 4, "has more than one column 'force'"),
    "15 no tare": (manifest('tare = "0.5 s", ', ""), 2, "[load_cell] needs tare"),
    "18 one id, two trials": (schedule("t02,", "t01,"), 2, "trial 't01' is already in trials.csv, line 3"),
    "20 a wrong rate": (doubled_clock, 4, "the clock column runs at 100 Hz, the manifest says 200 Hz"),
    "20 a wrong rate, by the planned length": (manifest('"200 Hz"', '"250 Hz"'), 4, "where 2.5 s at 250 Hz are 625\n  is the rate 200 Hz?"),
    "24 on the boundary": (schedule("t01,ground,30", "t01,ground,0"), 4, "0 mm with an offset of 0 mm puts the rotor on the ground itself"),
    "24 inside the boundary": (schedule(",30,", ",-3,"), 4, "-3 mm"),
    "26 no gravity": (manifest(', gravity = "9.8 m/s^2"', ""), 2, "rig.gravity: is missing\n  `nearlift new DIR` writes"),
    "32 a link out of the folder": (link("../../away.csv"), 4, OUT),
    "32 a link to itself": (link("t01.csv"), 4, "is a loop of symbolic links"),
    "32 a pipe": (fifo, 4, "is not a regular file"),
    "32 a device": (link("/dev/zero"), 4, OUT),
    "32 a path upwards": (manifest("trials/{trial}.csv", "../raw/trials/{trial}.csv"), 4, OUT),
    "32 an absolute path": (manifest("trials/{trial}.csv", "/dev/{trial}"), 4, f"{OUT}, to /dev"),
    "33 a later manifest": (manifest("nearlift.campaign/1", "nearlift.campaign/2"), 2, "schema: is 'nearlift.campaign/2', and this nearlift reads 'nearlift.campaign/1'"),
}  # fmt: skip


@pytest.mark.parametrize(("damage", "code", "text"), STOPPED.values(), ids=STOPPED)
def test_what_cannot_be_true_stops_the_run_and_writes_nothing(
    raw: Path, damage: Edit, code: int, text: str
) -> None:
    damage(raw)
    exit_code, said, quality = ingest(raw)
    assert (exit_code, quality) == (code, {}), said
    assert text in said
    assert code == 2 or "\n  " in said, "it says what to do"


def test_17_a_throttle_without_a_far_station_has_no_delta_L_unless_asked(raw: Path) -> None:
    """L_inf of such a group would be a lift that the boundary changes."""
    rows = (raw / "trials.csv").read_text().split()
    (raw / "trials.csv").write_text("\n".join(r for r in rows if not r.startswith("t12")) + "\n")
    assert ingest(raw)[0] == 0
    text = (raw / "campaign.toml").read_text()
    for asked in (False, True):
        if asked:
            (raw / "campaign.toml").write_text(text + "\n[quality]\nnear_reference = true\n")
        said = nearlift("reduce", raw, "--out", raw.parent).stderr
        cells = product(raw, LIFT)
        assert "at 75 % throttle no trial is farther than z_hat = 1.3, where others reach" in said
        assert ("near_reference = true under [quality]" in said) is not asked
        known = np.isfinite(cells["delta_L"]) & np.isfinite(cells["u_delta_L"])
        assert (known == (asked | (cells["throttle"] != 0.75))).all()
        assert np.isfinite(cells["lift_N"]).all()


def test_6_and_31_names_with_blanks_and_umlauts_work(raw: Path) -> None:
    name = "Pr\u00fcfling 7 (b)"
    path_of(raw).rename(path_of(raw, name))
    edit(raw, "trials.csv", "t01,", f"{name},")
    code, _, quality = ingest(raw)
    assert (code, quality[name]) == (0, "")
    # two names that differ in case only are two trials
    edit(raw, "trials.csv", "t02,", "T03,")
    path_of(raw, "t02").rename(path_of(raw, "T03"))
    assert set(ingest(raw)[2]) >= {"T03", "t03"}


def test_31_an_id_longer_than_any_file_name_is_a_missing_record(raw: Path) -> None:
    edit(raw, "trials.csv", "t01,", "t" * 300 + ",")
    assert ingest(raw)[0] in (3, 4)


def test_32_the_size_is_told_before_reading_and_json_names_the_rejected(raw: Path) -> None:
    path_of(raw).write_bytes(b"")
    length = sum(path.stat().st_size for path in raw.rglob("*.*"))
    assert f"(has not run yet; 10 files with {length / 1e3:.3g} kB)" in ingest(raw)[1]
    content = json.loads(nearlift("ingest", raw, "--out", raw.parent, "--json").stdout)
    assert content["exit_code"] == 3
    assert content["stages"][0]["rejected"][0][0] == TRIAL


def test_a_dataflash_log_is_named_as_what_it_is(tmp_path: Path) -> None:
    path = written.put(tmp_path, "00000012.BIN", b"\xa3\x95\x80\x80\x59FMT\0" + bytes(80))
    with pytest.raises(InputRefused, match=r"is a DataFlash log \(\.BIN\) of ArduPilot"):
        inspect(path)
