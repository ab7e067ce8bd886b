"""Rows of a text table as numbers, by one strict layout.

Every line has one cell for each column name. Every wanted cell is a number, or a word that loggers
write for "no number". pyarrow parses; where it refuses, Python's csv reads line by line and names
the first bad line. Both give the bits of Python's `float`.
"""

from __future__ import annotations

import contextlib
import csv
import fnmatch
import glob
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.units import NUMBER

if TYPE_CHECKING:
    import pyarrow as pa

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
    r"(?:[-+]?(?:nan|inf)|over|ovf?l|o\.?l|#nv|#?n/a|na|null|-?1\.#(?:inf|qnan|ind))?"
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
_DAMAGED = "the file is damaged; copy it again from the rig, or take the trial out of the schedule"


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The complete dialect of a text table.

    Attributes
    ----------
    separator : str
        One character, `BLANKS` or `NONE`.
    decimal, thousands : str
        The decimal sign, ``.`` or ``,``; the sign between thousands, if any.
    trailing : bool
        Every line ends with a separator, so that a blank cell follows the last.
    ignore : tuple of str
        Whole lines (such as START) that are no rows; ``*`` matches anything.
    labels : bool
        Cells are ``name: number``, with the same names on every line.
    names, units : tuple of str
        The columns.
    first : int
        Line of the first row, from 1.
    preamble : tuple of str
        Lines above the column names.
    texts : tuple of int
        Indices of the columns that hold text.
    """

    encoding: str = "utf-8"
    separator: str = ","
    decimal: str = "."
    thousands: str = ""
    trailing: bool = False
    ignore: tuple[str, ...] = ()
    labels: bool = False
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    first: int = 1
    preamble: tuple[str, ...] = ()
    texts: tuple[int, ...] = ()

    @property
    def numeric(self) -> list[int]:
        """Indices of the columns of numbers."""
        return [i for i in range(len(self.names)) if i not in self.texts]

    def skips(self, line: str) -> bool:
        """Whether a line is no row: it is blank, or to be ignored."""
        plain = line.strip()
        return not plain or any(matches(form, plain) for form in self.ignore)

    def split(self, line: str) -> list[str]:
        """The cells of one line without the blanks around them; labels are kept."""
        if self.separator == NONE:
            return [line.strip()]
        if self.separator == BLANKS:
            return line.split()
        # an odd quote begins a cell with a line break in it, or means inches
        halved = line.count('"') % 2 == 1
        cells = next(csv.reader([line], delimiter=self.separator, strict=halved), [])
        return [cell.strip() for cell in cells]

    def value(self, cell: str) -> float | None:
        """The number of a cell, as `value_of` gives it."""
        return value_of(cell, self.decimal, self.thousands)

    def spoken(self) -> str:
        """The dialect in words; empty for plain CSV."""
        parts = []
        if self.encoding not in ("utf-8", "ascii"):
            names = {"utf-8-sig": "UTF-8 with a byte order mark", "cp1252": "Windows-1252"}
            parts.append(names.get(self.encoding, self.encoding.upper()))
        if self.separator not in (",", NONE):
            parts.append(f"separated by {SPOKEN.get(self.separator, repr(self.separator))}")
        if self.decimal == ",":
            parts.append("decimal commas")
        if self.thousands:
            parts.append(f"{self.thousands!r} between thousands")
        if self.trailing:
            parts.append("a separator at the end of every line")
        if self.labels:
            parts.append("labelled cells")
        if self.preamble:
            lines = f"{len(self.preamble)} line{'s' * (len(self.preamble) > 1)}"
            parts.append(f"{lines} above the columns' names left out")
        return ", ".join(parts)


def matches(form: str, line: str) -> bool:
    """Whether a line has this form, in which ``*`` matches anything."""
    return fnmatch.fnmatchcase(line, glob.escape(form).replace("[*]", "*"))


#: Whole part in groups of three digits, with `_` between them, and the rest of the number.
GROUPED = re.compile(r"([-+]?\d{1,3}(?:_\d{3})+)((?:[.eE].*)?)")


def _ungrouped(text: str, decimal: str, thousands: str) -> str:
    """A number without its thousands separators; other texts as they are."""
    if "_" in text or thousands not in text:
        return text
    groups = GROUPED.fullmatch(text.replace(thousands, "_").replace(decimal, "."))
    return groups[1].replace("_", "") + groups[2].replace(".", decimal) if groups else text


def value_of(text: str, decimal: str = ".", thousands: str = "") -> float | None:
    """The number of a cell; NaN for a word that means "no number", None where it is neither."""
    plain = text.strip()
    if NO_NUMBER.fullmatch(plain.lower()):
        return math.nan
    if thousands:
        plain = _ungrouped(plain, decimal, thousands)
    if decimal == ",":
        # a point would part thousands, or belong to another dialect: neither is a number here
        if "." in plain or plain.count(",") > 1:
            return None
        plain = plain.replace(",", ".")
        if NO_NUMBER.fullmatch(plain.lower()):
            return math.nan
    if not NUMBER.fullmatch(plain):
        return None
    value = float(plain)
    return value if math.isfinite(value) else math.nan


def number(text: str, at: str, column: str, decimal: str = ".", thousands: str = "") -> float:
    """The number of a cell, NaN for "no number"; `InputRefused` of anything else."""
    value = value_of(text, decimal, thousands)
    if value is not None:
        return value
    remedy = "every cell must be a number; correct the line, or take the trial out of the schedule"
    if re.fullmatch(r"[-+]?\d+[.,]\d+", text):
        remedy = f"write decimals with a {'point' if decimal == '.' else 'comma'}"
    elif re.fullmatch(r"[-+]?\d{1,3}([,.' ])\d{3}(\1\d{3})*([.,]\d*)?", text):
        sign = re.sub(r"[-+\d]", "", text)[0]
        remedy = (
            f'if {sign!r} parts thousands: reader = "text" with dialect = {{ thousands ='
            f' "{sign}" }} under [records]'
        )
    elif (pair := label(text)) and NUMBER.fullmatch(pair[1]):
        remedy = cut_at(f"{pair[0]}:")
    raise InputRefused(at, f"{text!r} in column {column!r} is not a number", remedy)


def label(cell: str) -> tuple[str, str] | None:
    """Name and number of a cell ``T: 0.01``; None where it is not of that form."""
    name, colon, rest = cell.partition(":")
    return (name.strip(), rest.strip()) if colon and len(rest.split()) <= 1 else None


def no_nul(line: str, at: str) -> None:
    """Refuse a line with NUL bytes, which a power cut leaves behind."""
    if "\0" in line:
        raise InputRefused(at, "holds NUL bytes", _DAMAGED)


def parse(
    body: bytes, where: str, layout: Layout, first: int, wanted: Sequence[int]
) -> list[FloatArray]:
    """The wanted columns of some rows.

    Parameters
    ----------
    body : bytes
        UTF-8 text of whole lines, each with a line feed at its end.
    first : int
        Line of the file at which `body` begins.
    wanted : sequence of int
        Indices of the columns, each once.

    Raises
    ------
    InputRefused
        A line has too few or too many cells or holds NUL, a wanted cell is no number, or the bytes
        are no UTF-8. The refusal names the line.
    """
    columns = None if b"\0" in body else _by_arrow(body, layout, wanted)
    return _line_by_line(body, where, layout, first, wanted) if columns is None else columns


def words(body: bytes, where: str, layout: Layout, first: int, place: int) -> list[str]:
    """The cells of one column as texts; arguments and refusals as for `parse`."""
    table = None if b"\0" in body else _arrow_table(body, layout, [place], "string")
    if table is not None:
        with contextlib.suppress(UnicodeDecodeError):
            return [str(cell or "") for cell in table.column(0).to_pylist()]
    lines = enumerate(body.decode("utf-8", "replace").split("\n"), start=first)
    return [
        row_of(line.rstrip("\r"), f"{where}, line {number}", layout)[place]
        for number, line in lines
        if not layout.skips(line)
    ]


def _by_arrow(body: bytes, layout: Layout, wanted: Sequence[int]) -> list[FloatArray] | None:
    """The columns by pyarrow; None where it does not read every line."""
    table = _arrow_table(body, layout, wanted, "double")
    if table is None:
        return None
    arrays = [floats(table[f"c{i}"].combine_chunks()) for i in wanted]
    return [np.where(np.isfinite(values), values, np.nan) for values in arrays]


def _arrow_table(
    body: bytes, layout: Layout, wanted: Sequence[int], kind: Literal["double", "string"]
) -> pa.Table | None:
    """The wanted columns as pyarrow reads them; None where it does not read every line."""
    import pyarrow as pa
    import pyarrow.csv as pc

    if layout.labels or layout.thousands:
        return None
    if layout.ignore:
        try:
            lines = body.decode().splitlines(keepends=True)
        except UnicodeDecodeError:
            return None
        body = "".join(line for line in lines if not layout.skips(line)).encode()
    separator, quote = layout.separator, '"'
    if separator == BLANKS:
        cells = (filter(None, line.split(b" ")) for line in body.replace(b"\t", b" ").split(b"\n"))
        body, separator, quote = b"\n".join(map(b"\t".join, cells)), "\t", ""
    elif separator == NONE:
        # a character that no text holds
        separator, quote = "\x1f", ""
    names = [f"c{i}" for i in range(len(layout.names))]
    chosen = [names[i] for i in wanted]
    # the blank cell behind the last separator must be blank in every row
    phantom = ["blank"] if layout.trailing else []
    try:
        table = pc.read_csv(
            pa.BufferReader(body),
            read_options=pc.ReadOptions(
                column_names=names + phantom,
                use_threads=False,
                block_size=max(1 << 20, len(body) + 1),
            ),
            parse_options=pc.ParseOptions(delimiter=separator, quote_char=quote or False),
            convert_options=pc.ConvertOptions(
                include_columns=chosen + phantom,
                column_types={
                    **dict.fromkeys(chosen, pa.type_for_alias(kind)),
                    **dict.fromkeys(phantom, pa.null()),
                },
                null_values=[""] if phantom else ["", *_WORDS],
                check_utf8=False,
                decimal_point=layout.decimal,
            ),
        )
    except pa.ArrowInvalid:
        return None
    # a quote without its other half may swallow lines
    if quotes := body.count(b'"'):
        rows = sum(map(bool, map(bytes.strip, body.split(b"\n"))))
        if quotes % 2 or table.num_rows != rows:
            return None
    return table


def floats(column: pa.Array) -> FloatArray:
    """A numeric array as float64, null as NaN; whole numbers beyond 2^53 are rounded.

    By DLPack: Arrow's own `to_numpy` imports pandas (0.3 s).
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    values: Any = pc.cast(column, "float64", safe=False)
    if values.null_count:
        # from bytes: `pa.scalar` and `pa.array` would import pandas as well
        nan = pa.Array.from_buffers(pa.float64(), 1, [None, pa.py_buffer(np.array([np.nan]))])
        values = pc.fill_null(values, nan[0])
    return np.asarray(np.from_dlpack(values), dtype=np.float64)


