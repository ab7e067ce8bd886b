"""Delimited text in any usual dialect, and headerless numbers by recipe: one file per trial, read
block by block.

Found by `dialect.sniff` from the first bytes and held to from there on: a later line that breaks
the dialect stops the run with its number. A last line without its end is left out and the record
called truncated.
"""

from __future__ import annotations

import codecs
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import interleaved, packed, table
from nearlift.readers.channel import (
    Channel,
    Contents,
    Names,
    RecordsDialect,
    pick,
    rate_of,
    split_unit,
    wanted,
)
from nearlift.readers.dialect import HEAD, NoRows, sniff
from nearlift.readers.interleaved import ONE, one_column
from nearlift.readers.layout import Given, Layout
from nearlift.readers.per_file import Format, reader_of
from nearlift.readers.table import NONE, CellSyntax, row_of

BLOCK = 8 << 20
OPTIONS = {
    "encoding": str,
    "separator": str,
    "decimal": str,
    "skip": int,
    "columns": list,
    "units": list,
    "ignore": list,
    "labels": bool,
    "lines": int,
}


def given(dialect: RecordsDialect) -> Given:
    """The manifest's dialect as the sniffer takes it; `ManifestError` where a list holds something
    that is no text, units are not as many as columns, or the decimal sign is none.
    """
    said: dict[str, Any] = {key: value for key, value in dialect.items() if key in OPTIONS}
    for key in ("columns", "units", "ignore"):
        if key in said and not all(isinstance(item, str) for item in said[key]):
            raise ManifestError(
                f"records.dialect.{key}",
                f"{said[key]!r} holds more than texts",
                'write it as ["force", "t"]',
            )
        said[key] = tuple(said.get(key, ()))
    if said["units"] and len(said["units"]) != len(said["columns"]):
        raise ManifestError(
            "records.dialect.units",
            f"names {len(said['units'])} units for {len(said['columns'])} columns",
            'one for each; "" for none',
        )
    if said.get("decimal", ".") not in (".", ","):
        raise ManifestError(
            "records.dialect.decimal", f"{said['decimal']!r} is no decimal sign", 'write "." or ","'
        )
    if said.get("lines", 1) != 1 and said["lines"] != len(said["columns"]):
        raise ManifestError(
            "records.dialect.lines",
            f"says {said['lines']} lines to a row, and columns names {len(said['columns'])}",
            'a number to a line, one name for each: columns = ["force", "millis"], lines = 2',
        )
    if said.get("skip", 0) < 0:
        raise ManifestError(
            "records.dialect.skip",
            f"{said['skip']} is negative",
            "it counts the lines above the columns' names",
        )
    try:
        codecs.lookup(said.get("encoding", "utf-8"))
    except LookupError:
        raise ManifestError(
            "records.dialect.encoding",
            f"{said['encoding']!r} is no encoding",
            'such as "utf-8", "utf-16" or "latin-1"',
        ) from None
    return Given(**said)


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a text file; `InputRefused` where no dialect fits, or a line breaks it."""
    return from_text(path, given(dialect), names)


def from_text(path: Path, said: Given, names: Names, layout: Layout | None = None) -> Contents:
    """The channels of a text file in a dialect known in part (`said`) or in whole (`layout`)."""
    where = str(path)
    if said.lines > 1:
        return interleaved.parted(path, said, from_text(path, one_column(said), None))
    head, whole = head_of(path)
    if not head.strip(b"\0"):
        return Contents(channels=(), kind="text", codes=("EMPTY",))
    if layout is None:
        try:
            layout = layout_of(path, said)
        except NoRows:
            if head.count(b"\n") > 2 or not whole:
                raise
            codes = ("NO_DATA",) if head.endswith((b"\n", b"\r")) else ("NO_DATA", "truncated")
            return Contents(channels=(), kind="text", codes=codes)
    chosen = _chosen(layout, names, where)
    blocks = Blocks(path, layout)
    parts: list[list[FloatArray]] = [[] for _ in chosen]
    above = _above(head, layout)
    after = [0] if above and above[-1].strip() and layout.cells.skips(above[-1]) else []
    rows = 0
    for first, body in blocks:
        if layout.cells.ignore:
            behind, rows = _after_ignored(body, layout.cells, rows)
            after += behind
        for held, values in zip(
            parts, table.read(body, where, first, layout.names, chosen, layout.cells), strict=True
        ):
            held.append(values)
    if layout.cells.separator == NONE and parts and parts[0] and layout.names != (ONE,):
        interleaved.refuse(np.concatenate(parts[0]), where, layout.first)
    spoken = layout.spoken()
    channels = tuple(
        Channel(
            name=layout.names[i],
            unit=layout.units[i],
            values=np.concatenate(held) if held else np.empty(0),
        )
        for i, held in zip(chosen, parts, strict=True)
    )
    if names is not None or len(channels) == 1:
        _of_one_kind(channels[0], after, where)
    return Contents(
        channels=channels,
        kind="text" + (f": {spoken}" if spoken else ""),
        codes=("truncated",) if blocks.cut else (),
        notes=(f"text read as {spoken}",) if spoken else (),
    )


def _after_ignored(body: bytes, cells: CellSyntax, rows: int) -> tuple[list[int], int]:
    """The rows of a block that stand right behind an ignored line, and how many rows there are."""
    places, behind = [], False
    for line in map(str.strip, body.decode("utf-8", errors="replace").split("\n")):
        if line and cells.skips(line):
            behind = True
        elif line:
            places += [rows] if behind else []
            rows, behind = rows + 1, False
    return places, rows


def _of_one_kind(channel: Channel, after: Sequence[int], where: str) -> None:
    """Refuse numbers behind ignored lines that are unlike those that follow them.

    A rig that writes THROTTLE, and its number on a line of its own, would otherwise have throttles
    among its forces.
    """
    parts = [p for p in np.split(channel.values, after)[1:] if len(p) > 3]
    ends = [(p[0], np.nanmin(p[1:]), np.nanmax(p[1:])) for p in parts if np.isfinite(p[1:]).any()]
    if len(ends) > 1 and all(
        x < low - (high - low) or x > high + (high - low) for x, low, high in ends
    ):
        first, low, high = ends[0]
        raise InputRefused(
            where,
            f"has a number of another kind behind every ignored line: {first:g}, then"
            f" {low:g} to {high:g} in {channel.name!r}",
            "take these lines out of the file, or write the number on the line that is ignored",
        )


def head_of(path: Path) -> tuple[bytes, bool]:
    """The first bytes of a text, and whether they are all of it."""
    with packed.opened(path) as file:
        head = file.read(HEAD + 1)
    return head[:HEAD], len(head) <= HEAD


def layout_of(path: Path, said: Given) -> Layout:
    """The dialect of a file, known in part; raises as `sniff` does."""
    head, whole = head_of(path)
    if whole and not head.startswith((b"\xff\xfe", b"\xfe\xff")) and b"\0\0\0" in head[-3:]:
        # the tail of a power cut
        head = head.rstrip(b"\0")
    return sniff(head, str(path), said, whole=whole)


def _chosen(layout: Layout, names: Names, where: str) -> list[int]:
    """Which columns to read: those that `pick` may choose, or all that hold numbers."""
    if names is None:
        return layout.numeric
    chosen = [i for i, name in enumerate(layout.names) if wanted(name, names)]
    if not chosen:
        channels = [Channel(name=name, values=np.empty(0)) for name in layout.names]
        header = f"{where}, line {max(layout.first - 1, 1)}"
        # refuses: none of them fits
        pick(channels, names[0], "records.force.column", header)
    return chosen


class Blocks:
    """A file's rows in blocks of whole lines, as UTF-8 with line feeds, each with the number of its
    first line.

    `cut` is True afterwards if the last line had no end and was left out.
    """

    def __init__(self, path: Path, layout: Layout) -> None:
        self.path, self.layout, self.cut = path, layout, False

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        line, skip = 1, self.layout.first - 1
        held = b""
        encoding = self.layout.encoding
        foreign = encoding not in ("utf-8", "utf-8-sig")
        decoder = codecs.getincrementaldecoder(encoding)() if foreign else None
        with packed.opened(self.path) as file:
            while True:
                raw = file.read(BLOCK)
                if not raw:
                    break
                held += raw if decoder is None else self._decoded(decoder, raw, line)
                if line == 1 and held.startswith(codecs.BOM_UTF8):
                    held = held[len(codecs.BOM_UTF8) :]
                # a carriage return at the end of a block may belong to a line feed in the next
                whole = held[:-1] if held.endswith(b"\r") else held
                if b"\r" in whole:
                    held = whole.replace(b"\r\n", b"\n").replace(b"\r", b"\n") + held[len(whole) :]
                end = held.rfind(b"\n") + 1
                body, held = held[:end], held[end:]
                if len(held) > BLOCK:
                    # gigabytes without the end of a line would be copied again with every block
                    if held.strip(b"\0"):
                        above = line + body.count(b"\n") - 1
                        raise InputRefused(
                            f"{self.path}, after line {above}",
                            "has a line of more than 8 MB",
                            "it is no table, or damaged",
                        )
                    held = b"\0"
                if not body:
                    continue
                lines = body.count(b"\n")
                if skip:
                    taken = min(skip, lines)
                    body = b"\n".join(body.split(b"\n", taken)[taken:])
                    skip, line, lines = skip - taken, line + taken, lines - taken
                if body:
                    yield line, body
                line += lines
        if held.endswith(b"\r") and b"\n" not in held:
            last = held[:-1] + b"\n"
            if last.strip() and not skip:
                yield line, last
        elif held:
            self.cut = bool(held.strip()) or b"\0" in held
        # half a character of UTF-16 is left over
        self.cut = self.cut or (decoder is not None and bool(decoder.getstate()[0]))

    def _decoded(self, decoder: codecs.IncrementalDecoder, raw: bytes, line: int) -> bytes:
        try:
            return decoder.decode(raw).encode()
        except UnicodeError as fault:
            raise InputRefused(
                f"{self.path}, line {line} or later",
                f"is not {self.layout.encoding} text: {fault}",
                "the file is damaged or in another encoding",
            ) from None


def marked(path: Path, said: Given, marks: Sequence[str]) -> list[tuple[int, str]]:
    """Every line like one of `marks` (``*`` is anything), and how many rows stand above it."""
    to_a_row = said.lines
    said = replace(said, ignore=tuple(dict.fromkeys((*said.ignore, *marks))))
    layout = layout_of(path, said if to_a_row == 1 else one_column(said))
    are = CellSyntax(ignore=tuple(marks))
    above = _above(head_of(path)[0], layout)
    places = [(0, line.strip()) for line in above if line.strip() and are.skips(line)]
    rows = 0
    for _, line in _lines(path, layout):
        if not layout.cells.skips(line):
            rows += 1
        elif line.strip() and are.skips(line):
            places.append((rows // to_a_row, line.strip()))
    return places


def words_of(path: Path, dialect: RecordsDialect, column: str) -> list[str]:
    """The cells of one column of a text, as they stand, a row each; `InputRefused` if it is not
    there.
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


def _above(head: bytes, layout: Layout) -> list[str]:
    """The lines above the first row."""
    text = head.decode(layout.encoding, errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")[: layout.first - 1]


def with_rate(file: Contents) -> Contents:
    """The same, each channel with the rate of the clock: the first called time in s, ms or us."""
    ticks, called = {"s": 1.0, "ms": 1e-3, "us": 1e-6}, ("t", "time", "x_value", "zeit")
    timed = [c for c in file.channels if c.unit in ticks]
    clocks = [c for c in timed if split_unit(c.name)[0].casefold() in called]
    if not clocks or len(clocks[0].values) < 3:
        return file
    rate = rate_of(ticks[clocks[0].unit] * clocks[0].values)
    return replace(file, channels=tuple(replace(c, rate_Hz=rate) for c in file.channels))


TEXT = Format(
    name="text",
    title=(
        "delimited text in any usual dialect, or headerless numbers by recipe; one file per trial"
    ),
    recognises=lambda head, name: False,
    contents=contents,
    options=OPTIONS,
)
READER = reader_of(TEXT)
