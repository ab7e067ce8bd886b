"""One record, many trials: cut as by hand, honest about what pieces share, refused with a remedy."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.unit import small_run
from tests.unit.bench_campaign import run_ingest
from tests.unit.manifests import manifest
from tests.unit.sweeps import HEAD_S, RATE, THROTTLES, campaign, lift_N, sweep, text_of, write

from nearlift.errors import InputRefused, ManifestError, NearliftError
from nearlift.likelihood import budget
from nearlift.observed import observe
from nearlift.readers import reader, segments
from nearlift.stages.ingest import TRIALS


def table(folder: Path, out: Path, **changes: Any) -> dict[str, Any]:
    """trials.parquet of a campaign of sweeps."""
    _, job = run_ingest(folder, out, campaign(changes.pop("cut", None), **changes))
    return job.read(TRIALS)


def rewritten(path: Path, change: Callable[[int, list[str]], object]) -> None:
    """Each row of a record as `change` leaves its cells."""
    names, *lines = path.read_text().splitlines()
    cells = [line.split(",") for line in lines]
    for i, row in enumerate(cells):
        change(i, row)
    path.write_text("\n".join([names, *map(",".join, cells)]) + "\n")


def codes_of(trials: dict[str, Any]) -> dict[str, str]:
    return dict(zip(trials["trial"].tolist(), trials["quality"].tolist(), strict=True))


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("sweeps") / "raw")


# ---- what comes out


def test_a_sweep_becomes_trials(root: Path, tmp_path: Path) -> None:
    outcome, job = run_ingest(root, tmp_path, campaign())
    trials = job.read(TRIALS)
    # the head and the end are at rest, and no trials
    assert trials["trial"].tolist() == [f"r{k}#{n}" for k in range(3) for n in (2, 3, 4)]
    np.testing.assert_allclose(trials["throttle"], [0.4, 0.6, 0.8] * 3)
    want = [lift_N(z, t) for z in (1.0, 2.0, 4.0) for t in THROTTLES[1:-1]]
    # 4 s at 80 Hz less 1 s: the mean of 240 samples, and the zero's of 160; five of them
    np.testing.assert_allclose(trials["lift_N"], want, atol=5 * 0.002 * np.sqrt(1 / 240 + 1 / 160))
    assert not trials["quality"].any()
    assert trials["visit"].tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert trials["session"].tolist() == trials["record"].tolist()
    assert trials["piece"].tolist() == [2, 3, 4] * 3
    # a column of the record by its mean and scatter, each piece by itself
    np.testing.assert_allclose(trials["record supply"], [15.6, 15.4, 15.2] * 3, atol=0.005)
    np.testing.assert_allclose(trials["sd_record supply"], 0.01, rtol=0.3)
    [note] = [n for n in outcome.notes if "cut into" in n]
    assert note == (
        "3 records cut into 9 trials; 22.2 % of the samples are settling, 5.56 % are in 3 pieces"
        " that are too short, 3 pieces are at rest"
    )


def test_pieces_cut_by_hand_are_the_same_to_the_bit(root: Path, tmp_path: Path) -> None:
    """One file for each piece, its record's head before it, as records are without [segments]."""
    trials = table(root, tmp_path / "a", records={"time": None})
    hand = tmp_path / "hand"
    (hand / "trials").mkdir(parents=True)
    rows = ["trial,boundary,distance,throttle"]
    head = round(HEAD_S * RATE)
    for k, z_hat in enumerate((1.0, 2.0, 4.0)):
        lines = (root / "sweeps" / f"r{k}.csv").read_text().splitlines()
        names, body = lines[0], lines[1:]
        level = np.array([float(line.split(",")[1]) for line in body])
        edges = [0, *(np.flatnonzero(np.diff(level)) + 1).tolist(), len(level)]
        for n in (2, 3, 4):
            own = body[edges[n - 1] : edges[n]]
            text = "\n".join([names, *body[:head], *own]) + "\n"
            (hand / "trials" / f"r{k}-{n}.csv").write_text(text)
            rows.append(f"r{k}-{n},ground,{23 * z_hat:g},{level[edges[n - 1]]:g}")
    (hand / "trials.csv").write_text("\n".join(rows) + "\n")
    given = manifest(
        vehicle={"name": "rotor", "rotors": 1, "rotor_spacing": None},
        load_cell={"sample_rate": "80 Hz", "tare": "2 s", "settle": "1 s", "range": None},
    )
    _, job = run_ingest(hand, tmp_path / "b", given)
    by_hand = job.read(TRIALS)
    for name in ("lift_N", "u_lift_N", "n", "n_eff", "sd_N", "drift_N_s", "z_hat", "throttle"):
        np.testing.assert_array_equal(trials[name], by_hand[name], err_msg=name)
    assert trials["visit"].tolist() == by_hand["visit"].tolist()


