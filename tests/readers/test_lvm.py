"""LabVIEW's text: segments, claims of its headers, damage named by line."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.readers.reading import contents
from tests.unit import written

from nearlift.errors import InputRefused
from nearlift.readers.base import pick


def test_lvm_segments_are_joined_and_counted(tmp_path: Path) -> None:
    path = written.put(tmp_path, "a.lvm", written.lvm([1.5, 2.5, 3.5], segments=2))
    found = contents("lvm", path)
    assert pick(found.channels, "Force", "k", "f").values.tolist() == [1.5, 2.5, 3.5] * 2
    assert found.channels[0].name == "X_Value"
    cut = path.read_bytes().rstrip(b"\n")
    path.write_bytes(cut[: cut.rfind(b"\n") + 1])
    found = contents("lvm", path)
    assert found.codes == ("truncated",), "the last segment has fewer rows than its header promises"


def test_an_lvm_that_ends_within_its_headers_is_truncated(tmp_path: Path) -> None:
    content = written.lvm([1.5, 2.5, 3.5])
    for end in (content.index(b"Channels"), content.index(b"X_Value"), content.index(b"***End")):
        found = contents("lvm", written.put(tmp_path, "a.lvm", content[:end]))
        assert found.codes == ("truncated", "NO_DATA")


def test_the_rate_in_an_lvm_header_is_not_believed_beside_a_clock(tmp_path: Path) -> None:
    content = written.lvm([1.5, 2.5, 3.5]).replace(b"Delta_X\t0,001\t0,001", b"Delta_X\t1,0\t1,0")
    found = contents("lvm", written.put(tmp_path, "a.lvm", content))
    assert found.notes == ("the header says 1 Hz, X_Value 1000 Hz: the column is believed",)
    assert found.channels[1].rate_Hz == pytest.approx(1000)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ((b"LabVIEW", b"NoVIEW"), "this is no LVM file"),
        ((b"2,5", b"2,5x"), "'2,5x' in column 'Force' is not a number"),
        ((b"2,5\t4,0", b"2,5"), "has 2 cells under 4 columns"),
        ((b"\tSupply", b"\tForce"), "names two columns alike"),
        ((b"Decimal_Separator\t,", b"Decimal_Separator\t;"), "states the decimal separator ';'"),
    ],
)
def test_a_damaged_lvm_is_refused_with_its_line(
    tmp_path: Path, change: tuple[bytes, bytes], match: str
) -> None:
    path = written.put(tmp_path, "a.lvm", written.lvm([1.5, 2.5, 3.5]).replace(*change))
    with pytest.raises(InputRefused, match=match):
        contents("lvm", path)
