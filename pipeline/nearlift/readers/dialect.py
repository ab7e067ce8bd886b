"""The dialect of a text file, found strictly: one layout fits, or the file is refused.

Each pair of separator and decimal sign is tried on the first lines. A pair fits if every line from
the first row of numbers on has the same number of cells. The cells are numeric where those of the
first row are. The header has as many names. Two pairs that fit and read different numbers are
ambiguous, and so is a comma that may part thousands. Nothing is guessed that the manifest states
under ``[records] dialect``.
"""

from __future__ import annotations

import codecs
import csv
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.base import RecordsDialect, split_unit, unit_word
from nearlift.readers.table import SEPARATORS, SPOKEN, Layout
from nearlift.units import NUMBER

#: Lines in which two dialects must read the same numbers, or the file is ambiguous.
READ = 20
#: Lines of a refusal that goes before all others.
FARTHEST = 1 << 30
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
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_PACKED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """The dialect as far as the manifest states it, under ``[records] dialect``.

    `columns` and `units` name the cells of a file without a header. `skip` counts the lines above
    the header, or the first row. `ignore` lists whole lines that are no rows; ``*`` matches
    anything. `labels`: cells are ``name: number``. `lines` of one number each make a row.
    """

    encoding: str = ""
    separator: str = ""
    decimal: str = ""
    thousands: str = ""
    skip: int = 0
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    labels: bool = False
    lines: int = 1


UNSTATED = Dialect()


def given(stated: RecordsDialect) -> Dialect:
    """The manifest's dialect as the sniffer takes it.

    Raises
    ------
    ManifestError
        A list holds more than texts, units are not as many as columns, a sign cannot be one, or
        `skip` is negative.
    """
    options: dict[str, Any] = {}
    for key in OPTIONS.keys() & stated.keys():
        value = stated[key]
        options[key] = tuple(value) if isinstance(value, list) else value
        if isinstance(value, list) and not all(isinstance(item, str) for item in value):
            raise _refusal(key, f"{value!r} holds more than texts", 'write it as ["force", "t"]')
    said = Dialect(**options)
    columns, units = len(said.columns), len(said.units)
    if units not in (0, columns):
        what = f"names {units} units for {columns} columns"
        raise _refusal("units", what, 'one for each; "" for none')
    if said.decimal not in ("", ".", ","):
        what = f"{said.decimal!r} is no decimal sign"
        raise _refusal("decimal", what, 'write "." or ","')
    if len(said.thousands) > 1 or said.thousands.isalnum() or said.thousands in ("+", "-"):
        what = f"{said.thousands!r} is no sign between thousands"
        raise _refusal("thousands", what, 'write ",", ".", "\'" or " "')
    if said.thousands and said.thousands == said.decimal:
        what = f"{said.thousands!r} is the decimal sign as well"
        raise _refusal("thousands", what, "state another decimal sign")
    if said.lines not in (1, columns):
        remedy = 'a number to a line, one name for each: columns = ["force", "millis"], lines = 2'
        what = f"says {said.lines} lines to a row, and columns names {columns}"
        raise _refusal("lines", what, remedy)
    if said.skip < 0:
        remedy = "it counts the lines above the columns' names"
        raise _refusal("skip", f"{said.skip} is negative", remedy)
    try:
        codecs.lookup(said.encoding or "utf-8")
    except LookupError:
        what = f"{said.encoding!r} is no encoding"
        raise _refusal("encoding", what, 'such as "utf-8", "utf-16" or "latin-1"') from None
    return said


def _refusal(key: str, what: str, remedy: str) -> ManifestError:
    return ManifestError(f"records.dialect.{key}", what, remedy)


