"""Parquet: one long table with a column `trial`, in which the rows of a trial follow one another.

The trial column is read first, alone. Samples are then read in stretches of whole trials, so that
memory does not depend on the size of the file.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import base, guarded
from nearlift.readers.files import MARK, Piece, inside, source_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.table import floats

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

    here = [TRIAL] if TRIAL in pq.read_schema(path).names else None
    return pq.ParquetFile(
        path, read_dictionary=here, page_checksum_verification=True, buffer_size=1 << 20
    )


def _numeric(schema: pa.Schema, names: base.Names) -> list[str]:
    """The wanted columns of numbers."""
    from pyarrow.types import is_floating, is_integer

    numbers = [field.name for field in schema if is_integer(field.type) or is_floating(field.type)]
    return [name for name in numbers if base.wanted(name, names)]


def _channels(table: pa.Table) -> tuple[base.Channel, ...]:
    columns = zip(table.column_names, table.columns, strict=True)
    return tuple(base.Channel(name=name, values=floats(c.combine_chunks())) for name, c in columns)


def spans(path: Path, asked: Mapping[str, str]) -> dict[str, tuple[int, int]]:
    """First row and end of every trial, in the table's order.

    Raises
    ------
    InputRefused
        It lacks a column that is asked for (manifest's key to name), or that is not of numbers. Or
        a row has no trial, or the rows of a trial do not follow one another.
    """
    firsts: dict[str, int] = {}
    at, last = 0, None
    with _opened(path) as file:
        schema = file.schema_arrow
        if schema.names.count(TRIAL) != 1:
            what = f"has {'more than one' if TRIAL in schema.names else 'no'} column {TRIAL!r}"
            raise InputRefused(str(path), what, f"it has {', '.join(schema.names)}")
        columns = [base.Channel(name=name, values=np.empty(0)) for name in schema.names]
        for key, name in asked.items():
            column = base.pick(columns, name, key, str(path)).name
            if column not in _numeric(schema, None):
                what = f"column {column!r} holds {schema.field(column).type}, not numbers"
                raise InputRefused(str(path), what, "write it as integers or floats")
        for batch in file.iter_batches(BATCH, columns=[TRIAL], use_threads=False):
            trial = batch.column(0)
            if trial.null_count:
                what = f"row {at + trial.is_null().to_pylist().index(True) + 1} has no trial"
                raise InputRefused(str(path), what, "every sample belongs to a trial")
            trial = trial if hasattr(trial, "indices") else trial.dictionary_encode()
            starts = np.flatnonzero(np.diff(np.from_dlpack(trial.indices), prepend=-1))
            for start in starts.tolist():
                if (name := str(trial[start].as_py())) == last:
                    continue
                if name in firsts:
                    rows = f"rows {firsts[name] + 1} and {at + start + 1}"
                    what = f"has trial {name!r} in two places, at {rows}"
                    remedy = "sort the table by trial, keeping the samples' order"
                    raise InputRefused(str(path), what, remedy)
                firsts[name], last = at + start, name
            at += batch.num_rows
    return dict(zip(firsts, itertools.pairwise([*firsts.values(), at]), strict=True))


def rows(path: Path, names: base.Names, first: int, end: int) -> tuple[base.Channel, ...]:
    """The wanted columns from row `first` up to `end`."""
    import pyarrow as pa

    batches = []
    with _opened(path) as file:
        counts = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
        group = int(np.searchsorted(np.cumsum(counts), first, side="right"))
        at, groups = sum(counts[:group]), range(group, len(counts))
        columns = _numeric(file.schema_arrow, names)
        for batch in file.iter_batches(BATCH, groups, columns=columns, use_threads=False):
            skipped = max(first - at, 0)
            if skipped < batch.num_rows:
                batches.append(batch.slice(skipped, end - at - skipped))
            at += batch.num_rows
            if at >= end:
                break
    return _channels(pa.Table.from_batches(batches))


def contents(path: Path, dialect: base.RecordsDialect, names: base.Names) -> base.Contents:
    """The numeric columns of a table, with a note where it has no column `trial`."""
    with _opened(path) as file:
        schema = file.schema_arrow
        channels = _channels(file.read(columns=_numeric(schema, names), use_threads=False))
    notes = ['it has no column "trial", which reader = "parquet" needs']
    notes = [] if TRIAL in schema.names else notes
    return base.Contents(channels=channels, kind="Parquet", notes=tuple(notes))


# ---- the reader


def _asked(function: Callable[..., Answer], *arguments: object) -> Answer:
    """The guarded answer; an unreadable file is refused, since it holds all trials."""
    try:
        return guarded.run(function, *arguments)
    except Malformed as fault:
        what = f"is no table of Parquet that can be read: {fault}"
        remedy = "copy it again from the rig, or write it again"
        raise InputRefused(str(arguments[0]), what, remedy) from None


def trials(path: Path) -> dict[str, tuple[int, int]]:
    """First row and end of every trial of a long table; `InputRefused` where it is none."""
    return _asked(spans, path, {})


@dataclass(frozen=True, slots=True, kw_only=True)
class LongTable(base.Reader):
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
        asked = dict(zip(keys, base.names_of(campaign, MARK), strict=False))
        held, listed = _asked(spans, path, asked), set(trials)
        other = [name for name in held if name not in listed]
        notes = [
            f"{source_of(root, path)} holds {len(other)} trials that the schedule does not list,"
            f" such as {name!r}; they were left out"
            for name in other[:1]
        ]
        pieces: list[Piece] = []
        stretch: dict[str, tuple[int, int]] = {}
        for name in (name for name in held if name in listed):
            stretch[name] = held[name]
            if held[name][1] - next(iter(stretch.values()))[0] >= ROWS:
                pieces.append(_piece(path, stretch))
                stretch = {}
        return [*pieces, *[_piece(path, stretch)] * bool(stretch)], notes

    def read_piece(
        self, campaign: Campaign, root: Path, piece: Piece, *, whole: bool = False
    ) -> Iterator[base.Record]:
        """The piece's records in the plan's order."""
        path, first = piece.paths[0], piece.rows[0][0]
        columns = _asked(rows, path, base.names_of(campaign, MARK), first, piece.rows[-1][1])
        for trial, (start, end) in zip(piece.trials, piece.rows, strict=True):
            part = slice(start - first, end - first)
            read = base.Contents(channels=tuple(replace(c, values=c.values[part]) for c in columns))
            yield base.record_of(
                campaign, base.one_clock(read), trial, str(path), source_of(root, path)
            )


def _piece(path: Path, spans: Mapping[str, tuple[int, int]]) -> Piece:
    return Piece(trials=tuple(spans), paths=(path,), rows=tuple(spans.values()))


READER = LongTable(
    name="parquet",
    title="one long Parquet table with a column `trial`",
    recognises=lambda head, name: head.startswith(b"PAR1"),
    contents=contents,
    guarded=True,
)