def test_the_zero_of_a_record_is_one_unknown_of_its_pieces(root: Path, tmp_path: Path) -> None:
    given = campaign()
    trials = table(root, tmp_path)
    data = observe(trials, given, "ground")
    np.testing.assert_allclose(data.u_lift_N**2 + trials["u_zero_N"] ** 2, trials["u_lift_N"] ** 2)
    [zero] = [c for c in budget.components(given) if c.is_measured]
    shared = budget.shared(data, (zero,), np.zeros(data.n))
    same = data.session[:, None] == data.session
    u = trials["u_zero_N"] / trials["lift_N"]
    np.testing.assert_allclose(shared @ shared.T, np.where(same, np.outer(u, u), 0.0))
    # without a zero that was measured there is nothing to share
    assert not any(c.is_measured for c in budget.components(campaign(load_cell={"tare": "0 s"})))
    assert not any(c.is_measured for c in budget.components(manifest()))
    assert "sd_record supply" not in data.covariates
    assert "piece" not in data.covariates
    assert "record supply" in data.covariates


def test_the_lowest_level_is_a_tare_between_the_others(tmp_path: Path) -> None:
    """A zero that creeps by 0.1 N over the record is estimated from the rests around each piece."""
    folder = write(tmp_path / "raw", (2.0,), (5, 40, 5, 60, 5, 80, 5))
    path, rest = folder / "sweeps" / "r0.csv", 1e3 * lift_N(2.0, 5)
    count = path.read_text().count("\n") - 1

    def creep(i: int, row: list[str]) -> None:
        row[2] = repr(float(row[2]) + 100 * i / count - rest * (row[1] == "5.0"))

    rewritten(path, creep)
    trials = table(folder, tmp_path / "out", load_cell={"tare": "level 0"})
    assert trials["trial"].tolist() == ["r0#2", "r0#4", "r0#6"]
    # the mean of two rests is off the zero in the middle by what the lag leaves, and no more
    np.testing.assert_allclose(trials["lift_N"], [lift_N(2.0, t) for t in (40, 60, 80)], atol=0.01)
    head = table(folder, tmp_path / "head")
    assert abs(head["lift_N"][-1] - lift_N(2.0, 80)) > 0.05


def test_a_stepping_distance(tmp_path: Path) -> None:
    """One throttle, the traverse in steps: every stop is a visit."""
    folder = tmp_path / "raw"
    (folder / "sweeps").mkdir(parents=True)
    rng = np.random.default_rng(3)
    parts = [sweep(z, rng, (50,)) for z in (1.0, 2.0, 4.0)]
    columns = {n: np.concatenate([p[n] for p in parts]) for n in ("throttle", "force")}
    columns["z"] = np.repeat([23.0, 46.0, 92.0], len(parts[0]["t"]))
    (folder / "sweeps" / "a.csv").write_text(text_of(columns))
    (folder / "records.csv").write_text("record,boundary,throttle\na,ground,50\n")
    trials = table(
        folder,
        tmp_path / "out",
        cut={"column": "z", "unit": "mm", "becomes": "distance"},
        records={"time": None},
        load_cell={"tare": "0 s"},
        trials={"units": {"throttle": "percent"}},
    )
    np.testing.assert_allclose(trials["z_hat"], [1.0, 2.0, 4.0])
    assert trials["visit"].tolist() == [0, 1, 2]
    np.testing.assert_allclose(trials["throttle"], 0.5)


OWN = {"columns": {"throttle": {"column": "throttle", "unit": "percent"}}}
STEPS: dict[str, Any] = {"column": None, "cut": "plateaus", "unit": None, "step": "50 mN", **OWN}
FULL = {"unit": None, "full": 80.0, "columns": {"supply": {"column": "supply", "unit": "V"}}}


