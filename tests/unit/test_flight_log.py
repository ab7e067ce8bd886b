"""A flight log becomes trials: weighed, cut, and left out where the vehicle did not fly; and every
convention that a log can break is refused or coded, with its remedy.
"""

from __future__ import annotations

import copy
import struct
import tomllib
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.calibration import flying
from tests.calibration.flying import FLIGHT, Craft, Log

from nearlift.cli import main
from nearlift.errors import InputRefused, ManifestError
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS
from nearlift.readers import usd

from .bench_campaign import run_ingest

CRAFT = Craft()


@pytest.fixture(scope="module")
def log() -> Log:
    """Two starts of half a minute, the second after a landing behind which the height is off."""
    rng = np.random.default_rng(11)
    return flying.joined(
        flying.fly(CRAFT, rng, flying.heights(rng, 12)),
        flying.fly(CRAFT, rng, flying.heights(rng, 12), floor_reads=0.041),
    )


def campaign_of(folder: Path, logs: dict[str, bytes | Log]) -> Path:
    (folder / "logs").mkdir(parents=True)
    for name, content in logs.items():
        if isinstance(content, bytes):
            (folder / "logs" / f"{name}.csv").write_bytes(content)
        else:
            flying.write_csv(folder / "logs" / f"{name}.csv", content)
    rows = "".join(f"{name},ground\n" for name in logs)
    (folder / "trials.csv").write_text(f"record,boundary\n{rows}", encoding="utf-8")
    return folder


def ingest(
    folder: Path, logs: dict[str, Any], flight: dict[str, Any] | None = None, **changes: Any
) -> tuple[dict[str, Any], list[str]]:
    given = manifests.parse(flying.manifest({**FLIGHT, **(flight or {})}, **changes))
    outcome, job = run_ingest(campaign_of(folder, logs), folder / "out", given)
    return job.read(TRIALS), list(outcome.notes)


def changed(key: str, **keys: Any) -> dict[str, Any]:
    """[flight] with keys of one of its columns replaced."""
    return {key: {**copy.deepcopy(FLIGHT[key]), **keys}}


# ---- what comes out


def test_a_flight_becomes_trials(log: Log, tmp_path: Path) -> None:
    trials, notes = ingest(tmp_path, {"a": log})
    good = trials["quality"] == ""
    # 24 set-points of 2 s, less what was on the floor and settling at its edges
    assert 170 < good.sum() <= 4 * 24 * 2
    assert set(trials["quality"]) <= {"", "CONTACT", "FRAGMENT"}
    # every sample stands in one row
    assert trials["samples"].sum() == len(log["t"])
    weight = CRAFT.mass * flying.G
    assert abs(trials["lift_N"][good].mean() / weight - 1) < 0.01
    # closed as the truth has it: the command behind the true lag explains lift to the gusts
    z_m, v = trials["z_m"][good], trials["climb_m_s"][good]
    near = np.array([flying.ground(float(z), CRAFT) for z in z_m])
    power = np.log(trials["throttle"][good] * trials["supply_V"][good])
    rest = np.log(trials["lift_N"][good] / near / (1 - CRAFT.climb * v))
    left = rest - np.polyval(np.polyfit(power, rest, 1), power)
    assert left.std() < 0.02
    # the floor of the second start is its own
    assert trials["z_m"][good].min() > CRAFT.plane - 0.005
    assert trials["z_m"][good].max() < 0.6
    [lag] = [n for n in notes if "lag is" in n]
    assert abs(float(lag.split("is ")[1].split(" ms")[0]) - 75) < 25
    [counted] = [n for n in notes if "windows" in n]
    assert counted.startswith(f"1 log cut into {good.sum()} windows")


