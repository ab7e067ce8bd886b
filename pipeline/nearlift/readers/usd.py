"""Binary logs of the Crazyflie's uSD deck, by an own decoder.

Layout: 0xBC, version (u16: 1 or 2), number of event types (u16), for each its id (u16), name (ends
in 0), number of variables (u16) and their texts ``name(type)`` (each ends in 0); then records: id
(u16), time (v1: u32 in ms, v2: u64 in us), values packed, little endian; the last four bytes are
the CRC-32 of all before. A wrong sum rejects the record, unless ``dialect = { salvage = true }``
takes the records before the first one that cannot be. A channel is called ``event.variable``, an
event's clock ``event.time``.

Firmware before that wrote: number of variables (u8), their texts ``name(type),`` (the first is
``tick(I)``, in ms; 35 of them make a log begin ``#tick``), a sum; then sets: number of records
(u8), the records, a sum. The sums are CRC-32 without the last inversion, each of its own part. A
channel is called as its variable.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers.channel import (
    Channel,
    Contents,
    Malformed,
    Names,
    RecordsDialect,
    of_topic,
    rate_of,
)
from nearlift.readers.per_file import Format, reader_of

MAGIC = 0xBC
KIND = "Crazyflie uSD log"
#: What the sums of a log of older firmware come to with the bytes that they are written in.
RESIDUE = 0xFFFFFFFF
#: Type letters (as Python's struct) to numpy's.
TYPES = {
    letter: f"<{kind}{struct.calcsize(f'<{letter}')}"
    for kind, letters in {"u": "BHILQ", "i": "bhilq", "f": "efd"}.items()
    for letter in letters
}
#: Version to the clock's type and its unit in s.
CLOCKS = {1: ("<u4", 1e-3), 2: ("<u8", 1e-6)}
MOST_BYTES = 1 << 30
#: How logs began before they had a version: the number of variables, then ``name(type),`` for each.
OLDER = re.compile(rb"[\x01-\xff](?:[\w.]{1,60}\([BbHhIiLlQqefd]\),){1,}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One type of record: its name and the layout of its bytes: its id's, clock, the rest."""

    name: str
    layout: np.dtype[Any]


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a log; `InputRefused` of a later version, or over 1 GiB, `Malformed` where it
    is cut off or its sum is wrong and `salvage` was not asked for.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise InputRefused(
            str(path),
            f"has {size} bytes, more than the {MOST_BYTES} that a log may have",
            "cut it into trials on the rig",
        )
    return decode(path.read_bytes(), str(path), salvage=bool(dialect.get("salvage", False)))


def decode(content: bytes, where: str, *, salvage: bool = False) -> Contents:
    """The channels of a log's bytes; raises as `contents` does."""
    if not content.strip(b"\0"):
        return Contents(channels=(), kind=KIND, codes=("EMPTY",))
    if _is_older(content):
        return _older(content, salvage)
    events, unit_s, start = _head(content, where)
    whole = (
        len(content) - start >= 4
        and zlib.crc32(content[:-4]) == struct.unpack("<I", content[-4:])[0]
    )
    if not whole and not salvage:
        raise Malformed(
            "its check sum is wrong: it is cut off or damaged; dialect = { salvage = true } takes"
            " what comes before the damage"
        )
    runs, end = _walk(content, events, start, len(content) - 4 if whole else len(content))
    if whole and end != len(content) - 4:
        raise Malformed(f"byte {end} begins no record, though the check sum is right")
    channels = []
    for number, event in events.items():
        records = np.frombuffer(b"".join(runs[number]), dtype=event.layout)
        clock = records["time"].astype(np.float64) * unit_s
        fields = ((field, records[field]) for field in (event.layout.names or ())[1:])
        channels += of_topic(event.name, clock, fields)
    return Contents(channels=tuple(channels), kind=KIND, codes=() if whole else ("salvaged",))


def _head(content: bytes, where: str) -> tuple[dict[int, Event], float, int]:
    """Event types by id, the clock's unit in s, and where the records begin."""
    try:
        magic, version, count = struct.unpack_from("<BHH", content, 0)
    except struct.error:
        raise Malformed(f"ends after {len(content)} bytes, within its head") from None
    if magic != MAGIC:
        raise Malformed(
            f"begins with 0x{magic:02X}, not 0x{MAGIC:02X}: it is no log of the uSD deck"
        )
    if version not in CLOCKS:
        raise InputRefused(
            where,
            f"is a uSD log of version {version}",
            f"this reads versions {' and '.join(map(str, CLOCKS))}; a newer nearlift may read it",
        )
    clock, unit_s = CLOCKS[version]
    events: dict[int, Event] = {}
    at = 5
    for _ in range(count):
        number, at = _u16(content, at)
        name, at = _name(content, at)
        variables, at = _u16(content, at)
        fields: list[tuple[str, str]] = [("time", clock)]
        for _ in range(variables):
            text, at = _name(content, at)
            variable, kind = _variable(text)
            if variable in (f for f, _ in fields):
                raise Malformed(f"describes a variable {text!r}, which is none")
            fields.append((variable, kind))
        if number in events or not name:
            raise Malformed(f"describes event {number} twice, or without a name")
        events[number] = Event(name=name, layout=_behind_id(fields))
    return events, unit_s, at


