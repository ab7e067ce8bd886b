"""Delimited text in any usual dialect, and headerless numbers by recipe: one file per trial, read
block by block.

The dialect of the first bytes holds for the whole file: a later line that breaks it stops the run
with its number. It is found once for files that begin alike. A last line without its end is left
out, and the record is called truncated.
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
from nearlift.readers import interleaved, packed
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
from nearlift.readers.dialect import HEAD, Dialect, NoRows, encoding_of, sniff
from nearlift.readers.per_file import Format, reader_of
from nearlift.readers.table import Layout, matches, parse, row_of

BLOCK = 8 << 20
OPTIONS = {
    "encoding": str,
    "separator": str,
    "decimal": str,
    "thousands": str,
    "skip": int,
    "columns": list,
    "units": list,
    "ignore": list,
    "labels": bool,
    "lines": int,
}
#: Layouts found so far, by the dialect stated and the bytes above the first row.
_found: dict[tuple[Dialect, bytes], Layout] = {}
MOST_FOUND = 8


def given(dialect: RecordsDialect) -> Dialect:
    """The manifest's dialect as the sniffer takes it.

    Raises
    ------
    ManifestError
        A list holds more than texts, units are not as many as columns, a sign cannot be one, or
        `skip` is negative.
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
    thousands = said.get("thousands", "")
    if thousands and (len(thousands) > 1 or thousands.isalnum() or thousands in "+-"):
        raise ManifestError(
            "records.dialect.thousands",
            f"{thousands!r} is no sign between thousands",
            'write ",", ".", "\'" or " "',
        )
    if thousands and thousands == said.get("decimal"):
        raise ManifestError(
            "records.dialect.thousands",
            f"{thousands!r} is the decimal sign as well",
            "state another decimal sign",
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
    return Dialect(**said)


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a text file; `InputRefused` where no dialect fits, or a line breaks it."""
    return from_text(path, given(dialect), names)


def from_text(path: Path, said: Dialect, names: Names, layout: Layout | None = None) -> Contents:
    """The channels of a text file in a dialect known in part (`said`) or in whole (`layout`)."""
    if said.lines > 1:
        whole = from_text(path, interleaved.one_column(said), None)
        marks = marked(path, interleaved.one_column(said), said.ignore) if said.ignore else []
        return interleaved.parted(whole, said, marks, str(path))
    head, whole_file = head_of(path)
    if not head.strip(b"\0"):
        return Contents(channels=(), kind="text", codes=("EMPTY",))
    if layout is not None:
        return _read(path, layout, names)
    if (layout := _known(head, said, str(path))) is not None:
        try:
            return _read(path, layout, names)
        except InputRefused:
            # this file may be of another dialect; if not, it is refused again
            pass
    try:
        layout = layout_of(path, said)
    except NoRows:
        if head.count(b"\n") > 2 or not whole_file:
            raise
        codes = ("NO_DATA",) if head.endswith((b"\n", b"\r")) else ("NO_DATA", "truncated")
        return Contents(channels=(), kind="text", codes=codes)
    file = _read(path, layout, names)
    _keep(head, said, layout)
    return file


def _known(head: bytes, said: Dialect, where: str) -> Layout | None:
    """The layout of an earlier file that began alike and was read."""
    for (stated, top), layout in list(_found.items()):
        if stated == said and head.startswith(top) and encoding_of(head, where) == layout.encoding:
            return layout
    return None


def _keep(head: bytes, said: Dialect, layout: Layout) -> None:
    """Keep the layout for files that begin alike; one with decimal commas is judged by each file,
    whose commas may part thousands.
    """
    above = head.split(b"\n", layout.first - 1)
    if layout.decimal == "." and len(above) == layout.first and len(_found) < MOST_FOUND:
        _found[said, head[: len(head) - len(above[-1])]] = layout


def _read(path: Path, layout: Layout, names: Names) -> Contents:
    """The channels of a text file in a known layout."""
    where = str(path)
    chosen = _chosen(layout, names, where)
    blocks = Blocks(path, layout)
    parts: list[list[FloatArray]] = [[] for _ in chosen]
    after: list[int] = []
    if layout.ignore:
        above = _above(head_of(path)[0], layout)
        after = [0] if above and above[-1].strip() and layout.skips(above[-1]) else []
    rows = 0
    for first, body in blocks:
        if layout.ignore:
            behind, rows = _after_ignored(body, layout, rows)
            after += behind
        for held, values in zip(parts, parse(body, where, layout, first, chosen), strict=True):
            held.append(values)
    channels = tuple(
        Channel(
            name=layout.names[i],
            unit=layout.units[i],
            values=held[0] if len(held) == 1 else np.concatenate([np.empty(0), *held]),
        )
        for i, held in zip(chosen, parts, strict=True)
    )
    if len(layout.names) == 1 and layout.names != (interleaved.ONE,):
        interleaved.refuse(channels[0].values, where, layout.first)
    if names is not None or len(channels) == 1:
        _of_one_kind(channels[0], after, where)
    spoken = layout.spoken()
    return Contents(
        channels=channels,
        kind="text" + (f": {spoken}" if spoken else ""),
        codes=("truncated",) if blocks.cut else (),
        notes=(f"text read as {spoken}",) if spoken else (),
    )


def _after_ignored(body: bytes, layout: Layout, rows: int) -> tuple[list[int], int]:
    """The rows of a block right behind an ignored line, and the count of rows so far."""
    places, behind = [], False
    for line in map(str.strip, body.decode("utf-8", errors="replace").split("\n")):
        if line and layout.skips(line):
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
    parts = [p for p in np.split(channel.values, after)[1:] if len(p) > 3] if after else []
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


def layout_of(path: Path, said: Dialect) -> Layout:
    """The layout of a file, known in part; raises as `sniff` does."""
    head, whole = head_of(path)
    if whole and not head.startswith((b"\xff\xfe", b"\xfe\xff")) and b"\0\0\0" in head[-3:]:
        # the tail of a power cut
        head = head.rstrip(b"\0")
    return sniff(head, str(path), said, whole=whole)


def _chosen(layout: Layout, names: Names, where: str) -> list[int]:
    """Indices of the columns to read: those that `pick` may choose, or all of numbers."""
    if names is None:
        return layout.numeric
    columns = list(enumerate(layout.names))
    chosen: set[int] = set()
    for name in names:
        exact = {i for i, column in columns if column == name}
        chosen |= exact or {i for i, column in columns if wanted(column, (name,))}
    if not chosen:
        channels = [Channel(name=name, values=np.empty(0)) for name in layout.names]
        # refuses: none of them fits
        pick(
            channels,
            names[0],
            "records.force.column",
            f"{where}, line {max(layout.first - 1, 1)}",
        )
    return sorted(chosen)


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
        # room for a whole block would be fetched for every small file
        size = min(BLOCK, max(self.path.stat().st_size + 1, HEAD))
        with packed.opened(self.path) as file:
            while True:
                raw = file.read(size)
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


def marked(path: Path, said: Dialect, marks: Sequence[str]) -> list[tuple[int, str]]:
    """Every line like one of `marks` (``*`` matches anything), and the count of rows above it."""
    to_a_row = said.lines
    said = replace(said, ignore=tuple(dict.fromkeys((*said.ignore, *marks))))
    layout = layout_of(path, said if to_a_row == 1 else interleaved.one_column(said))

    def is_mark(line: str) -> bool:
        return any(matches(form, line.strip()) for form in marks) and bool(line.strip())

    above = _above(head_of(path)[0], layout)
    places = [(0, line.strip()) for line in above if is_mark(line)]
    rows = 0
    for _, line in _lines(path, layout):
        if is_mark(line):
            places.append((rows // to_a_row, line.strip()))
        elif not layout.skips(line):
            rows += 1
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
        row_of(line, f"{path}, line {number}", layout)[place]
        for number, line in _lines(path, layout)
        if not layout.skips(line)
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
