"""Texts inside other files: packed by gzip, or the first sheet of a spreadsheet.

The file itself is what is digested. `readers.guarded` calls whatever opens such a file.
"""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING

from nearlift.errors import InputRefused

if TYPE_CHECKING:
    import python_calamine

GZIP = b"\x1f\x8b"
#: How spreadsheets begin, and the names that they have.
SHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
SHEET_NAMES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
MOST_BYTES = 1 << 30
#: Whole numbers up to here are exact.
EXACT = 2.0**53


def is_packed(path: Path) -> bool:
    """Whether a file has its text inside; False where it cannot be opened."""
    try:
        with path.open("rb") as file:
            head = file.read(4)
    except OSError:
        return False
    return head.startswith(GZIP) or is_sheet(head, path.name)


def is_sheet(head: bytes, name: str) -> bool:
    """Whether a file with these first bytes and this name is a spreadsheet."""
    return head.startswith(SHEETS) and name.casefold().endswith(SHEET_NAMES)


def opened(path: Path) -> IO[bytes]:
    """The file, or the text inside."""
    file = path.open("rb")
    head = file.peek(4)[:4]
    if is_sheet(head, path.name):
        file.close()
        return io.BytesIO(_as_csv(path))
    if not head.startswith(GZIP):
        return file
    return io.BufferedReader(_Unpacked(file, str(path)), 1 << 16)


def content(path: Path) -> bytes:
    """All bytes of the file, or of the text inside."""
    with opened(path) as file:
        return file.read()


class _Unpacked(io.RawIOBase):
    """The text in a gzip file, with gzip's complaints as refusals."""

    def __init__(self, file: IO[bytes], where: str) -> None:
        self._file, self._where, self._left = file, where, MOST_BYTES
        self._inner = gzip.GzipFile(fileobj=file)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        try:
            part = self._inner.read(len(buffer))
        except (EOFError, zlib.error, gzip.BadGzipFile) as fault:
            raise InputRefused(
                self._where,
                f"is compressed, and damaged or cut off: {fault}",
                "copy it anew from the rig",
            ) from None
        self._left -= len(part)
        if self._left < 0:
            raise InputRefused(
                self._where,
                f"is compressed, and holds more than {MOST_BYTES >> 20} MB",
                "unpack it, and cut it into records on the rig",
            )
        buffer[: len(part)] = part
        return len(part)

    def close(self) -> None:
        self._file.close()
        super().close()


def _book(path: Path) -> python_calamine.CalamineWorkbook:
    import python_calamine

    try:
        return python_calamine.load_workbook(str(path))
    except python_calamine.CalamineError as fault:
        raise _unreadable(path, fault) from None


def _unreadable(path: Path, fault: Exception) -> InputRefused:
    return InputRefused(
        str(path),
        f"cannot be read as a spreadsheet: {fault}",
        "save it again, or save the sheet as CSV",
    )


def sheet_names(path: Path) -> list[str]:
    """The names of the sheets of a spreadsheet."""
    return list(_book(path).sheet_names)


def _as_csv(path: Path) -> bytes:
    """The first sheet of a spreadsheet as CSV; rows and columns that are blank throughout above and
    left of the table are left out.
    """
    import python_calamine

    book = _book(path)
    if not book.sheet_names:
        raise InputRefused(str(path), "holds no sheet", "save the table as CSV")
    try:
        rows: Sequence[Sequence[object]] = book.get_sheet_by_index(0).to_python()
    except python_calamine.CalamineError as fault:
        raise _unreadable(path, fault) from None
    out = io.StringIO()
    write = csv.writer(out, lineterminator="\n")
    for row in rows:
        write.writerow([_text(cell) for cell in row])
    return out.getvalue().encode()


def _text(cell: object) -> str:
    """A cell as CSV has it: whole numbers without a point, times as in ISO 8601."""
    if isinstance(cell, bool):
        return str(cell).upper()
    if isinstance(cell, float):
        return str(int(cell)) if cell.is_integer() and abs(cell) < EXACT else repr(cell)
    if hasattr(cell, "isoformat"):
        return str(cell.isoformat())
    return " ".join(str(cell).split())
