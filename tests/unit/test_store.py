"""Products on disk: whole or not at all, read back only if intact, the same bytes for the same
content.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearlift.errors import ProductError
from nearlift.products import LIFT, TRIALS, Product
from nearlift.run import store
from nearlift.run.arrow_tables import to_arrow
from nearlift.run.schema import integer, real, text

CLOSED = Product(
    file="closed.parquet",
    title="closed",
    row="a row",
    columns=(
        text("who", "a name"),
        real("lift_N", "N", "a force"),
        integer("n", "a count"),
    ),
)
OPEN = Product(
    file="open.parquet", title="open", row="a row", columns=CLOSED.columns, open_ended=True
)


def table(n: int = 3) -> dict[str, np.ndarray]:
    return {
        "who": np.array([f"é{i}" for i in range(n)], dtype=object),
        "lift_N": np.arange(n) / 7,
        "n": np.arange(n),
    }


def write_table(path: Path, content: dict[str, np.ndarray], product: Product) -> None:
    store.write_bytes(path, store.table_bytes(content, product))


# ---- atomic


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_write_that_fails_leaves_the_old_bytes_and_no_litter(tmp_path, monkeypatch, call):
    """The disk fills up, or the power goes, before the rename."""
    path = tmp_path / "fit.json"
    store.write_bytes(path, b"old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(*((os, "fsync") if call == "fsync" else (Path, "replace")), full)
        with pytest.raises(OSError, match="No space left on device"):
            store.write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupt_is_no_exception_to_that(tmp_path, monkeypatch):
    path = tmp_path / "fit.json"
    store.write_bytes(path, b"old")

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        store.write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_content_reaches_the_disk_before_the_name_and_the_folder_after_it(tmp_path, monkeypatch):
    """Else a crash may leave the new name on an empty file."""
    told = []
    real_sync, real_replace = os.fsync, Path.replace
    monkeypatch.setattr(
        os,
        "fsync",
        lambda fd: (
            told.append("folder" if os.path.isdir(f"/proc/self/fd/{fd}") else "content"),  # noqa: PTH112
            real_sync(fd),
        )[1],
    )
    monkeypatch.setattr(Path, "replace", lambda a, b: (told.append("name"), real_replace(a, b))[1])
    store.write_bytes(tmp_path / "new" / "fit.json", b"content")
    assert told == ["content", "name", "folder"]


def test_a_table_that_breaks_its_schema_is_not_written_at_all(tmp_path):
    path = tmp_path / "closed.parquet"
    write_table(path, table(), CLOSED)
    before = path.read_bytes()
    with pytest.raises(
        ProductError, match=r"closed.parquet: lacks \['n'\], has undeclared \['m'\]"
    ):
        write_table(path, {"who": table()["who"], "lift_N": np.zeros(3), "m": np.zeros(3)}, CLOSED)
    with pytest.raises(ProductError, match=r"closed.parquet: has columns of different lengths"):
        write_table(path, {**table(), "n": np.arange(4)}, CLOSED)
    assert path.read_bytes() == before


# ---- tables


@settings(max_examples=30)
@given(
    who=st.lists(st.text(st.characters(exclude_categories=("Cs",))), min_size=0, max_size=8),
    lift=st.floats(allow_nan=True, allow_infinity=True),
    n=st.integers(-(2**63), 2**63 - 1),
)
def test_what_is_written_is_what_is_read(tmp_path_factory, who, lift, n):
    path = tmp_path_factory.mktemp("round") / "closed.parquet"
    given_table = {
        "who": np.array(who, dtype=object),
        "lift_N": np.full(len(who), lift),
        "n": np.full(len(who), n, dtype=np.int64),
    }
    write_table(path, given_table, CLOSED)
    found = store.read_table(path, CLOSED)
    assert found["who"].tolist() == who
    assert np.array_equal(found["lift_N"], given_table["lift_N"], equal_nan=True)
    assert np.array_equal(found["n"], given_table["n"])


def test_a_column_keeps_its_order_unit_meaning_and_kind(tmp_path):
    path = tmp_path / "open.parquet"
    write_table(
        path,
        {"extra": np.array([1, 2, 3], dtype=np.int32), **table(), "note": np.array(["a", "b", ""])},
        OPEN,
    )
    schema = pq.read_schema(path)
    assert schema.names == ["who", "lift_N", "n", "extra", "note"]
    assert schema.field("lift_N").metadata == {b"unit": b"N", b"meaning": b"a force"}
    assert [schema.field(c).type for c in ("who", "lift_N", "n", "extra", "note")] == [
        pa.string(),
        pa.float64(),
        pa.int64(),
        pa.int64(),
        pa.string(),
    ]
    assert schema.metadata[b"schema"] == b"nearlift.open/1"


def test_other_readers_see_the_same(tmp_path):
    pd = pytest.importorskip("pandas")
    write_table(tmp_path / "closed.parquet", table(), CLOSED)
    frame = pd.read_parquet(tmp_path / "closed.parquet")
    assert frame["who"].tolist() == ["é0", "é1", "é2"]
    assert frame["lift_N"].to_numpy() == pytest.approx(np.arange(3) / 7, rel=0)


def test_what_only_reads_products_loads_neither_pandas_nor_numba(tmp_path):
    """They take longer to import than most figures to draw."""
    path = tmp_path / CLOSED.file
    write_table(path, table(), CLOSED)
    code = (
        "import sys; from pathlib import Path; import nearlift.report.registry\n"
        "from nearlift.run import store; from tests.unit.test_store import CLOSED\n"
        f"before = 'pandas' in sys.modules\nstore.read_table(Path({str(path)!r}), CLOSED)\n"
        "print(before, 'pandas' in sys.modules, 'numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"] * 3


def test_the_same_content_gives_the_same_bytes(tmp_path):
    for name in "ab":
        write_table(tmp_path / name, table(500), CLOSED)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("bit", [0, 2, 5])
def test_no_flipped_bit_passes(tmp_path, bit):
    """Each 7th byte of the file in turn, footer included: refused, or, where nothing depends on it,
    read as it was written.
    """
    path = tmp_path / "open.parquet"
    whole = {**table(400), "supply_V": np.random.default_rng(1).normal(size=400)}
    write_table(path, whole, OPEN)
    content = path.read_bytes()
    refused = 0
    for at in range(bit, len(content), 7):
        path.write_bytes(content[:at] + bytes([content[at] ^ (1 << bit)]) + content[at + 1 :])
        try:
            found = store.read_table(path, OPEN)
        except ProductError:
            refused += 1
        else:
            assert list(found) == list(whole)
            assert all(np.array_equal(found[name], whole[name]) for name in whole)
    assert refused > 0.7 * len(content) / 7


def test_a_footer_that_lost_rows_or_renamed_a_column_is_damage(tmp_path):
    """As found by flipping bits: no page checksum covers the number of rows or the names."""
    path = tmp_path / "open.parquet"
    good = to_arrow(table(), OPEN)
    for spoilt in (
        good.slice(0, 2),
        good.rename_columns(["who", "lift_M", "n"]),
        good.set_column(2, "n", good["n"].cast(pa.int32())),
    ):
        pq.write_table(spoilt.replace_schema_metadata(good.schema.metadata), path)
        with pytest.raises(
            ProductError,
            match=(
                "is damaged: its columns or its length are not what was written\n  delete it and"
                " run again"
            ),
        ):
            store.read_table(path, OPEN)


def test_a_table_that_cannot_be_used_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "trials.parquet"
    with pytest.raises(
        ProductError, match=r"trials.parquet: is missing\n  run the stage that writes it"
    ):
        store.read_table(path, TRIALS)
    path.write_bytes(b"not parquet")
    with pytest.raises(
        ProductError, match=r"trials.parquet: is damaged: .*\n  delete it and run again"
    ):
        store.read_table(path, TRIALS)
    write_table(path, table(), CLOSED)
    with pytest.raises(
        ProductError,
        match=(
            r"has schema nearlift.closed/1, not nearlift.lift/1\n  it was written by another"
            r" version"
        ),
    ):
        store.read_table(path, LIFT)


# ---- JSON


def test_json_keeps_every_digit_and_knows_no_nan(tmp_path):
    path = tmp_path / "fit.json"
    content = {
        "a": 1 / 3,
        "b": np.float64(2e-300),
        "c": [math.nan, math.inf],
        "d": np.array([[1.5, -np.inf]]),
        "e": np.int64(3),
        "f": ("é", True, None),
    }
    store.write_json(path, content)
    found = store.read_json(path)
    assert found == {
        "a": 1 / 3,
        "b": 2e-300,
        "c": [None, None],
        "d": [[1.5, None]],
        "e": 3,
        "f": ["é", True, None],
    }
    # strict: no NaN or Infinity, which other languages' readers refuse
    json.loads(
        path.read_text(encoding="utf-8"),
        parse_constant=lambda text: pytest.fail(f"{text} is not JSON"),
    )


def test_json_that_cannot_be_used_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "fit.json"
    with pytest.raises(ProductError, match=r"fit.json: is missing\n  run the stage that writes it"):
        store.read_json(path)
    path.write_text('{"schema": ')
    with pytest.raises(ProductError, match=r"fit.json: is damaged: .*\n  delete it and run again"):
        store.read_json(path)
    path.write_text("[1]")
    with pytest.raises(ProductError, match=r"fit.json: is not a JSON object"):
        store.read_json(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ProductError, match=r"fit.json: is damaged"):
        store.read_json(path)
    assert store.read_json_if_whole(path) == {}
    path.write_text('{"a": 1}')
    assert store.read_json_if_whole(path) == {"a": 1}


def test_digest_is_that_of_the_bytes(tmp_path):
    (tmp_path / "x").write_bytes(b"abc")
    assert (
        store.sha256(tmp_path / "x")
        == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    )


ALONE = """
import os, sys
from nearlift.run import copies, store
assert copies.alone()
real = store.sha256
copied = []
fork = os.fork
os.fork = lambda: copied.append(fork()) or copied[-1]
"""


def by_itself(code: str, *arguments: str) -> str:
    """What code prints that runs in a process with one thread."""
    if sys.platform != "linux":
        pytest.skip("processes are copied on Linux only")
    done = subprocess.run(
        [sys.executable, "-c", ALONE + code, *arguments],
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    )
    return done.stdout


@pytest.fixture
def files(tmp_path):
    """Paths of some files, and what their digests are."""
    contents = [bytes([i]) * (1 + 300 * i) for i in range(37)]
    for i, content in enumerate(contents):
        (tmp_path / f"{i}").write_bytes(content)
    return [str(tmp_path / f"{i}") for i in range(len(contents))], [
        hashlib.sha256(content).hexdigest() for content in contents
    ]


def test_many_files_are_digested_while_something_else_is_done(files):
    paths, want = files
    done = []
    assert store.sha256_of(paths, lambda: done.append(1)) == want
    assert done == [1]
    code = "print(store.sha256_of(sys.argv[1:], lambda: print('meanwhile', len(copied) > 0)))"
    assert by_itself(code, *paths).splitlines() == ["meanwhile True", str(want)]


@pytest.mark.parametrize("end", ["os._exit(0)", "os.kill(os.getpid(), 9)", "raise MemoryError"])
def test_a_copy_that_ends_before_its_last_digest_costs_none(files, end):
    paths, want = files
    code = f"""
