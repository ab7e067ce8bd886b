"""The dialect of a text file, found strictly: one reading fits, or the file is refused.

A dialect is an encoding, a separator, a decimal sign, lines above the header, a header, perhaps a
row of units, perhaps a separator at the end of every line. Each pair of separator and decimal sign
is tried on the first lines; a pair fits if every line from the first row of numbers on has the same
number of cells, numeric where the first row's are, under a header of as many names. What fits a
hundred lines alone is tried on the others of the first 64 kB; where it fails there, every pair is
tried on all of them. Two pairs that fit and read different numbers are ambiguous, and so is a comma
that may part thousands. What the manifest says under ``[records] dialect`` is not guessed.
"""

from __future__ import annotations

import codecs
import csv
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from nearlift.errors import InputRefused
from nearlift.readers import table
from nearlift.readers.channel import split_unit, unit_word
from nearlift.readers.layout import NAMED, SPOKEN, UNGIVEN, Given, Layout, encoding_of
from nearlift.readers.table import BLANKS, NONE, CellSyntax, cut_at, label, row_of, value_of
from nearlift.units import NUMBER

#: As many bytes as the sniffer looks at, and as many lines at first: whatever fits all of the bytes
#: fits those.
HEAD, SHORT = 1 << 16, 100
#: Rows in which two dialects must read the same numbers, or the file is ambiguous.
READ = 20
SEPARATORS = tuple(NAMED.values())
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")


class NoRows(InputRefused):
    """A text without a single row of numbers: nothing but a header, or nothing that is known."""


class NoNames(InputRefused):
    """Rows of numbers with no names above them; `columns` of them."""

    def __init__(self, where: str, what: str, remedy: str, columns: int) -> None:
        super().__init__(where, what, remedy)
        self.columns = columns


def sniff(head: bytes, where: str, given: Given = UNGIVEN, *, whole: bool = True) -> Layout:
    """The dialect of a file from its first bytes; `whole` if they are all of it. `InputRefused`
    where none fits, several do, or neither a header nor the manifest names the columns.
    """
    encoding = given.encoding or encoding_of(head, where)
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(head)
    except (UnicodeDecodeError, LookupError) as fault:
        raise InputRefused(
            where,
            f"is not {encoding} text: {fault}",
            "mend `encoding` under [records] dialect, or leave it out",
        ) from None
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    # what follows the last line feed may be cut off
    lines = lines[:-1] if len(lines) > 1 or not whole else lines
    if len(lines) > SHORT:
        try:
            layout = _fitting_dialect(lines[:SHORT], where, given)
        except InputRefused:
            # it may be another dialect's, and a refusal is to tell what is wrong with the whole
            pass
        else:
            if layout.first + READ <= SHORT and _reads(layout, lines, where):
                return replace(layout, encoding=encoding)
    return replace(_fitting_dialect(lines, where, given), encoding=encoding)


def _fitting_dialect(lines: Sequence[str], where: str, given: Given) -> Layout:
    """The one dialect that fits these lines, its encoding left open; raises as `sniff` does."""
    fits, failed = _tried(lines, where, given)
    readings = {reading for _, reading in fits}
    if not fits:
        raise max(failed, key=lambda f: f[0])[1]
    if len(readings) > 1:
        ways = " or ".join(
            f"{SPOKEN[c.cells.separator]} with decimal"
            f" {'point' if c.cells.decimal == '.' else 'comma'}"
            for c, _ in fits[:2]
        )
        raise InputRefused(
            where,
            f"can be read in two ways: separated by {ways}",
            'say which: dialect = { separator = "...", decimal = "..." } under [records]',
        )
    layout = fits[0][0]
    _no_thousands(layout, lines, where, given)
    return layout


def _reads(layout: Layout, lines: Sequence[str], where: str) -> bool:
    """Whether every line from the first row on has the layout's cells, and numbers where it has."""
    body = "\n".join([*lines[layout.first - 1 :], ""]).encode()
    try:
        table.read(body, where, layout.first, layout.names, layout.numeric, layout.cells)
    except InputRefused:
        return False
    return True


#: Names and numbers of the first rows: what two dialects must agree on.
Reading = tuple[tuple[str, ...], tuple[tuple[float | None, ...], ...]]


