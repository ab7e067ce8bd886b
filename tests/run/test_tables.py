"""Products on disk: what is read back is what was written, or refused."""

from __future__ import annotations

import errno
import os
import random

import numpy as np
import pyarrow.parquet as pq
import pytest

from nearlift.errors import ProductError
from nearlift.results.provenance import ProvenanceLedger, StageRecord
from nearlift.run import tables
from nearlift.run.tables import Product, integer, real, text
from nearlift.stages.ingest import TRIALS

CELLS = Product(
    file="cells.parquet",
    title="Cells",
    row="a cell",
    columns=(
        text("boundary", "ground"),
        real("lift_N", "N", "mean lift"),
        integer("n", "trials", optional=True),
    ),
)
OPEN = Product(file="open.parquet", title="Open", row="a row", open_ended=True)


def table(n=200):
    rng = np.random.default_rng(3)
    return {
        "boundary": np.array(["ground", "ceiling"] * (n // 2), dtype=object),
        "lift_N": rng.normal(0.3, 0.01, n),
        "n": np.arange(n),
    }


def test_a_table_is_read_back_with_units_and_meanings(tmp_path):
    path = tmp_path / CELLS.file
    given = table() | {"lift_N": np.r_[np.nan, np.inf, 1e-300, np.zeros(197)]}
    tables.write_whole(path, tables.table_bytes(given, CELLS))
    found = tables.read_table(path, CELLS)
    for name, values in given.items():
        np.testing.assert_array_equal(found[name], values)
    assert found["boundary"].dtype == object
    about = pq.read_schema(path).field("lift_N").metadata
    assert (about[b"unit"], about[b"meaning"]) == (b"N", b"mean lift")
    assert tables.table_bytes(given, CELLS) == path.read_bytes()


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"lift_N": None}, "lacks ['lift_N']"),
        ({"more": np.zeros(200)}, "undeclared ['more']"),
        ({"n": np.zeros(3)}, "different lengths"),
    ],
)
def test_a_table_that_is_not_as_declared_is_not_written(change, fault):
    given = {k: v for k, v in (table() | change).items() if v is not None}
    with pytest.raises(ProductError, match="defect of the stage") as refusal:
        tables.table_bytes(given, CELLS)
    assert fault in str(refusal.value)


def test_an_open_table_takes_further_columns_by_their_type(tmp_path):
    path = tmp_path / OPEN.file
    given = {
        "name": np.array(["a"], dtype=object),
        "count": np.array([1], dtype=np.int32),
        "x": np.array([0.5], dtype=np.float32),
    }
    tables.write_whole(path, tables.table_bytes(given, OPEN))
    found = tables.read_table(path, OPEN)
    assert [found[name].dtype.kind for name in given] == ["O", "i", "f"]


def test_rows_become_columns():
    found = CELLS.columns_of([{"boundary": "ground", "lift_N": 1, "n": 2}])
    assert (found["lift_N"].dtype.kind, found["n"].dtype.kind) == ("f", "i")
    assert len(tables.stacked(CELLS, [])["lift_N"]) == 0
    assert len(tables.stacked(CELLS, [table(4), table(2)])["n"]) == 6


def test_no_flipped_bit_passes_where_the_digest_is_stated(tmp_path):
    path = tmp_path / CELLS.file
    content = tables.table_bytes(table(), CELLS)
    path.write_bytes(content)
    outputs = {f"processed/{CELLS.file}": tables.sha256(path)}
    record = StageRecord(material={}, outputs=outputs, rejected=(), notes=(), wall_s=0.0)
    ledger = tables.json_bytes(ProvenanceLedger(stages={"reduce": record}))
    (tmp_path / tables.LEDGER).write_bytes(ledger)
    assert tables.read_table(path, CELLS)
    rng = random.Random(5)
    for _ in range(60):
        damaged = bytearray(content)
        damaged[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        with pytest.raises(ProductError, match="is damaged"):
            tables.read_table(path, CELLS)


def test_a_damaged_page_is_found_without_a_digest(tmp_path):
    path = tmp_path / CELLS.file
    content = bytearray(tables.table_bytes(table(), CELLS))
    content[300] ^= 4
    path.write_bytes(content)
    with pytest.raises(ProductError, match=r"is damaged.*\n.*delete it and run again"):
        tables.read_table(path, CELLS)
    path.write_bytes(content[:100])
    with pytest.raises(ProductError, match="is damaged"):
        tables.read_table(path, CELLS)


def test_a_missing_file_and_another_schema_say_what_to_do(tmp_path):
    with pytest.raises(ProductError, match=r"is missing\n.*run the stage that writes it"):
        tables.read_table(tmp_path / TRIALS.file, TRIALS)
    path = tmp_path / CELLS.file
    path.write_bytes(tables.table_bytes({}, OPEN))
    with pytest.raises(ProductError, match=r"has schema nearlift\.open/1, not nearlift\.cells/1"):
        tables.read_table(path, CELLS)
    (tmp_path / "fit.json").write_text("[1]")
    with pytest.raises(ProductError, match="is not a JSON object"):
        tables.read_json(tmp_path / "fit.json")
    assert tables.read_json_if_whole(tmp_path / "none.json") == {}


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "a" / "fit.json"
    tables.write_whole(path, b"old")

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as fault:
        tables.write_whole(path, b"new")
    assert fault.value.filename == str(path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in path.parent.iterdir()] == ["fit.json"]
