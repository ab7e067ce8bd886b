"""CSV: one file per trial, columns by header name, commas between cells, points in decimals, UTF-8.

Strict: every cell of the force (and clock) column is a number or a word that loggers write for "no
number", else the first bad line is named. A file that does not end in a newline may be cut within a
number, which no reader could see: its last line is left out and the trial says so. Three ways lead
to the same bits: a compiled scanner, pyarrow where numbers are not plain or have more digits than
the scanner takes, and a slow one that explains.
"""

from __future__ import annotations

import csv
import difflib
import functools
import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers import guarded, interleaved, packed, scanner, table
from nearlift.readers.files import files_per_trial, plan_per_trial, source_of
from nearlift.readers.seam import ChannelSpec, Piece, Reader, Record
from nearlift.units import NUMBER


def _read_piece(campaign: Campaign, root: Path, piece: Piece) -> Iterator[Record]:
    spec = ChannelSpec.from_manifest(campaign)
    for trial, path in zip(piece.trials, piece.paths, strict=True):
        # without a buffer, which would only be copied
        with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - half the time of the path's own
            content = file.readall()
        if content.startswith(packed.GZIP) or packed.is_sheet(content[:4], path.name):
            force, time, codes = guarded.run(_unpacked, path, spec.column, spec.clock)
        else:
            force, time, codes = parse(content, str(path), spec.column, spec.clock)
        yield Record(
            trial=trial,
            # the products are the record's own, unlike what was parsed
            force_N=spec.lift_N(force),
            time_s=None if time is None else spec.tick * time,
            source=source_of(root, path),
            codes=codes,
            sha256=functools.partial(_sha256, content),
        )


def _unpacked(
    path: Path, force: str, time: str | None
) -> tuple[FloatArray, FloatArray | None, tuple[str, ...]]:
    """The columns and codes of a packed file, as `parse` gives them."""
    return parse(packed.content(path), str(path), force, time)


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def parse(
    content: bytes, where: str, force: str, time: str | None = None
) -> tuple[FloatArray, FloatArray | None, tuple[str, ...]]:
    """Force and clock columns of one file's bytes, in memory that this thread's next file takes
    over, and quality codes; `InputRefused` where the file is not UTF-8, a column is missing or
    stands twice, or a line is not what the header promises.
    """
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
    columns = scanner.scan(content, body, len(header), wanted) or table.read(
        content[body:], where, 2, header, wanted
    )
    if len(header) == 1:
        interleaved.refuse(columns[0], where, 2)
    return columns[0], columns[1] if time is not None else None, codes


@functools.lru_cache(maxsize=8)
def _usual_header(line: bytes) -> list[str]:
    """As `_header`, once for all records that begin alike; empty for a line that is refused."""
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


READER = Reader(
    name="csv",
    title="one CSV file per trial, columns by header name",
    files=files_per_trial,
    plan=plan_per_trial,
    read_piece=_read_piece,
)
