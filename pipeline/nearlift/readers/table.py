"""The numbers of a text table, strictly: every line has the cells that the header promises, every
cell wanted is a number, or what loggers write where there is none.

Two ways to the same bits: pyarrow's, and, where there is a line that it cannot read, a slow one
that reads the words for "no number" and names the first bad line.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.units import NUMBER

if TYPE_CHECKING:
    import pyarrow as pa

#: A separator that stands for runs of blanks and tabs, and one that never occurs: the line is one
#: cell.
BLANKS, NONE = " ", ""
#: What loggers write where there is no number, in lower case.
NO_NUMBER = re.compile(
    r"(?:[-+]?(?:nan|inf)|over|ovf?l|o\.?l|#nv|#?n/a|na|null|-?1\.#(?:inf|qnan|ind))?"
)


def _stands_for(form: str, line: str) -> bool:
    """Whether a line is the one of this form, in which ``*`` stands for anything."""
    first, *between = form.split("*")
    if not between:
        return line == form
    last, at = between.pop(), len(first)
    if not line.startswith(first):
        return False
    for part in between:
        at = line.find(part, at)
        if at < 0:
            return False
        at += len(part)
    return line.endswith(last) and len(line) - len(last) >= at


@dataclass(frozen=True, slots=True, kw_only=True)
class CellSyntax:
    """How the lines of a table are cut into cells and cells become numbers.

    The `separator` is one character, `BLANKS` for any run of blanks and tabs, or `NONE` for one
    cell to a line; the `decimal` sign is ``.`` or ``,``. `trailing`: every line ends with a
    separator, so that a blank cell follows the last. `ignore` are whole lines (such as START) that
    are no rows; ``*`` stands for anything in them. `labels`: cells are ``name: number``, with the
    same names on every line.
    """

    separator: str = ","
    decimal: str = "."
    trailing: bool = False
    ignore: tuple[str, ...] = ()
    labels: bool = False

    @property
    def plain(self) -> bool:
        """Whether pyarrow can cut the lines as they stand."""
        return self.separator not in (BLANKS, NONE) and not self.labels and not self.ignore

    def skips(self, line: str) -> bool:
        """Whether a line is no row: it is blank, or to be ignored."""
        plain = line.strip()
        return not plain or any(_stands_for(form, plain) for form in self.ignore)

    def split(self, line: str) -> list[str]:
        """The cells of one line, blanks around them taken off; labels, if any, are kept."""
        if self.separator == NONE:
            return [line.strip()]
        if self.separator == BLANKS:
            return line.split()
        # a quote without its other half begins a cell with a line break in it, unless it stands for
        # inches
        halved = line.count('"') % 2 == 1
        return [
            cell.strip()
            for cell in next(csv.reader([line], delimiter=self.separator, strict=halved), [])
        ]


COMMAS = CellSyntax()


def value_of(text: str, decimal: str = ".") -> float | None:
    """The cell's number, NaN for a word that means "no number", None where it is neither."""
    plain = text.strip()
    if decimal == ",":
        # a point in a file of decimal commas would be a thousands separator or another dialect:
        # neither is a number here
        if "." not in plain and plain.count(",") <= 1:
            plain = plain.replace(",", ".")
        elif not NO_NUMBER.fullmatch(plain.lower()):
            plain = "?"
    if NUMBER.fullmatch(plain):
        value = float(plain)
        return value if math.isfinite(value) else math.nan
    words = {plain.lower(), text.strip().lower()}
    return math.nan if any(map(NO_NUMBER.fullmatch, words)) else None


def number(text: str, at: str, column: str, decimal: str = ".") -> float:
    """The cell's number, NaN for a word that means "no number"; `InputRefused` of anything else."""
    value = value_of(text, decimal)
    if value is not None:
        return value
    other = "point" if decimal == "." else "comma"
    remedy = (
        f"write decimals with a {other}"
        if re.fullmatch(r"[-+]?\d+[.,]\d+", text)
        else "every cell must be a number; mend the line, or take the trial out of the schedule"
    )
    raise InputRefused(at, f"{text!r} in column {column!r} is not a number", remedy)


def label(cell: str) -> tuple[str, str] | None:
    """Name and number of a cell ``T: 0.01``; None where it is not of that form."""
    name, colon, rest = cell.partition(":")
    return (name.strip(), rest.strip()) if colon and len(rest.split()) <= 1 else None


def cut_at(words: str) -> str:
    """The manifest's lines that cut a record at lines of these words and a number."""
    return (
        "if it tells of the values beneath it:"
        f' [segments] by = "markers", begin = "{words} {{level}}" cuts the record there, with'
        ' dialect = { columns = ["force"] } under [records]'
    )


