"""Parquet: one long table for the whole campaign, with a column `trial` and the force column.

The trial column is read first, alone (dictionary encoded it costs next to nothing), to find which rows are whose. Samples are
then read in batches, starting at the row group in which a piece's first trial begins, so that memory does not depend on the
size of the file or of its row groups.
"""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nearlift import units
from nearlift.campaign import Campaign
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.arrow import floats, indices
from nearlift.readers.seam import FloatArray, Piece, Plan, Reader, Record, files_pattern, force_channel, inside, source_of

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

TRIAL = "trial"
BATCH = 1 << 16


def _path(campaign: Campaign, root: Path) -> Path:
    pattern = files_pattern(campaign)
    if "{" in pattern:
        raise ManifestError("records.files", f"{pattern!r} is a pattern", 'reader = "parquet" takes one long table with a column "trial"')
    return inside(root, pattern, "records.files")


def _files(campaign: Campaign, root: Path, trials: Sequence[str]) -> list[Path]:
    path = _path(campaign, root)
    return [path] if path.is_file() else []


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    """The file, with pyarrow's complaints as refusals."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.is_file():
        raise InputRefused(str(path), "is missing", "name the table under [records] files = ...")
    try:
        # foreign bytes: page checksums are verified where the writer left any
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            names = file.schema_arrow.names
        with pq.ParquetFile(path, read_dictionary=[TRIAL] if TRIAL in names else None, page_checksum_verification=True) as file:
            yield file
    except (pa.ArrowException, OSError) as fault:
        raise InputRefused(
            str(path), f"cannot be read as Parquet: {str(fault).splitlines()[0]}", "copy it anew from the rig, or write it again"
        ) from None


def _check_columns(campaign: Campaign, path: Path, schema: pa.Schema) -> None:
    import pyarrow as pa

    force, clock = force_channel(campaign), campaign.records.time
    for key, name in (("", TRIAL), ("records.force.column", force.column), *([("records.time.column", clock.column)] if clock else [])):
        if schema.names.count(name) != 1:
            close = difflib.get_close_matches(name, schema.names, n=1)
            hint = f"{key} = {close[0]!r}?" if close and key else f"it has {', '.join(schema.names)}"
            raise InputRefused(str(path), f"has {'no' if name not in schema.names else 'more than one'} column {name!r}", hint)
        kind = schema.field(name).type
        if name != TRIAL and not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
            raise InputRefused(str(path), f"column {name!r} holds {kind}, not numbers", "write it as integers or floats")


def _spans(path: Path, file: pq.ParquetFile) -> dict[str, tuple[int, int]]:
    """First row and one past the last of every trial.

    Raises
    ------
    InputRefused
        A row has no trial, or a trial's rows do not stand together.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    spans: dict[str, tuple[int, int]] = {}
    at, last = 0, None
    for batch in file.iter_batches(batch_size=1 << 20, columns=[TRIAL], use_threads=False):
        column: Any = batch.column(0)
        if column.null_count:
            first = at + column.is_null().to_pylist().index(True)
            raise InputRefused(str(path), f"row {first + 1} has no trial", "every sample belongs to a trial")
        if not pa.types.is_dictionary(column.type):
            column = pc.dictionary_encode(column)
        codes = indices(column)
        names = [str(name) for name in column.dictionary.to_pylist()]
        starts = np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1, [len(codes)]]) if len(codes) else np.zeros(1, dtype=np.int64)
        for start, end in zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True):
            name = names[codes[start]]
            if name == last:
                spans[name] = (spans[name][0], at + end)
            elif name in spans:
                raise InputRefused(
                    str(path),
                    f"trial {name!r} stands in two places, at rows {spans[name][0] + 1} and {at + start + 1}",
                    "sort the table by trial, keeping the samples' order",
                )
            else:
                spans[name] = (at + start, at + end)
            last = name
        at += len(codes)
    return spans


def _plan(campaign: Campaign, root: Path, trials: Sequence[str]) -> Plan:
    path = _path(campaign, root)
    with _opened(path) as file:
        _check_columns(campaign, path, file.schema_arrow)
        spans = _spans(path, file)
        ends = _row_group_ends(file)
    wanted = set(trials)
    unlisted = [name for name in spans if name not in wanted]
    notes = (
        [f"{source_of(root, path)} holds {len(unlisted)} trials that the schedule does not list, such as {unlisted[0]!r}; they were left out"]
        if unlisted
        else []
    )
    here = [name for name in spans if name in wanted]
    groups = np.searchsorted(ends, [spans[name][0] for name in here], side="right")
    size = path.stat().st_size // max(len(ends), 1)
    pieces = []
    for group in np.unique(groups):
        own = [name for name, g in zip(here, groups, strict=True) if g == group]
        pieces.append(Piece(trials=tuple(own), paths=(path,), rows=tuple(spans[name] for name in own), bytes=size))
    return Plan(pieces=tuple(pieces), notes=tuple(notes))


def _row_group_ends(file: pq.ParquetFile) -> FloatArray:
    """One past the last row of each row group."""
    return np.cumsum([file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)])


def _read_piece(campaign: Campaign, root: Path, piece: Piece) -> Iterator[Record]:
    path, force, clock = piece.paths[0], force_channel(campaign), campaign.records.time
    factor, zero = force.linear()
    tick = units.to_si(clock.unit, "time", "records.time.unit")[0] if clock else 1.0
    names = [force.column] + ([clock.column] if clock else [])
    with _opened(path) as file:
        ends = _row_group_ends(file)
        first_group = int(np.searchsorted(ends, piece.rows[0][0], side="right"))
        at = int(ends[first_group - 1]) if first_group else 0
        batches = file.iter_batches(batch_size=BATCH, row_groups=range(first_group, file.num_row_groups), columns=names, use_threads=False)
        held: list[list[FloatArray]] = [[] for _ in names]
        trial = 0
        for batch in batches:
            arrays = [floats(batch.column(name)) for name in names]
            end = at + batch.num_rows
            while trial < len(piece.trials) and piece.rows[trial][0] < end:
                start, stop = piece.rows[trial]
                part = slice(max(start, at) - at, min(stop, end) - at)
                for parts, values in zip(held, arrays, strict=True):
                    parts.append(values[part])
                if stop > end:
                    break
                columns = [np.concatenate(parts) for parts in held]
                held = [[] for _ in names]
                yield Record(
                    trial=piece.trials[trial],
                    force_N=factor * (columns[0] - zero),
                    time_s=tick * columns[1] if clock else None,
                    source=source_of(root, path),
                )
                trial += 1
            at = end
            if trial == len(piece.trials):
                break


PARQUET = Reader(name="parquet", title="one long Parquet table with a column `trial`", files=_files, plan=_plan, read_piece=_read_piece)