def _behind_id(fields: Sequence[tuple[str, str]]) -> np.dtype[Any]:
    """The layout of packed fields behind two bytes that are none of them."""
    names, kinds = zip(*fields, strict=True)
    sizes = [np.dtype(kind).itemsize for kind in kinds]
    *offsets, end = np.cumsum([2, *sizes]).tolist()
    return np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": end})


def _is_older(head: bytes) -> bool:
    """Whether a log begins so; a text that does, a table's header behind ``#``, has lines."""
    return OLDER.match(head) is not None and not any(
        b"\n" in text for text in head[1:].split(b",", head[0])[: head[0]]
    )


def _older(content: bytes, salvage: bool) -> Contents:
    """The channels of a log of older firmware; raises `Malformed` as `contents` does."""
    width = content[0]
    texts = content[1:].split(b",", width)[:width]
    fields = [_variable(text.decode("ascii", "replace").strip()) for text in texts]
    start = 1 + sum(len(text) + 1 for text in texts) + 4
    if len(fields) < width or len({name for name, _ in fields}) < width:
        raise Malformed("names fewer variables than it has, or one of them twice")
    if start > len(content) or zlib.crc32(content[:start]) != RESIDUE:
        raise Malformed("its head's check sum is wrong: it is cut off or damaged")
    layout = np.dtype(fields)
    parts, at = [], start
    while at < len(content):
        end = at + 1 + content[at] * layout.itemsize
        if end + 4 > len(content) or zlib.crc32(content[at : end + 4]) != RESIDUE:
            break
        parts.append(content[at + 1 : end])
        at = end + 4
    whole = at == len(content)
    if not whole and not salvage:
        raise Malformed(
            f"the check sum of the set at byte {at} is wrong: it is cut off or damaged; dialect ="
            " { salvage = true } takes what comes before the damage"
        )
    records = np.frombuffer(b"".join(parts), dtype=layout)
    clock = records["tick"].astype(np.float64) if "tick" in dict(fields) else np.empty(0)
    rate = rate_of(1e-3 * clock) if len(clock) > 2 else None
    channels = []
    for name, _ in fields:
        values, unit = records[name].astype(np.float64), "ms" if name == "tick" else ""
        channels.append(Channel(name=name, unit=unit, rate_Hz=rate, values=values))
    return Contents(channels=tuple(channels), kind=KIND, codes=() if whole else ("salvaged",))


def _variable(text: str) -> tuple[str, str]:
    """Name and numpy's type of a variable such as ``acc.x(f)``."""
    name, _, kind = text.removesuffix(")").rpartition("(")
    if kind not in TYPES or not name:
        raise Malformed(f"describes a variable {text!r}, which is none")
    return name, TYPES[kind]


def _u16(content: bytes, at: int) -> tuple[int, int]:
    if at + 2 > len(content):
        raise Malformed(f"ends after {len(content)} bytes, within its head")
    return int.from_bytes(content[at : at + 2], "little"), at + 2


def _name(content: bytes, at: int) -> tuple[str, int]:
    end = content.find(b"\0", at, at + 256)
    if end < 0:
        raise Malformed("describes its events by a name without an end")
    try:
        return content[at:end].decode("ascii"), end + 1
    except UnicodeDecodeError:
        raise Malformed("describes its events by a name that is no text") from None


def _walk(
    content: bytes, events: Mapping[int, Event], at: int, end: int
) -> tuple[dict[int, list[bytes]], int]:
    """The records of each event, those that follow each other as one, and the byte at which no
    further whole record of a known event begins.
    """
    runs: dict[int, list[bytes]] = {number: [] for number in events}
    while at + 2 <= end:
        number = content[at] | content[at + 1] << 8
        event = events.get(number)
        if event is None or at + event.layout.itemsize > end:
            break
        upto = _same(content, at, end, event.layout.itemsize)
        runs[number].append(content[at:upto])
        at = upto
    return runs, at


def _same(content: bytes, at: int, end: int, size: int) -> int:
    """Where the records of one event end that begin at byte `at` and follow each other."""
    number, count, ahead = content[at : at + 2], 1, 1
    most = (end - at) // size
    while count < most:
        # twice as far as before, while that is all of one kind
        upto = min(count + ahead, most)
        first, last = at + count * size, at + (upto - 1) * size + 1
        for byte in (0, 1):
            column = content[first + byte : last + byte : size]
            rest = column.lstrip(number[byte : byte + 1])
            upto = min(upto, count + len(column) - len(rest))
        if upto < count + ahead:
            return at + upto * size
        count, ahead = upto, 2 * ahead
    return at + count * size


READER = reader_of(
    Format(
        name="crazyflie-usd",
        title="binary logs of the Crazyflie's uSD deck, check sum verified",
        recognises=lambda head, name: (
            (len(head) > 5 and head[0] == MAGIC and head[2] == 0 and head[1] in range(1, 16))
            or _is_older(head)
        ),
        contents=contents,
        options={"salvage": bool},
    )
)
