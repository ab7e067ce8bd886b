"""One long table: the same records from every layout, and tables that cannot be meant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.readers.reading import of_trials
from tests.unit.manifests import manifest

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import parquet, reader
from nearlift.readers.base import Record

PARQUET: dict[str, Any] = {
    "records": {
        "reader": "parquet",
        "files": "records.parquet",
        "force": {"column": "force", "unit": "mN", "sign": 1},
    }
}


def write_table(folder: Path, columns: dict[str, Any], row_group_size: int = 7) -> None:
    pq.write_table(pa.table(columns), folder / "records.parquet", row_group_size=row_group_size)


def table_records(folder: Path, trials: list[str], **changes: Any) -> list[Record]:
    return of_trials("parquet", manifest(**{**PARQUET, **changes}), folder, trials)


@pytest.mark.parametrize("row_group_size", [1, 7, 100])
@pytest.mark.parametrize("rows", [2, 1 << 21])
@pytest.mark.parametrize("kind", ["text", "dictionary", "integer"])
def test_records_do_not_depend_on_the_files_layout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, row_group_size: int, rows: int, kind: str
) -> None:
    monkeypatch.setattr(parquet, "ROWS", rows)
    lengths = {"0": 4, "1": 9, "2": 1, "3": 12}
    names = [t for t, n in lengths.items() for _ in range(n)]
    trial = {
        "text": pa.array(names),
        "dictionary": pa.array(names).dictionary_encode(),
        "integer": pa.array([int(t) for t in names]),
    }[kind]
    force = np.arange(26.0)
    write_table(tmp_path, {"trial": trial, "force": pa.array(force)}, row_group_size)
    got = table_records(tmp_path, ["3", "0", "2"])
    assert [r.trial for r in got] == ["0", "2", "3"]
    for record, want in zip(got, (force[:4], force[13:14], force[14:]), strict=True):
        np.testing.assert_allclose(record.force_N, 1e-3 * want)


def test_pieces_are_independent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parquet, "ROWS", 5)
    names = [f"t{i}" for i in range(6) for _ in range(5)]
    write_table(tmp_path, {"trial": names, "force": np.arange(30)})
    given = manifest(**PARQUET)
    pieces, _ = reader("parquet").plan(given, tmp_path, [f"t{i}" for i in range(6)])
    assert len(pieces) > 2
    read = reader("parquet").read_piece
    backwards = [r for piece in reversed(pieces) for r in read(given, tmp_path, piece)]
    want = {f"t{i}": pytest.approx(5e-3 * i) for i in range(6)}
    assert {r.trial: r.force_N[0] for r in backwards} == want


def test_a_missing_sample_is_nan_and_a_clock_is_read(tmp_path: Path) -> None:
    columns = {"trial": ["a"] * 3, "force": pa.array([1, None, 3]), "t": [0.0, 5.0, 10.0]}
    write_table(tmp_path, columns)
    given = {"records": {**PARQUET["records"], "time": {"column": "t", "unit": "ms"}}}
    (record,) = table_records(tmp_path, ["a"], **given)
    np.testing.assert_allclose(record.force_N, [1e-3, np.nan, 3e-3])
    np.testing.assert_allclose(record.time_s, [0, 0.005, 0.01])


def test_trials_that_the_schedule_does_not_list_are_noted(tmp_path: Path) -> None:
    write_table(tmp_path, {"trial": ["a", "b"], "force": [1, 2]})
    _, notes = reader("parquet").plan(manifest(**PARQUET), tmp_path, ["a"])
    assert "1 trials that the schedule does not list, such as 'b'" in notes[0]


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        ({"trial": ["a", "b", "a"], "force": [1, 2, 3]}, "'a' in two places, at rows 1 and 3"),
        ({"trial": ["a", None], "force": [1, 2]}, "row 2 has no trial"),
        ({"tril": ["a"], "force": [1]}, "no column 'trial'"),
        ({"trial": ["a"], "forze": [1]}, "no column 'force'\n  records.force.column = .forze.\\?"),
        ({"trial": ["a"], "force": ["1"]}, "holds string, not numbers"),
    ],
)
def test_tables_that_cannot_be_meant(tmp_path: Path, columns: dict[str, Any], match: str) -> None:
    write_table(tmp_path, columns)
    with pytest.raises(InputRefused, match=match):
        table_records(tmp_path, ["a", "b"])


def test_damage_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputRefused, match="is missing"):
        table_records(tmp_path, ["a"])
    write_table(tmp_path, {"trial": ["a"] * 100, "force": np.arange(100)})
    content = (tmp_path / "records.parquet").read_bytes()
    (tmp_path / "records.parquet").write_bytes(content[: len(content) // 2])
    with pytest.raises(InputRefused, match="no table of Parquet that can be read"):
        table_records(tmp_path, ["a"])


def test_a_pattern_is_no_long_table(tmp_path: Path) -> None:
    with pytest.raises(ManifestError, match="takes one long table"):
        table_records(tmp_path, ["a"], records={**PARQUET["records"], "files": "{trial}.parquet"})
