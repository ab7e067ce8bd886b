"""Files that a manifest names: inside the campaign's folder, regular, one for each trial.

A file is plain, compressed by gzip, or a spreadsheet, whose first sheet is read.
"""

from __future__ import annotations

import csv
import errno
import functools
import glob
import io
import os
import re
import stat
import unicodedata
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.errors import InputRefused, ManifestError

if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign

#: Placeholder of a trial's id in ``[records] files``.
MARK = "{trial}"
_NOT_IN_NAMES = re.compile(r"[/\\\0]")
#: Files of one task, and bytes, whatever is reached first.
FILES_PER_PIECE, BYTES_PER_PIECE = 32, 64 << 20
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


def inside(root: Path, relative: str, key: str) -> Path:
    """The path of a file that a manifest names.

    `InputRefused` where it leads outside the campaign's folder, by ``..`` or by a symbolic link.
    `InputRefused` also where it exists but is no regular file.
    """
    return _checked(root, relative, key)[0]


def _checked(root: Path, relative: str, key: str) -> tuple[Path, int | None]:
    """The path that `inside` gives, and the file's size: None where there is no file."""
    path = root / relative
    # links are followed
    real, status = os.path.realpath(path), None
    try:
        status = os.stat(path)  # noqa: PTH116 - of many records, pathlib takes longer
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as fault:
        loop = fault.errno == errno.ELOOP
        raise InputRefused(
            f"{key} = {relative!r}",
            "is a loop of symbolic links" if loop else f"cannot be read: {fault}",
            "put a readable file into the campaign's folder",
        ) from None
    if not real.startswith(_prefix(root.absolute())) or ".." in path.parts[len(root.parts) :]:
        raise InputRefused(
            f"{key} = {relative!r}",
            f"leads outside the campaign's folder, to {real}",
            "put the file itself into the folder",
        )
    if status is not None and not stat.S_ISREG(status.st_mode):
        raise InputRefused(
            str(path),
            "is not a regular file",
            "a record is a plain file, no folder, pipe or device",
        )
    return path, None if status is None else status.st_size


@functools.lru_cache(maxsize=64)
def _prefix(root: Path) -> str:
    """The begin of the real paths of files in a folder."""
    return os.path.join(os.path.realpath(root), "")  # noqa: PTH118 - with a separator at its end


def source_of(root: Path, path: Path) -> str:
    """A file's name relative to the campaign's folder, with forward slashes."""
    # pathlib's own ways take several times as long
    folder, name = f"{root}{os.sep}", str(path)
    inside = name[len(folder) :] if name.startswith(folder) else str(path.relative_to(root))
    return inside if os.sep == "/" else inside.replace(os.sep, "/")


def per_trial(campaign: Campaign, root: Path, trials: Sequence[str]) -> dict[str, tuple[Path, int]]:
    """File and size in bytes of each trial that has one, by the manifest's pattern of one file per
    trial.

    `ManifestError` where the pattern has no ``{trial}``, or a trial's id cannot be part of a file
    name. `InputRefused` as by `inside`.
    """
    pattern = campaign.records.pattern
    if MARK not in pattern:
        raise ManifestError(
            "records.files",
            f"{pattern!r} does not say where the trial's id is",
            'write {trial} in it, as in "trials/{trial}.csv"',
        )
    there: dict[str, tuple[Path, int]] = {}
    for trial in trials:
        if _NOT_IN_NAMES.search(trial) or trial in (".", ".."):
            raise ManifestError(
                f"trial {trial!r}",
                "has an id that cannot be part of a file name",
                "use letters, digits, '-', '_' and '.'",
            )
        path, size = _checked(root, pattern.replace(MARK, trial), "records.files")
        if size is not None:
            there[trial] = path, size
    return there


def pieces(there: Mapping[str, tuple[Path, int]]) -> Iterator[Piece]:
    """Tasks of some files each, from path and size in bytes of every trial's."""
    trials: list[str] = []
    size = 0
    for i, (trial, (_, length)) in enumerate(there.items(), start=1):
        trials.append(trial)
        size += length
        if len(trials) == FILES_PER_PIECE or size > BYTES_PER_PIECE or i == len(there):
            yield Piece(trials=tuple(trials), paths=tuple(there[t][0] for t in trials))
            trials, size = [], 0