def _tried(
    lines: Sequence[str], where: str, given: Given
) -> tuple[list[tuple[Layout, Reading]], list[tuple[int, InputRefused]]]:
    """Every dialect that fits, and why each other does not, with how far it came."""
    fits: list[tuple[Layout, Reading]] = []
    failed: list[tuple[int, InputRefused]] = []
    said = given.separator
    wanted = SEPARATORS if said is None else (NAMED.get(said, said),)
    # those that stand nowhere cut nothing, all alike: the first speaks for them
    signs = [s for s in SEPARATORS if s not in (BLANKS, NONE)]
    absent = [s for s in signs if not any(s in line for line in lines)]
    separators = [s for s in wanted if s not in absent[1:]]
    decimals = (".", ",") if given.decimal is None else (given.decimal,)
    for strict in (True, False):
        for separator, decimal in itertools.product(separators, decimals):
            if separator == decimal:
                continue
            cells = CellSyntax(
                separator=separator, decimal=decimal, ignore=given.ignore, labels=given.labels
            )
            try:
                fits.append(_fit(lines, where, cells, given, strict=strict))
            except _Unfit as unfit:
                failed.append((unfit.lines, unfit.refusal))
        if fits:
            break
    return [fit for fit in fits if not any(_numbers_of(fit[0], other[0]) for other in fits)], failed


def _numbers_of(layout: Layout, other: Layout) -> bool:
    """Whether the other reads numbers where this one, cut alike, has texts, such as ``0,5``."""
    return layout.cells.separator == other.cells.separator and set(other.texts) < set(layout.texts)


class _Unfit(Exception):
    """A dialect does not fit: how many lines it went well, and what to say if no other fits."""

    def __init__(self, lines: int, refusal: InputRefused) -> None:
        super().__init__(lines)
        self.lines, self.refusal = lines, refusal


def _unfit(lines: int, where: str, what: str, remedy: str = "") -> _Unfit:
    return _Unfit(lines, InputRefused(where, what, remedy))


def _fit(
    lines: Sequence[str], where: str, cells: CellSyntax, given: Given, *, strict: bool
) -> tuple[Layout, Reading]:
    """The layout of a file read with these cells; `strict`: every cell of a row is a number."""
    start = _first_row(lines, cells, given, strict)
    if start is None:
        raise _Unfit(
            -1,
            NoRows(
                where,
                "holds no row of numbers in any dialect known",
                "see docs/formats.md; dialect = { ... } under [records] helps",
            ),
        )
    row = _cut(lines[start], cells)
    trailing = len(row) > 1 and row[-1] == "" and cells.separator not in (BLANKS, NONE)
    names, units, top = _header(lines, start, cells, given, row, trailing, where)
    if trailing and len(names) == len(row) - 1:
        cells = replace(cells, trailing=True)
    elif len(names) != len(row):
        raise _unfit(
            0,
            f"{where}, line {start + 1}",
            f"has {len(row)} cells under {len(names)} column names",
            "a decimal comma makes two cells of one where commas part cells; save it with"
            " decimal points, or parted by semicolons",
        )
    if cells.separator != NONE and len(names) < 2 and not cells.trailing:
        raise _unfit(-2, where, "is one column")
    if (
        not given.columns
        and cells.separator == NONE
        and re.search(r"[,;\t|]", re.sub(r"\([^()]*\)|\[[^\[\]]*\]|\"[^\"]*\"", "", names[0]))
    ):
        raise _unfit(-2, where, "is not one column")
    twice = sorted(n for n, k in Counter(names).items() if k > 1)
    if twice:
        raise _unfit(
            len(lines),
            f"{where}, line {top}",
            f"has more than one column {twice[0]!r}",
            "rename or drop one of them",
        )
    first = [_value(cell, cells) for cell in row[: len(names)]]
    texts = tuple(i for i, value in enumerate(first) if value is None)
    if texts and row[texts[0]].endswith(":") and len(row) > texts[0] + 1:
        # what the number beside it is differs from line to line
        said, below = row[texts[0]], "".join(lines[start + 1 : start + 2]).split(":")[0]
        raise _unfit(
            len(lines),
            f"{where}, line {start + 1}",
            f"labels its cells: {' '.join(row[texts[0] : texts[0] + 2])!r}",
            "such cells are read by dialect = { labels = true } under [records], where every"
            " line has the same"
            if texts[0] or f"{below.strip()}:" == said
            else cut_at(said),
        )
    reading: list[tuple[float | None, ...]] = []
    for at, line in enumerate(lines[start:], start):
        if cells.skips(line):
            continue
        place = f"{where}, line {at + 1}"
        try:
            parts = row_of(line, place, names, cells)
        except InputRefused as refusal:
            raise _Unfit(at - start, refusal) from None
        values = tuple(
            None if i in texts else value_of(cell, cells.decimal) for i, cell in enumerate(parts)
        )
        bad = next((i for i, value in enumerate(values) if value is None and i not in texts), None)
        if bad is not None:
            raise _unfit(
                at - start,
                place,
                f"{parts[bad]!r} in column {names[bad]!r} is not a number",
                cut_at(f"{mark[0]}:")
                if (mark := label(parts[bad])) and NUMBER.fullmatch(mark[1])
                else "mend the line, or say the dialect under [records]",
            )
        if len(reading) < READ:
            reading.append(tuple(0.5 if value != value else value for value in values))
    layout = Layout(
        encoding="",
        cells=cells,
        names=tuple(names),
        units=tuple(units),
        first=start + 1,
        preamble=tuple(line for line in lines[: top - 1] if not cells.skips(line)),
        texts=texts,
    )
    return layout, (tuple(names), tuple(reading))


