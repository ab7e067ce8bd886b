"""TDMS: half-written files are flagged, an index file is not believed."""

from __future__ import annotations

from pathlib import Path

from tests.readers.reading import contents
from tests.unit import written


def test_a_half_written_tdms_is_flagged_and_its_index_not_believed(tmp_path: Path) -> None:
    whole = written.tdms(list(range(500)))
    path = written.put(tmp_path, "a.tdms", whole[:-100])
    found = contents("tdms", path)
    assert found.codes == ("truncated",)
    assert len(found.channels[0].values) < 500
    path.write_bytes(whole)
    written.put(tmp_path, "a.tdms_index", b"TDSh" + b"\xff" * 40)
    found = contents("tdms", path)
    assert (found.codes, len(found.channels[0].values), found.channels[0].unit) == ((), 500, "N")


def test_a_tdms_cut_within_the_head_of_a_segment_is_flagged(tmp_path: Path) -> None:
    """nptdms passes over it in silence: only the segments' own lengths tell."""
    content = written.tdms(list(range(500)))
    last = content.rfind(b"TDSm")
    for at in (last + 2, last + 28, last + 60):
        found = contents("tdms", written.put(tmp_path, "a.tdms", content[:at]))
        assert (found.codes, len(found.channels[0].values)) == (("truncated",), 400)
