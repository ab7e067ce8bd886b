"""Text with one number to a line, of which every second (third, ...) is another column's: a value,
then its millis.

Nothing in such a file says so, and a clock read as a force would be a number in silence: a record
in which every second number only ever grows is refused until `lines` says what it is, and where the
order breaks, by a line of words within a row or a line lost, the line is named.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.channel import Channel, Contents
from nearlift.readers.layout import Given

#: The name of the one column that such a file is read as first.
ONE = "value"
#: Rows from which on a clock shows: noise grows through so many in one record of 40,000.
FEWEST = 8
#: What a clock is called.
CLOCKS = ("millis", "micros", "ms", "us", "t", "time", "tick")


def one_column(said: Given) -> Given:
    """The dialect in which each line is a row."""
    return replace(said, columns=(ONE,), units=(), lines=1, separator="none")


def parted(path: Path, said: Given, contents: Contents) -> Contents:
    """The columns of a file that was read as one; `InputRefused` where a line of words stands
    within a row, or a clock, by its name or its first numbers, does not only grow: a line is lost.
    """
    from nearlift.readers.text import marked

    if not contents.channels:
        return contents
    values, k = contents.channels[0].values, said.lines
    rows = len(values) // k
    codes = contents.codes if rows * k == len(values) else (*contents.codes, "truncated")
    for number, line in marked(path, one_column(said), said.ignore):
        if number % k:
            raise InputRefused(
                f"{path}, number {number + 1}",
                f"a row of {k} lines is broken by {line!r}",
                "mend the file, or take the record out of the schedule",
            )
    table = values[: rows * k].reshape(rows, k)
    for name, column in zip(said.columns, table.T, strict=True):
        is_clock = name.casefold() in CLOCKS or (len(column) > FEWEST and _grows(column[:FEWEST]))
        if is_clock and not np.all(np.diff(column) > 0):
            row = int(np.argmin(np.diff(column) > 0)) + 1
            raise InputRefused(
                f"{path}, number {row * k + 1}",
                f"{name!r} only grew until there, and is {column[row]:g} after"
                f" {column[row - 1]:g}: a line is lost, or the clock was set back",
                "mend the file, or take the record out of the schedule",
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
        if len(clock) >= FEWEST and _grows(clock) and not _grows(other) and not _grows(values):
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