def test_a_window_of_a_climb_stands_where_the_curve_has_its_mean(tmp_path: Path) -> None:
    """Brisk starts, without gusts or noise: by the mean height the first quarter second would gain
    0.7 % too little.
    """
    still = Craft(climb=0.0, gust_N=1e-6, height_noise=1e-5, acceleration_noise=1e-4)
    rng = np.random.default_rng(5)
    starts = [flying.fly(still, rng, np.array([0.3, 0.2])) for _ in range(3)]
    trials, _ = ingest(tmp_path, {"a": flying.joined(*starts)}, flight={"lag": "75 ms"})
    good = trials["quality"] == ""
    flown = {name: values[good] for name, values in trials.items()}
    near = np.array([flying.ground(float(z), still) for z in flown["z_m"]])
    told = flown["throttle"] * flown["supply_V"] / (still.hover * still.supply_V)
    left = np.log(flown["lift_N"] / (still.mass * flying.G) / near) - 1.7 * np.log(told)
    first = np.flatnonzero(np.diff(flown["flight"], prepend=0.0))
    assert len(first) == 3
    assert np.all(flown["climb_m_s"][first] > 0.2)
    assert np.abs(left[first]).max() < 0.004
    assert np.abs(np.delete(left, first)).max() < 0.002


@pytest.mark.parametrize("version", [1, 2])
def test_binary_logs_say_the_same(log: Log, tmp_path: Path, version: int) -> None:
    text, _ = ingest(tmp_path / "text", {"a": log})
    records = {"reader": "crazyflie-usd", "files": "logs/{record}.csv"}
    usd, _ = ingest(tmp_path / "usd", {"a": flying.usd(log, version)}, records=records)
    for name in ("lift_N", "z_m", "throttle", "supply_V", "climb_m_s"):
        np.testing.assert_allclose(usd[name], text[name], rtol=1e-4, atol=1e-5)
    assert usd["quality"].tolist() == text["quality"].tolist()


@pytest.mark.filterwarnings("error")
def test_a_log_that_is_there_twice_is_told_once_and_counts_once(log: Log, tmp_path: Path) -> None:
    other = {**log, "az": log["az"] + 0.01 * np.sin(log["t"])}
    trials, notes = ingest(tmp_path / "twice", {"a": log, "b": log, "c": other})
    assert [n for n in notes if "byte for byte" in n] == [
        "the record of b is that of a, byte for byte"
    ]
    good = trials["quality"] == ""
    assert set(trials["record"][good]) == {"a", "c"}
    once, said = ingest(tmp_path / "once", {"a": log, "c": other})
    assert [n for n in notes if "lag" in n] == [n for n in said if "lag" in n]
    assert np.array_equal(trials["throttle"][good], once["throttle"][once["quality"] == ""])


def test_the_lag_can_be_given(log: Log, tmp_path: Path) -> None:
    trials, notes = ingest(tmp_path, {"a": log}, {"lag": "75 ms"})
    assert not any("lag is" in n for n in notes)
    good = trials["quality"] == ""
    assert not trials["u_lag_s"][good].any()
    other, _ = ingest(tmp_path / "other", {"a": log}, {"lag": "80 ms"})
    # the covariate says what another lag would change, in log lift
    change = 1.7 * np.log(other["throttle"][good] / trials["throttle"][good])
    near = trials["lag_slope"][good] * 0.005
    assert np.corrcoef(change, near)[0, 1] > 0.99


def test_the_lag_is_that_of_the_motors_and_not_of_the_windows(log: Log, tmp_path: Path) -> None:
    said = [
        next(n for n in ingest(tmp_path / w, {"a": log}, {"window": f"{w} s"})[1] if "lag is" in n)
        for w in ("0.25", "0.5")
    ]
    assert said[0] == said[1]


# ---- conventions


def along_the_world(log: Log) -> Log:
    """The same in world axes, of a vehicle that sways: gravity removed, in g."""
    sway = 0.15 * np.sin(2 * np.pi * 0.7 * log["t"])
    ax = 9.81 * sway
    felt = log["az"]
    up = np.sqrt(np.maximum(felt**2 - ax**2, 0.0)) - 9.81
    speed = np.cumsum(ax - ax.mean()) * 0.01
    unit = flying.G / 9.80665
    return {
        **log,
        "ax": ax / 9.80665,
        "ay": np.zeros_like(ax),
        "az": up / 9.80665 * unit,
        "vx": speed - speed.mean(),
        "vy": np.zeros_like(ax),
    }


def test_the_norm_is_taken_along_the_worlds_axes(log: Log, tmp_path: Path) -> None:
    plain, _ = ingest(tmp_path / "plain", {"a": log})
    said = changed("acceleration", unit="g", gravity="removed", axes="world")
    world, _ = ingest(tmp_path / "world", {"a": along_the_world(log)}, said)
    good = plain["quality"] == ""
    np.testing.assert_allclose(world["lift_N"][good], plain["lift_N"][good], rtol=2e-3)
    assert np.nanmax(world["tilt_rad"]) > 0.1