@pytest.mark.parametrize(
    ("cut", "want"),
    [
        (FULL, {"throttle": [0.5, 0.75, 1.0], "supply_V": [15.6, 15.4, 15.2]}),
        # no command was logged but its mean: the force itself says where it steps
        (STEPS, {"throttle": [0.4, 0.6, 0.8]}),
        (
            {"length": "1 s", "shortest": "1 s"},
            {"throttle": [0.4] * 3 + [0.6] * 3 + [0.8] * 3, "n": [80] * 9},
        ),
    ],
)
def test_other_ways_to_cut(
    root: Path, tmp_path: Path, cut: dict[str, Any], want: dict[str, list[float]]
) -> None:
    trials = table(root, tmp_path, cut=cut)
    for name, values in want.items():
        np.testing.assert_allclose(trials[name], values * 3, atol=0.005)
    lift = [lift_N(z, 100 * t) for z in (1.0, 2.0, 4.0) for t in (0.4, 0.6, 0.8)]
    np.testing.assert_allclose(trials["lift_N"][:: len(want["throttle"]) // 3], lift, atol=0.005)
    assert len(set(trials["visit"].tolist())) == 3


def test_a_record_that_is_missing_or_damaged_has_a_row(tmp_path: Path) -> None:
    """And levels of two records are one within the tolerance."""
    folder = write(tmp_path / "raw", (1.0, 2.0, 3.0, 4.0))
    sweeps = folder / "sweeps"
    (sweeps / "r1.csv").unlink()
    (sweeps / "r2.csv").write_text("t,throttle,force\n0,1,x\n")
    (sweeps / "r3.csv").write_text((sweeps / "r3.csv").read_text().replace(",60.0,", ",60.1,"))
    for tolerance, levels in ((0.0, 4), (0.2, 3)):
        trials = table(folder, tmp_path / str(levels), cut={"tolerance": tolerance})
        throttle = trials["throttle"]
        assert len(set(throttle[np.isfinite(throttle)].tolist())) == levels
    codes = codes_of(trials)
    assert codes["r1"] == "MISSING"
    assert codes["r2"].startswith("MALFORMED")
    assert "r3#2" in codes
    assert np.isnan(throttle[trials["trial"] == "r1"]).all()


def test_a_word_that_says_when_it_counts(tmp_path: Path) -> None:
    folder = write(tmp_path / "raw", (2.0,), (0, 60))
    path = folder / "sweeps" / "r0.csv"
    rewritten(path, lambda _, row: row.append("on" if row[1] == "60.0" else "off"))
    path.write_text(path.read_text().replace("\n", ",state\n", 1))
    (folder / "records.csv").write_text("record,boundary,distance,throttle\nr0,ground,46,60\n")
    trials = table(
        folder,
        tmp_path / "out",
        cut={"column": "state", "unit": None, "keep_where": "on"},
        trials={"units": {"distance": "mm", "throttle": "percent"}},
    )
    assert trials["n"].tolist() == [240]
    np.testing.assert_allclose(trials["lift_N"], lift_N(2.0, 60), atol=0.002)


def test_a_record_twice_and_one_left_out(tmp_path: Path) -> None:
    folder = write(tmp_path / "raw")
    (folder / "sweeps" / "r2.csv").write_bytes((folder / "sweeps" / "r0.csv").read_bytes())
    trials = table(folder, tmp_path / "a", quality={"exclude": {"r1#3": "a bird"}})
    codes = codes_of(trials)
    assert [t for t, c in codes.items() if c == "DUPLICATE"] == ["r2#2", "r2#3", "r2#4"]
    assert [t for t, c in codes.items() if c == "EXCLUDED"] == ["r1#3"]
    trials = table(folder, tmp_path / "b", quality={"exclude": ["r1"]})
    assert sum("EXCLUDED" in c for c in trials["quality"]) == 3
    with pytest.raises(ManifestError, match="no trial of the schedule is called 'r1#9'"):
        table(folder, tmp_path / "c", quality={"exclude": ["r1#9"]})


def test_a_stamp_that_repeats_with_its_force_is_one_sample(tmp_path: Path) -> None:
    """A loop that runs twice as fast as its cell writes every sample twice."""
    folder = write(tmp_path / "raw", (2.0,))
    path = folder / "sweeps" / "r0.csv"
    names, *lines = path.read_text().splitlines()
    path.write_text("\n".join([names, *(line for line in lines for _ in range(2))]) + "\n")
    outcome, job = run_ingest(folder, tmp_path / "a", campaign(load_cell={"sample_rate": "160 Hz"}))
    twice = job.read(TRIALS)
    path.write_text("\n".join([names, *lines]) + "\n")
    np.testing.assert_allclose(twice["n"], table(folder, tmp_path / "b")["n"])
    assert any("were counted once" in note for note in outcome.notes)


MANIFEST = """
schema = "nearlift.campaign/1"
name = "sweeps"
vehicle = { name = "rotor", rotors = 1, rotor_radius = "23 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
load_cell = { sample_rate = "80 Hz", tare = "2 s" }
records = { reader = "csv", files = "sweeps/{record}.csv", force = { column = "force", unit = "mN", sign = 1 } }
trials = { file = "records.csv", units = { distance = "mm" } }
"""
KEYS = 'segments = { column = "throttle", unit = "percent", settle = "1 s", shortest = "2 s" }\n'


def test_the_cuts_are_shown_before_anything_is_fitted(tmp_path: Path) -> None:
    folder = write(tmp_path / "raw", (2.0,))
    shown = partial(small_run.nearlift, "inspect", "--cuts", folder, "--out", tmp_path)
    assert shown().exit_code == 2
    (folder / "campaign.toml").write_text(MANIFEST.replace("{record}", "{trial}"))
    assert "add [segments] with column, settle and shortest" in shown().stderr
    (folder / "campaign.toml").write_text(MANIFEST + KEYS)
    lines = shown().stdout.splitlines()
    assert lines[0] == "r0: 3 pieces, 1 too short, 1 at rest; 4 s settling, 1 s between"
    assert [line.split()[0] for line in lines[1:4]] == ["r0#2", "r0#3", "r0#4"]
    assert "throttle 0.4" in lines[1]
    picture = tmp_path / "reports" / "sweeps" / "segments.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "processed").exists()


# ---- refused

PLATEAUS: dict[str, Any] = {"column": None, "cut": "plateaus"}
WINDOWS: dict[str, Any] = {"column": None, "cut": "windows"}


@pytest.mark.parametrize(
    ("cut", "changes", "match"),
    [
        ({"shortest": "0.05 s"}, {}, "4 samples at 80 Hz; a trial needs 5: 0.0625 s"),
        ({"cut": "plateaus"}, {}, "give either column or cut"),
        ({"column": None}, {}, "give either column or cut"),
        ({**PLATEAUS}, {}, 'cut = "plateaus" needs step'),
        ({**WINDOWS}, {}, 'cut = "windows" needs length'),
        ({"step": "1 N"}, {}, 'step needs cut = "plateaus"'),
        ({**PLATEAUS, "step": "1 kg"}, {}, "segments.step: "),
        ({**PLATEAUS, "step": "1 N", "tolerance": 0.1}, {}, "tolerance and keep_where need column"),
        ({"tolerance": -1.0}, {}, "segments.tolerance: Input should be"),
        ({"length": "1 s"}, {}, "length is below shortest"),
        ({**WINDOWS, "length": "3 s", "settle": "3 s"}, {}, "length is below shortest, or settle"),
        ({}, {"records": {"files": "sweeps/{trial}.csv"}}, "write {record} in"),
        ({}, {"load_cell": {"settle": "1 s"}}, "settle and record apply to records"),
        ({}, {"records": {"reader": "means"}}, "has none"),
        ({**WINDOWS, "length": "3 s"}, {"load_cell": {"tare": "level 0"}}, "lowest level"),
        ({"settel": "1 s"}, {}, "settel: unknown key; did you mean 'settle'?"),
        ({"by": "throttle"}, {}, 'segments.by: was renamed; write column = "...", or cut ='),
        ({"hold": 0.2}, {}, "segments.hold: was renamed; write tolerance"),
    ],
)
def test_a_manifest_that_contradicts_itself(
    cut: dict[str, Any], changes: dict[str, Any], match: str
) -> None:
    with pytest.raises(ManifestError, match=re.escape(match)):
        campaign(cut, **changes)


def test_marks_of_records_go_with_segments() -> None:
    for change in ({"records": {"files": "s/{record}.csv"}}, {"load_cell": {"tare": "level 0"}}):
        with pytest.raises(ManifestError, match="goes with"):
            manifest(**change)


ON_ROWS = "record,boundary,distance,throttle\nr0,ground,23,5\n"


@pytest.mark.parametrize(
    ("cut", "schedule", "match"),
    [
        ({"column": "thrattle"}, "", "has no column 'thrattle'"),
        ({"unit": None}, "", "give the unit of 'throttle', or full"),
        ({"unit": "fraction"}, "", "is not between 0 and 1"),
        ({"unit": "mm"}, "", "mm"),
        ({"shortest": "3.5 s"}, "", 'shortest = "3 s" under [segments] would keep half'),
        ({"column": "force"}, "", "a ramp, or each row is a mean already"),
        ({"keep_where": "on"}, ON_ROWS, "has no 'on' in"),
        ({"columns": {"suply": {"column": "supply", "unit": "V"}}}, "", "did you mean 'supply'?"),
        ({"columns": {"supply": {"column": "supply"}}}, "", "unit: is missing"),
        ({"columns": {"throttle": {"column": "throttle"}}}, "", "given by the level already"),
        ({}, ON_ROWS, "also brought by the pieces of records"),
        ({}, "trial,boundary,distance\nr0,ground,23\n", "call the column of its ids record"),
        ({}, "record,boundary,distance\nx,ground,23\n", "none of the 1 records"),
        ({}, "record,boundary,distance\nr0,ground,2300\n", "outside the 1.5 m arena"),
    ],
)
def test_what_does_not_fit_the_records_is_refused(
    root: Path, tmp_path: Path, cut: dict[str, Any], schedule: str, match: str
) -> None:
    folder = root
    if schedule:
        folder = tmp_path / "raw"
        shutil.copytree(root / "sweeps", folder / "sweeps")
        (folder / "records.csv").write_text(schedule)
    with pytest.raises(NearliftError, match=re.escape(match)):
        run_ingest(folder, tmp_path / "out", campaign(cut))
    assert not [*tmp_path.rglob("trials.parquet")]


def test_steps_finer_than_three_codes_are_refused(tmp_path: Path) -> None:
    folder = write(tmp_path / "raw", (2.0,))

    def coarse(_: int, row: list[str]) -> None:
        row[2] = repr(round(float(row[2]) / 20) * 20.0)

    rewritten(folder / "sweeps" / "r0.csv", coarse)
    with pytest.raises(InputRefused, match="less than three of the converter's own"):
        run_ingest(folder, tmp_path / "a", campaign(STEPS))
    assert len(table(folder, tmp_path / "b", cut={**STEPS, "step": "60 mN"})["trial"]) == 3


# ---- damage


def pieces_of(folder: Path, content: bytes, **changes: Any) -> segments.Segmented | None:
    """The pieces of a record of these bytes; None where it is refused."""
    path = folder / "sweeps" / "r0.csv"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    try:
        return segments.read(campaign(**changes), folder, reader("csv"), "r0", path)
    except InputRefused:
        return None


WHOLE = text_of(sweep(2.0, np.random.default_rng(8))).encode()


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(0, len(WHOLE)))
def test_a_record_cut_anywhere_gives_its_whole_pieces_or_fewer(cut: int, tmp_path: Path) -> None:
    """Each piece that is left has samples of the whole record's piece of its number, from its
    start.
    """
    whole = pieces_of(tmp_path, WHOLE)
    assert whole is not None
    known = {p.number: p for p in whole.pieces}
    found = pieces_of(tmp_path, WHOLE[:cut])
    for piece in found.pieces if found else ():
        own = known[piece.number]
        np.testing.assert_array_equal(piece.force_N, own.force_N[: len(piece.force_N)])
        assert piece.brought == own.brought
    if found and cut < len(WHOLE) and found.record.force_N.size and WHOLE[cut - 1 : cut] != b"\n":
        assert "truncated" in found.record.codes
