"""Logs of PX4 and ROS 2: the same flight as in text, topics with clocks of their own, and damage that
their libraries pass over.
"""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.calibration import flying
from tests.calibration.flying import Craft, Log

from nearlift.errors import InputRefused
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS
from nearlift.readers import built_in
from nearlift.readers.channel import Malformed
from nearlift.readers.child import Child, source

from .bench_campaign import run_ingest

#: Libraries that read each format; an extra brings them.
LIBRARIES = {"ulog": ("pyulog",), "mcap": ("mcap", "mcap_ros2"), "rosbag": ("mcap_ros2",)}


@pytest.fixture(params=list(LIBRARIES))
def kind(request: pytest.FixtureRequest) -> str:
    for library in LIBRARIES[request.param]:
        pytest.importorskip(library)
    return str(request.param)


@pytest.fixture(scope="module")
def log() -> Log:
    rng = np.random.default_rng(3)
    return flying.fly(Craft(), rng, flying.heights(rng, 8))


@pytest.fixture(scope="module")
def written(log: Log, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Made when a test of the format asks, since its library may not be there."""
    return {}


def content(kind: str, log: Log, written: dict[str, bytes], folder: Path) -> bytes:
    if kind not in written and kind == "ulog":
        written[kind] = flying.ulog(log)
    if kind not in written:
        (flying.mcap if kind == "mcap" else flying.rosbag)(folder / "whole", log)
        written[kind] = (folder / "whole").read_bytes()
    return written[kind]


def trials_of(folder: Path, kind: str, data: bytes, dialect: dict[str, Any] | None = None) -> Any:
    (folder / "logs").mkdir(parents=True)
    (folder / "logs" / "a").write_bytes(data)
    (folder / "trials.csv").write_text("record,boundary\na,ground\n", encoding="utf-8")
    records = {"reader": kind, "files": "logs/{record}", "dialect": dialect or {}}
    given = manifests.parse(flying.manifest(flying.TOPICS, records=records))
    _, job = run_ingest(folder, folder / "out", given)
    return job.read(TRIALS)


def test_topics_come_together(
    kind: str, log: Log, written: dict[str, bytes], tmp_path: Path
) -> None:
    trials = trials_of(tmp_path / "a", kind, content(kind, log, written, tmp_path))
    folder = tmp_path / "b"
    (folder / "logs").mkdir(parents=True)
    flying.write_csv(folder / "logs" / "a.csv", log)
    (folder / "trials.csv").write_text("record,boundary\na,ground\n", encoding="utf-8")
    flight = {k: v for k, v in flying.FLIGHT.items() if k != "setpoint"}
    _, job = run_ingest(folder, folder / "out", manifests.parse(flying.manifest(flight)))
    text = job.read(TRIALS)
    good, same = trials["quality"] == "", text["quality"] == ""
    # topics whose clocks are milliseconds apart may move the edge of a stretch by a sample
    assert abs(int(good.sum()) - int(same.sum())) <= 2
    assert good.sum() > 40
    for name, near in (("lift_N", 3e-3), ("supply_V", 3e-3), ("throttle", 5e-3)):
        a, b = (np.median(x[name][m]) for x, m in ((trials, good), (text, same)))
        assert abs(a / b - 1) < near


def channels(kind: str, path: Path, dialect: dict[str, Any] | None = None) -> dict[str, Any]:
    form = built_in(kind).format
    assert form is not None
    with source(form, Child()) as contents:
        found = contents(path, dialect or {}, None)
    return {"codes": found.codes, **{c.name: c.values for c in found.channels}}


@pytest.mark.parametrize("share", [0.0005, 0.2, 0.5, 0.93, 0.9999])
def test_a_cut_log_is_told(
    kind: str, share: float, log: Log, written: dict[str, bytes], tmp_path: Path
) -> None:
    whole = content(kind, log, written, tmp_path)
    # not between two messages, where a log that only ended shows nothing
    (tmp_path / "cut").write_bytes(whole[: max(int(share * len(whole)), 9) | 1])
    try:
        found = channels(kind, tmp_path / "cut")
    except Malformed:
        return
    assert kind == "ulog"
    assert found["codes"] == ("truncated",) or len(whole[: int(share * len(whole)) | 1]) < 2000


def test_a_stamp_out_of_nowhere_is_damage(log: Log, tmp_path: Path) -> None:
    pytest.importorskip("pyulog")
    data = bytearray(flying.ulog(log))
    at = data.index(b"D", len(data) // 2)
    while data[at - 2 : at] != struct.pack("<H", 14):  # an acceleration: id, stamp, one float
        at = data.index(b"D", at + 1)
    data[at + 3 : at + 11] = struct.pack("<Q", 1 << 60)
    (tmp_path / "a.ulg").write_bytes(data)
    with pytest.raises(Malformed, match="lies a day from its start"):
        channels("ulog", tmp_path / "a.ulg")


def test_bytes_that_are_no_message_are_damage(log: Log, tmp_path: Path) -> None:
    pytest.importorskip("pyulog")
    data = bytearray(flying.ulog(log))
    data[5000:5400] = bytes(400)
    (tmp_path / "a.ulg").write_bytes(data)
    with pytest.raises(Malformed):
        channels("ulog", tmp_path / "a.ulg")


@pytest.mark.parametrize("bag", ["mcap", "rosbag"])
def test_the_stamp_in_the_header_is_when_it_was_measured(
    bag: str, log: Log, tmp_path: Path
) -> None:
    for library in LIBRARIES[bag]:
        pytest.importorskip(library)
    getattr(flying, bag)(tmp_path / "a", log, late_s=0.05)
    name = "/battery_status.time"
    measured = channels(bag, tmp_path / "a")[name]
    logged = channels(bag, tmp_path / "a", {"stamps": "log"})[name]
    np.testing.assert_allclose(logged - measured, 0.05, atol=1e-5)


def test_a_bag_without_definitions_says_how_to_get_them(log: Log, tmp_path: Path) -> None:
    pytest.importorskip("mcap_ros2")
    flying.rosbag(tmp_path / "old.db3", log, defined=False)
    with pytest.raises(InputRefused, match=r"no definitions.*\n.*ros2 bag convert"):
        channels("rosbag", tmp_path / "old.db3")


def test_another_sqlite_file_is_no_bag(tmp_path: Path) -> None:
    pytest.importorskip("mcap_ros2")
    with closing(sqlite3.connect(tmp_path / "a.db3")) as other:
        other.execute("CREATE TABLE names(name TEXT)")
    with pytest.raises(Malformed, match="no tables of topics and messages"):
        channels("rosbag", tmp_path / "a.db3")


@pytest.mark.parametrize("name", ["ulog", "mcap"])
def test_a_missing_library_is_told(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyulog", None)
    monkeypatch.setitem(__import__("sys").modules, "mcap.reader", None)
    form = built_in(name).format
    assert form is not None
    (tmp_path / "a").write_bytes(flying.ulog({k: np.zeros(3) for k in LOG_NAMES}))
    with pytest.raises(InputRefused, match=rf'pip install "nearlift\[{name}\]"'):
        form.contents(tmp_path / "a", {}, None)


LOG_NAMES = ("t", "az", "z", "vz", "m1", "m2", "m3", "m4", "supply")