WRONG: list[tuple[str, dict[str, Any], Callable[[Log], Log], str]] = [
    ("g", changed("acceleration", unit="g"), dict, r'unit = "m/s\^2"\?'),
    ("removed", changed("acceleration", gravity="removed"), dict, r'gravity = "included"\?'),
    (
        "m/s^2",
        changed("acceleration", unit="m/s^2", gravity="removed", axes="world"),
        along_the_world,
        r'unit = "g"\?',
    ),
    (
        "included",
        changed("acceleration", unit="g", axes="world"),
        along_the_world,
        r'gravity = "removed"\?',
    ),
    (
        "body",
        changed("acceleration", unit="g", gravity="removed"),
        along_the_world,
        r'axes = "world"',
    ),
    ("down", {}, lambda x: {**x, "az": -x["az"]}, r"sign = -1\?"),
    ("mm", changed("height", unit="mm"), dict, r"height\.unit"),
    ("falls", {}, lambda x: {**x, "vz": -x["vz"]}, r"velocity\.sign = -1"),
    ("command", changed("command", full=1000), dict, r"mend full and zero"),
    ("no column", changed("velocity", column="vzz"), dict, r'flight\.velocity\.column = "vz"\?'),
    ("no axes", changed("acceleration", axes="world"), dict, r'are they "body" axes\?'),
    ("unit", changed("supply", unit="m"), dict, r"voltage"),
]


@pytest.mark.parametrize(
    ("said", "make", "remedy"), [w[1:] for w in WRONG], ids=[w[0] for w in WRONG]
)
def test_a_wrong_declaration_is_refused(
    log: Log, tmp_path: Path, said: dict[str, Any], make: Callable[[Log], Log], remedy: str
) -> None:
    with pytest.raises((InputRefused, ManifestError), match=remedy):
        ingest(tmp_path, {"a": make(log)}, said)


def test_a_clock_goes_by_its_steps(log: Log, tmp_path: Path) -> None:
    folder = campaign_of(tmp_path / "a", {})
    flying.write_csv(folder / "logs" / "a.csv", log, tick=1e6, unit="ms")
    (folder / "trials.csv").write_text("record,boundary\na,ground\n", encoding="utf-8")
    with pytest.raises(InputRefused, match=r'steps by 1e\+04 ms.*\n.*unit = "us"\?'):
        run_ingest(folder, tmp_path / "out", manifests.parse(flying.manifest()))
    raw = flying.manifest()
    raw["records"]["time"]["unit"] = "us"
    outcome, job = run_ingest(folder, tmp_path / "out", manifests.parse(raw))
    assert any("the header says ms of 't (ms)'" in n for n in outcome.notes)
    assert (job.read(TRIALS)["quality"] == "").sum() > 170


# ---- damage


@pytest.mark.parametrize("share", [0.0, 0.01, 0.31, 0.5, 0.77, 0.999])
@pytest.mark.parametrize("kind", ["text", "usd"])
def test_a_log_cut_anywhere_is_told(log: Log, tmp_path: Path, share: float, kind: str) -> None:
    flying.write_csv(tmp_path / "whole.csv", log)
    whole = (tmp_path / "whole.csv").read_bytes() if kind == "text" else flying.usd(log)
    records = {"reader": "crazyflie-usd", "files": "logs/{record}.csv"} if kind == "usd" else {}
    base = flying.manifest()["records"]
    fine = flying.usd(log) if kind == "usd" else whole
    trials, _ = ingest(
        tmp_path / "a",
        {"fine": fine, "other": fine + b"", "cut": whole[: round(share * len(whole))]},
        records={**base, **records} if kind == "text" else records,
    )
    mine = trials["record"] == "cut"
    codes = set(" ".join(trials["quality"][mine]).split())
    lost = {"EMPTY", "MALFORMED", "NO_DATA", "truncated"}
    if kind == "usd" or share == 0:
        assert codes & lost
        assert not (trials["quality"][mine] == "").any()
    else:
        # a text that is whole to its last line cannot show that there were more
        assert trials["samples"][mine].sum() <= (share + 0.02) * len(log["t"]) + 1
        assert codes & {"truncated", "CONTACT", "MALFORMED"}


