"""Delimited text: in any usual dialect, as plain CSV, as a spreadsheet's first sheet, or as numbers
without a header by recipe; one file per trial.

The dialect of the first bytes holds for the whole file: a later line that breaks it is refused with
its number. It is found once for files that begin alike. A last line without its end is left out,
and the record is called truncated.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.base import (
    SECONDS,
    Channel,
    Contents,
    Names,
    Reader,
    RecordsDialect,
    fold,
    pick,
    rate_of,
    split_unit,
    wanted,
)
from nearlift.readers.clock import is_time, seconds_of
from nearlift.readers.dialect import HEAD, UNSTATED, Dialect, NoRows, encoding_of, sniff
from nearlift.readers.files import content_of, is_sheet, sheet_of
from nearlift.readers.table import Layout, no_nul, parse, row_of, words
from nearlift.units import NUMBER

#: Longest line, and bytes that are parsed at once.
LONGEST_LINE = 8 << 20
OPTIONS = {
    "encoding": str,
    "separator": str,
    "decimal": str,
    "thousands": str,
    "skip": int,
    "columns": list,
    "units": list,
    "ignore": list,
    "labels": bool,
    "lines": int,
}
#: Layouts found so far, by the dialect stated and the bytes above the first row.
_found: dict[tuple[Dialect, bytes], Layout] = {}
MOST_FOUND = 8
#: Column of a file with one number to a line, as it is read first.
ONE_COLUMN = "value"
#: Rows from which on a clock is seen among them: noise grows through so many in one of 40,000.
MIN_CLOCK_ROWS = 8
#: Names of columns that hold times.
CALLED_TIME = ("time", "timestamp", "time of day", "datetime", "clock", "zeit", "uhrzeit")
CLOCKS = ("millis", "micros", "ms", "us", "t", "time", "tick")
_CORRECT = "correct the file, or take the record out of the schedule"


def given(dialect: RecordsDialect) -> Dialect:
    """The manifest's dialect as the sniffer takes it.

    Raises
    ------
    ManifestError
        A list holds more than texts, units are not as many as columns, a sign cannot be one, or
        `skip` is negative.
    """
    said: dict[str, Any] = {key: value for key, value in dialect.items() if key in OPTIONS}

    def refuse(key: str, what: str, remedy: str) -> ManifestError:
        return ManifestError(f"records.dialect.{key}", what, remedy)

    for key in ("columns", "units", "ignore"):
        if key in said and not all(isinstance(item, str) for item in said[key]):
            what = f"{said[key]!r} holds more than texts"
            raise refuse(key, what, 'write it as ["force", "t"]')
        said[key] = tuple(said.get(key, ()))
    columns, thousands = said["columns"], said.get("thousands", "")
    if said["units"] and len(said["units"]) != len(columns):
        what = f"names {len(said['units'])} units for {len(columns)} columns"
        raise refuse("units", what, 'one for each; "" for none')
    if said.get("decimal", ".") not in (".", ","):
        raise refuse("decimal", f"{said['decimal']!r} is no decimal sign", 'write "." or ","')
    if thousands and (len(thousands) > 1 or thousands.isalnum() or thousands in "+-"):
        what = f"{thousands!r} is no sign between thousands"
        raise refuse("thousands", what, 'write ",", ".", "\'" or " "')
    if thousands and thousands == said.get("decimal"):
        what = f"{thousands!r} is the decimal sign as well"
        raise refuse("thousands", what, "state another decimal sign")
    if said.get("lines", 1) != 1 and said["lines"] != len(columns):
        raise refuse(
            "lines",
            f"says {said['lines']} lines to a row, and columns names {len(columns)}",
            'a number to a line, one name for each: columns = ["force", "millis"], lines = 2',
        )
    if said.get("skip", 0) < 0:
        what = f"{said['skip']} is negative"
        raise refuse("skip", what, "it counts the lines above the columns' names")
    try:
        codecs.lookup(said.get("encoding", "utf-8"))
    except LookupError:
        what = f"{said['encoding']!r} is no encoding"
        raise refuse("encoding", what, 'such as "utf-8", "utf-16" or "latin-1"') from None
    return Dialect(**said)


# ---- reading


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a text file; `InputRefused` where no dialect fits, or a line breaks it."""
    return from_text(content_of(path), str(path), given(dialect), names)


