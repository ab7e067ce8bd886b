"""Parquet: one long table with a column `trial` and the force; a child reads it (`long_table`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import child, long_table
from nearlift.readers.channel import Malformed
from nearlift.readers.files import inside, source_of
from nearlift.readers.per_file import Format
from nearlift.readers.seam import ChannelSpec, Piece, Reader, ReadingPlan, Record
from nearlift.readers.serve import Answer, ReadRows, ReadSpans

#: Rows of one answer, and of one task at least.
BATCH, ROWS = 1 << 16, 1 << 21


def _path(campaign: Campaign, root: Path) -> Path:
    pattern = campaign.records.pattern
    if "{" in pattern:
        raise ManifestError(
            "records.files",
            f"{pattern!r} is a pattern",
            'reader = "parquet" takes one long table with a column "trial"',
        )
    return inside(root, pattern, "records.files")


def _files(campaign: Campaign, root: Path, trials: Sequence[str]) -> list[Path]:
    path = _path(campaign, root)
    return [path] if path.is_file() else []


def _asked(path: Path, request: ReadSpans | ReadRows) -> Iterator[Answer]:
    """The child's answers; what it cannot read is refused, since all trials stand in one file."""
    try:
        with child.borrowed() as reader:
            yield from reader.ask(request)
    except Malformed as fault:
        raise InputRefused(
            str(path), str(fault), "copy it anew from the rig, or write it again"
        ) from None


def trials(path: Path) -> list[str]:
    """The trials of a long table, in its order; raises `InputRefused` where it is none."""
    ((answer, _),) = _asked(path, ReadSpans(path=str(path)))
    return [str(trial) for trial in answer["trials"]]


def _plan(campaign: Campaign, root: Path, trials: Sequence[str]) -> ReadingPlan:
    path, spec = _path(campaign, root), ChannelSpec.from_manifest(campaign)
    if not path.is_file():
        raise InputRefused(str(path), "is missing", "name the table under [records] files = ...")
    columns = [("records.force.column", spec.column)]
    columns += [("records.time.column", spec.clock)] if spec.clock is not None else []
    asked = ReadSpans(path=str(path), columns=tuple(columns))
    ((answer, (starts, stops, ends)),) = _asked(path, asked)
    rows = zip(starts.astype(int).tolist(), stops.astype(int).tolist(), strict=True)
    spans = dict(zip(answer["trials"], rows, strict=True))
    wanted = set(trials)
    unlisted = [name for name in spans if name not in wanted]
    notes = []
    if unlisted:
        notes.append(
            f"{source_of(root, path)} holds {len(unlisted)} trials that the schedule does not list,"
            f" such as {unlisted[0]!r}; they were left out"
        )
    here = {name: span for name, span in spans.items() if name in wanted}
    return ReadingPlan(pieces=tuple(_pieces(path, here, ends)), notes=tuple(notes))


def _pieces(path: Path, spans: Mapping[str, tuple[int, int]], ends: FloatArray) -> Iterator[Piece]:
    """The trials of whole row groups, of as many as make a piece worth a child of its own."""
    groups = np.searchsorted(ends, [first for first, _ in spans.values()], side="right")
    size = path.stat().st_size // max(int(ends[-1]), 1) if len(ends) else 0
    names, rows = tuple(spans), tuple(spans.values())
    begin = 0
    for i in range(1, len(names) + 1):
        at_end = i == len(names)
        length = (rows[-1][1] if at_end else rows[i][0]) - rows[begin][0]
        if at_end or (groups[i] != groups[i - 1] and length >= ROWS):
            part = slice(begin, i)
            yield Piece(trials=names[part], paths=(path,), rows=rows[part], bytes=size * length)
            begin = i


def _read_piece(campaign: Campaign, root: Path, piece: Piece) -> Iterator[Record]:
    path, spec = piece.paths[0], ChannelSpec.from_manifest(campaign)
    names = (spec.column,) if spec.clock is None else (spec.column, spec.clock)
    at, trial = piece.rows[0][0], 0
    request = ReadRows(path=str(path), columns=names, first=at, end=piece.rows[-1][1], size=BATCH)
    held: list[list[FloatArray]] = [[] for _ in names]
    for _, arrays in _asked(path, request):
        end = at + len(arrays[0])
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
                force_N=spec.lift_N(columns[0]),
                time_s=None if spec.clock is None else spec.tick * columns[1],
                source=source_of(root, path),
            )
            trial += 1
        at = end


FORMAT = Format(
    name="parquet",
    title="one long Parquet table with a column `trial`",
    recognises=lambda head, name: head.startswith(b"PAR1"),
    contents=long_table.contents,
    child=True,
)
READER = Reader(
    name=FORMAT.name,
    title=FORMAT.title,
    files=_files,
    plan=_plan,
    read_piece=_read_piece,
    format=FORMAT,
)
