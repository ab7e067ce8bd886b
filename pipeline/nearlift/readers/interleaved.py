"""Text with one number to a line, of which every second (third, ...) belongs to another column: a
value, then its millis.

A clock read as a force would be a number in silence. A record in which every second number only
ever grows is therefore refused until `lines` states what it is. Where the order breaks, by words
within a row or by a lost line, the place is named.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.channel import Channel, Contents
from nearlift.readers.dialect import Dialect

#: Name of the one column that such a file is read as first.
ONE = "value"
#: Rows from which on a clock shows: noise grows through so many in one record of 40,000.
FEWEST = 8
CLOCKS = ("millis", "micros", "ms", "us", "t", "time", "tick")
_MEND = "mend the file, or take the record out of the schedule"


def one_column(said: Dialect) -> Dialect:
    """The dialect in which each line is a row."""
    return replace(said, columns=(ONE,), units=(), lines=1, separator="none")


def parted(
    contents: Contents, said: Dialect, marks: Iterable[tuple[int, str]], where: str
) -> Contents:
    """The columns of a file that was read as one column.

    Parameters
    ----------
    marks : iterable of (int, str)
        Ignored lines, each with the count of numbers above it.

    Raises
    ------
    InputRefused
        An ignored line is within a row, or a clock, by its name or its first numbers, does not
        only grow: a line is lost.
    """
    if not contents.channels:
        return contents
    values, k = contents.channels[0].values, said.lines
    rows = len(values) // k
    codes = contents.codes if rows * k == len(values) else (*contents.codes, "truncated")
    for number, line in marks:
        if number % k:
            raise InputRefused(
                f"{where}, number {number + 1}", f"a row of {k} lines is broken by {line!r}", _MEND
            )
    table = values[: rows * k].reshape(rows, k)
    for name, column in zip(said.columns, table.T, strict=True):
        is_clock = name.casefold() in CLOCKS or (len(column) > FEWEST and _grows(column[:FEWEST]))
        if is_clock and not np.all(np.diff(column) > 0):
            row = int(np.argmin(np.diff(column) > 0)) + 1
            raise InputRefused(
                f"{where}, number {row * k + 1}",
                f"{name!r} only grew until there, and is {column[row]:g} after"
                f" {column[row - 1]:g}: a line is lost, or the clock was set back",
                _MEND,
            )
    channels = tuple(
        Channel(name=name, unit=unit, values=np.ascontiguousarray(column))
        for name, unit, column in zip(said.columns, said.units or [""] * k, table.T, strict=True)
    )
    notes = (*contents.notes, f"text read as {k} lines to a row")
    return replace(contents, channels=channels, codes=codes, notes=notes)


def refuse(values: FloatArray, where: str, first: int) -> None:
    """Refuse one column, from line `first` on, of which every second number is a clock's, and the
    others are not.
    """
    for k in (0, 1):
        clock, other = values[k::2], values[1 - k :: 2]
        # the first few settle it for nearly every record
        if len(clock) < FEWEST or not _grows(clock[:FEWEST]):
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
    return bool(np.all(np.diff(values) > 0) and np.all(values == np.round(values)))