def test_what_is_salvaged_counts_and_what_is_not_says_how(log: Log, tmp_path: Path) -> None:
    cut = flying.usd(log)[: 60 * len(log["t"]) // 2]
    records = {"reader": "crazyflie-usd", "files": "logs/{record}.csv"}
    with pytest.raises(InputRefused, match=r"check sum is wrong.*salvage = true"):
        ingest(tmp_path / "plain", {"cut": cut}, records=records)
    salvage = {**records, "dialect": {"salvage": True}}
    trials, notes = ingest(tmp_path / "salvaged", {"cut": cut}, records=salvage)
    kept = int((trials["quality"] == "salvaged").sum())
    assert kept > 50
    assert any(n.startswith(f"1 log cut into {kept} windows") for n in notes)


def test_records_of_several_kinds_are_told_apart_in_any_order() -> None:
    rng = np.random.default_rng(4)
    kinds = rng.integers(0, 2, 60).repeat(rng.integers(1, 9, 60))
    head = struct.pack("<BHH", 0xBC, 2, 2)
    for number, text in ((7, b"a\0\1\0x(f)\0"), (7 + 256, b"b\0\2\0y(H)\0z(d)\0")):
        head += struct.pack("<H", number) + text
    body = b"".join(
        struct.pack("<HQHd", 7 + 256, i, i, -i) if kind else struct.pack("<HQf", 7, i, i)
        for i, kind in enumerate(kinds)
    )
    content = head + body
    content += struct.pack("<I", zlib.crc32(content))
    found = {c.name: c.values for c in usd.decode(content, "log").channels}
    places = np.arange(len(kinds))
    assert np.array_equal(found["a.x"], places[kinds == 0])
    assert np.array_equal(found["b.y"], places[kinds == 1])
    assert np.array_equal(found["b.z"], -places[kinds == 1])
    assert np.array_equal(found["b.time"], 1e-6 * places[kinds == 1])


def with_holes(log: Log) -> Log:
    keep = np.ones(len(log["t"]), dtype=bool)
    keep[800:812] = keep[1500:1504] = False
    return {name: values[keep] for name, values in log.items()}


def set_back(log: Log) -> Log:
    t = log["t"].copy()
    t[1000:] -= 3.0
    return {**log, "t": t}


def flying_stamps(log: Log) -> Log:
    t = log["t"].copy()
    t[[700, 1200, 1900]] += 1e6
    return {**log, "t": t}


def commands_lost(log: Log) -> Log:
    lost = {f"m{k}": log[f"m{k}"].copy() for k in (1, 2, 3, 4)}
    for values in lost.values():
        values[900:903] = 0
    return {**log, **lost}


def one_saturates(log: Log) -> Log:
    values = log["m1"].copy()
    values[1000:1100] = flying.FULL
    return {**log, "m1": values}


def no_height(log: Log) -> Log:
    values = log["z"].copy()
    values[1000:1050] = np.nan
    return {**log, "z": values}


@pytest.mark.parametrize(
    ("make", "code", "least"),
    [
        (with_holes, "GAPS", 40),
        (flying_stamps, "clock", 3),
        (commands_lost, "ZERO_COMMAND", 3),
        (one_saturates, "FULL_COMMAND", 100),
        (no_height, "OUT_OF_RANGE", 50),
    ],
)
def test_a_flaw_is_coded_and_the_rest_kept(
    log: Log, tmp_path: Path, make: Callable[[Log], Log], code: str, least: int
) -> None:
    trials, _ = ingest(tmp_path, {"a": make(log)})
    flawed = np.array([code in text.split() for text in trials["quality"]])
    assert trials["samples"][flawed].sum() >= least
    kept = np.array([text in ("", "clock") for text in trials["quality"]])
    assert kept.sum() > 150


def test_a_clock_set_back_is_cut_there(log: Log, tmp_path: Path) -> None:
    trials, _ = ingest(tmp_path, {"a": set_back(log)})
    assert any("clock" in text.split() for text in trials["quality"])
    good = np.array([not set(q.split()) - {"clock"} for q in trials["quality"]])
    # samples of the part that repeats the clock are gone, and no window has both
    assert 100 < good.sum() < 190
    assert trials["sd_N"][good].max() < 0.1


def shuffled(log: Log) -> Log:
    t = log["t"].copy()
    np.random.default_rng(1).shuffle(t)
    return {**log, "t": t}


def saturated_throughout(log: Log) -> Log:
    top = {f"m{k}": np.where(log["m1"] > 0, flying.FULL, 0.0) for k in (1, 2, 3, 4)}
    return {**log, **top}


def on_the_floor(log: Log) -> Log:
    n = len(log["t"])
    rng = np.random.default_rng(2)
    still = {"z": 0.002, "vz": 0.005, "az": 0.02}
    quiet = {name: sd * rng.normal(size=n) for name, sd in still.items()}
    return {**log, **quiet, "az": quiet["az"] + flying.G}


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (shuffled, r"the clock 't.* steps by -?[\d.]+ ms, which no log.*\n.*another clock"),
        (saturated_throughout, r"FULL_COMMAND.*\n.*mend full under \[flight\] command"),
        (on_the_floor, r"CONTACT.*\n.*mend airborne, or the sign and unit of velocity"),
        (lambda x: {k: v[:30] for k, v in x.items()}, r"has 30 samples of 't"),
        (lambda x: {k: v for k, v in x.items() if k != "supply"}, r"has no column 'supply'"),
    ],
    ids=["clock", "saturated", "floor", "short", "missing"],
)
def test_a_log_that_is_no_flight_is_refused(
    log: Log, tmp_path: Path, make: Callable[[Log], Log], told: str
) -> None:
    with pytest.raises(InputRefused, match=told):
        ingest(tmp_path, {"a": make(log)})


