"""LVM, LabVIEW's measurement text, by an own parser that runs nothing and believes little.

Two headers: one of the file, one for each segment. The rate in a segment's header (`Delta_X`) is
compared with the column `X_Value` where there is one. The number of `Samples` shows a cut file.
Segments of one file are joined. A channel is called as in the file; where every channel has its own
clock, that is ``NAME.X_Value``.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.base import (
    Channel,
    Contents,
    Names,
    Reader,
    RecordsDialect,
    rate_of,
    unit_word,
    wanted,
)
from nearlift.readers.dialect import UNSTATED
from nearlift.readers.files import content_of
from nearlift.readers.table import Layout, Lines, parse
from nearlift.readers.text import plain

FIRST = "LabVIEW Measurement"
END = "***End_of_Header***"
CLOCK, COMMENT = "X_Value", "Comment"

#: The cells behind the keys of a header.
Header = Mapping[str, Sequence[str]]


@dataclass(kw_only=True)
class _Series:
    """One channel: unit, step of its clock as stated, values and clock of each segment."""

    unit: str = ""
    step_s: float | None = None
    values: list[FloatArray] = field(default_factory=list)
    clock: list[FloatArray] = field(default_factory=list)


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of an LVM file; `InputRefused` of another file, or of a bad line."""
    content, where = content_of(path), str(path)
    if not content.strip(b"\0"):
        return Contents(kind="LVM", codes=("EMPTY",))
    if not _is_lvm(content):
        remedy = "`nearlift inspect FILE` identifies it"
        raise InputRefused(f"{where}, line 1", f"is not {FIRST!r}: this is no LVM file", remedy)
    text = plain(content, where, UNSTATED)
    try:
        lines = text.body.decode().split("\n")
    except UnicodeDecodeError:
        remedy = "the file is damaged; copy it again from the rig"
        raise InputRefused(where, f"is not {text.encoding} text throughout", remedy) from None
    special = False
    for i, line in enumerate(lines):
        if special or line.startswith("***Start_Special***"):
            special, lines[i] = not line.startswith("***End_Special***"), ""
    about, at = _header(lines, 0, "\t" if "\t" in "".join(lines[:5]) else ",")
    separator = "," if _at(about, "Separator", 0).casefold() == "comma" else "\t"
    series: dict[str, _Series] = {}
    starts = [i for i in range(at, len(lines)) if lines[i].startswith(f"Channels{separator}")]
    # a number may be cut within its digits
    cut = text.cut or not starts
    for start, end in itertools.pairwise([*starts, len(lines)]):
        cut |= _read_segment(lines[:end], start, separator, about, series, where)
    channels, notes = _channels(series, _at(about, "X_Columns", 0).casefold() == "multi")
    chosen = [c for c in channels if wanted(c.name, names)]
    return Contents(
        channels=tuple(chosen or channels),
        kind="LVM",
        codes=("truncated",) * cut + ("NO_DATA",) * (not channels),
        notes=tuple(dict.fromkeys(notes)),
    )


def _refusal(where: str, at: int, what: str) -> InputRefused:
    remedy = "the file is damaged, or of a dialect not known: export it again from LabVIEW"
    return InputRefused(f"{where}, line {at + 1}", what, remedy)


def _header(lines: Sequence[str], at: int, separator: str) -> tuple[Header, int]:
    """A header's keys, and the index of the line behind its end."""
    end = next((i for i in range(at, len(lines)) if lines[i].startswith(END)), len(lines))
    cells = (line.split(separator) for line in lines[at:end])
    return {key.strip(): values for key, *values in cells}, end + 1


