"""LVM, LabVIEW's measurement text, by an own parser that runs nothing and believes little.

Two headers: one of the file, one for each segment. The rate in a segment's header (`Delta_X`) is
compared with the column `X_Value` where there is one. The number of `Samples` shows a cut file.
Segments of one file are joined. A channel is called as in the file; where every channel has its own
clock, that is ``NAME.X_Value``.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

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
from nearlift.readers.dialect import encoding_of
from nearlift.readers.files import content_of
from nearlift.readers.table import Layout, refuse_nul

FIRST = "LabVIEW Measurement"
END = "***End_of_Header***"
CLOCK, COMMENT = "X_Value", "Comment"
#: Bytes that show the encoding.
HEAD = 1 << 16
#: Lines within which the file's header ends.
LONGEST_HEADER = 200

#: The cells behind the keys of a segment's header.
Header = Mapping[str, Sequence[str]]


@dataclass(kw_only=True)
class _Series:
    """One channel as it grows, over all segments."""

    unit: str = ""
    step_s: float | None = None
    values: array[float] = field(default_factory=lambda: array("d"))
    clock: array[float] = field(default_factory=lambda: array("d"))


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of an LVM file; `InputRefused` of another file, or of a bad line."""
    content = content_of(path)
    head = content[:HEAD]
    if not head.strip(b"\0"):
        return Contents(kind="LVM", codes=("EMPTY",))
    if not head.lstrip(b"\xef\xbb\xbf").startswith(FIRST.encode()):
        raise InputRefused(
            f"{path}, line 1",
            f"is not {FIRST!r}: this is no LVM file",
            "`nearlift inspect FILE` says what it is",
        )
    encoding = encoding_of(head, str(path))
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        raise InputRefused(
            str(path),
            f"is not {encoding} text throughout",
            "the file is damaged; copy it again from the rig",
        ) from None
    log = _Log(str(path), text)
    channels, notes = log.channels()
    chosen = tuple(c for c in channels if wanted(c.name, names))
    return Contents(
        channels=chosen or tuple(channels),
        kind="LVM",
        codes=("truncated",) * log.cut + ("NO_DATA",) * (not channels),
        notes=tuple(dict.fromkeys(notes)),
    )


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Whole lines with their numbers, from 1; special blocks are left out."""
    special = False
    for at, line in enumerate(text.split("\n")[:-1], start=1):
        if special or line.startswith("***Start_Special***"):
            special = not line.startswith("***End_Special***")
        else:
            yield at, line.rstrip("\r")


class _Log:
    """The series of a file, and whether it was `cut` off."""

    def __init__(self, where: str, text: str) -> None:
        self.where = where
        self.about: dict[str, str] = {}
        self.series: dict[str, _Series] = {}
        # a number may be cut within its digits
        self.cut = bool(text[text.rfind("\n") + 1 :].strip(" \t\r"))
        self.separator, self.layout = "\t", Layout()
        lines = _lines(text)
        if self._file_header(lines):
            self._segments(lines)

    def refuse(self, at: int, what: str) -> InputRefused:
        return InputRefused(
            f"{self.where}, line {at}",
            what,
            "the file is damaged, or of a dialect not known: export it again from LabVIEW",
        )

    def _file_header(self, lines: Iterator[tuple[int, str]]) -> bool:
        """Whether the header has an end."""
        for at, line in lines:
            if line.startswith(END):
                break
            key, _, value = line.partition("\t" if "\t" in line else ",")
            if at > LONGEST_HEADER:
                raise self.refuse(at, f"has no {END} in its first {LONGEST_HEADER} lines")
            self.about[key.strip()] = value.strip()
        else:
            self.cut = True
            return False
        self.separator = "," if self.about.get("Separator", "").casefold() == "comma" else "\t"
        if (stated := self.about.get("Decimal_Separator", "")) not in ("", ".", ","):
            raise self.refuse(1, f"states the decimal separator {stated!r}")
        return True

    def _segments(self, lines: Iterator[tuple[int, str]]) -> None:
        header: dict[str, list[str]] = {}
        columns: list[str] = []
        ended, rows = False, 0
        for at, line in lines:
            if columns and line.startswith("Channels" + self.separator):
                self._count(header, rows)
                header, columns, ended, rows = {}, [], False, 0
            if not ended and line.startswith(END):
                ended = True
            elif columns and line.strip(" \t,"):
                self._row(at, line, columns)
                rows += 1
            elif line.strip() and ended and not columns:
                columns = self._columns(at, line, header)
            elif line.strip() and not ended:
                key, *values = line.split(self.separator)
                header[key.strip()] = values
        if columns:
            self._count(header, rows)

    def _columns(self, at: int, line: str, header: Header) -> list[str]:
        columns = [name.strip() for name in line.split(self.separator)]
        while columns and not columns[-1]:
            columns.pop()
        if not columns or columns[0] != CLOCK:
            named = line.strip()[:80]
            raise self.refuse(at, f"names the columns {named!r}; the first should be {CLOCK}")
        names = [name for name in columns if name not in (CLOCK, COMMENT)]
        if len(set(names)) != len(names) or "" in names:
            raise self.refuse(at, "names two columns alike, or one not at all")
        if not self.series:
            numbers = "".join(c for key in ("X0", "Delta_X") for c in header.get(key, ()))
            usual = "," if "," in numbers and "." not in numbers else "."
            self.layout = Layout(decimal=self.about.get("Decimal_Separator") or usual)
        for i, name in enumerate(names):
            series = self.series.setdefault(name, _Series())
            # each channel has a clock before it, or all have one
            place = columns.index(name) - 1 if columns.count(CLOCK) > 1 else i
            unit = _at(header, "Y_Unit_Label", place)
            series.unit = unit_word(unit) or unit
            series.step_s = self.layout.value(_at(header, "Delta_X", place))
        return columns

    def _row(self, at: int, line: str, columns: Sequence[str]) -> None:
        cells = [cell.strip() for cell in line.split(self.separator)]
        place = f"{self.where}, line {at}"
        refuse_nul(line, place)
        if len(cells) < len(columns) - (columns[-1] == COMMENT) or any(cells[len(columns) :]):
            raise self.refuse(at, f"has {len(cells)} cells under {len(columns)} columns")
        clock = np.nan
        several_clocks = columns.count(CLOCK) > 1
        for name, cell in zip(columns, cells, strict=False):
            if name == CLOCK:
                clock = self.layout.number(cell, place, CLOCK)
            # channels with clocks of their own end at different rows
            elif name != COMMENT and not (several_clocks and not cell and np.isnan(clock)):
                self.series[name].values.append(self.layout.number(cell, place, name))
                self.series[name].clock.append(clock)

    def _count(self, header: Header, rows: int) -> None:
        """Whether a segment has its header's samples; under one heading, a multiple of them."""
        stated = map(Layout().value, header.get("Samples", ()))
        promised = [value for value in stated if value is not None and value >= 1]
        if promised:
            usual = int(max(promised))
            several = self.about.get("Multi_Headings", "No").casefold() == "no"
            self.cut |= rows < usual or (several and rows % usual > 0)

    def channels(self) -> tuple[list[Channel], list[str]]:
        """The series, each with its rate, and the clocks; remarks on rates that are not so."""
        channels: list[Channel] = []
        notes: list[str] = []
        one = self.about.get("X_Columns", "One").casefold() != "multi"
        for i, (name, series) in enumerate(self.series.items()):
            clock = np.array(series.clock)
            rate = 1 / series.step_s if series.step_s else None
            if len(clock) > 2 and np.isfinite(clock).all():
                measured = rate_of(clock)
                if measured is None or rate is None or abs(measured / rate - 1) > 0.01:
                    remark = (
                        f"the header says {rate:.6g} Hz, X_Value {measured:.6g} Hz"
                        if rate and measured
                        else "X_Value has no steady rate that the header knows of"
                    )
                    notes.append(f"{remark}: the column is believed")
                    rate = measured
                if not one or i == 0:
                    called = CLOCK if one else f"{name}.{CLOCK}"
                    channels.append(Channel(name=called, unit="s", rate_Hz=rate, values=clock))
            values = np.array(series.values)
            channels.append(Channel(name=name, unit=series.unit, rate_Hz=rate, values=values))
        return channels, notes


def _at(header: Header, key: str, i: int) -> str:
    values = header.get(key, ())
    return values[i].strip() if 0 <= i < len(values) else ""


READER = Reader(
    name="lvm",
    title="LabVIEW measurement text (LVM), one file per trial",
    recognises=lambda head, name: head.lstrip(b"\xef\xbb\xbf").startswith(FIRST.encode()),
    contents=contents,
)
