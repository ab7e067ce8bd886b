"""Delimited text, one file per trial.

It is in any usual dialect, plain CSV, a spreadsheet's first sheet, or numbers without a header by
recipe.

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

import numpy as np

from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.base import (
    SECONDS,
    Channel,
    Contents,
    Names,
    Reader,
    RecordsDialect,
    fitting,
    fold,
    pick,
    rate_of,
    split_unit,
)
from nearlift.readers.clock import is_time, seconds_of
from nearlift.readers.dialect import (
    HEAD,
    OPTIONS,
    Dialect,
    NoRows,
    encoding_of,
    given,
    sniff,
)
from nearlift.readers.files import content_of, is_sheet, sheet_of
from nearlift.readers.table import Layout, Lines, parse, refuse_nul
from nearlift.units import NUMBER

#: Longest line, bytes.
LONGEST_LINE = 8 << 20
#: Layouts of earlier files, by the dialect stated and the bytes above the first row.
_earlier: dict[tuple[Dialect, bytes], Layout] = {}
MOST_KEPT = 8
#: Column of a file with one number to a line, as it is read first.
ONE_COLUMN = "value"
#: Lines from which on a clock is seen among them: noise grows through so many in one of 40,000.
MIN_CLOCK_ROWS = 8
#: Names of columns that hold times.
CALLED_TIME = ("time", "timestamp", "time of day", "datetime", "clock", "zeit", "uhrzeit")
CLOCKS = ("millis", "micros", "ms", "us", "t", "time", "tick")
_CORRECT = "correct the file, or take the record out of the schedule"


# ---- reading


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a text file; `InputRefused` where no dialect fits, or a line breaks it."""
    return from_text(content_of(path), str(path), given(dialect), names)


def from_text(content: bytes, where: str, said: Dialect, names: Names) -> Contents:
    """The channels of a text in a dialect known in part."""
    if said.lines > 1:
        one_column = replace(said, columns=(ONE_COLUMN,), units=(), lines=1, separator="none")
        return _parted(from_text(content, where, one_column, None), said, where)
    head = content[:HEAD]
    if not head.strip(b"\0"):
        return Contents(kind="text", codes=("EMPTY",))
    if (layout := _known(head, said, where)) is not None:
        # this file may be of another dialect; if not, it is refused again
        with contextlib.suppress(InputRefused):
            return by_layout(content, layout, names, where)
    try:
        layout = layout_of(content, where, said)
    except NoRows:
        if head.count(b"\n") > 2 or len(content) > HEAD:
            raise
        codes = ("NO_DATA",) if head.endswith((b"\n", b"\r")) else ("NO_DATA", "truncated")
        return Contents(kind="text", codes=codes)
    file = by_layout(content, layout, names, where)
    # decimal commas are judged in each file: they may part thousands
    above = head.split(b"\n", layout.first - 1)
    plain = layout.decimal == "." and not layout.labels and not layout.encoding.startswith("utf-16")
    if plain and len(above) == layout.first and len(_earlier) < MOST_KEPT:
        _earlier[said, head[: len(head) - len(above[-1])]] = layout
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
    for (stated, top), layout in list(_earlier.items()):
        if stated == said and head.startswith(top) and encoding_of(head, where) == layout.encoding:
            row = head[len(top) :].split(b"\n", 1)[0].decode(layout.encoding, "replace")
            with contextlib.suppress(csv.Error):
                cells = layout.split(row.rstrip("\r"))
                texts = tuple(i for i, cell in enumerate(cells) if layout.value(cell) is None)
                if any(cells) and texts == layout.texts:
                    return layout
    return None


def by_layout(content: bytes, layout: Layout, names: Names, where: str) -> Contents:
    """The channels of a text in a known layout."""
    above, rows, cut = _rows_of(content, layout, where)
    numbers, clocks, notes = _chosen(layout, names, rows)
    arrays, times = parse(rows, layout, numbers, clocks)
    columns = dict(zip(numbers, arrays, strict=True))
    units = dict(enumerate(layout.units))
    for i, cells in zip(clocks, times, strict=True):
        seconds, bad = seconds_of(cells)
        name, is_read = layout.names[i], "read as seconds from its first"
        if bad is None:
            columns[i], units[i] = seconds, "s"
        elif names is not None:
            what = f"has no time of day in column {name!r}, row {bad + 1}"
            raise InputRefused(where, what, _CORRECT)
        else:
            is_read = f"not read: row {bad + 1} is none"
        notes.append(f"column {name!r} is a time of day: {is_read}")
    channels = tuple(
        Channel(name=layout.names[i], unit=units[i], values=columns[i]) for i in sorted(columns)
    )
    if len(layout.names) == 1 and layout.names != (ONE_COLUMN,) and numbers:
        _refuse_clock_between(columns[0], where, layout.first)
    marks: list[tuple[int, str]] = []
    if layout.ignore:
        marks = [*_marks(above, layout)]
        known = 0 if marks and layout.skips(above[-1]) else len(marks)
        marks += _marks(rows.body.decode("utf-8", "replace").split("\n"), layout)
        if names is not None or len(channels) == 1:
            _require_one_kind(channels[0], [row for row, _ in marks[known:]], where)
    if layout.spoken:
        notes.insert(0, f"text read as {layout.spoken}")
    return Contents(
        channels=channels,
        kind="text" + (f": {layout.spoken}" if layout.spoken else ""),
        codes=("truncated",) if cut else (),
        notes=tuple(notes),
        marks=tuple(marks),
    )


