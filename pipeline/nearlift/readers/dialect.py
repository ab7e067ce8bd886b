"""The dialect of a text file, found strictly: one layout fits, or the file is refused.

Each pair of separator and decimal sign is tried on the first lines. A pair fits if every line from
the first row of numbers on has the same number of cells. The cells are numeric where the
first one of the column is. The header has as many names. Two pairs that fit and read different
numbers are ambiguous, and so is a comma that may part thousands. Nothing is guessed that the
manifest states under ``[records] dialect``.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.base import Names, RecordsDialect, fitting, parted, split_unit, unit_word
from nearlift.readers.table import BLANKS, NONE, SEPARATORS, SPOKEN, Layout
from nearlift.units import NUMBER

#: Lines in which two dialects must read the same numbers, or the file is ambiguous.
READ = 20
#: Rows of numbers that settle a dialect, though a later line breaks it.
ROWS = 3
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
    anything. `labels`: cells are ``name: number``.
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


UNSTATED = Dialect()
#: Keys of ``[records] dialect``, and their types.
OPTIONS = {
    key.name: list if isinstance(key.default, tuple) else type(key.default)
    for key in fields(Dialect)
}


def given(stated: RecordsDialect) -> Dialect:
    """The manifest's dialect as the sniffer takes it; `ManifestError` of a value that cannot be."""
    options: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in stated.items()
        if key in OPTIONS
    }
    said = Dialect(**options)
    sign, encoding = said.thousands, said.encoding or "utf-8"
    is_sign = not sign or not (len(sign) > 1 or sign.isalnum() or sign in "+-")
    with contextlib.suppress(LookupError):
        encoding = codecs.lookup(encoding) and ""
    checks = [
        *(
            (key, not all(isinstance(item, str) for item in value), "holds more than texts")
            for key, value in options.items()
            if isinstance(value, tuple)
        ),
        ("units", len(said.units) not in (0, len(said.columns)), "has not one for each column"),
        ("decimal", said.decimal not in ("", ".", ","), 'is neither "." nor ","'),
        ("thousands", not is_sign, 'is no sign between thousands, as ",", "." or "\'"'),
        ("thousands", sign and sign == said.decimal, "is the decimal sign as well"),
        ("skip", said.skip < 0, "is negative"),
        ("encoding", encoding, 'is no encoding, as "utf-8", "utf-16" or "latin-1"'),
    ]
    for key, is_wrong, what in checks:
        if is_wrong:
            where = f"records.dialect.{key}"
            raise ManifestError(where, f"{stated[key]!r} {what}", "see docs/formats.md")
    return said


def encoding_of(head: bytes, where: str) -> str:
    """The encoding of a file's first bytes; `InputRefused` where they are no text, or packed."""
    for mark, name in _MARKS.items():
        if head.startswith(mark):
            return name
    if head.startswith(_PACKED):
        remedy = "unpack it: what is inside is then digested and read as it is"
        raise InputRefused(where, "is compressed", remedy)
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


class Unfit(InputRefused):
    """Refusal of one pair of signs, which could read `lines` lines (infinity: refused in any case).

    Of several refusals that with most lines is shown. A row without names has `columns` cells.
    """

    def __init__(
        self, lines: float, where: str, what: str, remedy: str = "", columns: int = 0
    ) -> None:
        super().__init__(where, what, remedy)
        self.lines, self.columns = lines, columns


class NoRows(Unfit):
    """A text without a single row of numbers."""


class NoNames(Unfit):
    """Rows of so many numbers, without names above them."""


