"""Traps of flight logs: what a log says wrongly is refused with the place and the remedy, and what
is right and looks odd is not.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.calibration import flying
from tests.calibration.flying import FLIGHT, Craft, Log

from nearlift.errors import InputRefused
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS

from .bench_campaign import run_ingest
from .small_run import nearlift
from .test_flight_log import changed, ingest

MOTORS = ("m1", "m2", "m3", "m4")


@pytest.fixture(scope="module")
def log() -> Log:
    """One start of half a minute."""
    rng = np.random.default_rng(21)
    return flying.fly(Craft(), rng, flying.heights(rng, 12))


def every(name: str, value: float) -> Callable[[Log], Log]:
    """The log with one column at one value throughout."""
    return lambda log: {**log, name: np.full(len(log["t"]), value)}


def times(factor: float, *names: str) -> Callable[[Log], Log]:
    """The log with columns in another unit."""
    return lambda log: {**log, **{name: factor * log[name] for name in names}}


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (times(1e3, "supply"), r"supply \('supply'\): its median.* 3\d\d\d V\n.*unit = \"mV\"\?"),
        (times(1e-3, "supply"), r"supply.* 0.003\d+ V\n.*unit = \"V\"\?"),
        (times(-1, "supply"), r"supply.* -3\.\d+ V\n.*another column"),
        (times(1e3, "setpoint"), r"setpoint.*by 0\.0009\d* of what it asks for\n.*unit or sign"),
        (every("setpoint", np.nan), r"setpoint.*holds no number in flight\n.*take it away"),
        (every("az", flying.G), r"acceleration \('az'\): it is 9.81 throughout\n.*that changes"),
        (every("z", 0.3), r"height \('z'\): it is 0.3 throughout"),
        (every("vz", 0.0), r"velocity \('vz'\): it is 0 throughout"),
        (every("vz", np.nan), r"velocity \('vz'\): it holds no number\n.*another column"),
        (
            lambda log: {**log, **{m: np.where(log[m] > 0, 4e4, 0.0) for m in MOTORS}},
            r"command \('m1'\): it is 0.6\d+ throughout",
        ),
        (times(0.0, *MOTORS), r"command \('m1'\): it is 0 throughout"),
        (times(1e3, "z", "vz"), r"acceleration \('az'\): it changes by 0.00\d+ of"),
        (lambda log: {name: np.repeat(v, 2) for name, v in log.items()}, r"steps by 0 ms"),
    ],
    ids=[
        "millivolts called volts",
        "volts called millivolts",
        "supply below zero",
        "set-point in mm called m",
        "set-point without a number",
        "an accelerometer that stands still",
        "a height sensor that stands still",
        "a velocity that is always zero",
        "a velocity without a number",
        "commands that never change",
        "motors that never turn",
        "height and velocity in mm called m",
        "every row twice",
    ],
)
def test_what_no_flight_logs_is_refused(
    log: Log, tmp_path: Path, make: Callable[[Log], Log], told: str
) -> None:
    with pytest.raises(InputRefused, match=told):
        ingest(tmp_path, {"a": make(log)})


@pytest.mark.parametrize(("unit", "told"), [("s", "10 s"), ("us", "10 us")])
def test_a_clock_in_another_unit_is_refused(log: Log, tmp_path: Path, unit: str, told: str) -> None:
    records = {**flying.manifest()["records"], "time": {"column": "t", "unit": unit}}
    with pytest.raises(InputRefused, match=rf'steps by {told}, which no log.*\n.*unit = "ms"\?'):
        ingest(tmp_path, {"a": log}, records=records)


def test_a_log_of_too_few_samples_in_a_window_says_how_long_it_has_to_be(
    log: Log, tmp_path: Path
) -> None:
    with pytest.raises(InputRefused, match=r'[23] samples in a window.*\n.*window = "0.5 s"'):
        ingest(tmp_path, {"a": {name: values[::10] for name, values in log.items()}})


def test_a_quiet_hover_contradicts_nothing(tmp_path: Path) -> None:
    """Where the vehicle hardly climbs, noise of the velocity halves the plain slope of acceleration
    on it; a log was refused for that.
    """
    for seed in range(6):
        craft, rng = Craft(gust_N=0.002), np.random.default_rng(seed)
        log = flying.fly(craft, rng, np.array([0.3, 0.3, 0.28, 0.3]))
        trials, _ = ingest(tmp_path / str(seed), {"a": log}, {"lag": "75 ms"})
        assert (trials["quality"] == "").sum() > 20


def test_a_set_point_that_stays_is_no_fault_and_other_bits_of_commands_are_none(
    log: Log, tmp_path: Path
) -> None:
    plain, _ = ingest(tmp_path / "a", {"a": log}, {"lag": "75 ms"})
    stays, _ = ingest(tmp_path / "b", {"a": every("setpoint", 0.3)(log)}, {"lag": "75 ms"})
    np.testing.assert_array_equal(plain["lift_N"], stays["lift_N"])
    bits = {**log, **{m: np.round(log[m] / 257) for m in MOTORS}}
    few, _ = ingest(tmp_path / "c", {"a": bits}, {**changed("command", full=255), "lag": "75 ms"})
    np.testing.assert_allclose(few["throttle"], plain["throttle"], rtol=5e-3)


def test_a_log_that_begins_in_flight_has_the_floor_at_zero(log: Log, tmp_path: Path) -> None:
    """No rest before its start tells the floor: heights stand as they were logged."""
    begun = {name: values[600:2400] for name, values in log.items()}
    trials, _ = ingest(tmp_path, {"a": begun}, {"lag": "75 ms"})
    good = trials["quality"] == ""
    assert good.sum() > 30
    assert trials["z_m"][good].min() > Craft().plane - 0.01
    assert FLIGHT["height"]["zero"] == "each start"


def test_new_from_logs_is_a_campaign_of_flights(log: Log, tmp_path: Path) -> None:
    """What the logs say is written; what nobody logs stays to be filled in."""
    for name in ("a", "b"):
        flying.write_csv(tmp_path / f"{name}.csv", log)
    logs = [x for name in ("a", "b") for x in ("--from", tmp_path / f"{name}.csv")]
    assert nearlift("new", tmp_path / "raw", *logs).exit_code == 0
    text = (tmp_path / "raw" / "campaign.toml").read_text()
    assert 'held            = "command"' in text
    assert 'files  = "logs/{record}.csv"' in text
    assert "[load_cell]" not in text
    assert (tmp_path / "raw" / "trials.csv").read_text() == (
        "record,boundary\na,FILL IN\nb,FILL IN\n"
    )
    given = flying.manifest()
    own = tomllib.loads(text)
    assert own["flight"]["acceleration"] == given["flight"]["acceleration"]
    assert set(own["flight"]) == set(given["flight"])
    filled = manifests.parse({**given, "records": own["records"], "flight": own["flight"]})
    schedule = (tmp_path / "raw" / "trials.csv").read_text().replace("FILL IN", "ground")
    (tmp_path / "raw" / "trials.csv").write_text(schedule)
    _, job = run_ingest(tmp_path / "raw", tmp_path / "out", filled)
    assert (job.read(TRIALS)["quality"] == "").sum() > 80