def from_text(
    content: bytes, where: str, said: Dialect, names: Names, layout: Layout | None = None
) -> Contents:
    """The channels of a text in a dialect known in part (`said`) or in whole (`layout`)."""
    if said.lines > 1:
        return _parted(from_text(content, where, one_column(said), None), said, where)
    head = content[:HEAD]
    if not head.strip(b"\0"):
        return Contents(kind="text", codes=("EMPTY",))
    if layout is not None:
        return _read(content, layout, names, where)
    if (layout := _known(head, said, where)) is not None:
        try:
            return _read(content, layout, names, where)
        except InputRefused:
            # this file may be of another dialect; if not, it is refused again
            pass
    try:
        layout = layout_of(content, where, said)
    except NoRows:
        if head.count(b"\n") > 2 or len(content) > HEAD:
            raise
        codes = ("NO_DATA",) if head.endswith((b"\n", b"\r")) else ("NO_DATA", "truncated")
        return Contents(kind="text", codes=codes)
    file = _read(content, layout, names, where)
    _keep(head, said, layout)
    return file


def layout_of(content: bytes, where: str, said: Dialect) -> Layout:
    """The layout of a text, known in part; raises as `sniff` does."""
    head, whole = content[:HEAD], len(content) <= HEAD
    if whole and not head.startswith((b"\xff\xfe", b"\xfe\xff")) and b"\0\0\0" in head[-3:]:
        # the tail of a power cut
        head = head.rstrip(b"\0")
    return sniff(head, where, said, whole=whole)


def _known(head: bytes, said: Dialect, where: str) -> Layout | None:
    """The layout of an earlier file that began alike, with numbers in the same columns."""
    for (stated, top), layout in list(_found.items()):
        if stated == said and head.startswith(top) and encoding_of(head, where) == layout.encoding:
            row = head[len(top) :].split(b"\n", 1)[0].decode(layout.encoding, "replace")
            with contextlib.suppress(csv.Error):
                cells = layout.split(row.rstrip("\r"))
                texts = tuple(i for i, cell in enumerate(cells) if layout.value(cell) is None)
                if any(cells) and texts == layout.texts:
                    return layout
    return None


def _keep(head: bytes, said: Dialect, layout: Layout) -> None:
    """Keep the layout for files that begin alike; one with decimal commas is judged by each file,
    whose commas may part thousands.
    """
    above = head.split(b"\n", layout.first - 1)
    plain = layout.decimal == "." and not layout.labels and not layout.encoding.startswith("utf-16")
    if plain and len(above) == layout.first and len(_found) < MOST_FOUND:
        _found[said, head[: len(head) - len(above[-1])]] = layout


def _read(content: bytes, layout: Layout, names: Names, where: str) -> Contents:
    """The channels of a text in a known layout."""
    above, body, cut = _rows_of(content, layout, where)
    chosen, clocks, notes = _chosen(layout, names, where, _first_row(body, layout))
    held: list[list[FloatArray]] = [[np.empty(0)] for _ in chosen]
    cells: list[list[str]] = [[] for _ in clocks]
    for first, block in _blocks(body, layout.first, where):
        for parts, values in zip(held, parse(block, where, layout, first, chosen), strict=True):
            parts.append(values)
        for i, texts in zip(clocks, cells, strict=True):
            texts += words(block, where, layout, first, i)
    columns = {
        i: parts[1] if len(parts) == 2 else np.concatenate(parts)
        for i, parts in zip(chosen, held, strict=True)
    }
    for i, texts in zip(clocks, cells, strict=True):
        columns[i], bad = seconds_of(texts)
        if bad is not None and names is not None:
            raise InputRefused(
                where, f"has no time of day in column {layout.names[i]!r}, row {bad + 1}", _CORRECT
            )
        read = (
            "read as seconds from its first" if bad is None else f"not read: row {bad + 1} is none"
        )
        notes.append(f"column {layout.names[i]!r} is a time of day: {read}")
        if bad is not None:
            del columns[i]
    channels = tuple(
        Channel(
            name=layout.names[i],
            unit="s" if i in clocks else layout.units[i],
            values=columns[i],
        )
        for i in sorted(columns)
    )
    if len(layout.names) == 1 and layout.names != (ONE_COLUMN,) and chosen:
        _refuse_clock_between(columns[0], where, layout.first)
    marks = list(_marks(above, layout)) if layout.ignore else []
    if layout.ignore:
        known = 0 if marks and layout.skips(above[-1]) else len(marks)
        marks += _marks(body.decode("utf-8", "replace").split("\n"), layout)
        if names is not None or len(channels) == 1:
            _require_one_kind(channels[0], [row for row, _ in marks[known:]], where)
    spoken = layout.spoken()
    return Contents(
        channels=channels,
        kind="text" + (f": {spoken}" if spoken else ""),
        codes=("truncated",) if cut else (),
        notes=(*((f"text read as {spoken}",) if spoken else ()), *notes),
        marks=tuple(marks),
    )