def _fits(name: str, pattern: str) -> bool:
    """Whether a name is the pattern with one trial in all its places."""
    parts = pattern.split(MARK)
    length, rest = divmod(len(name) - sum(map(len, parts)), len(parts) - 1)
    trial = name[len(parts[0]) : len(parts[0]) + length]
    return length > 0 and rest == 0 and pattern.replace(MARK, trial) == name


def unlisted(campaign: Campaign, root: Path, trials: Collection[str]) -> list[str]:
    """Notes on files among the records that no trial of the schedule names: a row may be lost, or
    an id mistyped.
    """
    pattern, listing = campaign.records.pattern, campaign.trials.file
    paths = root.glob(glob.escape(pattern).replace(MARK, "*"))
    there = {name for path in paths if (name := source_of(root, path)) != listing}
    wanted = {pattern.replace(MARK, trial) for trial in trials}
    other = sorted(
        name for name in there - wanted if _fits(name, pattern) and (root / name).is_file()
    )
    # a name that differs from a missing one only in case, or in the form of its accents
    missing = {_folded(name): name for name in wanted - there}
    notes, rest = [], []
    for name in other:
        if (meant := missing.get(_folded(name))) is None:
            rest.append(name)
            continue
        same = unicodedata.normalize("NFC", name) == unicodedata.normalize("NFC", meant)
        how = "in the Unicode form of its accents (NFC, NFD)" if same else "in case"
        notes.append(
            f"{meant} is missing, but {name} is there, which differs only {how}: rename the file,"
            " or the id in the schedule"
        )
    if len(notes) > MOST_NAMED:
        notes[MOST_NAMED:] = [f"... and {len(notes) - MOST_NAMED} more such files"]
    if rest:
        more = f" and {len(rest) - 1} more are" if len(rest) > 1 else " is"
        notes.append(
            f"{rest[0]}{more} no trial's record: the schedule has no such row, so left out; a row"
            " lost, or an id mistyped?"
        )
    return notes


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


# ---- bytes


def head_of(path: Path, length: int) -> bytes:
    """The first bytes of a file as it is."""
    with path.open("rb") as file:
        return file.read(length)


def is_packed(path: Path) -> bool:
    """Whether a file has its text inside; False where it cannot be opened."""
    try:
        head = head_of(path, 4)
    except OSError:
        return False
    return head.startswith(GZIP) or is_sheet(head, path.name)


def is_sheet(head: bytes, name: str) -> bool:
    """Whether a file with these first bytes and this name is a spreadsheet."""
    return head.startswith(SHEETS) and name.casefold().endswith(SHEET_NAMES)


def content_of(path: Path, length: int | None = None) -> bytes:
    """The bytes of the file, or of the text inside; only the first ones where a length is given.
    `InputRefused` of a damaged or too long one.
    """
    head = head_of(path, 4)
    if head.startswith(GZIP):
        return _unpacked(path, length)
    if is_sheet(head, path.name):
        return sheet_of(path)[0].encode()
    if length is not None:
        return head_of(path, length)
    if (size := path.stat().st_size) > MOST_BYTES:
        remedy = f"a text has at most {MOST_BYTES >> 20}; cut it"
        raise InputRefused(str(path), f"has {size >> 20} MB", remedy)
    return path.read_bytes()


def _unpacked(path: Path, length: int | None) -> bytes:
    """The text in a gzip file."""
    import gzip

    most = MOST_UNPACKED if length is None else length
    try:
        with gzip.open(path) as file:
            content = file.read(most + (length is None))
    except (EOFError, zlib.error, gzip.BadGzipFile) as fault:
        raise InputRefused(
            str(path),
            f"is compressed, and damaged or cut off: {fault}",
            "copy it again from the rig",
        ) from None
    if len(content) > most:
        raise InputRefused(
            str(path),
            f"is compressed, and holds more than {most >> 20} MB",
            "unpack it, and cut it into records on the rig",
        )
    return content


def sheet_of(path: Path) -> tuple[str, list[str]]:
    """The first sheet of a spreadsheet as CSV, and the names of all sheets."""
    import python_calamine

    try:
        book = python_calamine.load_workbook(str(path))
        rows: Sequence[Sequence[object]] = (
            book.get_sheet_by_index(0).to_python() if book.sheet_names else ()
        )
    except python_calamine.CalamineError as fault:
        raise InputRefused(
            str(path),
            f"cannot be read as a spreadsheet: {fault}",
            "save it again, or save the sheet as CSV",
        ) from None
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