def ending(path):
    if not all(copied) and path.endswith("9"):
        {end}
    return real(path)
store.sha256 = ending
print(store.sha256_of(sys.argv[1:]))
"""
    assert by_itself(code, *paths).strip() == str(want)


def test_without_room_for_a_process_files_are_digested_here(files):
    paths, want = files
    code = """
def none():
    raise BlockingIOError
os.fork = none
print(store.sha256_of(sys.argv[1:]), len(os.listdir("/proc/self/fd")) < 8)
"""
    assert by_itself(code, *paths).strip() == f"{want} True"


def test_an_interrupt_meanwhile_leaves_no_copy_behind(files):
    code = """
def interrupted():
    raise KeyboardInterrupt
store.sha256 = lambda path: __import__("time").sleep(60)
try:
    store.sha256_of(sys.argv[1:], interrupted)
except KeyboardInterrupt:
    print([os.path.exists(f"/proc/{pid}") for pid in copied])
"""
    assert set(by_itself(code, *files[0]).strip(" []\n").split(", ")) == {"False"}


def test_a_file_that_cannot_be_read_says_so(files):
    paths, _ = files
    code = """
try:
    store.sha256_of([*sys.argv[1:], "missing"])
except FileNotFoundError as fault:
    print(fault.filename)
"""
    assert by_itself(code, *paths).strip() == "missing"