def encoding_of(head: bytes, where: str) -> str:
    """The encoding of a file's first bytes; `InputRefused` where they are no text, or packed."""
    for mark, name in _MARKS.items():
        if head.startswith(mark):
            return name
    if head.startswith(_PACKED):
        raise InputRefused(
            where, "is compressed", "unpack it: what is inside is then digested and read as it is"
        )
    if b"\0" in (full := head.rstrip(b"\0")):
        pairs = head[: len(head) // 2 * 2]
        for name, zeros in (("utf-16-le", pairs[1::2]), ("utf-16-be", pairs[0::2])):
            if zeros.count(0) > 0.9 * len(zeros):
                return name
        line = full[: full.index(b"\0")].count(b"\n") + 1
        raise InputRefused(
            f"{where}, line {line}",
            "holds NUL bytes",
            "it is damaged, or binary of a format that is not read: docs/formats.md lists those"
            " that are; export it as text",
        )
    try:
        # a character may be cut at the end of the head
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        # the bytes 0x80 to 0x9f are control characters in Latin-1 and letters in Windows-1252
        return "cp1252" if any(0x80 <= byte < 0xA0 for byte in head) else "latin-1"
    return "utf-8"


# ---- the layout that fits


class NoRows(InputRefused):
    """A text without a single row of numbers."""


class NoNames(InputRefused):
    """Rows of so many numbers, without names above them."""

    def __init__(self, where: str, what: str, remedy: str, columns: int) -> None:
        super().__init__(where, what, remedy)
        self.columns = columns


class _Unfit(Exception):
    """The refusal of one pair of signs, and how many lines it read."""

    def __init__(self, lines: int, refusal: InputRefused) -> None:
        super().__init__(lines)
        self.lines, self.refusal = lines, refusal


def _unfit(lines: int, where: str, what: str, remedy: str = "") -> _Unfit:
    return _Unfit(lines, InputRefused(where, what, remedy))


def sniff(lines: Sequence[str], where: str, said: Dialect = UNSTATED) -> Layout:
    """The one layout that fits the first lines of a file.

    Raises
    ------
    InputRefused
        No dialect fits, several do, or neither a header nor the manifest names the columns.
    """
    fits: list[tuple[Layout, object]] = []
    failed: list[_Unfit] = []
    for strict in (True, False):
        for signs in _pairs(lines, said):
            try:
                fits.append(_fitted(lines, where, signs, said, strict=strict))
            except _Unfit as unfit:
                failed.append(unfit)
        if fits:
            break
    else:
        raise max(failed, key=lambda unfit: unfit.lines).refusal
    # cut alike, numbers such as 0,5 go before texts
    fits = [
        (layout, reading)
        for layout, reading in fits
        if not any(
            other.separator == layout.separator and set(other.texts) < set(layout.texts)
            for other, _ in fits
        )
    ]
    if len({reading for _, reading in fits}) > 1:
        ways = " or ".join(
            f"{SPOKEN[layout.separator]} with decimal"
            f" {'point' if layout.decimal == '.' else 'comma'}"
            for layout, _ in fits[:2]
        )
        raise InputRefused(
            where,
            f"can be read in two ways: separated by {ways}",
            'say which: dialect = { separator = "...", decimal = "..." } under [records]',
        )
    layout = fits[0][0]
    if layout.decimal == "," and not said.decimal and not said.thousands:
        _refuse_thousands(layout, lines, where)
    return layout


def _pairs(lines: Sequence[str], said: Dialect) -> list[Layout]:
    """The pairs of separator and decimal sign to try, as layouts without columns."""
    # signs that no line holds cut nothing, all alike: the first speaks for them
    absent = [s for s in SEPARATORS.values() if s.strip(" ") and not any(s in x for x in lines)]
    separators = [s for s in SEPARATORS.values() if s not in absent[1:]]
    if said.separator:
        separators = [SEPARATORS.get(said.separator, said.separator)]
    return [
        Layout(thousands=said.thousands, separator=separator, decimal=decimal)
        for separator, decimal in itertools.product(separators, said.decimal or (".", ","))
        if separator != decimal != said.thousands and not said.thousands == separator == " "
    ]


def _refuse_thousands(layout: Layout, lines: Sequence[str], where: str) -> None:
    """Refuse decimal commas that may part thousands: 1,234 everywhere, and never 0,5 or 12,34."""
    rows = (cell for line in lines[layout.first - 1 :] for cell in _cut(line, layout))
    cells = [cell for cell in rows if "," in cell]
    if cells and all(_THOUSANDS.fullmatch(cell) for cell in cells):
        raise InputRefused(
            f"{where}, line {layout.first}",
            f"{cells[0]!r} may be {cells[0].replace(',', '.')} or {cells[0].replace(',', '')}",
            'say which: dialect = { decimal = "," } under [records], or { thousands = "," }',
        )


def _cut(line: str, signs: Layout) -> list[str]:
    try:
        return signs.split(line)
    except csv.Error:
        return [line]


def _fitted(
    lines: Sequence[str], where: str, signs: Layout, said: Dialect, *, strict: bool
) -> tuple[Layout, object]:
    """The layout of some lines by one pair of signs, and what it reads: names and first numbers.

    `_Unfit` where they are not of it. `strict`: every cell of the first row is a number, or none.
    """
    start = _first_row(lines, where, signs, said.skip, strict)
    row = _cut(lines[start], signs)
    names, units, top = _header(lines, where, signs, said, start, row)
    trailing = 1 < len(row) == len(names) + 1 and row[-1] == "" and signs.separator.strip() != ""
    _check_names(names, len(row) - trailing, f"{where}, line {start + 1}", signs, said, trailing)
    _refuse_repeated(names, f"{where}, line {top + 1}")
    texts = tuple(i for i in range(len(names)) if signs.value(row[i]) is None)
    if texts and row[texts[0]].endswith(":"):
        raise _unfit(
            len(lines),
            f"{where}, line {start + 1}",
            f"labels its cells: {' '.join(row[texts[0] : texts[0] + 2])!r}",
            "such cells are read by dialect = { labels = true } under [records], where every line"
            " has the same",
        )
    layout = replace(
        signs,
        trailing=trailing,
        names=names,
        units=units,
        first=start + 1,
        preamble=sum(line.strip() != "" for line in lines[:top]),
        texts=texts,
    )
    read: list[tuple[float, ...]] = []
    for at, line in enumerate(lines[start:], start):
        if not line.strip():
            continue
        place = f"{where}, line {at + 1}"
        try:
            cells = layout.row(line, place)
            values = [layout.number(cells[i], place, names[i]) for i in layout.numeric]
        except InputRefused as refusal:
            raise _Unfit(at - start, refusal) from None
        if len(read) < READ:
            read.append(tuple(0.5 if value != value else value for value in values))
    return layout, (names, tuple(read))


def _first_row(lines: Sequence[str], where: str, signs: Layout, skip: int, strict: bool) -> int:
    """Index of the first line that holds a number, or of words for "no number" right above it;
    `strict`: and no other words.
    """
    first = skip
    for at in range(skip, len(lines)):
        numbers = [signs.value(cell) for cell in _cut(lines[at], signs)]
        numeric = any(value is not None and value == value for value in numbers)
        if numeric and (not strict or None not in numbers):
            return min(first, at)
        if None in numbers or not lines[at].strip():
            first = at + 1
    what = "holds no row of numbers in any dialect known"
    remedy = "see docs/formats.md; dialect = { ... } under [records] helps"
    raise _Unfit(-1, NoRows(where, what, remedy))


def _header(
    lines: Sequence[str], where: str, signs: Layout, said: Dialect, start: int, row: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Names and units of the columns, and the index of the line of names, or of the first row."""
    if said.columns:
        return said.columns, said.units or ("",) * len(said.columns), start
    above = [i for i in range(start - 1, -1, -1) if lines[i].strip()][:2]
    heads = [_names(lines[i], signs, len(row)) for i in above]
    if len(heads) > 1 and heads[1]:
        # a row of units below that of names
        units = [_unit(cell) for cell in _cut(lines[above[0]], signs)][: len(heads[1])]
        if len(units) == len(heads[1]) and None not in units and any(units):
            return heads[1], tuple(unit or "" for unit in units), above[1]
    if len(heads) > 1 and heads[0]:
        # names over several columns, and their parts below
        upper = _cut(lines[above[1]], signs)
        if len(upper) == len(heads[0]) > sum(map(bool, upper)) > 1 and upper[0]:
            wide = list(upper)
            for k in range(1, len(wide)):
                wide[k] = wide[k] or wide[k - 1]
            names = tuple(f"{a} {b}" for a, b in zip(wide, heads[0], strict=True))
            return names, tuple(split_unit(name)[1] for name in names), above[1]
    if not heads or not heads[0]:
        raise _Unfit(
            1,
            NoNames(
                f"{where}, line {start + 1}",
                f"has no columns' names above its rows of {len(row)} cell{'s' * (len(row) > 1)}",
                f'name them: dialect = {{ columns = ["force"{", ..." * (len(row) > 1)}] }} under'
                " [records]",
                len(row),
            ),
        )
    return heads[0], tuple(split_unit(name)[1] for name in heads[0]), above[0]


def _unit(cell: str) -> str | None:
    """The unit in a cell of a row of units, which may be in brackets or blank; else None."""
    known = unit_word(cell)
    return cell.strip("[]() ") if known is None and re.match(r"[\[(].*[\])]$", cell) else known


def _names(line: str, signs: Layout, columns: int) -> tuple[str, ...]:
    """The cells of a line if they may be names of so many columns, else none."""
    row = _cut(re.sub(r"^\s*(?:#|%|//)+\s*", "", line), signs)
    row = row[:-1] if len(row) > 1 and row[-1] == "" else row
    if any(NUMBER.fullmatch(cell) for cell in row) or not all(row):
        return ()
    several = signs.separator.strip() and len(row) > 1
    return tuple(row) if several or len(row) in (columns, columns - 1) else ()


def _check_names(
    names: Sequence[str], cells: int, at: str, signs: Layout, said: Dialect, trailing: bool
) -> None:
    """Raise `_Unfit` where the names are not those of so many cells."""
    if len(names) != cells:
        raise _unfit(
            0,
            at,
            f"has {cells} cells under {len(names)} column names",
            "a decimal comma makes two cells of one where commas part cells; save it with"
            " decimal points, or parted by semicolons",
        )
    where = at.rpartition(", line ")[0]
    if signs.separator and len(names) < 2 and not (trailing or said.separator):
        raise _unfit(-2, where, "is one column")
    bare = re.sub(r"\([^()]*\)|\[[^\[\]]*\]|\"[^\"]*\"", "", names[0])
    if not (signs.separator or said.columns) and re.search(r"[,;\t|]", bare):
        raise _unfit(-2, where, "is not one column")


def _refuse_repeated(names: Sequence[str], at: str) -> None:
    """Raise `_Unfit` where two columns have one name."""
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice and re.search(r"\w", twice[0]):
        what = f"has more than one column {twice[0]!r}"
        raise _unfit(FARTHEST, at, what, "rename or drop one of them")
    if twice:
        raise _unfit(
            FARTHEST,
            at,
            f"holds {twice[0]!r} where the columns' names should be",
            "name them: dialect = { columns = [...] } under [records]; if the file holds"
            " several tables, save each as a file of its own",
        )
