"""Binary formats: what is written comes back, their traps are sprung, damage costs one trial."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.readers.test_formats import records
from tests.unit import written
from tests.unit.manifests import manifest

from nearlift import readers
from nearlift.errors import InputRefused, ManifestError
from nearlift.onboarding.inspection import inspect
from nearlift.readers import parquet, reader
from nearlift.readers.base import Record

PARQUET: dict[str, Any] = {
    "records": {
        "reader": "parquet",
        "files": "records.parquet",
        "force": {"column": "force", "unit": "mN", "sign": 1},
    }
}


def contents(name: str, path: Path, names: Any = None) -> Any:
    return readers.reader(name).open(path, {}, names)


@pytest.mark.filterwarnings("ignore::pandas.errors.Pandas4Warning")
@pytest.mark.filterwarnings("ignore:duration_to_mat")
def test_matlab_of_every_age(tmp_path: Path) -> None:
    import pandas as pd
    import scipy.io
    from matio import save_to_mat

    force = [1.0, 2.0, 3.0]
    for name, content in (("v5", written.mat(force, compressed=False)), ("v7", written.mat(force))):
        found = contents("mat", written.put(tmp_path, f"{name}.mat", content))
        assert [(c.name, c.values.tolist()) for c in found.channels] == [("run.force", force)]
    found = contents("mat", written.put(tmp_path, "v73.mat", written.v73(force)))
    assert [(c.name, c.values.tolist()) for c in found.channels] == [("force", force)]
    scipy.io.savemat(tmp_path / "m.mat", {"data": np.arange(6.0).reshape(3, 2), "who": "me"})
    found = contents("mat", tmp_path / "m.mat", names=("data(:,2)",))
    assert [(c.name, c.values.tolist()) for c in found.channels] == [("data(:,2)", [1.0, 3.0, 5.0])]
    table = pd.DataFrame(
        {"force": force}, index=pd.Index(np.array([0, 1, 2], dtype="timedelta64[ms]"), name="Time")
    )
    for version in ("v7", "v7.3"):
        save_to_mat(str(tmp_path / "tt.mat"), {"tt": table}, version=version)
        found = contents("mat", tmp_path / "tt.mat")
        assert [(c.name, c.unit) for c in found.channels] == [("tt.Time", "s"), ("tt.force", "")]
        np.testing.assert_allclose(found.channels[0].values, [0, 0.001, 0.002])


def test_hdf5_follows_no_link_out_of_the_file(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["secret"] = np.ones(3)
    layout = h5py.VirtualLayout(shape=(3,), dtype="f8")
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "secret", shape=(3,))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["force"] = np.arange(3.0)
        file["out"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/secret")
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset(
            "far", (3,), dtype="f8", external=[(str(tmp_path / "raw.bin"), 0, h5py.h5f.UNLIMITED)]
        )
        file["circle"] = file["/"]
    found = contents("hdf5", tmp_path / "a.h5")
    assert [c.name for c in found.channels] == ["/force"]
    assert len(found.notes) == 3
    assert any("is a link to another file" in n for n in found.notes)


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


@pytest.mark.parametrize(("name", "suffix"), [("hdf5", "h5"), ("mat", "mat"), ("tdms", "tdms")])
def test_garbage_costs_its_trial_only(tmp_path: Path, name: str, suffix: str) -> None:
    write, column, unit, _ = written.WRITERS[name]
    written.put(tmp_path, f"a.{suffix}", b"\x89HDF garbage " * 50)
    written.put(tmp_path, f"b.{suffix}", write([1.0, 2.0, 3.0]))
    a, b = records(tmp_path, name, column, unit, f"{{trial}}.{suffix}")
    assert a.codes == ("MALFORMED",)
    assert a.fault.startswith(f"a.{suffix}: ")
    assert len(b.force_N) == 3


def test_a_dataflash_log_is_named_as_what_it_is(tmp_path: Path) -> None:
    path = written.put(tmp_path, "00000012.BIN", b"\xa3\x95\x80\x80\x59FMT\0" + bytes(80))
    with pytest.raises(InputRefused, match=r"is a DataFlash log \(\.BIN\) of ArduPilot"):
        inspect(path)


# ---- Parquet


def write_table(folder: Path, columns: dict[str, Any], row_group_size: int = 7) -> None:
    pq.write_table(pa.table(columns), folder / "records.parquet", row_group_size=row_group_size)


def table_records(folder: Path, trials: list[str], **changes: Any) -> list[Record]:
    return list(reader("parquet").read(manifest(**{**PARQUET, **changes}), folder, trials))


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
    plan = reader("parquet").plan(given, tmp_path, [f"t{i}" for i in range(6)])
    assert len(plan.pieces) > 2
    backwards = [
        r
        for piece in reversed(plan.pieces)
        for r in reader("parquet").read_piece(given, tmp_path, piece)
    ]
    assert {r.trial: r.force_N[0] for r in backwards} == {
        f"t{i}": pytest.approx(5e-3 * i) for i in range(6)
    }


def test_a_missing_sample_is_nan_and_a_clock_is_read(tmp_path: Path) -> None:
    write_table(
        tmp_path, {"trial": ["a"] * 3, "force": pa.array([1, None, 3]), "t": [0.0, 5.0, 10.0]}
    )
    given = {"records": {**PARQUET["records"], "time": {"column": "t", "unit": "ms"}}}
    (record,) = table_records(tmp_path, ["a"], **given)
    np.testing.assert_allclose(record.force_N, [1e-3, np.nan, 3e-3])
    np.testing.assert_allclose(record.time_s, [0, 0.005, 0.01])


def test_trials_that_the_schedule_does_not_list_are_noted(tmp_path: Path) -> None:
    write_table(tmp_path, {"trial": ["a", "b"], "force": [1, 2]})
    plan = reader("parquet").plan(manifest(**PARQUET), tmp_path, ["a"])
    assert "1 trials that the schedule does not list, such as 'b'" in plan.notes[0]


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        (
            {"trial": ["a", "b", "a"], "force": [1, 2, 3]},
            r"trial 'a' in two places, at rows 1 and 3",
        ),
        ({"trial": ["a", None], "force": [1, 2]}, "row 2 has no trial"),
        ({"tril": ["a"], "force": [1]}, "no column 'trial'"),
        ({"trial": ["a"], "forze": [1]}, r"no column 'force'\n  records.force.column = 'forze'\?"),
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