def read(
    body: bytes,
    where: str,
    first: int,
    header: Sequence[str],
    wanted: Sequence[int],
    cells: CellSyntax = COMMAS,
) -> list[FloatArray]:
    """The wanted columns of `body`, UTF-8 text whose lines end in a line feed and whose first is
    line `first` of the file; `InputRefused` where a line has too few or too many cells, a cell
    wanted is no number, or the bytes are no UTF-8.
    """
    columns = _by_arrow(body, len(header), wanted, cells) if cells.plain else None
    return columns if columns is not None else _explained(body, where, first, header, wanted, cells)


def _by_arrow(
    body: bytes, columns: int, wanted: Sequence[int], cells: CellSyntax
) -> list[FloatArray] | None:
    """By pyarrow; None where there is a line that it cannot read."""
    import pyarrow as pa
    import pyarrow.csv as pc

    names = [f"c{i}" for i in range(columns)]
    chosen = [names[i] for i in wanted]
    kinds = dict.fromkeys(chosen, pa.float64())
    # the phantom cell behind the last separator must be blank in every row
    phantom = ["blank"] if cells.trailing else []
    try:
        table = pc.read_csv(
            io.BytesIO(body),
            read_options=pc.ReadOptions(
                column_names=names + phantom,
                use_threads=False,
                block_size=max(1 << 20, len(body) + 1),
            ),
            parse_options=pc.ParseOptions(delimiter=cells.separator),
            convert_options=pc.ConvertOptions(
                include_columns=chosen + phantom,
                column_types={**kinds, **dict.fromkeys(phantom, pa.null())},
                null_values=[""],
                check_utf8=False,
                decimal_point=cells.decimal,
            ),
        )
    except pa.ArrowInvalid:
        return None
    arrays = [floats(table[name].combine_chunks()) for name in chosen]
    return [np.where(np.isfinite(values), values, np.nan) for values in arrays]


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


def _explained(
    body: bytes,
    where: str,
    first: int,
    header: Sequence[str],
    wanted: Sequence[int],
    cells: CellSyntax,
) -> list[FloatArray]:
    """Line by line, so that the first bad line is named."""
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
        if cells.skips(line):
            continue
        at = f"{where}, line {line_number}"
        row = row_of(line.rstrip("\r"), at, header, cells)
        for values, column in zip(out, wanted, strict=True):
            values.append(number(row[column], at, header[column], cells.decimal))
    return [np.array(values) for values in out]


def _way_out(line: str, cells: CellSyntax) -> str:
    """What to do about a line whose cells are not the header's: it may be of a kind of its own."""
    if not cells.labels and len(re.findall(r"\b[A-Za-z]\w*+\s*+:\s*+[-+.\d]", line)) > 1:
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
    other = "point" if cells.decimal == "." else "comma"
    return (
        f"decimals want a {other} and no cell may be left out; mend the line, or take the trial out"
        " of the schedule"
    )


def no_nul(line: str, at: str) -> None:
    """Refuse a line with NUL bytes, which a power cut leaves behind."""
    if "\0" in line:
        raise InputRefused(
            at,
            "holds NUL bytes",
            "the file is damaged; copy it anew from the rig, or take the trial out of the schedule",
        )


def row_of(line: str, at: str, header: Sequence[str], cells: CellSyntax) -> list[str]:
    """One line's cells, one for each name of the header; `InputRefused` where they are too few or
    too many, labelled otherwise, or the header once more.
    """
    no_nul(line, at)
    try:
        row = cells.split(line)
    except csv.Error as fault:
        raise InputRefused(
            at,
            f"is not a row of cells: {fault}",
            "mend the line, or take the trial out of the schedule",
        ) from None
    if cells.trailing and len(row) == len(header) + 1 and not row[-1]:
        row = row[:-1]
    if row == list(header):
        raise InputRefused(
            at,
            "repeats the header: two records stand in one file",
            "give each trial a file of its own",
        )
    if len(row) != len(header):
        raise InputRefused(
            at, f"has {len(row)} cells under {len(header)} column names", _way_out(line, cells)
        )
    if not cells.labels:
        return row
    pairs = [label(cell) for cell in row]
    names = [pair[0] if pair else "" for pair in pairs]
    if names != list(header):
        raise InputRefused(
            at,
            f"is labelled {', '.join(names)}, not {', '.join(header)}",
            "mend the line, or take the trial out of the schedule",
        )
    return [pair[1] for pair in pairs if pair]
