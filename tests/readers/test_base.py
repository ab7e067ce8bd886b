"""Every format: round trips, units, rates and names of columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.readers.reading import contents, records
from tests.unit import written

from nearlift import readers, units
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.base import fold, pick, split_unit, unit_word

NUMBERS = st.lists(st.floats(-1e6, 1e6, width=32), min_size=3, max_size=40)


@pytest.mark.parametrize("name", [n for n in written.WRITERS if n != "csv"])
def test_what_is_written_comes_back(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    write, column, _, suffix = written.WRITERS[name]
    folder = tmp_path_factory.mktemp(name)

    @settings(max_examples=15)
    @given(force=NUMBERS)
    def turn(force: list[float]) -> None:
        path = written.put(folder, f"a.{suffix}", write(force))
        found = contents(name, path, names=(column,))
        channel = pick(found.channels, column, "records.force.column", "a")
        np.testing.assert_array_equal(channel.values, force)
        assert set(found.codes) <= {"dead_speed"}

    turn()


@pytest.mark.parametrize("name", list(written.WRITERS))
def test_records_are_newtons_of_lift(tmp_path: Path, name: str) -> None:
    write, column, unit, suffix = written.WRITERS[name]
    force = [1.5, 2.25, 3.5, 4.0, 5.75, 6.5]
    written.put(tmp_path, f"trials/a.{suffix}", write(force))
    written.put(tmp_path, f"trials/b.{suffix}", b"")
    if name == "csv":
        column = "force"
    a, b = records(tmp_path, name, column, unit, f"trials/{{trial}}.{suffix}")
    factor, _ = units.to_si(unit, "force", "")
    np.testing.assert_allclose(a.force_N, factor * np.array(force), rtol=1e-7)
    assert a.source == f"trials/a.{suffix}"
    assert b.codes == ("EMPTY",)
    assert len(b.force_N) == 0


@pytest.mark.parametrize("name", ["rcbenchmark", "flight-stand", "hdf5", "tdms", "lvm", "text"])
def test_a_unit_in_the_file_that_the_manifest_contradicts_is_refused(
    tmp_path: Path, name: str
) -> None:
    """Gram-force read as newton is a factor of 102."""
    write, column, unit, suffix = written.WRITERS[name]
    written.put(tmp_path, f"a.{suffix}", write([1.0, 2.0, 3.0]))
    other = "N" if unit != "N" else "gf"
    says = rf"states .* in {unit}, the manifest says {other}: a factor of .*\n"
    with pytest.raises(InputRefused, match=rf'{says}  records.force.unit = "{unit}"'):
        records(tmp_path, name, column, other, f"{{trial}}.{suffix}")


def test_a_rate_in_the_file_that_the_manifest_contradicts_is_refused(tmp_path: Path) -> None:
    written.put(tmp_path, "a.lvm", written.lvm([1.0, 2.0, 3.0], columns="No"))
    with pytest.raises(
        InputRefused, match=r"'Force' has 1000 Hz, the manifest says 200 Hz\n.*ignore_rate"
    ):
        records(tmp_path, "lvm", "Force", "N", "{trial}.lvm", rate="200 Hz")
    (a,) = records(
        tmp_path, "lvm", "Force", "N", "{trial}.lvm", rate="200 Hz", dialect={"ignore_rate": True}
    )
    assert len(a.force_N) == 3


def test_names_are_folded_before_they_are_compared() -> None:
    assert fold("Torque (N\u00b7m)") == fold("torque  (N\u22c5m)") == fold("Torque (N*m)")
    assert fold("ESC signal (\u00b5s)") == fold("ESC signal (\u03bcs)")
    names = ("Thrust (gf)", "weight[g]", "force Fz (thrust) (N)", "rpm1")
    parts = [("Thrust", "gf"), ("weight", "g"), ("force Fz (thrust)", "N"), ("rpm1", "")]
    assert [*map(split_unit, names)] == parts
    assert unit_word("[\u00b5s]") == "us"
    assert unit_word("furlong") is None


def test_a_column_that_is_not_there_or_twice_is_refused(tmp_path: Path) -> None:
    found = contents("rcbenchmark", written.put(tmp_path, "a.csv", written.rcbenchmark([1.0, 2.0])))
    assert pick(found.channels, "thrust", "k", "f").name == "Thrust (gf)"
    with pytest.raises(InputRefused, match=r"has no column 'Trust'\n  k = \"Thrust \(gf\)\""):
        pick(found.channels, "Trust", "k", "f")
    doubled = (*found.channels, *found.channels)
    with pytest.raises(InputRefused, match="has more than one column 'Thrust'"):
        pick(doubled, "Thrust", "k", "f")


def test_an_unknown_reader_gets_the_nearest_name() -> None:
    with pytest.raises(ManifestError, match="did you mean 'parquet'"):
        readers.reader("parket")
    assert [r.name for r in readers.readers()[: len(readers.BUILT_IN)]] == list(readers.BUILT_IN)
