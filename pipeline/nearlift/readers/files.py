"""Files that a manifest names: inside the campaign's folder, regular, one for each trial.

A file is plain, compressed by gzip, or a spreadsheet, whose first sheet is read.
"""

from __future__ import annotations

import csv
import errno
import functools
import glob
import gzip
import io
import os
import stat
import unicodedata
import zlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from nearlift.errors import InputRefused
from nearlift.readers import guarded

#: Placeholder of a trial's id in ``[records] files``.
MARK = "{trial}"
#: Missing files named one by one in a note.
MOST_NAMED = 5
GZIP = b"\x1f\x8b"
#: First bytes of spreadsheets, and suffixes of their names.
SHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
SHEET_NAMES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
#: Largest text, bytes: 1 GB plain, and as much as the guarded process holds if it is compressed.
MOST_BYTES, MOST_UNPACKED = 1 << 30, 256 << 20
#: Largest number up to which whole numbers are exact.
EXACT = 2.0**53


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """The work of one task: some trials, their files, and (where a file holds many trials) rows.

    `paths` has one entry per trial, or a single one for all; `rows` one (first, end) pair per
    trial, or none.
    """

    trials: tuple[str, ...]
    paths: tuple[Path, ...]
    rows: tuple[tuple[int, int], ...] = ()


# ---- places


def inside(root: Path, relative: str, key: str) -> tuple[Path, bool]:
    """Path of a file that a manifest names, and whether there is a file.

    `InputRefused` where it leads outside the campaign's folder, by ``..`` or by a symbolic link.
    `InputRefused` also where it exists but is no regular file.
    """
    path, status, where = root / relative, None, f"{key} = {relative!r}"
    # links are followed; of many records, pathlib takes longer
    folder, name = os.path.split(os.path.abspath(path))  # noqa: PTH100
    real = os.path.join(_real(folder), name)  # noqa: PTH118
    try:
        status = os.lstat(path)
        if not stat.S_ISREG(status.st_mode):
            real, status = os.path.realpath(path), os.stat(path)  # noqa: PTH116
    except (FileNotFoundError, NotADirectoryError):
        status = None
    except OSError as fault:
        loop = fault.errno == errno.ELOOP
        what = "is a loop of symbolic links" if loop else f"cannot be read: {fault}"
        remedy = "put a readable file into the campaign's folder"
        raise InputRefused(where, what, remedy) from None
    campaign = _real(os.path.abspath(root)).rstrip(os.sep)  # noqa: PTH100
    if not real.startswith(campaign + os.sep) or ".." in path.parts[len(root.parts) :]:
        what = f"leads outside the campaign's folder, to {real}"
        raise InputRefused(where, what, "put the file itself into the folder")
    if status is not None and not stat.S_ISREG(status.st_mode):
        remedy = "a record is a plain file, no folder, pipe or device"
        raise InputRefused(str(path), "is not a regular file", remedy)
    return path, status is not None


@functools.lru_cache(maxsize=64)
def _real(folder: str) -> str:
    """The real path of a folder that holds many files."""
    return os.path.realpath(folder)


def source_of(root: Path, path: Path) -> str:
    """A file's name relative to the campaign's folder, with forward slashes."""
    # pathlib's own ways take several times as long
    folder, name = f"{root}{os.sep}", str(path)
    inside = name[len(folder) :] if name.startswith(folder) else str(path.relative_to(root))
    return inside if os.sep == "/" else inside.replace(os.sep, "/")


