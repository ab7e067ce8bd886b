"""Text packed by gzip, one number to a line, logs of older firmware: read to the bit, or refused."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nearlift import readers
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import csv_trial, packed
from nearlift.readers.channel import Contents, pick

from . import written

FORCE = [float(f) for f in np.round(np.random.default_rng(1).normal(100, 3, 60), 2)]
ANY = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def read(name: str, path: Path, **dialect: Any) -> Contents:
    form = readers.reader(name).format
    assert form is not None
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
    monkeypatch.setattr(packed, "MOST_BYTES", 1 << 20)
    path = put(tmp_path, gzip.compress(b"t,force\n" + b"1,2\n" * 500_000))
    with pytest.raises(InputRefused, match="holds more than 1 MB"):
        read("text", path)


# ---- one number to a line


def log(force: list[float], every: int = 0, words: str = "Tare done") -> str:
    """Values by the line, a line of words before every so many."""
    lines = []
    for i, f in enumerate(force):
        lines += [words] if every and i % every == 0 else []
        lines.append(f"{f}")
    return "\n".join(lines) + "\n"


def test_words_between_values_are_no_force(tmp_path: Path) -> None:
    path = put(tmp_path, log(FORCE, 20, "Calibration factor: 420.5"))
    with pytest.raises(InputRefused, match="Calibration factor"):
        read("text", path, columns=["force"])
    found = read("text", path, columns=["force"], ignore=["Calibration factor: *"])
    np.testing.assert_array_equal(found.channels[0].values, FORCE)


@pytest.mark.parametrize("first", ["force", "millis"])
def test_a_clock_between_the_values_is_no_force(tmp_path: Path, first: str) -> None:
    pairs = [(f, 1000 + 12 * i) for i, f in enumerate(FORCE)]
    order = pairs if first == "force" else [(t, f) for f, t in pairs]
    names = ["force", "millis"] if first == "force" else ["millis", "force"]
    path = put(tmp_path, "".join(f"{a}\n{b}\n" for a, b in order))
    with pytest.raises(InputRefused) as refused:
        read("text", path, columns=["force"])
    assert "a clock between the values" in str(refused.value)
    remedy = ", ".join(f'"{name}"' for name in names)
    assert f"dialect = {{ columns = [{remedy}], lines = 2 }}" in str(refused.value)
    found = read(
        "text", path, columns=names, units=["", "ms"] if names[1] == "millis" else [], lines=2
    )
    np.testing.assert_array_equal(pick(found.channels, "force", "k", "f").values, FORCE)
    np.testing.assert_array_equal(
        pick(found.channels, "millis", "k", "f").values, [t for _, t in pairs]
    )


def test_a_column_with_a_name_is_looked_at_as_well(tmp_path: Path) -> None:
    text = "force\n" + "".join(f"{f}\n{1000 + 12 * i}\n" for i, f in enumerate(FORCE))
    with pytest.raises(InputRefused, match="a clock between the values"):
        csv_trial.parse(text.encode(), "a.csv", "force")
    values, _, _ = csv_trial.parse(("force\n" + log(FORCE)).encode(), "a.csv", "force")
    np.testing.assert_array_equal(values, FORCE)


@ANY
@given(lost=st.integers(0, 2 * len(FORCE) - 4), name=st.sampled_from(["millis", "second"]))
def test_a_line_that_is_lost_is_told(lost: int, name: str, tmp_path: Path) -> None:
    """From there on values and clock have changed places; a clock that is not called one shows by
    its first eight numbers.
    """
    lines = [x for i, f in enumerate(FORCE) for x in (f"{f}", f"{1000 + 12 * i}")]
    path = put(tmp_path, "\n".join(lines[:lost] + lines[lost + 1 :]) + "\n")
    if name == "millis" or lost > 16:
        with pytest.raises(InputRefused, match=r"a line is lost"):
            read("text", path, columns=["force", name], lines=2)


def test_words_within_a_row_are_told(tmp_path: Path) -> None:
    lines = [x for i, f in enumerate(FORCE) for x in (f"{f}", f"{1000 + 12 * i}")]
    for at, fits in ((40, True), (41, False)):
        path = put(tmp_path, "\n".join([*lines[:at], "Tare", *lines[at:]]) + "\n")
        told = {"columns": ["force", "millis"], "lines": 2, "ignore": ["Tare"]}
        if fits:
            assert len(read("text", path, **told).channels[0].values) == len(FORCE)
        else:
            with pytest.raises(InputRefused, match="a row of 2 lines is broken by 'Tare'"):
                read("text", path, **told)
    cut = put(tmp_path, "\n".join(lines[:-1]) + "\n")
    assert "truncated" in read("text", cut, columns=["force", "millis"], lines=2).codes
    with pytest.raises(ManifestError, match="says 3 lines to a row"):
        read("text", cut, columns=["force", "millis"], lines=3)