def _rows_of(content: bytes, layout: Layout, where: str) -> tuple[list[str], bytes, bool]:
    """The lines above the first row, the whole lines from it on as UTF-8 with line feeds, and
    whether a last line without its end was left out.
    """
    half = False
    if layout.encoding not in ("utf-8", "utf-8-sig"):
        decoder = codecs.getincrementaldecoder(layout.encoding)()
        try:
            content = decoder.decode(content).encode()
        except UnicodeError as fault:
            raise InputRefused(
                where,
                f"is not {layout.encoding} text: {fault}",
                "the file is damaged or in another encoding",
            ) from None
        # a part of a character of UTF-16 is left over
        half = bool(decoder.getstate()[0])
    content = content.removeprefix(codecs.BOM_UTF8)
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    start, end = 0, content.rfind(b"\n") + 1
    for _ in range(layout.first - 1):
        start = content.find(b"\n", start) + 1 or end
    tail = content[end:]
    if len(tail) > LONGEST_LINE and tail.strip(b"\0"):
        raise _too_long(f"{where}, after line {content.count(10)}")
    above = content[:start].decode("utf-8", "replace").split("\n")[:-1]
    return above, content[start:end], half or bool(tail.strip()) or b"\0" in tail


def _blocks(body: bytes, first: int, where: str) -> Iterator[tuple[int, bytes]]:
    """Whole lines of some megabytes, each with the number of its first line."""
    start = 0
    while start < len(body):
        end = len(body)
        if end - start > LONGEST_LINE:
            end = body.rfind(b"\n", start, start + LONGEST_LINE) + 1
            if not end:
                raise _too_long(f"{where}, after line {first - 1}")
        yield first, body[start:end]
        first, start = first + body.count(b"\n", start, end), end


def _too_long(at: str) -> InputRefused:
    what = f"has a line of more than {LONGEST_LINE >> 20} MB"
    return InputRefused(at, what, "it is no table, or damaged")


def _marks(lines: Sequence[str], layout: Layout) -> Iterator[tuple[int, str]]:
    """The ignored lines, each with the count of rows above it."""
    rows = 0
    for line in map(str.strip, lines):
        if line and layout.skips(line):
            yield rows, line
        elif line:
            rows += 1


def _require_one_kind(channel: Channel, after: Sequence[int], where: str) -> None:
    """Refuse numbers behind ignored lines that are unlike those that follow them.

    A rig that writes THROTTLE, and its number on a line of its own, would otherwise have throttles
    among its forces.
    """
    places = sorted(set(after))
    parts = [p for p in np.split(channel.values, places)[1:] if len(p) > 3] if places else []
    ends = [(p[0], np.nanmin(p[1:]), np.nanmax(p[1:])) for p in parts if np.isfinite(p[1:]).any()]
    if len(ends) > 1 and all(
        x < low - (high - low) or x > high + (high - low) for x, low, high in ends
    ):
        first, low, high = ends[0]
        raise InputRefused(
            where,
            f"has a number of another kind behind every ignored line: {first:g}, then"
            f" {low:g} to {high:g} in {channel.name!r}",
            "take these lines out of the file, or write the number on the line that is ignored",
        )