def unlisted(root: Path, pattern: str, trials: Collection[str], listing: str) -> list[str]:
    """Notes on files among the records that no trial of the schedule names: a row may be lost, or
    an id mistyped. `listing` is the schedule itself.
    """
    first, *_ = parts = pattern.split(MARK)
    wanted = {pattern.replace(MARK, trial) for trial in trials}
    there, other = set(), []
    for path in root.glob(glob.escape(pattern).replace(MARK, "*")):
        there.add(name := source_of(root, path))
        length = (len(name) - sum(map(len, parts))) // (len(parts) - 1)
        trial = name[len(first) : len(first) + length]
        # one trial in all its places
        whole = trial and pattern.replace(MARK, trial) == name
        if whole and name not in wanted and name != listing and path.is_file():
            other.append(name)
    missing = {_folded(name): name for name in wanted - there}
    rest = [name for name in sorted(other) if _folded(name) not in missing]
    notes = [
        f"{missing[_folded(name)]} is missing, but {name} is there, which differs only in case or"
        " in the Unicode form of its accents: rename the file, or the id in the schedule"
        for name in sorted(other)
        if _folded(name) in missing
    ]
    if (more := len(notes) - MOST_NAMED) > 0:
        notes[MOST_NAMED:] = [f"... and {more} more such files"]
    if rest:
        which = f"{rest[0]} and {len(rest) - 1} more are" if len(rest) > 1 else f"{rest[0]} is"
        notes.append(
            f"{which} no trial's record: the schedule has no such row, so left out; a row lost, or"
            " an id mistyped?"
        )
    return notes


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


# ---- bytes


def head_of(path: Path, length: int) -> bytes:
    """The first bytes of a file as it is."""
    with path.open("rb") as file:
        return file.read(length)


def packing(path: Path) -> str:
    """The packing of a file's text, "gzip" or "sheet"; empty where it is plain."""
    return _packing(head_of(path, 4), path.name)


def _packing(head: bytes, name: str) -> str:
    if head.startswith(SHEETS) and name.casefold().endswith(SHEET_NAMES):
        return "sheet"
    return "gzip" if head.startswith(GZIP) else ""


def content_of(path: Path, length: int | None = None) -> bytes:
    """The bytes of the file, or of the text inside, unpacked in the guarded process; only the first
    ones where a length is given. `InputRefused` of a damaged or too long one.
    """
    with path.open("rb", buffering=0) as file:
        packed = _packing(file.read(4), path.name)
        if not packed:
            if length is None and (size := os.fstat(file.fileno()).st_size) > MOST_BYTES:
                remedy = f"a text has at most {MOST_BYTES >> 20}; cut it"
                raise InputRefused(str(path), f"has {size >> 20} MB", remedy)
            file.seek(0)
            return file.read(-1 if length is None else length)
    return guarded.run(unpacked, path, packed, length)


def unpacked(path: Path, packed: str, length: int | None) -> bytes:
    """The text in a gzip file, or the first sheet as CSV."""
    if packed == "sheet":
        return sheet_of(path)[0].encode()
    most = MOST_UNPACKED if length is None else length
    try:
        with gzip.open(path) as file:
            content = file.read(most + (length is None))
    except (EOFError, zlib.error, gzip.BadGzipFile) as fault:
        what = f"is compressed, and damaged or cut off: {fault}"
        raise InputRefused(str(path), what, "copy it again from the rig") from None
    if len(content) > most:
        what = f"is compressed, and holds more than {most >> 20} MB"
        raise InputRefused(str(path), what, "unpack it, and cut it into records on the rig")
    return content


def sheet_of(path: Path) -> tuple[str, list[str]]:
    """The first sheet of a spreadsheet as CSV, and the names of all sheets."""
    import python_calamine

    rows: Sequence[Sequence[object]] = ()
    try:
        book = python_calamine.load_workbook(str(path))
        if book.sheet_names:
            rows = book.get_sheet_by_index(0).to_python()
    except python_calamine.CalamineError as fault:
        what = f"cannot be read as a spreadsheet: {fault}"
        remedy = "save it again, or save the sheet as CSV"
        raise InputRefused(str(path), what, remedy) from None
    if not book.sheet_names:
        raise InputRefused(str(path), "holds no sheet", "save the table as CSV")
    out = io.StringIO()
    for row in rows:
        cells = list(map(_cell, row))
        # a blank row is a blank line
        csv.writer(out, lineterminator="\n").writerow(cells if any(cells) else [])
    return out.getvalue(), list(book.sheet_names)


def _cell(value: object) -> str:
    """A cell as CSV has it: whole numbers without a point, times as in ISO 8601."""
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < EXACT else repr(value)
    if hasattr(value, "isoformat"):
        return str(value.isoformat())
    return " ".join(str(value).split())
