"""Spreadsheets (xlsx, xls, ods): the first sheet is read as the table that it would be as CSV."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from nearlift.readers import packed, text
from nearlift.readers.channel import Contents, Names, RecordsDialect
from nearlift.readers.per_file import Format, reader_of


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The columns of numbers of the first sheet."""
    read = text.contents(path, {"separator": ",", **dialect}, names)
    first, *others = packed.sheet_names(path)
    left_out = f"; {len(others)} more left out" if others else ""
    return replace(read, kind=f"spreadsheet, sheet {first!r}{left_out}")


FORMAT = Format(
    name="sheet",
    title="spreadsheet (xlsx, xls, ods): its first sheet; one file per trial",
    recognises=packed.is_sheet,
    contents=contents,
    options={"skip": int, "columns": list, "units": list, "ignore": list},
    child=True,
)
READER = reader_of(FORMAT)
