"""Delimited text, one file per trial.

It is in any usual dialect, plain CSV, a spreadsheet's first sheet, or numbers without a header by
recipe.

A file is first brought to UTF-8 with one row to a line (`plain`). The dialect of the first lines
holds for the whole file: a later line that breaks it is refused with its number. It is found once
for files that begin alike. A last line without its end is left out, and the record is called
truncated.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import fnmatch
import glob
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers import base
from nearlift.readers.clock import is_time, seconds_of, two_columns
from nearlift.readers.dialect import (
    OPTIONS,
    Dialect,
    NoRows,
    encoding_of,
    given,
    refuse_thousands,
    sniff,
)
from nearlift.readers.files import SHEET_NAMES, SHEETS, content_of, sheet_of
from nearlift.readers.table import CORRECT_LINE, Layout, Lines, parse

#: Bytes that the sniffer sees.
HEAD = 1 << 15
#: Layouts of earlier files, by dialect stated, encoding, and the bytes above the first row.
_earlier: dict[tuple[Dialect, str, bytes], Layout] = {}
MOST_KEPT = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Plain:
    """Whole lines of a text in UTF-8 with line feeds, one row to a line.

    `said` is the part of the dialect that is stated and not dealt with. `cut`: the end of a last
    line is missing.
    """

    body: bytes
    said: Dialect
    encoding: str
    cut: bool

    @property
    def lines(self) -> list[str]:
        """The lines that the sniffer sees."""
        head = self.body[:HEAD].rpartition(b"\n")[0].decode("utf-8", "replace")
        return head.split("\n") if self.body else []


def plain(content: bytes, where: str, said: Dialect) -> Plain:
    """A text without its marks of encoding, lines to ignore, and labels.

    `InputRefused` where it is no text, or its labels differ.
    """
    encoding = said.encoding or encoding_of(content[:HEAD], where)
    half = False
    if encoding not in ("utf-8", "utf-8-sig", "ascii"):
        decoder = codecs.getincrementaldecoder(encoding)()
        try:
            content = decoder.decode(content).encode()
        except UnicodeError as fault:
            what = f"is not {encoding} text: {fault}"
            remedy = "it is damaged, or `encoding` under [records] dialect is wrong"
            if not said.encoding:
                what = "is text, but not in UTF-8, UTF-16, Windows-1252 or Latin-1"
                remedy = 'state it under [records], such as dialect = { encoding = "shift_jis" }'
            raise InputRefused(where, what, remedy) from None
        # a part of a character of UTF-16 is left over
        half = bool(decoder.getstate()[0])
    content = content.removeprefix(codecs.BOM_UTF8)
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    # most texts are ASCII, which is seen ten times sooner
    if not content.isascii() and (minus := "\N{MINUS SIGN}".encode()) in content:
        content = content.replace(minus, b"-")
    if said.thousands == " ":
        # spreadsheets write blanks at which no line breaks
        for sign in "\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}":
            content = content.replace(sign.encode(), b" ")
    body = content[: content.rfind(b"\n") + 1]
    cut = half or bool(content[len(body) :].strip())
    if said.ignore or said.labels:
        lines = body.decode("utf-8", "replace").split("\n")[:-1]
        forms = [glob.escape(form).replace("[*]", "*") for form in said.ignore]
        for i, line in enumerate(lines):
            if any(fnmatch.fnmatchcase(line.strip(), form) for form in forms):
                lines[i] = ""
        if said.labels:
            lines, said = _without_labels(lines, where, said)
        body = "".join(f"{line}\n" for line in lines).encode()
    return Plain(body=body, said=said, encoding=encoding, cut=cut)


def _without_labels(lines: Sequence[str], where: str, said: Dialect) -> tuple[list[str], Dialect]:
    """Rows ``T: 0.01  C: 0.65`` as cells under the names of the first; refuses other labels."""
    names: tuple[str, ...] = ()
    rows = [""] * len(lines)
    for i, line in enumerate(lines[said.skip :], said.skip):
        if not line.strip():
            continue
        first, *parts = line.split(":")
        pairs = [re.split(r"[\s;|]+|,(?=\s|[^\W\d])", part.strip(), maxsplit=1) for part in parts]
        if not parts:
            remedy = f"lines above all others: skip = {i + 1} under [records] dialect"
            raise InputRefused(f"{where}, line {i + 1}", "has no label", remedy)
        if base.parted(parts[-1].strip())[1]:
            pairs[-1] = [parts[-1].strip()]
        labels = (first.strip(), *(pair[1].strip() for pair in pairs if len(pair) > 1))
        names = names or labels
        if labels != names or len(pairs) != len(names):
            what = f"is labelled {', '.join(labels)}, not {', '.join(names)}"
            raise InputRefused(f"{where}, line {i + 1}", what, CORRECT_LINE)
        rows[i] = "\t".join(pair[0] for pair in pairs)
    separator = "tab" if len(names) > 1 else "none"
    return rows, replace(said, columns=names or said.columns, units=(), separator=separator)


# ---- reading


def contents(path: Path, dialect: base.RecordsDialect, names: base.Names) -> base.Contents:
    """The channels of a text file; `InputRefused` where no dialect fits, or a line breaks it."""
    return from_text(content_of(path), str(path), given(dialect), names)


def csv_contents(path: Path, dialect: base.RecordsDialect, names: base.Names) -> base.Contents:
    """The columns of plain CSV: commas and decimal points."""
    try:
        return contents(path, {"separator": "comma", "decimal": "."}, names)
    except InputRefused:
        first = content_of(path, HEAD).split(b"\n", 1)[0]
        if b"," in first or not (b";" in first or b"\t" in first):
            raise
    remedy = 'save it with commas and decimal points, or say reader = "text"'
    raise InputRefused(f"{path}, line 1", "is not parted by commas", remedy)


def sheet_contents(path: Path, dialect: base.RecordsDialect, names: base.Names) -> base.Contents:
    """The columns of numbers of the first sheet, read as the table that it would be as CSV."""
    content, (sheet, *others) = sheet_of(path)
    columns = base.Contents()
    with contextlib.suppress(*([NoRows] if others else [])):
        said = given({"separator": "comma", **dialect})
        columns = from_text(content.encode(), str(path), said, names)
    if others and not columns.channels:
        listed = ", ".join(map(repr, others[:3]))
        what = f"has no rows of numbers in its first sheet, {sheet!r}; others are {listed}"
        raise InputRefused(str(path), what, "move the table to the first sheet")
    left_out = f"; {len(others)} more left out" if others else ""
    return replace(columns, kind=f"spreadsheet, sheet {sheet!r}{left_out}")


def from_text(content: bytes, where: str, said: Dialect, names: base.Names) -> base.Contents:
    """The channels of a text in a dialect known in part."""
    if not content[:HEAD].strip(b"\0"):
        return base.Contents(kind="text", codes=("EMPTY",))
    text = plain(content, where, said)
    for (stated, encoding, top), layout in list(_earlier.items()):
        known = (stated, encoding) == (text.said, text.encoding) and text.body.startswith(top)
        cells = _cells(text.body[len(top) : len(top) + HEAD], layout) if known else []
        # numbers in the same columns
        if any(cells) and all(
            (layout.value(cell) is None) == (i in layout.texts and cell != "")
            for i, cell in enumerate(cells)
        ):
            # this file may be of another dialect; if not, it is refused again
            with contextlib.suppress(InputRefused):
                if layout.decimal == ",":
                    refuse_thousands(layout, text.lines, where, text.said)
                return by_layout(text, layout, names, where)
    try:
        layout = sniff(text.lines, where, text.said, names)
    except NoRows:
        if text.body.count(b"\n") > 2:
            raise
        return base.Contents(kind="text", codes=("NO_DATA", *["truncated"] * text.cut))
    read = by_layout(text, layout, names, where)
    if len(_earlier) < MOST_KEPT:
        top = text.body.removesuffix(text.body.split(b"\n", layout.first - 1)[-1])
        _earlier[text.said, text.encoding, top] = layout
    return read


def _cells(rows: bytes, layout: Layout) -> list[str]:
    """The cells of the first line; none where a quote has no other half."""
    with contextlib.suppress(csv.Error):
        return layout.split(rows.split(b"\n", 1)[0].decode("utf-8", "replace"))
    return []


def by_layout(text: Plain, layout: Layout, names: base.Names, where: str) -> base.Contents:
    """The channels of a text in a known layout: those that `pick` may choose, or all.

    A column of times of day is read as seconds; notes name those that cannot be read.
    """
    body = text.body.split(b"\n", layout.first - 1)[-1]
    notes = [f"text read as {layout.spoken}"] * bool(layout.spoken)
    rows = Lines(body=body, where=where, line=layout.first)
    row = _cells(body[:HEAD].lstrip(b"\n"), layout)[: len(layout.names)]
    words = {i for i, cell in enumerate(row) if layout.value(cell) is None}
    spelled = {i for i in words if is_time(row[i]) or base.parted(row[i])[1]}
    if names is None:
        chosen = {*range(len(layout.names))} - ({*layout.texts} - spelled)
        notes += [
            f"column {name!r} is not read: {row[i]!r} is neither a number nor a time of day"
            for i, name in enumerate(layout.names)
            if i in words - spelled and (layout.units[i] or re.search(r"\d\D\d", row[i]))
        ]
        if text.encoding in ("latin-1", "cp1252") and not text.said.encoding:
            sure = "if letters are wrong, state `encoding` in dialect"
            notes.append(f"text read as {text.encoding}: {sure}")
    else:
        chosen = {i for name in names for i in base.fitting(layout.names, name)}
        if not chosen:
            channels = [base.Channel(name=name, values=np.empty(0)) for name in layout.names]
            place = f"{where}, line {max(layout.first - 1, 1)}"
            # refuses: none of them fits
            base.pick(channels, names[0], "records.force.column", place)
        for *pair, _ in two_columns(layout.names):
            places = {*map(layout.names.index, pair)}
            chosen |= places if places & chosen else set()
    numbers, others = sorted(chosen - spelled), sorted(chosen & spelled)
    arrays, texts = parse(rows, layout, numbers, others)
    columns = {i: (layout.units[i], values) for i, values in zip(numbers, arrays, strict=True)}
    for i, cells in zip(others, texts, strict=True):
        name, is_clock = layout.names[i], is_time(row[i])
        unit = "s" if is_clock else layout.units[i] or base.parted(row[i])[1]
        values, bad = seconds_of(cells) if is_clock else _measured(cells, layout, unit)
        if bad is None:
            columns[i] = unit, values
            if is_clock:
                notes.append(f"column {name!r} is a time of day: read as seconds from its first")
            continue
        line = [number for number, _ in rows][bad]
        kind = "time of day" if is_clock else f"number of {unit}"
        what = f"has {cells[bad]!r} in column {name!r}, no {kind}"
        if names is not None:
            raise InputRefused(f"{where}, line {line}", what, CORRECT_LINE)
        notes.append(f"column {name!r} is not read: line {line} {what}")
    return base.Contents(
        channels=tuple(
            base.Channel(name=layout.names[i], unit=unit, values=values)
            for i, (unit, values) in sorted(columns.items())
        ),
        kind="text" + (f": {layout.spoken}" if layout.spoken else ""),
        codes=("truncated",) if text.cut else (),
        notes=tuple(notes),
    )


def _measured(cells: Sequence[str], layout: Layout, unit: str) -> tuple[FloatArray, int | None]:
    """Numbers of cells such as ``0.123 N`` (n,), all in this unit or of no number; and the index of
    the first other one.
    """
    values = np.full(len(cells), np.nan)
    for i, cell in enumerate(cells):
        number, stated = base.parted(cell)
        value = layout.value(number)
        if value is None or (value == value and stated != unit):
            return values, i
        values[i] = value
    return values, None


def cells_of(
    content: bytes, where: str, dialect: base.RecordsDialect
) -> tuple[Layout, list[list[str]]]:
    """The layout of a text and the cells of its rows; `InputRefused` where no dialect fits."""
    text = plain(content, where, given(dialect))
    layout = sniff(text.lines, where, text.said)
    rows = text.body.decode("utf-8", "replace").split("\n")[layout.first - 1 :]
    kept = [(i, line) for i, line in enumerate(rows, layout.first) if line.strip()]
    return layout, [layout.row(line, f"{where}, line {i}") for i, line in kept]


def words_of(path: Path, dialect: base.RecordsDialect, column: str) -> list[str]:
    """The cells of one column of a text, a row each; `InputRefused` if it is not there."""
    layout, rows = cells_of(content_of(path), str(path), dialect)
    if column not in layout.names:
        known = ", ".join(map(repr, layout.names))
        what = f"has no column {column!r}"
        raise InputRefused(str(path), what, f"it has {known}; segments.column names it")
    place = layout.names.index(column)
    return [row[place] for row in rows]


TEXT = base.Reader(
    name="text",
    title=(
        "delimited text in any usual dialect, or headerless numbers by recipe; one file per trial"
    ),
    contents=contents,
    options=OPTIONS,
)
CSV = base.Reader(
    name="csv", title="one CSV file per trial, columns by header name", contents=csv_contents
)
SHEET = base.Reader(
    name="sheet",
    title="spreadsheet (xlsx, xls, ods): its first sheet; one file per trial",
    contents=sheet_contents,
    recognises=lambda head, name: head.startswith(SHEETS) and name.endswith(SHEET_NAMES),
    options={"skip": int, "columns": list, "units": list, "ignore": list},
    guarded=True,
)
