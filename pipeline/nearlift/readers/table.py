"""Rows of a text table as numbers, by one strict layout.

Every line has one cell for each column name. Every wanted cell is a number, or a word that loggers
write for "no number". pyarrow parses; where it refuses, Python's csv reads line by line and names
the first bad line. Both give the bits of Python's `float`.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.units import NUMBER

#: Runs of blanks and tabs as the separator, and no separator: the line is one cell.
BLANKS, NONE = " ", ""
#: Names of separators in a manifest, in the order in which they are tried.
SEPARATORS = {
    "tab": "\t",
    "semicolon": ";",
    "comma": ",",
    "bar": "|",
    "blank": BLANKS,
    "none": NONE,
}
#: Separators in a sentence.
SPOKEN = {sign: f"{name}s" for name, sign in SEPARATORS.items()} | {NONE: "line ends"}
#: Words of loggers for "no number", in lower case.
NO_NUMBER = re.compile(
    r"(?:[-+]?(?:nan|inf)|over|ovf?l|o\.?l|#nv|#?n/a|na|null|-?1\.#(?:inf|qnan|ind)|err(?:or)?|--+)?"
)
#: The usual spellings of these words, for pyarrow; it knows nan and inf itself.
_WORDS = [
    spelling
    for word in (
        *("over", "ovfl", "ovl", "o.l", "ol", "#nv", "n/a", "#n/a", "na", "null"),
        *(f"{sign}1.#{kind}" for sign in ("", "-") for kind in ("inf", "qnan", "ind")),
    )
    for spelling in (word, word.upper(), word.capitalize())
]
#: Whole part in groups of three digits, with `_` between them, and the rest of the number.
GROUPED = re.compile(r"([-+]?\d{1,3}(?:_\d{3})+)((?:[.e].*)?)")
CORRECT_LINE = "correct the line, or take the trial out of the schedule"


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The complete dialect of a text table.

    `separator` is one character, `BLANKS` or `NONE`. `decimal` is the sign ``.`` or ``,``, and
    `thousands` the sign between thousands, if any. `trailing` counts the separators at the end of
    every line. `names` and `units` are the columns', and `texts` the indices of those of words.
    `first` is the line of the first row, from 1.
    """

    separator: str = ","
    decimal: str = "."
    thousands: str = ""
    trailing: int = 0
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    first: int = 1
    texts: tuple[int, ...] = ()

    def split(self, line: str) -> list[str]:
        """The cells of one line without the blanks around them. `csv.Error` where a quote has no
        other half.
        """
        if self.separator == NONE:
            return [line.strip()]
        if self.separator == BLANKS:
            return line.split()
        # an odd quote begins a cell with a line break in it, or means inches
        halved = line.count('"') % 2 == 1
        cells = next(csv.reader([line], delimiter=self.separator, strict=halved), [])
        return [cell.strip() for cell in cells]

    def value(self, cell: str) -> float | None:
        """The number of a cell; NaN for a word that means "no number", None where it is neither."""
        plain = cell.strip().lower()
        if self.thousands and "_" not in plain:
            point = plain.replace(self.thousands, "_").replace(self.decimal, ".")
            if groups := GROUPED.fullmatch(point):
                plain = groups[1].replace("_", "") + groups[2].replace(".", self.decimal)
        if NO_NUMBER.fullmatch(plain):
            return math.nan
        if self.decimal == ",":
            # a point would part thousands, or belong to another dialect: neither is a number here
            plain = "?" if "." in plain else plain.replace(",", ".")
        if not NUMBER.fullmatch(plain):
            return None
        return value if math.isfinite(value := float(plain)) else math.nan

    def number(self, cell: str, at: str, column: str) -> float:
        """The number of a cell, NaN for "no number"; `InputRefused` of anything else."""
        if (value := self.value(cell)) is None:
            remedy = (
                f'{CORRECT_LINE}; other signs: reader = "text" with dialect = {{ decimal = "...",'
                ' thousands = "..." } under [records]'
            )
            raise InputRefused(at, f"{cell!r} in column {column!r} is not a number", remedy)
        return value

    def row(self, line: str, at: str) -> list[str]:
        """The cells of one line, one for each column; `InputRefused` of any other line."""
        if "\0" in line:
            # a power cut leaves them behind
            remedy = "the file is damaged; copy it again, or take the trial out of the schedule"
            raise InputRefused(at, "holds NUL bytes", remedy)
        try:
            row = self.split(line)
        except csv.Error as fault:
            raise InputRefused(at, f"is not a row of cells: {fault}", CORRECT_LINE) from None
        count = len(self.names)
        if len(row) == count + self.trailing and not any(row[count:]):
            row = row[:count]
        if row == list(self.names):
            what = "repeats the header: two records are in one file"
            raise InputRefused(at, what, "give each trial a file of its own")
        if len(row) != count:
            line_begin = json.dumps(line.strip()[:40], ensure_ascii=False)
            remedy = (
                f"{CORRECT_LINE}; lines that the rig writes between rows are left out by reader ="
                f' "text" with dialect = {{ ignore = [{line_begin}] }} under [records]; a second'
                " table goes into a file of its own"
            )
            raise InputRefused(at, f"has {len(row)} cells under {count} column names", remedy)
        return row

    @property
    def spoken(self) -> str:
        """The dialect in words; empty for plain CSV."""
        parts = []
        if self.separator not in (",", NONE):
            parts.append(f"separated by {SPOKEN.get(self.separator, repr(self.separator))}")
        if self.decimal == ",":
            parts.append("decimal commas")
        if self.thousands:
            parts.append(f"{self.thousands!r} between thousands")
        return ", ".join(parts)