# ---- told by inspect


@pytest.mark.parametrize(
    ("make", "lines"),
    [
        (dict, ['unit = "m/s^2", gravity = "included", axes = "body"', "full = 65535"]),
        (along_the_world, ['unit = "g", gravity = "removed", axes = "world"']),
    ],
)
def test_inspect_tells_a_flight_and_its_lines(
    log: Log, tmp_path: Path, make: Callable[[Log], Log], lines: list[str]
) -> None:
    flying.write_csv(tmp_path / "a.csv", make(log))
    done = CliRunner().invoke(main, ["inspect", str(tmp_path / "a.csv")])
    assert "it is the log of a flight" in done.output
    for line in lines:
        assert line in done.output
    block = done.output.split("\n\n", 1)[1]
    said = tomllib.loads(block)
    # what it proposes reads the log
    raw = flying.manifest()
    raw["records"] = {**said["records"], "files": "logs/{record}.csv"}
    raw["flight"] = said["flight"]
    _, job = run_ingest(
        campaign_of(tmp_path / "raw", {"a": make(log)}), tmp_path, manifests.parse(raw)
    )
    assert (job.read(TRIALS)["quality"] == "").sum() > 150


def test_a_stands_record_is_no_flight(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "t (s),thrust (N)\n" + "".join(f"{0.01 * i:.2f},{0.3 + 0.001 * i}\n" for i in range(60))
    )
    done = CliRunner().invoke(main, ["inspect", str(tmp_path / "a.csv")])
    assert "[flight]" not in done.output
    assert "[load_cell]" in done.output


# ---- the manifest


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"load_cell": {"tare": "none", "sample_rate": "100 Hz"}}, r"take \[load_cell\]"),
        ({"rig": {**flying.manifest()["rig"], "held": "throttle"}}, r'rig\.held = "command"'),
        ({"records": {"reader": "text", "files": "a.csv"}}, r"write \{record\}"),
        (
            {"segments": {"by": "windows", "length": "1 s", "settle": "0 s", "shortest": "1 s"}},
            "both cut records",
        ),
    ],
)
def test_a_manifest_that_cannot_be(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(ManifestError, match=told):
        manifests.parse(flying.manifest(**changes))


def test_commands_are_held_in_flight_alone() -> None:
    raw = flying.manifest()
    del raw["flight"]
    with pytest.raises(ManifestError, match=r"goes with \[flight\]"):
        manifests.parse(raw)


def test_a_lag_no_motor_has() -> None:
    with pytest.raises(ManifestError, match="no motor lags by more than 200 ms"):
        manifests.parse(flying.manifest({**FLIGHT, "lag": "2 s"}))