def sniff(
    lines: Sequence[str], where: str, said: Dialect = UNSTATED, names: Names = None
) -> Layout:
    """The one layout that fits the first lines of a file.

    With `names`, other columns may hold anything in their later rows.

    Raises
    ------
    InputRefused
        No dialect fits, several do, or neither a header nor the manifest names the columns.
    """
    fits: list[tuple[Layout, object]] = []
    failed: list[Unfit] = []
    for strict in (True, False):
        for signs in _pairs(lines, said):
            try:
                fits.append(_fitted(lines, where, signs, said, names, strict=strict))
            except Unfit as unfit:
                failed.append(unfit)
        farthest = max((unfit.lines for unfit in failed), default=0)
        if fits or ROWS <= farthest < math.inf:
            # after so many rows a bad line is one, and no sign of another dialect
            break
    if not (fits or failed):
        what = "has one sign between cells and in numbers"
        raise InputRefused(where, what, "correct [records] dialect")
    if not fits:
        raise max(failed, key=lambda unfit: unfit.lines)
    # cut alike, numbers such as 0,5 go before texts
    best = [
        (layout, reading)
        for layout, reading in fits
        if not any(
            other.separator == layout.separator and set(other.texts) < set(layout.texts)
            for other, _ in fits
        )
    ]
    if len({reading for _, reading in best}) > 1:
        ways = " or ".join(
            f"{SPOKEN[a.separator]} with decimal {'point' if a.decimal == '.' else 'comma'}"
            for a, _ in best[:2]
        )
        what = f"can be read in two ways: separated by {ways}"
        remedy = 'say which: dialect = { separator = "...", decimal = "..." } under [records]'
        raise InputRefused(where, what, remedy)
    refuse_thousands(best[0][0], lines, where, said)
    return best[0][0]


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
        if decimal != said.thousands
        and not said.thousands == separator == BLANKS
        # in quotes a decimal comma parts no cells
        and (separator != decimal or any('"' in line for line in lines))
    ]


def refuse_thousands(layout: Layout, lines: Sequence[str], where: str, said: Dialect) -> None:
    """Refuse decimal commas that may part thousands: 1,234 everywhere, and never 0,5 or 12,34."""
    if layout.decimal == "." or said.decimal or said.thousands:
        return
    rows = (cell for line in lines[layout.first - 1 :] for cell in _cut(line, layout))
    cells = (parted(cell)[0] for cell in rows if "," in cell)
    cell = next(cells, "")
    if _THOUSANDS.fullmatch(cell) and all(map(_THOUSANDS.fullmatch, cells)):
        at, what = f"{where}, line {layout.first}", f"{cell!r} may be {cell.replace(',', '.')} or"
        remedy = 'dialect = { decimal = "," } under [records], or { thousands = "," }'
        raise InputRefused(at, f"{what} {cell.replace(',', '')}", f"say which: {remedy}")


def _cut(line: str, signs: Layout) -> list[str]:
    with contextlib.suppress(csv.Error):
        return signs.split(line)
    return [line]