# ---- columns


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Whole lines of a text as UTF-8 with line feeds; `line` is that of the first in the file."""

    body: bytes
    where: str
    line: int

    def __iter__(self) -> Iterator[tuple[int, str]]:
        """The lines that are not blank, with their numbers; `InputRefused` of one that is no
        UTF-8.
        """
        try:
            text = io.StringIO(self.body.decode("utf-8"), newline="\n")
        except UnicodeDecodeError as fault:
            bad = self.body.count(b"\n", 0, fault.start) + self.line
            remedy = "the file is damaged or in another encoding; save it as UTF-8"
            raise InputRefused(f"{self.where}, line {bad}", "is not UTF-8 text", remedy) from None
        for number, line in enumerate(text, start=self.line):
            if line.strip():
                yield number, line.rstrip("\r\n")


#: Some columns of numbers, each (n,), and some of texts.
Columns = tuple[list[FloatArray], list[list[str]]]


def parse(
    rows: Lines, layout: Layout, numbers: Sequence[int], texts: Sequence[int] = ()
) -> Columns:
    """The columns of these indices, as numbers and as texts, by pyarrow where it reads every line.

    Raises
    ------
    InputRefused
        A line has too few or too many cells or holds NUL. Or a cell of `numbers` is no number, or
        the bytes are no UTF-8. The refusal names the line.
    """
    import pyarrow as pa
    import pyarrow.csv as pc

    if layout.thousands or b"\0" in rows.body:
        return by_line(rows, layout, numbers, texts)
    body, separator, quotes = rows.body, layout.separator, rows.body.count(b'"')
    if separator == BLANKS:
        cells = (filter(None, line.split(b" ")) for line in body.replace(b"\t", b" ").split(b"\n"))
        body, separator, quotes = b"\n".join(map(b"\t".join, cells)), "\t", 0
    elif separator == NONE:
        # a character that no text holds
        separator, quotes = "\x1f", 0
    names = [str(i) for i in range(len(layout.names) + layout.trailing)]
    kinds = dict.fromkeys([names[i] for i in numbers], pa.float64())
    kinds |= dict.fromkeys([names[i] for i in texts], pa.string())
    # the cells behind the last name must be blank in every row
    kinds |= dict.fromkeys(names[len(layout.names) :], pa.null())
    # looking each cell up among the words takes a fifth of the time, and most files have none
    for known_words in [[]] if layout.trailing else [[], _WORDS]:
        with contextlib.suppress(pa.ArrowInvalid, UnicodeDecodeError):
            # `read_csv` reads ahead in a thread, which two processes on two processors wait for
            table = pc.open_csv(
                pa.BufferReader(body),
                pc.ReadOptions(column_names=names, use_threads=False, block_size=1 << 20),
                pc.ParseOptions(delimiter=separator, quote_char='"' if quotes else False),
                pc.ConvertOptions(
                    include_columns=list(kinds),
                    column_types=kinds,
                    null_values=["", *known_words],
                    check_utf8=False,
                    decimal_point=layout.decimal,
                ),
            ).read_all()
            words = [[str(c or "").strip() for c in table[str(i)].to_pylist()] for i in texts]
            break
    else:
        return by_line(rows, layout, numbers, texts)
    # a quote without its other half may swallow lines
    if quotes:
        lines_of_text = sum(map(bool, map(bytes.strip, body.split(b"\n"))))
        if quotes % 2 or table.num_rows != lines_of_text:
            return by_line(rows, layout, numbers, texts)
    arrays = [floats(table[str(i)].combine_chunks()) for i in numbers]
    return [
        values if (finite := np.isfinite(values)).all() else np.where(finite, values, np.nan)
        for values in arrays
    ], words


def floats(column: Any) -> FloatArray:
    """A numeric Arrow array as float64, null as NaN; whole numbers beyond 2^53 are rounded.

    By DLPack: Arrow's own `to_numpy` imports pandas (0.3 s).
    """
    import pyarrow as pa

    # `pyarrow.compute` takes long to load, and most columns need none of it
    values = column if column.type == pa.float64() else column.cast("float64", safe=False)
    if values.null_count:
        import pyarrow.compute as pc

        # from bytes: `pa.scalar` and `pa.array` would import pandas as well
        nan = pa.Array.from_buffers(pa.float64(), 1, [None, pa.py_buffer(np.array([np.nan]))])
        values = pc.fill_null(values, nan[0])
    return np.asarray(np.from_dlpack(values), dtype=np.float64)


def by_line(
    rows: Lines, layout: Layout, numbers: Sequence[int], texts: Sequence[int] = ()
) -> Columns:
    """The columns by Python's csv, so that the first bad line is named."""
    arrays = [array("d") for _ in numbers]
    words: list[list[str]] = [[] for _ in texts]
    for number, line in rows:
        at = f"{rows.where}, line {number}"
        row = layout.row(line, at)
        for values, i in zip(arrays, numbers, strict=True):
            values.append(layout.number(row[i], at, layout.names[i]))
        for cells, i in zip(words, texts, strict=True):
            cells.append(row[i])
    return [np.array(values) for values in arrays], words