def _read_segment(
    lines: Sequence[str],
    start: int,
    separator: str,
    about: Header,
    series: dict[str, _Series],
    where: str,
) -> bool:
    """Append the segment that begins at `start`; whether it has fewer rows than it promises."""
    header, at = _header(lines, start, separator)
    at = next((i for i in range(at, len(lines)) if lines[i].strip()), len(lines))
    if at == len(lines):
        return True
    columns = [name.strip() for name in lines[at].rstrip(f"{separator} ").split(separator)]
    if columns[0] != CLOCK:
        what = f"names the columns {lines[at].strip()[:80]!r}; the first should be {CLOCK}"
        raise _refusal(where, at, what)
    names = [name for name in columns if name not in (CLOCK, COMMENT)]
    if len(set(names)) != len(names) or "" in names:
        raise _refusal(where, at, "names two columns alike, or one not at all")
    numbers = "".join(c for key in ("X0", "Delta_X") for c in header.get(key, ()))
    usual = "," if "," in numbers and "." not in numbers else "."
    decimal = _at(about, "Decimal_Separator", 0) or usual
    if decimal not in (".", ","):
        raise _refusal(where, 0, f"states the decimal separator {decimal!r}")
    # comments are not read, and may be missing
    count = len(columns) - (columns[-1] == COMMENT)
    rows = []
    for i in range(at + 1, len(lines)):
        cells = lines[i].split(separator) if lines[i].strip(" \t,") else []
        if cells and (len(cells) < count or any(c.strip() for c in cells[len(columns) :])):
            raise _refusal(where, i, f"has {len(cells)} cells under {len(columns)} columns")
        rows.append(separator.join(cells[:count]))
    layout = Layout(separator=separator, decimal=decimal, names=tuple(columns[:count]))
    body = "".join(f"{row}\n" for row in rows).encode()
    read, _ = parse(Lines(body=body, where=where, line=at + 2), layout, range(count))
    several = columns.count(CLOCK) > 1
    clock = read[0]
    for i, name in enumerate(columns[:count]):
        if name == CLOCK:
            clock = read[i]
            continue
        # each channel has a clock before it and its own end, or all have one
        place = i - 1 if several else names.index(name)
        kept = np.isfinite(read[i]) | np.isfinite(clock) if several else slice(None)
        one = series.setdefault(name, _Series())
        unit = _at(header, "Y_Unit_Label", place)
        one.unit, one.step_s = unit_word(unit) or unit, layout.value(_at(header, "Delta_X", place))
        one.values.append(read[i][kept])
        one.clock.append(clock[kept])
    stated = map(Layout().value, header.get("Samples", ()))
    promised = int(max((v for v in stated if v is not None and v >= 1), default=1))
    lasting = sum(map(bool, rows))
    # under one heading, a multiple of them
    several_headings = (_at(about, "Multi_Headings", 0) or "No").casefold() != "no"
    return lasting < promised or (not several_headings and lasting % promised > 0)


def _channels(series: Mapping[str, _Series], several: bool) -> tuple[list[Channel], list[str]]:
    """The series, each with its rate, and the clocks; remarks on rates that are not so."""
    channels: list[Channel] = []
    notes: list[str] = []
    for i, (name, one) in enumerate(series.items()):
        clock, values = np.concatenate(one.clock), np.concatenate(one.values)
        rate = 1 / one.step_s if one.step_s else None
        if len(clock) > 2 and np.isfinite(clock).all():
            measured = rate_of(clock)
            if measured is None or rate is None or abs(measured / rate - 1) > 0.01:
                remark = "X_Value and the header agree on no rate"
                if rate and measured:
                    remark = f"the header says {rate:.6g} Hz, X_Value {measured:.6g} Hz"
                notes.append(f"{remark}: the column is believed")
                rate = measured
            if several or i == 0:
                called = f"{name}.{CLOCK}" if several else CLOCK
                channels.append(Channel(name=called, unit="s", rate_Hz=rate, values=clock))
        channels.append(Channel(name=name, unit=one.unit, rate_Hz=rate, values=values))
    return channels, notes


def _at(header: Header, key: str, i: int) -> str:
    values = header.get(key, ())
    return values[i].strip() if 0 <= i < len(values) else ""


def _is_lvm(head: bytes, name: str = "") -> bool:
    return head.lstrip(b"\xef\xbb\xbf").startswith(FIRST.encode())


READER = Reader(
    name="lvm",
    title="LabVIEW measurement text (LVM), one file per trial",
    recognises=_is_lvm,
    contents=contents,
)
