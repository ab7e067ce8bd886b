"""LVM, LabVIEW's measurement text, by an own parser that runs nothing and believes little.

Two headers: one of the file, one for each segment. The rate in a segment's header (`Delta_X`) is a
claim, held against the column `X_Value` where there is one; the number of `Samples` tells a cut
file. Segments of one file are joined. A channel is called as in the file; where every channel has
its own clock, that is ``NAME.X_Value``.
"""

from __future__ import annotations

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
from nearlift.readers.dialect import HEAD, encoding_of
from nearlift.readers.files import content_of
from nearlift.readers.table import no_nul, number, value_of

FIRST = "LabVIEW Measurement"
END = "***End_of_Header***"
CLOCK = "X_Value"


@dataclass(kw_only=True)
class _Series:
    """One channel as it grows."""

    unit: str = ""
    step_s: float | None = None
    values: list[float] = field(default_factory=list)
    clock: list[float] = field(default_factory=list)


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
    lines = enumerate(text.split("\n"), start=1)
    last = text.count("\n") + 1
    return _Parser(str(path), names).read((at, line.rstrip("\r"), at < last) for at, line in lines)


class _Parser:
    """Header, segment header, columns' names, rows; and again."""

    def __init__(self, where: str, names: Names) -> None:
        self.where, self.names = where, names
        self.separator, self.decimal = "\t", ""
        self.about: dict[str, str] = {}
        self.series: dict[str, _Series] = {}
        self.cut = False
        self.notes: list[str] = []

    def refuse(self, at: int, what: str) -> InputRefused:
        return InputRefused(
            f"{self.where}, line {at}",
            what,
            "the file is damaged, or of a dialect not known: export it again from LabVIEW",
        )

    def read(self, lines: Iterator[tuple[int, str, bool]]) -> Contents:
        self._file_header(lines)
        segment: dict[str, list[str]] = {}
        columns: list[str] = []
        state, rows, special = "head", 0, False
        for at, line, ended in lines:
            if special or line.startswith("***Start_Special***"):
                special = not line.startswith("***End_Special***")
                continue
            if not ended:
                # a number may be cut within its digits
                self.cut = bool(line.strip(" \t"))
                break
            if state == "rows" and line.startswith("Channels" + self.separator):
                self._count(segment, rows)
                segment, state, rows = {}, "head", 0
            if state == "head":
                if line.startswith(END):
                    state = "names"
                elif line.strip():
                    key, *values = line.split(self.separator)
                    segment[key.strip()] = values
            elif state == "names":
                if line.strip():
                    columns = self._columns(at, line, segment)
                    state = "rows"
            elif line.strip(" \t,"):
                self._row(at, line, columns)
                rows += 1
        if state == "rows":
            self._count(segment, rows)
        return self._contents()

    def _file_header(self, lines: Iterator[tuple[int, str, bool]]) -> None:
        for at, line, ended in lines:
            if line.startswith(END):
                break
            if not ended:
                self.cut = True
                return
            key, _, value = line.partition("\t" if "\t" in line else ",")
            if at > 200:
                raise self.refuse(at, f"has no {END} in its first 200 lines")
            self.about[key.strip()] = value.strip()
        self.separator = "," if self.about.get("Separator", "").casefold() == "comma" else "\t"
        stated = self.about.get("Decimal_Separator", "")
        if stated not in ("", ".", ","):
            raise self.refuse(1, f"states the decimal separator {stated!r}")
        self.decimal = stated

    def _columns(self, at: int, line: str, segment: Mapping[str, Sequence[str]]) -> list[str]:
        columns = [name.strip() for name in line.split(self.separator)]
        while columns and not columns[-1]:
            columns.pop()
        if not columns or columns[0] != CLOCK:
            raise self.refuse(
                at, f"names the columns {line.strip()[:80]!r}; the first should be {CLOCK}"
            )
        channels = [name for name in columns if name not in (CLOCK, "Comment")]
        if len(set(channels)) != len(channels) or "" in channels:
            raise self.refuse(at, "names two columns alike, or one not at all")
        if not self.decimal:
            numbers = "".join(c for key in ("X0", "Delta_X") for c in segment.get(key, ()))
            self.decimal = "," if "," in numbers and "." not in numbers else "."
        several_clocks = columns.count(CLOCK) > 1
        for i, name in enumerate(channels):
            series = self.series.setdefault(name, _Series())
            # each channel has a clock before it, or all have one
            place = columns.index(name) - 1 if several_clocks else i
            unit = _at(segment, "Y_Unit_Label", place)
            series.unit = unit_word(unit) or unit
            series.step_s = value_of(_at(segment, "Delta_X", place), self.decimal)
        return columns

    def _row(self, at: int, line: str, columns: Sequence[str]) -> None:
        cells = [cell.strip() for cell in line.split(self.separator)]
        place = f"{self.where}, line {at}"
        no_nul(line, place)
        least = len(columns) - (columns[-1] == "Comment")
        if len(cells) < least or any(cells[len(columns) :]):
            raise self.refuse(at, f"has {len(cells)} cells under {len(columns)} columns")
        clock = np.nan
        several_clocks = list(columns).count(CLOCK) > 1
        for name, cell in zip(columns, cells, strict=False):
            if name == "Comment":
                continue
            if name == CLOCK:
                clock = number(cell, place, CLOCK, self.decimal)
                continue
            # channels with clocks of their own end at different rows
            if several_clocks and not cell and np.isnan(clock):
                continue
            self.series[name].values.append(number(cell, place, name, self.decimal))
            self.series[name].clock.append(clock)

    def _count(self, segment: Mapping[str, Sequence[str]], rows: int) -> None:
        """Whether a segment has its header's samples; under one heading, a multiple of them."""
        stated = map(value_of, segment.get("Samples", ()))
        promised = [value for value in stated if value is not None and value >= 1]
        if not promised:
            return
        usual = int(max(promised))
        several = self.about.get("Multi_Headings", "No").casefold() == "no"
        if rows < usual or (several and rows % usual):
            self.cut = True

    def _contents(self) -> Contents:
        channels: list[Channel] = []
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
                    self.notes.append(f"{remark}: the column is believed")
                    rate = measured
                if not one or i == 0:
                    called = CLOCK if one else f"{name}.{CLOCK}"
                    channels.append(Channel(name=called, unit="s", rate_Hz=rate, values=clock))
            channels.append(
                Channel(name=name, unit=series.unit, rate_Hz=rate, values=np.array(series.values))
            )
        chosen = tuple(c for c in channels if wanted(c.name, self.names))
        codes = ["truncated"] if self.cut else []
        codes += [] if channels else ["NO_DATA"]
        return Contents(
            channels=chosen or tuple(channels),
            kind="LVM",
            codes=tuple(codes),
            notes=tuple(dict.fromkeys(self.notes)),
        )


def _at(segment: Mapping[str, Sequence[str]], key: str, i: int) -> str:
    values = segment.get(key, ())
    return values[i].strip() if 0 <= i < len(values) else ""


READER = Reader(
    name="lvm",
    title="LabVIEW measurement text (LVM), one file per trial",
    recognises=lambda head, name: head.lstrip(b"\xef\xbb\xbf").startswith(FIRST.encode()),
    contents=contents,
)