def _first_row(body: bytes, layout: Layout) -> list[str]:
    """The cells of the first row; none where it is no row."""
    for line in body.split(b"\n", 20)[:20]:
        text = line.decode("utf-8", "replace")
        if not layout.skips(text):
            with contextlib.suppress(csv.Error):
                return layout.split(text)
            break
    return []


def _chosen(
    layout: Layout, names: Names, where: str, row: Sequence[str]
) -> tuple[list[int], list[int], list[str]]:
    """Indices of the columns of numbers to read, and of times of day, by the first row: those that
    `pick` may choose, or all. Notes name the times that cannot be read.
    """
    cells = row[: len(layout.names)]
    texts = [i for i, cell in enumerate(cells) if layout.value(cell) is None]
    clocks = [i for i in texts if is_time(row[i])] if not layout.labels else []
    if names is None:
        unread = [
            f"column {layout.names[i]!r} is not read: {row[i]!r} is no time of day that is known"
            for i in texts
            if i not in clocks
            and (
                re.search(r"\d:\d\d", row[i]) or fold(split_unit(layout.names[i])[0]) in CALLED_TIME
            )
        ]
        return layout.numeric, [i for i in clocks if i in layout.texts], unread
    columns = list(enumerate(layout.names))
    chosen: set[int] = set()
    for name in names:
        exact = {i for i, column in columns if column == name}
        chosen |= exact or {i for i, column in columns if wanted(column, (name,))}
    if not chosen:
        channels = [Channel(name=name, values=np.empty(0)) for name in layout.names]
        place = f"{where}, line {max(layout.first - 1, 1)}"
        # refuses: none of them fits
        pick(channels, names[0], "records.force.column", place)
    return sorted(chosen.difference(clocks)), sorted(chosen.intersection(clocks)), []


def words_of(path: Path, dialect: RecordsDialect, column: str) -> list[str]:
    """The cells of one column of a text, a row each; `InputRefused` if it is not there."""
    content, where = content_of(path), str(path)
    layout = layout_of(content, where, given(dialect))
    if column not in layout.names:
        raise InputRefused(
            where,
            f"has no column {column!r}",
            f"it has {', '.join(map(repr, layout.names))}; segments.by names it",
        )
    place = layout.names.index(column)
    body = _rows_of(content, layout, where)[1].decode("utf-8", "replace")
    return [
        row_of(line, f"{where}, line {number}", layout)[place]
        for number, line in enumerate(body.split("\n")[:-1], layout.first)
        if not layout.skips(line)
    ]


def with_rate(file: Contents) -> Contents:
    """The contents with the rate of the clock: the first channel called time, in s, ms or us."""
    called = ("t", "time", "x_value", "zeit")
    clocks = [
        c for c in file.channels if c.unit in SECONDS and split_unit(c.name)[0].casefold() in called
    ]
    if not clocks or len(clocks[0].values) < 3:
        return file
    rate = rate_of(SECONDS[clocks[0].unit] * clocks[0].values)
    return replace(file, channels=tuple(replace(c, rate_Hz=rate) for c in file.channels))


# ---- one number to a line


def one_column(said: Dialect) -> Dialect:
    """The dialect in which each line is a row."""
    return replace(said, columns=(ONE_COLUMN,), units=(), lines=1, separator="none")


