"""A long Parquet table as the reading child sees it: whose rows are whose, then the numbers in
batches.

The trial column is read first, alone (dictionary encoded it costs next to nothing). Samples are
then read in batches, from the row group in which the first one wanted stands, so that memory does
not depend on the size of the file.
"""

from __future__ import annotations

import contextlib
import difflib
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.channel import Channel, Contents, Names, RecordsDialect
from nearlift.readers.table import floats

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

TRIAL = "trial"


@contextlib.contextmanager
def opened(path: Path) -> Iterator[pq.ParquetFile]:
    """The file, with pyarrow's complaints as refusals."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # foreign bytes: page checksums are verified where the writer left any
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            names = file.schema_arrow.names
        with pq.ParquetFile(
            path,
            read_dictionary=[TRIAL] if TRIAL in names else None,
            page_checksum_verification=True,
        ) as file:
            yield file
    except MemoryError:
        raise
    except UnicodeDecodeError as fault:
        what = f"has a name that is no UTF-8 text: {fault.object!r}"
        raise InputRefused(
            f"{path}, column {_unreadable(path)}", what, "rename it where the table is written"
        ) from None
    except (pa.ArrowException, OSError) as fault:
        raise InputRefused(
            str(path),
            f"cannot be read as Parquet: {str(fault).splitlines()[0]}",
            "copy it anew from the rig, or write it again",
        ) from None


def _unreadable(path: Path) -> int:
    """Place, from 1, of the first column whose name is no UTF-8 text."""
    import pyarrow.dataset as ds

    schema = ds.dataset(str(path), format="parquet").schema
    for i in range(len(schema)):
        try:
            schema.field(i).name.encode()
        except UnicodeDecodeError:
            return i + 1
    return len(schema)


def _check_columns(path: Path, schema: pa.Schema, wanted: Sequence[tuple[str, str]]) -> None:
    """See that the trial's column is there, and those wanted (key and name of each), as numbers."""
    import pyarrow as pa

    for key, name in (("", TRIAL), *wanted):
        if schema.names.count(name) != 1:
            close = difflib.get_close_matches(name, schema.names, n=1)
            hint = (
                f"{key} = {close[0]!r}?" if close and key else f"it has {', '.join(schema.names)}"
            )
            raise InputRefused(
                str(path),
                f"has {'no' if name not in schema.names else 'more than one'} column {name!r}",
                hint,
            )
        kind = schema.field(name).type
        if name != TRIAL and not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
            raise InputRefused(
                str(path),
                f"column {name!r} holds {kind}, not numbers",
                "write it as integers or floats",
            )


def spans(
    path: Path, wanted: Sequence[tuple[str, str]]
) -> tuple[list[str], FloatArray, FloatArray]:
    """Every trial in the table's order, its first row and one past its last (n, 2), and one past
    the last row of each row group; `InputRefused` where the file is damaged, lacks a wanted column,
    a row has no trial, or a trial's rows do not stand together.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    rows: dict[str, tuple[int, int]] = {}
    at, last = 0, None
    with opened(path) as file:
        _check_columns(path, file.schema_arrow, wanted)
        groups = _row_group_ends(file)
        for batch in file.iter_batches(batch_size=1 << 20, columns=[TRIAL], use_threads=False):
            column: Any = batch.column(0)
            if column.null_count:
                first = at + column.is_null().to_pylist().index(True)
                raise InputRefused(
                    str(path), f"row {first + 1} has no trial", "every sample belongs to a trial"
                )
            if not pa.types.is_dictionary(column.type):
                column = pc.dictionary_encode(column)
            runs = pc.run_end_encode(column.indices)
            names = map(str, column.dictionary.take(runs.values).to_pylist())
            edges = [at, *(at + end for end in runs.run_ends.to_pylist())]
            for name, (start, end) in zip(names, itertools.pairwise(edges), strict=True):
                if name == last:
                    rows[name] = (rows[name][0], end)
                elif name in rows:
                    raise InputRefused(
                        str(path),
                        f"trial {name!r} stands in two places, at rows {rows[name][0] + 1} and"
                        f" {start + 1}",
                        "sort the table by trial, keeping the samples' order",
                    )
                else:
                    rows[name] = (start, end)
                last = name
            at += batch.num_rows
    bounds = np.array(list(rows.values()), dtype=float).reshape(-1, 2)
    return list(rows), bounds, groups.astype(float)


def _row_group_ends(file: pq.ParquetFile) -> FloatArray:
    """One past the last row of each row group."""
    return np.cumsum([file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)])


def batches(
    path: Path, names: Sequence[str], first: int, end: int, size: int
) -> Iterator[list[FloatArray]]:
    """The named columns from row `first` up to `end`, in batches of at most so many rows."""
    with opened(path) as file:
        ends = _row_group_ends(file)
        group = int(np.searchsorted(ends, first, side="right"))
        at = int(ends[group - 1]) if group else 0
        for batch in file.iter_batches(
            batch_size=size,
            row_groups=range(group, file.num_row_groups),
            columns=list(names),
            use_threads=False,
        ):
            part = slice(max(first - at, 0), min(end - at, batch.num_rows))
            if part.start < part.stop:
                yield [floats(batch.column(name))[part] for name in names]
            at += batch.num_rows
            if at >= end:
                break


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The numeric columns of a table, and whether it is our long form."""
    import pyarrow as pa

    from nearlift.readers.text import with_rate

    with opened(path) as file:
        schema = file.schema_arrow
        numeric = [
            f.name for f in schema if pa.types.is_integer(f.type) or pa.types.is_floating(f.type)
        ]
        table = file.read(
            columns=[name for name in numeric if names is None or name in names], use_threads=False
        )
        channels = tuple(
            Channel(name=name, values=floats(table[name].combine_chunks()))
            for name in table.column_names
        )
    without = 'it has no column "trial", which reader = "parquet" needs'
    notes = () if TRIAL in schema.names else (without,)
    return with_rate(Contents(channels=channels, kind="Parquet", notes=notes))