def _line_by_line(
    body: bytes, where: str, layout: Layout, first: int, wanted: Sequence[int]
) -> list[FloatArray]:
    """The columns by Python's csv, so that the first bad line is named."""
    try:
        lines = body.decode("utf-8").split("\n")
    except UnicodeDecodeError as fault:
        bad = body.count(b"\n", 0, fault.start) + first
        raise InputRefused(
            f"{where}, line {bad}",
            "is not UTF-8 text",
            "the file is damaged or in another encoding; save it as UTF-8",
        ) from None
    out: list[list[float]] = [[] for _ in wanted]
    for line_number, line in enumerate(lines, start=first):
        if layout.skips(line):
            continue
        at = f"{where}, line {line_number}"
        row = row_of(line.rstrip("\r"), at, layout)
        try:
            for values, i in zip(out, wanted, strict=True):
                values.append(number(row[i], at, layout.names[i], layout.decimal, layout.thousands))
        except InputRefused:
            if line_number > layout.first and _are_names(row, layout):
                raise _another_table(line, at) from None
            raise
    return [np.array(values) for values in out]


def row_of(line: str, at: str, layout: Layout) -> list[str]:
    """The cells of one line, one for each column; `InputRefused` where they are too few, too many,
    labelled otherwise, or the header again.
    """
    no_nul(line, at)
    names = list(layout.names)
    try:
        row = layout.split(line)
    except csv.Error as fault:
        raise InputRefused(
            at,
            f"is not a row of cells: {fault}",
            "correct the line, or take the trial out of the schedule",
        ) from None
    if layout.trailing and len(row) == len(names) + 1 and not row[-1]:
        row = row[:-1]
    if row == names:
        raise InputRefused(
            at,
            "repeats the header: two records are in one file",
            "give each trial a file of its own",
        )
    if len(row) != len(names):
        if _are_names(row, layout):
            raise _another_table(line, at)
        raise InputRefused(
            at, f"has {len(row)} cells under {len(names)} column names", _way_out(line, layout)
        )
    if not layout.labels:
        return row
    pairs = [label(cell) for cell in row]
    labels = [pair[0] if pair else "" for pair in pairs]
    if labels != names:
        raise InputRefused(
            at,
            f"is labelled {', '.join(labels)}, not {', '.join(names)}",
            "correct the line, or take the trial out of the schedule",
        )
    return [pair[1] for pair in pairs if pair]