def _fitted(
    lines: Sequence[str], where: str, signs: Layout, said: Dialect, wanted: Names, *, strict: bool
) -> tuple[Layout, object]:
    """The layout of some lines by one pair of signs, and what it reads: names and first numbers.

    `Unfit` if these signs do not fit. With `strict`, all cells of the first row must be numbers, or
    none.
    """
    start = _first_row(lines, where, signs, said.skip, strict)
    near = [_cut(line, signs) for line in lines[start - 1 : start + 2]] if start else []
    if len(near) == 3 and not said.columns and _merged(*near):
        # numbers of columns under a merged cell are no row
        start = _first_row(lines, where, signs, start + 1, strict)
    at, row = f"{where}, line {start + 1}", _cut(lines[start], signs)
    names, units, top = _header(lines, at, signs, said, start, row)
    more = len(row) - len(names)
    trailing = more if more > 0 and signs.separator.strip() and not any(row[-more:]) else 0
    if len(names) != len(row) - trailing:
        what = f"has {len(row) - trailing} cells under {len(names)} column names"
        remedy = f"name all: dialect = {{ skip = {start}, columns = [...] }} under [records]"
        if "," in lines[start]:
            remedy = "a decimal comma splits a cell: save with points, or semicolons between cells"
        raise Unfit(0, at, what, remedy)
    # a separator that cuts nothing, and one that is there and does not cut
    bare = re.sub(r"\([^()]*\)|\[[^\[\]]*\]|\"[^\"]*\"", "", names[0])
    uncut = signs.separator and len(names) < 2 and not (trailing or said.separator)
    if uncut or (signs.separator == NONE and not said.columns and re.search(r"[,;\t|]", bare)):
        raise Unfit(-2, where, "is one column" if uncut else "is not one column")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        what = f"has more than one column {twice[0]!r}"
        remedy = "rename or drop one of them, or name all: dialect = { columns = [...] } under"
        several = f"{remedy} [records]; several tables go into files of their own"
        raise Unfit(math.inf, f"{where}, line {top + 1}", what, several)
    texts = {i for i in range(len(names)) if signs.value(row[i]) is None}
    if texts and row[min(texts)].endswith(":"):
        what = f"labels its cells: {' '.join(row[min(texts) :][:2])!r}"
        remedy = "dialect = { labels = true } under [records], where every line has the same"
        raise Unfit(len(lines), at, what, f"such cells are read by {remedy}")
    layout = replace(signs, trailing=trailing, names=names, units=units, first=start + 1)
    # columns without a cell so far, which may be of words
    blank = {i for i in range(len(names)) if not row[i]}
    read: list[tuple[float, ...]] = []
    chosen: Sequence[int] = range(len(names))
    if wanted is not None:
        chosen = sorted({i for name in wanted for i in fitting(names, name)}) or chosen
    for k, line in enumerate(lines[start:], start):
        if not line.strip():
            continue
        at = f"{where}, line {k + 1}"
        try:
            cells = layout.row(line, at)
            texts |= {i for i in blank if signs.value(cells[i]) is None}
            blank = {i for i in blank if not cells[i]}
            numbers = [layout.number(cells[i], at, names[i]) for i in chosen if i not in texts]
        except InputRefused as bad:
            raise Unfit(k - start, bad.where, bad.what, bad.remedy) from None
        if len(read) < READ:
            read.append(tuple(0.5 if value != value else value for value in numbers))
    return replace(layout, texts=tuple(sorted(texts))), (names, tuple(read))


def _first_row(lines: Sequence[str], where: str, signs: Layout, skip: int, strict: bool) -> int:
    """Index of the first line that holds a number, or of words for "no number" right above it.

    If `strict`, the line holds no other words than units behind numbers.
    """

    def numbers(cells: Sequence[str], others: Sequence[str] = ()) -> list[float | None]:
        """The numbers of cells; with a unit, unless the one below has none or another."""
        read = []
        for cell, other in itertools.zip_longest(cells, others[: len(cells)], fillvalue=""):
            number, unit = parted(cell)
            below = signs.value(other) if unit else None
            alike = parted(other)[1] == unit or (below is not None and math.isnan(below))
            read.append(signs.value(number if alike else cell))
        return read

    def some(values: Sequence[float | None]) -> bool:
        return any(value is not None and value == value for value in values)

    last = [
        cells for cells in (_cut(x, signs) for x in lines[skip:][-READ:]) if some(numbers(cells))
    ]
    usual = max(lengths := [len(cells) for cells in last], key=lengths.count, default=0)
    first, cells = skip, list[str]()
    below = _cut(lines[skip], signs) if skip < len(lines) else []
    for at in range(skip, len(lines)):
        above, cells = cells, below
        below = _cut(lines[at + 1], signs) if at + 1 < len(lines) else cells
        values = numbers(cells, below)
        if some(values) and not (strict and None in values):
            # else a name and its value, or a value by itself, above the columns' names
            named = len(above) == len(cells) > 1 and set(numbers(above)) == {None}
            if named or usual in (0, len(cells)):
                return min(first, at)
        if None in values or not lines[at].strip():
            first = at + 1
    remedy = "see docs/formats.md; dialect = { ... } under [records] helps"
    raise NoRows(-1, where, "holds no row of numbers in any known dialect", remedy)


