"""The dialect of a text file, found strictly: one layout fits, or the file is refused.

Each pair of separator and decimal sign is tried on the first lines. A pair fits if every line from
the first row of numbers on has the same number of cells, numeric where those of the first row are,
under a header of as many names. Two pairs that fit and read different numbers are ambiguous, and so
is a comma that may part thousands. Nothing is guessed that the manifest states under
``[records] dialect``.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from nearlift.errors import InputRefused
from nearlift.readers.base import split_unit, unit_word
from nearlift.readers.table import (
    BLANKS,
    NONE,
    SEPARATORS,
    SPOKEN,
    Layout,
    cut_at,
    label,
    number,
    parse,
    row_of,
)
from nearlift.units import NUMBER

#: Bytes that the sniffer sees, and lines that it tries first.
HEAD, SHORT = 1 << 16, 100
#: Lines of a refusal that goes before all others.
FARTHEST = 1 << 30
#: Rows in which two dialects must read the same numbers, or the file is ambiguous.
READ = 20
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_PACKED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """The dialect as far as the manifest states it, under ``[records] dialect``.

    `columns` and `units` name the cells of a file without a header. `skip` counts the lines above
    the header, or the first row. `ignore` lists whole lines that are no rows; ``*`` matches
    anything. `labels`: cells are ``name: number``. `lines` of one number each make a row.
    """

    encoding: str | None = None
    separator: str | None = None
    decimal: str | None = None
    thousands: str = ""
    skip: int | None = None
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    labels: bool = False
    lines: int = 1


UNSTATED = Dialect()


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


def encoding_of(head: bytes, where: str) -> str:
    """The encoding of a file's first bytes; `InputRefused` where they are no text, or packed."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    if head.startswith(_PACKED):
        raise InputRefused(
            where, "is compressed", "unpack it: what is inside is then digested and read as it is"
        )
    if b"\0" in head.rstrip(b"\0"):
        pairs = head[: len(head) // 2 * 2]
        for name, zeros in (("utf-16-le", pairs[1::2]), ("utf-16-be", pairs[0::2])):
            if zeros.count(0) > 0.9 * len(zeros):
                return name
        raise InputRefused(
            where,
            "is no text: it holds NUL bytes",
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


def sniff(head: bytes, where: str, said: Dialect = UNSTATED, *, whole: bool = True) -> Layout:
    """The layout of a file from its first bytes; `whole` if they are all of it.

    Raises
    ------
    InputRefused
        No dialect fits, several do, or neither a header nor the manifest names the columns.
    """
    encoding = said.encoding or encoding_of(head, where)
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(head)
    except (UnicodeDecodeError, LookupError) as fault:
        raise InputRefused(
            where,
            f"is not {encoding} text: {fault}",
            "correct `encoding` under [records] dialect, or leave it out",
        ) from None
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    # the line behind the last line feed may be cut off
    lines = lines[:-1] if len(lines) > 1 or not whole else lines
    return replace(_settled(lines, where, said), encoding=encoding)


def _settled(lines: Sequence[str], where: str, said: Dialect) -> Layout:
    """The layout of the first lines if it reads all of them, else the one that fits all."""
    if len(lines) > SHORT:
        with contextlib.suppress(InputRefused):
            layout = _fitting(lines[:SHORT], where, said)
            if layout.first + READ <= SHORT:
                body = "\n".join([*lines[layout.first - 1 :], ""]).encode()
                parse(body, where, layout, layout.first, layout.numeric)
                return layout
    return _fitting(lines, where, said)


#: Names and numbers of the first rows: two dialects must agree on them.
Reading = tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]


def _fitting(lines: Sequence[str], where: str, said: Dialect) -> Layout:
    """The one layout that fits these lines, its encoding left open; raises as `sniff` does."""
    fits: list[tuple[Layout, Reading]] = []
    failed: list[_Unfit] = []
    for strict in (True, False):
        for signs in _pairs(lines, said):
            try:
                fits.append(_fit(lines, where, signs, said, strict=strict))
            except _Unfit as unfit:
                failed.append(unfit)
        if fits:
            break
    else:
        raise max(failed, key=lambda unfit: unfit.lines).refusal
    fits = [fit for fit in fits if not any(_has_more_numbers(other[0], fit[0]) for other in fits)]
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
    if layout.decimal == "," and said.decimal is None and not said.thousands:
        _no_thousands(layout, lines, where)
    return layout


def _pairs(lines: Sequence[str], said: Dialect) -> list[Layout]:
    """The pairs of separator and decimal sign to try, as layouts without columns."""
    # signs that no line holds cut nothing, all alike: the first speaks for them
    signs = [s for s in SEPARATORS.values() if s not in (BLANKS, NONE)]
    absent = [s for s in signs if not any(s in line for line in lines)]
    separators = [s for s in SEPARATORS.values() if s not in absent[1:]]
    if said.separator is not None:
        separators = [SEPARATORS.get(said.separator, said.separator)]
    return [
        Layout(
            separator=separator,
            decimal=decimal,
            thousands=said.thousands,
            ignore=said.ignore,
            labels=said.labels,
        )
        for separator, decimal in itertools.product(
            separators,
            (".", ",") if said.decimal is None else (said.decimal,),
        )
        if separator != decimal
        and said.thousands != decimal
        and not (said.thousands == separator == BLANKS)
    ]


def _has_more_numbers(one: Layout, other: Layout) -> bool:
    """Whether a layout reads numbers where another, cut alike, has texts, such as ``0,5``."""
    return one.separator == other.separator and set(one.texts) < set(other.texts)


def _fit(
    lines: Sequence[str], where: str, signs: Layout, said: Dialect, *, strict: bool
) -> tuple[Layout, Reading]:
    """The layout by these signs; `strict`: every cell of the first row is a number, or none."""
    start = _first_row(lines, signs, said, strict)
    if start is None:
        raise _Unfit(
            -1,
            NoRows(
                where,
                "holds no row of numbers in any dialect known",
                "see docs/formats.md; dialect = { ... } under [records] helps",
            ),
        )
    row = _cut(lines[start], signs)
    trailing = len(row) > 1 and row[-1] == "" and signs.separator not in (BLANKS, NONE)
    names, units, top = _header(lines, start, signs, said, row, trailing, where)
    trailing = trailing and len(names) == len(row) - 1
    _see_names(names, len(row) - trailing, trailing, signs, said, where, (start + 1, top))
    layout = replace(
        signs,
        trailing=trailing,
        names=tuple(names),
        units=tuple(units),
        first=start + 1,
        preamble=tuple(line for line in lines[: top - 1] if not signs.skips(line)),
        texts=tuple(i for i in range(len(names)) if _value(row[i], signs) is None),
    )
    _no_label(layout, lines, row, where)
    reading: list[tuple[float, ...]] = []
    for at, line in enumerate(lines[start:], start):
        if layout.skips(line):
            continue
        place = f"{where}, line {at + 1}"
        try:
            cells = row_of(line, place, layout)
            values = [
                number(cells[i], place, layout.names[i], layout.decimal, layout.thousands)
                for i in layout.numeric
            ]
        except InputRefused as refusal:
            raise _Unfit(at - start, refusal) from None
        if len(reading) < READ:
            reading.append(tuple(0.5 if value != value else value for value in values))
    return layout, (tuple(names), tuple(reading))


def _see_names(
    names: Sequence[str],
    cells: int,
    trailing: bool,
    signs: Layout,
    said: Dialect,
    where: str,
    lines: tuple[int, int],
) -> None:
    """Raise `_Unfit` where the names are not those of so many cells; `lines` of row and header."""
    row, top = lines
    if len(names) != cells:
        raise _unfit(
            0,
            f"{where}, line {row}",
            f"has {cells} cells under {len(names)} column names",
            "a decimal comma makes two cells of one where commas part cells; save it with"
            " decimal points, or parted by semicolons",
        )
    if signs.separator != NONE and len(names) < 2 and not trailing:
        raise _unfit(-2, where, "is one column")
    bare = re.sub(r"\([^()]*\)|\[[^\[\]]*\]|\"[^\"]*\"", "", names[0])
    if signs.separator == NONE and not said.columns and re.search(r"[,;\t|]", bare):
        raise _unfit(-2, where, "is not one column")
    for name, count in sorted(Counter(names).items()):
        if count > 1 and not re.search(r"\w", name):
            raise _unfit(
                FARTHEST,
                f"{where}, line {top}",
                f"holds {name!r} where the columns' names should be",
                "name them: dialect = { columns = [...] } under [records]; if the file holds"
                " several tables, save each as a file of its own",
            )
        if count > 1:
            raise _unfit(
                FARTHEST,
                f"{where}, line {top}",
                f"has more than one column {name!r}",
                "rename or drop one of them",
            )


def _no_label(layout: Layout, lines: Sequence[str], row: Sequence[str], where: str) -> None:
    """Raise `_Unfit` where a text column is the label of the number in the next cell."""
    first = layout.texts[0] if layout.texts else 0
    if not layout.texts or not row[first].endswith(":") or len(row) == first + 1:
        return
    said = row[first]
    below = "".join(lines[layout.first : layout.first + 1]).split(":")[0]
    raise _unfit(
        len(lines),
        f"{where}, line {layout.first}",
        f"labels its cells: {' '.join(row[first : first + 2])!r}",
        "such cells are read by dialect = { labels = true } under [records], where every line has"
        " the same"
        if first or f"{below.strip()}:" == said
        else cut_at(said),
    )


def _cut(line: str, signs: Layout) -> list[str]:
    try:
        return signs.split(line)
    except csv.Error:
        return [line]


def _value(cell: str, signs: Layout) -> float | None:
    if not signs.labels:
        return signs.value(cell)
    pair = label(cell)
    return signs.value(pair[1]) if pair and pair[1] else None


def _first_row(lines: Sequence[str], signs: Layout, said: Dialect, strict: bool) -> int | None:
    """Index of the first line that holds a number; `strict`: and no other words."""
    for at in range(said.skip or 0, len(lines)):
        if signs.skips(lines[at]):
            continue
        numbers = [_value(cell, signs) for cell in _cut(lines[at], signs)]
        numeric = any(value is not None and value == value for value in numbers)
        if numeric and (not strict or None not in numbers):
            return at
    return None


def _header(
    lines: Sequence[str],
    start: int,
    signs: Layout,
    said: Dialect,
    row: Sequence[str],
    trailing: bool,
    where: str,
) -> tuple[list[str], list[str], int]:
    """Names and units of the columns, and the line (from 1) at which names, else rows, begin."""
    if said.columns:
        return list(said.columns), list(said.units or [""] * len(said.columns)), start + 1
    if signs.labels:
        names = [pair[0] if (pair := label(cell)) else "" for cell in row]
        if not all(names):
            raise _unfit(
                0,
                f"{where}, line {start + 1}",
                f"has a cell without a label: {row[names.index('')]!r}",
                "correct the line, or say `skip`",
            )
        return names, [""] * len(names), start + 1
    above = [at for at in range(start - 1, -1, -1) if not signs.skips(lines[at])][:2]
    heads = [_names(lines[at], signs, len(row), trailing) for at in above]
    if not heads or heads[0] is None:
        cells = f"{len(row)} cell{'s' * (len(row) > 1)}"
        raise _Unfit(
            1,
            NoNames(
                f"{where}, line {start + 1}",
                f"has no columns' names above its rows of {cells}",
                f'name them: dialect = {{ columns = ["force"{", ..." * (len(row) > 1)}] }} under'
                " [records]",
                len(row),
            ),
        )
    units = [unit_word(cell) for cell in heads[0]]
    if len(heads) > 1 and heads[1] and len(heads[1]) == len(heads[0]) and None not in units:
        return heads[1], [unit or "" for unit in units], above[1] + 1
    return heads[0], [split_unit(name)[1] for name in heads[0]], above[0] + 1


def _names(line: str, signs: Layout, columns: int, trailing: bool) -> list[str] | None:
    """The cells of a line if they may be names of so many columns."""
    row = _cut(re.sub(r"^\s*(?:#|%|//)+\s*", "", line), signs)
    if trailing and len(row) == columns and row[-1] == "":
        row = row[:-1]
    if any(NUMBER.fullmatch(cell) for cell in row) or not all(row):
        return None
    delimited = signs.separator not in (BLANKS, NONE) and len(row) > 1
    return row if delimited or len(row) in (columns, columns - 1) else None


def _no_thousands(layout: Layout, lines: Sequence[str], where: str) -> None:
    """Refuse decimal commas that may part thousands: 1,234 everywhere, and never 0,5 or 12,34."""
    cells = [
        cell
        for line in lines[layout.first - 1 :]
        if line.strip()
        for cell in _cut(line, layout)
        if "," in cell
    ]
    if cells and all(_THOUSANDS.fullmatch(cell) for cell in cells):
        raise InputRefused(
            f"{where}, line {layout.first}",
            f"{cells[0]!r} may be {cells[0].replace(',', '.')} or {cells[0].replace(',', '')}",
            'say which: dialect = { decimal = "," } under [records], or { thousands = "," }',
        )