def _parted(whole: Contents, said: Dialect, where: str) -> Contents:
    """The columns of a file that was read as one column: a value, then its millis.

    Raises
    ------
    InputRefused
        An ignored line is within a row, or a clock, by its name or its first numbers, does not
        only grow: a line is lost.
    """
    if not whole.channels:
        return whole
    values, k = whole.channels[0].values, said.lines
    rows = len(values) // k
    for number, line in whole.marks:
        if number % k:
            raise InputRefused(
                f"{where}, number {number + 1}",
                f"a row of {k} lines is broken by {line!r}",
                _CORRECT,
            )
    table = np.ascontiguousarray(values[: rows * k].reshape(rows, k).T)
    for name, column in zip(said.columns, table, strict=True):
        shown = len(column) > MIN_CLOCK_ROWS and _grows(column[:MIN_CLOCK_ROWS])
        if (name.casefold() in CLOCKS or shown) and not np.all(np.diff(column) > 0):
            row = int(np.argmin(np.diff(column) > 0)) + 1
            raise InputRefused(
                f"{where}, number {row * k + 1}",
                f"{name!r} only grew until there, and is {column[row]:g} after"
                f" {column[row - 1]:g}: a line is lost, or the clock was set back",
                _CORRECT,
            )
    return replace(
        whole,
        channels=tuple(
            Channel(name=name, unit=unit, values=column)
            for name, unit, column in zip(said.columns, said.units or [""] * k, table, strict=True)
        ),
        codes=whole.codes if rows * k == len(values) else (*whole.codes, "truncated"),
        notes=(*whole.notes, f"text read as {k} lines to a row"),
        marks=tuple((number // k, line) for number, line in whole.marks),
    )


def _refuse_clock_between(values: FloatArray, where: str, first: int) -> None:
    """Refuse one column, from line `first` on, of which every second number is a clock's, and the
    others are not.
    """
    for k in (0, 1):
        clock, other = values[k::2], values[1 - k :: 2]
        # the first few settle it for nearly every record
        if len(clock) < MIN_CLOCK_ROWS or not _grows(clock[:MIN_CLOCK_ROWS]):
            continue
        if _grows(clock) and not _grows(other) and not _grows(values):
            names = '"millis", "force"' if k == 0 else '"force", "millis"'
            raise InputRefused(
                f"{where}, line {first + k} and every second one",
                f"only grows, from {clock[0]:g} to {clock[-1]:g}: a clock between the values, and"
                " not a force",
                f"dialect = {{ columns = [{names}], lines = 2 }} under [records], and the reader is"
                ' "text"',
            )


def _grows(values: FloatArray) -> bool:
    """Whether whole numbers each exceed the one before."""
    rising: BoolArray = np.diff(values) > 0
    return bool(rising.all() and np.all(values == np.round(values)))


# ---- plain CSV


def csv_contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of these names; `InputRefused` where the file is not plain CSV in UTF-8."""
    if names is None:
        return contents(path, {}, None)
    content = content_of(path)
    head = content[:HEAD]
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputRefused(
            str(path), "is UTF-16 text", 'save it as UTF-8, or say reader = "text", which reads it'
        )
    header = head.replace(b"\r", b"\n").split(b"\n", 1)
    if head.strip(b"\0") and len(header) == 1:
        return Contents(kind="CSV", codes=("NO_DATA", "truncated"))
    try:
        layout = _csv_layout(header[0])
    except InputRefused as refusal:
        raise InputRefused(f"{path}, line 1", refusal.what, refusal.remedy) from None
    return from_text(content, str(path), UNSTATED, names, layout)


@functools.lru_cache(maxsize=8)
def _csv_layout(header: bytes) -> Layout:
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
            "holds numbers where the columns' names should be",
            'put a header line above the samples, or say reader = "text" and dialect = { columns ='
            " [...] }",
        )
    return Layout(names=tuple(names), units=("",) * len(names), first=2)


# ---- spreadsheets


def sheet_contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The columns of numbers of the first sheet, read as the table that it would be as CSV."""
    content, sheets = sheet_of(path)
    said = given({"separator": "comma" if "," in content else "none", **dialect})
    columns = from_text(content.encode(), str(path), said, names)
    left_out = f"; {len(sheets) - 1} more left out" if len(sheets) > 1 else ""
    return replace(columns, kind=f"spreadsheet, sheet {sheets[0]!r}{left_out}")


TEXT = Reader(
    name="text",
    title=(
        "delimited text in any usual dialect, or headerless numbers by recipe; one file per trial"
    ),
    contents=contents,
    options=OPTIONS,
)
CSV = Reader(
    name="csv", title="one CSV file per trial, columns by header name", contents=csv_contents
)
SHEET = Reader(
    name="sheet",
    title="spreadsheet (xlsx, xls, ods): its first sheet; one file per trial",
    contents=sheet_contents,
    recognises=is_sheet,
    options={"skip": int, "columns": list, "units": list, "ignore": list},
    guarded=True,
)
