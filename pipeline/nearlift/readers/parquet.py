"""Parquet: one long table with a column `trial`, in which the rows of a trial follow one another.

The trial column is read first, alone. Samples are then read in stretches of whole trials, so that
memory does not depend on the size of the file.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import guarded
from nearlift.readers.base import (
    Channel,
    Contents,
    Names,
    Reader,
    Record,
    RecordsDialect,
    names_of,
    record_of,
)
from nearlift.readers.files import MARK, Piece, inside, source_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.table import floats
from nearlift.readers.text import with_rate

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

    from nearlift.campaign.manifest import Campaign

TRIAL = "trial"
#: Rows of one batch, and of one piece at least.
BATCH, ROWS = 1 << 16, 1 << 21

Answer = TypeVar("Answer")


# ---- in the guarded process


def _opened(path: Path) -> pq.ParquetFile:
    """The file, its page checksums verified where the writer left any."""
    import pyarrow.parquet as pq

    here = TRIAL in pq.read_schema(path).names
    return pq.ParquetFile(
        path,
        read_dictionary=[TRIAL] if here else None,
        page_checksum_verification=True,
        buffer_size=1 << 20,
    )


def _is_numeric(kind: pa.DataType) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


def spans(path: Path, wanted: Mapping[str, str]) -> dict[str, tuple[int, int]]:
    """First row and end of every trial, in the table's order.

    Raises
    ------
    InputRefused
        It lacks a wanted column of numbers (manifest's key to name). Or a row has no trial, or the
        rows of a trial do not follow one another.
    """
    rows: dict[str, tuple[int, int]] = {}
    at, last = 0, None
    with _opened(path) as file:
        _check_columns(path, file.schema_arrow, wanted)
        for batch in file.iter_batches(BATCH, columns=[TRIAL], use_threads=False):
            column = batch.column(0)
            if column.null_count:
                what = f"row {at + column.is_null().to_pylist().index(True) + 1} has no trial"
                raise InputRefused(str(path), what, "every sample belongs to a trial")
            column = column.dictionary_encode() if not hasattr(column, "indices") else column
            codes = np.from_dlpack(column.indices)
            starts = np.flatnonzero(np.diff(codes, prepend=-1)).tolist()
            for start, end in zip(starts, [*starts[1:], len(codes)], strict=True):
                name = str(column[start].as_py())
                first = rows.get(name, (at + start, 0))[0]
                if name in rows and name != last:
                    raise InputRefused(
                        str(path),
                        f"has trial {name!r} in two places, at rows {first + 1} and"
                        f" {at + start + 1}",
                        "sort the table by trial, keeping the samples' order",
                    )
                rows[name], last = (first, at + end), name
            at += batch.num_rows
    return rows


def _check_columns(path: Path, schema: pa.Schema, wanted: Mapping[str, str]) -> None:
    """Refuse a table without the trial's column, or without a wanted one of numbers."""
    for key, name in (("", TRIAL), *wanted.items()):
        if schema.names.count(name) != 1:
            close = difflib.get_close_matches(name, schema.names, n=1)
            raise InputRefused(
                str(path),
                f"has {'no' if name not in schema.names else 'more than one'} column {name!r}",
                f"{key} = {close[0]!r}?" if close and key else f"it has {', '.join(schema.names)}",
            )
        kind = schema.field(name).type
        if name != TRIAL and not _is_numeric(kind):
            what = f"column {name!r} holds {kind}, not numbers"
            raise InputRefused(str(path), what, "write it as integers or floats")


def rows(path: Path, names: Sequence[str], first: int, end: int) -> list[FloatArray]:
    """The named columns from row `first` up to `end`."""
    held: list[list[FloatArray]] = [[] for _ in names]
    with _opened(path) as file:
        counts = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        ends = np.cumsum(counts)
        group = int(np.searchsorted(ends, first, side="right"))
        at = int(ends[group] - counts[group])
        groups = range(group, file.num_row_groups)
        for batch in file.iter_batches(BATCH, groups, columns=list(names), use_threads=False):
            part = slice(max(first - at, 0), min(end - at, batch.num_rows))
            if part.start < part.stop:
                for values, name in zip(held, names, strict=True):
                    values.append(floats(batch.column(name))[part])
            at += batch.num_rows
            if at >= end:
                break
    return [np.concatenate(values) for values in held]


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The numeric columns of a table, with a note where it has no column `trial`."""
    with _opened(path) as file:
        schema = file.schema_arrow
        numeric = [f.name for f in schema if _is_numeric(f.type)]
        wanted = [name for name in numeric if names is None or name in names]
        table = file.read(columns=wanted, use_threads=False)
    channels = tuple(
        Channel(name=name, values=floats(table[name].combine_chunks()))
        for name in table.column_names
    )
    without = 'it has no column "trial", which reader = "parquet" needs'
    notes = () if TRIAL in schema.names else (without,)
    return with_rate(Contents(channels=channels, kind="Parquet", notes=notes))


# ---- the reader


def _asked(function: Callable[..., Answer], *arguments: object) -> Answer:
    """The guarded answer; an unreadable file is refused, since it holds all trials."""
    try:
        return guarded.run(function, *arguments)
    except Malformed as fault:
        what = f"is no table of Parquet that can be read: {fault}"
        remedy = "copy it again from the rig, or write it again"
        raise InputRefused(str(arguments[0]), what, remedy) from None


def trials(path: Path) -> list[str]:
    """The trials of a long table, in its order; raises `InputRefused` where it is none."""
    return list(_asked(spans, path, {}))


@dataclass(frozen=True, slots=True, kw_only=True)
class LongTable(Reader):
    """The reader of one table for all trials."""

    def places(self, campaign: Campaign, root: Path, trials: Sequence[str]) -> dict[str, Path]:
        """The table, for every trial; `InputRefused` where it is not there."""
        pattern = campaign.records.pattern
        if "{" in pattern:
            remedy = 'reader = "parquet" takes one long table with a column "trial"'
            raise ManifestError("records.files", f"{pattern!r} is a pattern", remedy)
        path, is_there = inside(root, pattern, "records.files")
        if not is_there:
            remedy = "name the table under [records] files = ..."
            raise InputRefused(str(path), "is missing", remedy)
        return dict.fromkeys(trials, path)

    def plan(
        self, campaign: Campaign, root: Path, trials: Sequence[str]
    ) -> tuple[list[Piece], list[str]]:
        """Stretches of trials, each of at least `ROWS` rows."""
        [path] = {*self.places(campaign, root, trials).values()}
        keys = ("records.force.column", "records.time.column")
        columns = dict(zip(keys, names_of(campaign, MARK), strict=False))
        held, listed = _asked(spans, path, columns), set(trials)
        other = [name for name in held if name not in listed]
        notes = [
            f"{source_of(root, path)} holds {len(other)} trials that the schedule does not list,"
            f" such as {name!r}; they were left out"
            for name in other[:1]
        ]
        here = [(name, span) for name, span in held.items() if name in listed]
        pieces, begin = [], 0
        for i, (_, (_, end)) in enumerate(here, start=1):
            if i == len(here) or end - here[begin][1][0] >= ROWS:
                names, rows = zip(*here[begin:i], strict=True)
                pieces.append(Piece(trials=names, paths=(path,), rows=rows))
                begin = i
        return pieces, notes

    def read_piece(
        self, campaign: Campaign, root: Path, piece: Piece, *, whole: bool = False
    ) -> Iterator[Record]:
        """The piece's records in the plan's order."""
        path, names, first = piece.paths[0], names_of(campaign, MARK), piece.rows[0][0]
        columns = _asked(rows, path, names, first, piece.rows[-1][1])
        for trial, (start, end) in zip(piece.trials, piece.rows, strict=True):
            channels = tuple(
                Channel(name=name, values=values[start - first : end - first])
                for name, values in zip(names, columns, strict=True)
            )
            contents = Contents(channels=channels)
            yield record_of(campaign, contents, trial, str(path), source_of(root, path))


READER = LongTable(
    name="parquet",
    title="one long Parquet table with a column `trial`",
    recognises=lambda head, name: head.startswith(b"PAR1"),
    contents=contents,
    guarded=True,
)