def _cut(line: str, cells: CellSyntax) -> list[str]:
    try:
        return cells.split(line)
    except csv.Error:
        return [line]


def _value(cell: str, cells: CellSyntax) -> float | None:
    if cells.labels:
        pair = label(cell)
        return value_of(pair[1], cells.decimal) if pair and pair[1] else None
    return value_of(cell, cells.decimal)


def _first_row(lines: Sequence[str], cells: CellSyntax, given: Given, strict: bool) -> int | None:
    """Index of the first line that holds a number; `strict`: nothing else but words for none."""
    for at in range(given.skip or 0, len(lines)):
        line = lines[at]
        if cells.skips(line):
            continue
        row = _cut(line, cells)
        numbers = [_value(cell, cells) for cell in row]
        numeric = any(value is not None and value == value for value in numbers)
        if numeric and (not strict or None not in numbers):
            return at
    return None


def _header(
    lines: Sequence[str],
    start: int,
    cells: CellSyntax,
    given: Given,
    row: Sequence[str],
    trailing: bool,
    where: str,
) -> tuple[list[str], list[str], int]:
    """Names and units of the columns, and the line (from 1) at which names, else rows, begin."""
    if given.columns:
        return list(given.columns), list(given.units or [""] * len(given.columns)), start + 1
    if cells.labels:
        names = [pair[0] if (pair := label(cell)) else "" for cell in row]
        if not all(names):
            raise _unfit(
                0,
                f"{where}, line {start + 1}",
                f"has a cell without a label: {row[names.index('')]!r}",
                "mend the line, or say `skip`",
            )
        return names, [""] * len(names), start + 1
    above = [at for at in range(start - 1, -1, -1) if not cells.skips(lines[at])]
    heads = [_names(lines[at], cells, len(row), trailing) for at in above[:2]]
    if not heads or heads[0] is None:
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
    if (
        len(heads) > 1
        and heads[1] is not None
        and len(heads[1]) == len(heads[0])
        and all(unit_word(cell) is not None for cell in heads[0])
    ):
        return heads[1], [unit_word(cell) or "" for cell in heads[0]], above[1] + 1
    return heads[0], [split_unit(name)[1] for name in heads[0]], above[0] + 1


def _names(line: str, cells: CellSyntax, columns: int, trailing: bool) -> list[str] | None:
    """The line's cells if they may be names of so many columns."""
    row = _cut(re.sub(r"^\s*(?:#|%|//)+\s*", "", line), cells)
    if trailing and len(row) == columns and row[-1] == "":
        row = row[:-1]
    if any(NUMBER.fullmatch(cell) for cell in row) or not all(row):
        return None
    if len(row) not in (columns, columns - 1) and not (
        cells.separator not in (BLANKS, NONE) and len(row) > 1
    ):
        return None
    return row


def _no_thousands(layout: Layout, lines: Sequence[str], where: str, given: Given) -> None:
    """Refuse decimal commas that may part thousands: 1,234 everywhere, and never 0,5 or 12,34."""
    if layout.cells.decimal != "," or given.decimal is not None:
        return
    cells = [
        c
        for line in lines[layout.first - 1 :]
        if line.strip()
        for c in _cut(line, layout.cells)
        if "," in c
    ]
    if cells and all(_THOUSANDS.fullmatch(c) for c in cells):
        raise InputRefused(
            f"{where}, line {layout.first}",
            f"{cells[0]!r} may be {cells[0].replace(',', '.')} or {cells[0].replace(',', '')}",
            'say which: dialect = { decimal = "," } under [records], or save it without separators'
            " of thousands",
        )
