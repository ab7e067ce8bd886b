"""Logs of thrust stands: their traps, and files of another stand."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.readers.reading import contents
from tests.unit import written

from nearlift.errors import InputRefused
from nearlift.readers.base import pick


def test_rcbenchmark_traps(tmp_path: Path) -> None:
    """Byte order mark, trailing comma, micro signs, a clock that runs backwards, a speed that reads
    zero while there is lift.
    """
    rows = "0.424,1000,,0.1,0,5.0,4.0,0,0.1,,\n0.378,1000,,0.1,0,6.0,4.0,0,0.1,hello,\n4.318,1000,,0.1,0,7.0,4.0,0,0.1,,\n"
    path = written.put(tmp_path, "a.csv", (written.RC_HEADER + "\n" + rows).encode())
    found = contents("rcbenchmark", path)
    assert [c.name for c in found.channels][:2] == ["Time (s)", "ESC signal (\u00b5s)"]
    assert "App message" not in [c.name for c in found.channels]
    assert found.codes == ("dead_speed",)
    assert pick(found.channels, "Time", "k", "f").values.tolist() == [0.424, 0.378, 4.318]
    path.write_bytes(path.read_bytes() + b"5,1000,,0.1\n")
    with pytest.raises(InputRefused, match=r"a.csv, line 5: has 4 cells under 10 column names"):
        contents("rcbenchmark", path)


def test_a_header_alone_is_no_data(tmp_path: Path) -> None:
    for content in (b"weight[g],pwm,vbat[V]", b"weight[g],pwm,vbat[V]\n"):
        found = contents("crazyflie", written.put(tmp_path, "a.csv", content))
        assert "NO_DATA" in found.codes


def test_stands_refuse_each_others_files(tmp_path: Path) -> None:
    for name, content in (
        ("rcbenchmark", written.tyto([1.0])),
        ("flight-stand", written.crazyflie([1.0])),
        ("crazyflie", written.rcbenchmark([1.0])),
    ):
        with pytest.raises(InputRefused, match="line 1: has not the header of"):
            contents(name, written.put(tmp_path, "a.csv", content))


def test_a_stand_with_a_column_twice_is_refused(tmp_path: Path) -> None:
    path = written.put(tmp_path, "a.csv", b"weight[g],pwm,vbat[V],pwm\n1,2,3,4\n")
    with pytest.raises(InputRefused, match="more than one column 'pwm'"):
        contents("crazyflie", path)


def test_crazyflie_weights_may_be_negative_and_one_dead_rotor_is_seen(tmp_path: Path) -> None:
    text = "weight[g],pwm,vbat[V],rpm1,rpm2,rpm3,rpm4\n-1.0586,0,3.9,0,0,0,0\n30.5,20000,3.8,9000,0,9100,9050\n"
    found = contents("crazyflie", written.put(tmp_path, "a.csv", text.encode()))
    assert pick(found.channels, "weight", "k", "f").values.tolist() == [-1.0586, 30.5]
    assert found.codes == ("dead_speed",)