def _are_names(row: Sequence[str], layout: Layout) -> bool:
    """Whether a row may be the header of another table: several words and no number."""
    return (
        len(row) > 1
        and layout.separator not in (BLANKS, NONE)
        and not layout.labels
        and all(re.match(r"[\W_]*[^\W\d_]", cell) for cell in row)
        and not any(layout.value(cell) is not None for cell in row)
    )


def _another_table(line: str, at: str) -> InputRefused:
    text = json.dumps(line.strip()[:40], ensure_ascii=False)
    return InputRefused(
        at,
        f"holds words and no number, as the header of another table: {text}",
        "save each table as a file of its own; if the rig writes such lines, reader ="
        f' "text" with dialect = {{ ignore = [{text}] }} under [records]',
    )


def cut_at(words: str) -> str:
    """The remedy for numbers behind a line of words: cut the record there."""
    return (
        "if it tells of the values beneath it:"
        f' [segments] by = "markers", begin = "{words} {{level}}" cuts the record there, with'
        ' dialect = { columns = ["force"] } under [records]'
    )


def _way_out(line: str, layout: Layout) -> str:
    """The remedy for a line whose cells are not those of the header."""
    if not layout.labels and len(re.findall(r"\b[A-Za-z]\w*+\s*+:\s*+[-+.\d]", line)) > 1:
        return (
            'cells such as "T: 0.01" are read by reader = "text" with dialect = { labels = true }'
            " under [records]"
        )
    if re.search(r"[A-Za-z]", line) and not re.search(r"\d", line):
        text = json.dumps(line.strip()[:40], ensure_ascii=False)
        return (
            f'if the rig writes such lines, reader = "text" with dialect = {{ ignore = [{text}] }};'
            " else take the trial out of the schedule"
        )
    other = "point" if layout.decimal == "." else "comma"
    return (
        f"decimals need a {other} and no cell may be left out; correct the line, or take the trial"
        " out of the schedule"
    )