def _header(
    lines: Sequence[str], at: str, signs: Layout, said: Dialect, start: int, row: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Names and units of the columns, and the index of the line of names, or of the first row."""
    if said.columns:
        return said.columns, said.units or ("",) * len(said.columns), start
    above = [i for i in range(start - 1, -1, -1) if lines[i].strip()][:3]
    cut = [*(_cut(lines[i], signs) for i in above), [], [], []]
    # names over several columns, and their parts below
    merged = [_merged(cut[k + 1], cut[k], row) for k in (0, 1)]
    plain = [_names(lines[i], signs, row) for i in above[:2]] + [(), ()]
    lower, upper = (whole or names for whole, names in zip(merged, plain, strict=False))
    if upper and not merged[0]:
        # a row of units below that of names
        units = [_unit(cell) for cell in cut[0]][: len(upper)]
        if len(units) == len(upper) and None not in units and any(units):
            return upper, tuple(unit or "" for unit in units), above[1]
    if not lower:
        cells, more = f"{len(row)} cell{'s' * (len(row) > 1)}", ", ..." * (len(row) > 1)
        what = f"has no columns' names above its rows of {cells}"
        remedy = f'name them: dialect = {{ columns = ["force"{more}] }} under [records]'
        raise NoNames(1, at, what, remedy, len(row))
    return lower, tuple(split_unit(name)[1] for name in lower), above[0]


def _merged(over: Sequence[str], below: Sequence[str], row: Sequence[str]) -> tuple[str, ...]:
    """Names of columns from two lines, or none if the lines are no such names.

    Cells of `over` are merged, as ``Force,,``. Cells of `below` are names or numbers of columns:
    numbers that count from 1, or that are whole where the `row` after them has decimals.
    """
    whole = [next(filter(None, over[k::-1]), "") for k in range(len(over))]
    inside = [k for k, name in enumerate(whole) if name and "" in over[k : k + 2]]
    if not inside or not len(over) == len(below) == len(row):
        return ()
    parts = [below[k] for k in inside]
    if all(part.isdecimal() for part in parts):
        counts = [1 if over[k] else int(below[k - 1]) + 1 for k in inside]
        if counts != [*map(int, parts)] and any(row[k].isdecimal() for k in inside):
            return ()
    elif not (all(parts) and over[0] and sum(map(bool, over)) > 1) or (
        any(map(NUMBER.fullmatch, below)) or any(parted(row[k])[1] for k in inside)
    ):
        return ()
    names = []
    for k, (name, part) in enumerate(zip(whole, below, strict=True)):
        bare, unit = split_unit(name)
        if k in inside:
            names.append(f"{bare} {part}" + f" [{unit}]" * bool(unit))
        elif stated := unit_word(part):
            names.append(f"{name} [{stated}]")
        else:
            names.append(name if NUMBER.fullmatch(part) else f"{name} {part}".strip())
    return tuple(names)


def _unit(cell: str) -> str | None:
    """The unit in a cell of a row of units, which may be in brackets or blank; else None."""
    known = unit_word(cell)
    return cell.strip("[]() ") if known is None and re.match(r"[\[(].*[\])]$", cell) else known


def _names(line: str, signs: Layout, below: Sequence[str]) -> tuple[str, ...]:
    """The cells of a line if they may be names of the columns of a row, else none."""
    line = re.sub(r"^\s*(?:#|%|//)+\s*", "", line)
    if signs.separator == BLANKS:
        # units in brackets behind blanks
        line = re.sub(r"(?<=\S)[ \t]+(?=[\[(])", "", line)
    row = _cut(line, signs)
    while len(row) > 1 and row[-1] == "":
        row.pop()
    if len(row) == len(below) > 1 and not row[0]:
        # row numbers have no name in tables of pandas and R
        row[0] = "index"
    if any(NUMBER.fullmatch(parted(cell)[0]) for cell in row) or not all(row):
        return ()
    several = signs.separator.strip() and len(row) > 1
    # a separator at the end of each row, or a decimal comma
    one_more = not below[-1] or signs.separator == ","
    return tuple(row) if several or len(row) in (len(below), len(below) - one_more) else ()