def _rows_of(content: bytes, layout: Layout, where: str) -> tuple[list[str], Lines, bool]:
    """The lines above the first row, the whole lines from it on, and whether a last line without
    its end was left out.
    """
    half = False
    if layout.encoding not in ("utf-8", "utf-8-sig"):
        decoder = codecs.getincrementaldecoder(layout.encoding)()
        try:
            content = decoder.decode(content).encode()
        except UnicodeError as fault:
            what = f"is not {layout.encoding} text: {fault}"
            raise InputRefused(where, what, "the file is damaged or in another encoding") from None
        # a part of a character of UTF-16 is left over
        half = bool(decoder.getstate()[0])
    content = content.removeprefix(codecs.BOM_UTF8)
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    start, end = 0, content.rfind(b"\n") + 1
    for _ in range(layout.first - 1):
        start = content.find(b"\n", start) + 1 or end
    tail = content[end:]
    begin, length = 0, len(content.rstrip(b"\0"))
    while length - begin > LONGEST_LINE:
        # as many whole lines as fit
        last = content.rfind(b"\n", begin, begin + LONGEST_LINE + 1)
        if last < 0:
            what = f"has a line of more than {LONGEST_LINE >> 20} MB"
            passed = content.count(b"\n", 0, begin)
            raise InputRefused(f"{where}, after line {passed}", what, "it is no table, or damaged")
        begin = last + 1
    above = content[:start].decode("utf-8", "replace").split("\n")[:-1]
    rows = Lines(body=content[start:end], where=where, line=layout.first)
    return above, rows, half or bool(tail.strip()) or b"\0" in tail


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


def _chosen(layout: Layout, names: Names, rows: Lines) -> tuple[list[int], list[int], list[str]]:
    """Indices of the columns of numbers to read, and of times of day, by the first row: those that
    `pick` may choose, or all. Notes name the times that cannot be read.
    """
    top = (line.decode("utf-8", "replace") for line in rows.body.split(b"\n", 20)[:20])
    row: list[str] = []
    with contextlib.suppress(csv.Error):
        row = layout.split(next((line for line in top if not layout.skips(line)), ""))
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
    chosen = {i for name in names for i in fitting(layout.names, name)}
    if not chosen:
        channels = [Channel(name=name, values=np.empty(0)) for name in layout.names]
        place = f"{rows.where}, line {max(layout.first - 1, 1)}"
        # refuses: none of them fits
        pick(channels, names[0], "records.force.column", place)
    return sorted(chosen.difference(clocks)), sorted(chosen.intersection(clocks)), []


def words_of(path: Path, dialect: RecordsDialect, column: str) -> list[str]:
    """The cells of one column of a text, a row each; `InputRefused` if it is not there."""
    content, where = content_of(path), str(path)
    layout = layout_of(content, where, given(dialect))
    if column not in layout.names:
        known = ", ".join(map(repr, layout.names))
        raise InputRefused(
            where, f"has no column {column!r}", f"it has {known}; segments.by names it"
        )
    _, rows, _ = _rows_of(content, layout, where)
    return parse(rows, layout, (), (layout.names.index(column),))[1][0]


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


def _parted(whole: Contents, said: Dialect, where: str) -> Contents:
    """The columns of a file that was read as one column: a value, then its millis.

    Raises
    ------
    InputRefused
        An ignored line is within a row. Or a clock does not only grow: a line is lost. A clock is
        known by its name or its first numbers.
    """
    if not whole.channels:
        return whole
    values, k = whole.channels[0].values, said.lines
    rows = len(values) // k
    for number, line in whole.marks:
        if number % k:
            what = f"a row of {k} lines is broken by {line!r}"
            raise InputRefused(f"{where}, number {number + 1}", what, _CORRECT)
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
    """The columns of plain CSV in UTF-8; without names, in any dialect."""
    if names is None:
        return contents(path, {}, None)
    content = content_of(path)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputRefused(
            str(path), "is UTF-16 text", 'save it as UTF-8, or say reader = "text", which reads it'
        )
    head = content[:HEAD]
    header, *below = head.replace(b"\r", b"\n").split(b"\n", 1)
    if not head.strip(b"\0"):
        return Contents(kind="text", codes=("EMPTY",))
    if not below:
        return Contents(kind="CSV", codes=("NO_DATA", "truncated"))
    try:
        layout = _csv_layout(header)
    except InputRefused as refusal:
        raise InputRefused(f"{path}, line 1", refusal.what, refusal.remedy) from None
    return by_layout(content, layout, names, str(path))


@functools.lru_cache(maxsize=8)
def _csv_layout(header: bytes) -> Layout:
    """The layout under a header, found once for records that begin alike."""
    try:
        line = header.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputRefused("", "is not UTF-8 text", "save it as UTF-8") from None
    refuse_nul(line.rstrip("\0"), "")
    try:
        names = Layout().split(line)
    except csv.Error as fault:
        remedy = "the file is damaged, or of another dialect"
        raise InputRefused("", f"is no header: {fault}", remedy) from None
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
