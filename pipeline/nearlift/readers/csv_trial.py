"""CSV: one file per trial, columns by header name, commas between cells, points in decimals, UTF-8.

Strict: every cell of the force (and clock) column is a number or a word that loggers write for "no
number", else the first bad line is named. A file that does not end in a newline may be cut within a
number, which no reader could see: its last line is left out and the trial says so. Three roads lead
to the same bits: a compiled scanner, pyarrow where numbers are not plain or have more digits than
the scanner takes, and a slow one that explains.
"""

from __future__ import annotations

import csv
import difflib
import functools
import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.errors import InputRefused
from nearlift.manifest.campaign import Campaign
from nearlift.readers import scanner, table
from nearlift.readers.seam import (
    FloatArray,
    Piece,
    Plan,
    Reader,
    Record,
    force_channel,
    per_trial,
    source_of,
    unlisted,
)
from nearlift.units import NUMBER

#: Files of one task; large enough that a task costs more than sending it.
PER_PIECE = 32


def _files(campaign: Campaign, root: Path, trials: Sequence[str]) -> list[Path]:
    return [path for path, _ in per_trial(campaign, root, trials).values()]


def _plan(campaign: Campaign, root: Path, trials: Sequence[str]) -> Plan:
    there = per_trial(campaign, root, trials)
    names = list(there)
    chunks = [names[i : i + PER_PIECE] for i in range(0, len(names), PER_PIECE)]
    pieces = tuple(
        Piece(
            trials=tuple(chunk),
            paths=tuple(there[t][0] for t in chunk),
            bytes=sum(there[t][1] for t in chunk),
        )
        for chunk in chunks
    )
    return Plan(pieces=pieces, notes=unlisted(campaign, root, trials))


def _read_piece(campaign: Campaign, root: Path, piece: Piece) -> Iterator[Record]:
    factor, zero = force_channel(campaign).linear()
    clock = campaign.records.time
    tick = units.to_si(clock.unit, "time", "records.time.unit")[0] if clock else 1.0
    for trial, path in zip(piece.trials, piece.paths, strict=True):
        # without a buffer, which would only be copied
        with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - half the time of the path's own
            content = file.readall()
        force, time, codes = _parsed(
            content, str(path), force_channel(campaign).column, clock.column if clock else None
        )
        yield Record(
            trial=trial,
            # the products are the record's own, unlike what was parsed
            force_N=factor * (force - zero if zero else force),
            time_s=None if time is None else tick * time,
            source=source_of(root, path),
            codes=codes,
            sha256=functools.partial(_sha256, content),
        )


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def parse(
    content: bytes, where: str, force: str, time: str | None = None
) -> tuple[FloatArray, FloatArray | None, tuple[str, ...]]:
    """Force and clock columns of one file's bytes, and quality codes.

    Raises
    ------
    InputRefused
        The file is not UTF-8, a column is missing or stands twice, or a line is not what the header
        promises.
    """
    found, clock, codes = _parsed(content, where, force, time)
    return found.copy(), None if clock is None else clock.copy(), codes


def _parsed(
    content: bytes, where: str, force: str, time: str | None
) -> tuple[FloatArray, FloatArray | None, tuple[str, ...]]:
    """What `parse` gives, in memory that this thread's next file takes over."""
    nothing = np.empty(0)
    blank = None if time is None else nothing
    codes: tuple[str, ...] = ()
    if not content.strip(b"\0"):
        return nothing, blank, ("EMPTY",)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputRefused(
            where, "is UTF-16 text", 'save it as UTF-8, or say reader = "text", which reads it'
        )
    if not content.endswith(b"\n"):
        # a NUL tail is what a power cut leaves behind
        content = content.rstrip(b"\0")
        content = content[: content.rfind(b"\n") + 1]
        codes = ("truncated",)
        if not content:
            return nothing, blank, ("NO_DATA", "truncated")
    body = content.find(b"\n") + 1
    header = _usual_header(content[:body]) or _header(content[:body], where)
    wanted = [
        _place(header, name, key, where)
        for name, key in ((force, "records.force.column"), (time, "records.time.column"))
        if name is not None
    ]
    if not content[body : body + 80].strip() and not content[body:].strip():
        return nothing, blank, (*codes, "NO_DATA")
    found = scanner.scan(content, body, len(header), wanted) or table.read(
        content[body:], where, 2, header, wanted
    )
    return found[0], found[1] if time is not None else None, codes


@functools.lru_cache(maxsize=8)
def _usual_header(line: bytes) -> list[str]:
    """What `_header` gives: a campaign's records begin alike. Empty where there is something to say
    of the line, with the file's name.
    """
    try:
        return _header(line, "")
    except InputRefused:
        return []


def _header(line: bytes, where: str) -> list[str]:
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputRefused(f"{where}, line 1", "is not UTF-8 text", "save it as UTF-8") from None
    try:
        header = [name.strip() for name in next(csv.reader([text.rstrip("\r\n")]), [])]
    except csv.Error as fault:
        raise InputRefused(
            f"{where}, line 1",
            f"is no header: {fault}",
            "the file is damaged, or of another dialect",
        ) from None
    if len(header) == 1 and any(d in header[0] for d in ";\t"):
        raise InputRefused(
            f"{where}, line 1",
            "is not separated by commas",
            'save it with commas between cells and points in decimals, or say reader = "text"',
        )
    if header and all(NUMBER.fullmatch(name) for name in header):
        raise InputRefused(
            f"{where}, line 1",
            "holds numbers where the columns' names should stand",
            'put a header line above the samples, or say reader = "text" and dialect = { columns ='
            " [...] }",
        )
    return header


def _place(header: list[str], name: str, key: str, where: str) -> int:
    if header.count(name) != 1:
        close = difflib.get_close_matches(name, header, n=1, cutoff=0.5)
        hint = (
            f'{key} = "{close[0]}"?'
            if close and name not in header
            else f"it has {', '.join(repr(h) for h in header)}; {key} names it"
        )
        raise InputRefused(
            f"{where}, line 1",
            f"{'more than one' if name in header else 'no'} column {name!r}",
            hint,
        )
    return header.index(name)


CSV = Reader(
    name="csv",
    title="one CSV file per trial, columns by header name",
    files=_files,
    plan=_plan,
    read_piece=_read_piece,
)
