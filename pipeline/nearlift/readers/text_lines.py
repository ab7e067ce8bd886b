"""The lines of a text that are no numbers: marks between the rows, and words in a column."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from nearlift.errors import InputRefused
from nearlift.readers import packed
from nearlift.readers.channel import RecordsDialect
from nearlift.readers.dialect import HEAD
from nearlift.readers.interleaved import one_column
from nearlift.readers.layout import Given, Layout
from nearlift.readers.table import CellSyntax, row_of
from nearlift.readers.text import Blocks, given, layout_of


def marked(path: Path, said: Given, marks: Sequence[str]) -> list[tuple[int, str]]:
    """Every line like one of `marks`, in which ``*`` stands for anything, and how many rows stand
    above it.
    """
    to_a_row = said.lines
    said = replace(said, ignore=tuple(dict.fromkeys((*said.ignore, *marks))))
    layout = layout_of(path, said if to_a_row == 1 else one_column(said))
    are = CellSyntax(ignore=tuple(marks))
    places = [
        (0, line.strip()) for line in _above(path, layout) if line.strip() and are.skips(line)
    ]
    rows = 0
    for _, line in _lines(path, layout):
        if not layout.cells.skips(line):
            rows += 1
        elif line.strip() and are.skips(line):
            places.append((rows // to_a_row, line.strip()))
    return places


def words_of(path: Path, dialect: RecordsDialect, column: str) -> list[str]:
    """The cells of one column of a text, as they stand, a row each.

    Raises
    ------
    InputRefused
        There is no such column.
    """
    layout = layout_of(path, given(dialect))
    if column not in layout.names:
        raise InputRefused(
            str(path),
            f"has no column {column!r}",
            f"it has {', '.join(map(repr, layout.names))}; segments.by names it",
        )
    place = layout.names.index(column)
    return [
        row_of(line, f"{path}, line {number}", layout.names, layout.cells)[place]
        for number, line in _lines(path, layout)
        if not layout.cells.skips(line)
    ]


def _lines(path: Path, layout: Layout) -> Iterator[tuple[int, str]]:
    """Number and text of every line from the first row on."""
    for first, body in Blocks(path, layout):
        yield from enumerate(body.decode("utf-8", "replace").removesuffix("\n").split("\n"), first)


def _above(path: Path, layout: Layout) -> list[str]:
    """The lines above the first row."""
    with packed.opened(path) as file:
        head = file.read(HEAD).decode(layout.encoding, "replace")
    return head.replace("\r\n", "\n").replace("\r", "\n").split("\n")[: layout.first - 1]
