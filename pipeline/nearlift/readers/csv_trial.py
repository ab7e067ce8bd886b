"""CSV: one file per trial, columns by header name, commas between cells, points in decimals, UTF-8.

The header is the first line. Nothing is sniffed: the layout follows from it.
"""

from __future__ import annotations

import csv
import functools
from pathlib import Path

from nearlift.errors import InputRefused
from nearlift.readers import text
from nearlift.readers.channel import Contents, Names, RecordsDialect
from nearlift.readers.dialect import UNSTATED
from nearlift.readers.per_file import Format, reader_of
from nearlift.readers.table import Layout, no_nul
from nearlift.units import NUMBER


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of these names; `InputRefused` where the file is not plain CSV in UTF-8."""
    if names is None:
        return text.contents(path, {}, None)
    head, _ = text.head_of(path)
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputRefused(
            str(path), "is UTF-16 text", 'save it as UTF-8, or say reader = "text", which reads it'
        )
    header = head.replace(b"\r", b"\n").split(b"\n", 1)
    if head.strip(b"\0") and len(header) == 1:
        return Contents(channels=(), kind="CSV", codes=("NO_DATA", "truncated"))
    try:
        layout = _layout(header[0])
    except InputRefused as refusal:
        raise InputRefused(f"{path}, line 1", refusal.what, refusal.remedy) from None
    return text.from_text(path, UNSTATED, names, layout)


@functools.lru_cache(maxsize=8)
def _layout(header: bytes) -> Layout:
    """The layout under a header, found once for records that begin alike."""
    try:
        line = header.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputRefused("", "is not UTF-8 text", "save it as UTF-8") from None
    no_nul(line.rstrip("\0"), "")
    try:
        names = [name.strip() for name in next(csv.reader([line]), [])]
    except csv.Error as fault:
        raise InputRefused(
            "", f"is no header: {fault}", "the file is damaged, or of another dialect"
        ) from None
    if len(names) == 1 and any(sign in names[0] for sign in ";\t"):
        raise InputRefused(
            "",
            "is not separated by commas",
            'save it with commas between cells and points in decimals, or say reader = "text"',
        )
    if names and all(NUMBER.fullmatch(name) for name in names):
        raise InputRefused(
            "",
            "holds numbers where the columns' names should stand",
            'put a header line above the samples, or say reader = "text" and dialect = { columns ='
            " [...] }",
        )
    return Layout(names=tuple(names), units=("",) * len(names), first=2)


READER = reader_of(
    Format(
        name="csv",
        title="one CSV file per trial, columns by header name",
        recognises=lambda head, name: False,
        contents=contents,
    )
)
