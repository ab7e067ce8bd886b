"""Text packed by gzip: read to the bit, or refused."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.unit import written

from nearlift import readers
from nearlift.errors import InputRefused
from nearlift.readers import files
from nearlift.readers.base import Contents, pick

FORCE = [float(f) for f in np.round(np.random.default_rng(1).normal(100, 3, 60), 2)]
ANY = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def read(name: str, path: Path, **dialect: Any) -> Contents:
    form = readers.reader(name)
    assert form.contents is not None
    return form.contents(path, form.checked_dialect(dialect), None)


def put(folder: Path, content: str | bytes, name: str = "a.txt") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


# ---- packed


@pytest.mark.parametrize(
    ("name", "content", "column"),
    [
        ("text", written.german(FORCE), "Kraft"),
        ("rcbenchmark", written.rcbenchmark(FORCE), "Thrust"),
        ("flight-stand", written.tyto(FORCE), "Powertrain 1 - force Fz (thrust)"),
        ("crazyflie", written.crazyflie(FORCE), "weight"),
        ("lvm", written.lvm(FORCE), "force"),
    ],
)
def test_a_packed_text_is_read_as_what_is_inside(
    tmp_path: Path, name: str, content: bytes, column: str
) -> None:
    plain = read(name, put(tmp_path, content))
    inside = read(name, put(tmp_path, gzip.compress(content), "a.txt.gz"))
    assert inside.codes == plain.codes
    np.testing.assert_array_equal(
        pick(inside.channels, column, "k", "f").values,
        pick(plain.channels, column, "k", "f").values,
    )


@ANY
@given(cut=st.integers(2, len(gzip.compress(written.rcbenchmark(FORCE), mtime=0)) - 1))
def test_a_packed_text_cut_anywhere_is_refused(cut: int, tmp_path: Path) -> None:
    content = gzip.compress(written.rcbenchmark(FORCE), mtime=0)[:cut]
    with pytest.raises(InputRefused, match="is compressed, and damaged or cut off"):
        read("rcbenchmark", put(tmp_path, content))


def test_a_packed_text_of_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "MOST_UNPACKED", 1 << 20)
    path = put(tmp_path, gzip.compress(b"t,force\n" + b"1,2\n" * 500_000))
    with pytest.raises(InputRefused, match="holds more than 1 MB"):
        read("text", path)
