"""LVM, LabVIEW's measurement text, by an own parser that runs nothing and believes little.

Two headers: one of the file, one for each segment. The rate in a segment's header (`Delta_X`) is
compared with the column `X_Value` where there is one. The number of `Samples` shows a cut file.
Segments of one file are joined. A channel is called as in the file; where every channel has its own
clock, that is ``NAME.X_Value``.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers import base
from nearlift.readers.dialect import UNSTATED
from nearlift.readers.files import content_of
from nearlift.readers.table import Layout, Lines, parse
from nearlift.readers.text import plain

FIRST = "LabVIEW Measurement"
END = "***End_of_Header***"
CLOCK, COMMENT = "X_Value", "Comment"

#: The cells behind the keys of a header.
Header = Mapping[str, Sequence[str]]
#: The parts of a series, one for each segment: its clock, and its values with the stated rate.
Parts = list[tuple[base.Channel, base.Channel]]


def contents(path: Path, dialect: base.RecordsDialect, names: base.Names) -> base.Contents:
    """The channels of an LVM file; `InputRefused` of another file, or of a bad line."""
    content, where = content_of(path), str(path)
    if not content.strip(b"\0"):
        return base.Contents(kind="LVM", codes=("EMPTY",))
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
    separator = "," if _cell(about, "Separator").casefold() == "comma" else "\t"
    series: dict[str, Parts] = defaultdict(list)
    starts = [i for i in range(at, len(lines)) if lines[i].startswith(f"Channels{separator}")]
    # a number may be cut within its digits
    cut = text.cut or not starts
    for start, end in itertools.pairwise([*starts, len(lines)]):
        cut |= _read_segment(lines[:end], start, separator, about, series, where)
    own_clocks = _cell(about, "X_Columns").casefold() == "multi"
    channels: list[base.Channel] = []
    notes: list[str] = []
    for i, (name, parts) in enumerate(series.items()):
        clock, values = (
            np.concatenate([c.values for c in half]) for half in zip(*parts, strict=True)
        )
        rate, shown = parts[-1][1].rate_Hz, len(clock) > 2 and np.isfinite(clock).all()
        if shown:
            rate, note = _believed(rate, base.rate_of(clock))
            notes.append(note)
        if shown and (own_clocks or i == 0):
            called = f"{name}.{CLOCK}" if own_clocks else CLOCK
            channels.append(base.Channel(name=called, unit="s", rate_Hz=rate, values=clock))
        unit = parts[-1][1].unit
        channels.append(base.Channel(name=name, unit=unit, rate_Hz=rate, values=values))
    return base.Contents(
        channels=tuple(channels),
        kind="LVM",
        codes=("truncated",) * cut + ("NO_DATA",) * (not channels),
        notes=tuple(filter(None, dict.fromkeys(notes))),
    )


def _believed(stated: float | None, measured: float | None) -> tuple[float | None, str]:
    """The rate in the header if the clock has it, else the clock's, with a note."""
    if stated and measured and abs(measured / stated - 1) <= 0.01:
        return stated, ""
    remark = "X_Value and the header agree on no rate"
    if stated and measured:
        remark = f"the header says {stated:.6g} Hz, X_Value {measured:.6g} Hz"
    return measured, f"{remark}: the column is believed"


def _refusal(where: str, at: int, what: str) -> InputRefused:
    remedy = "the file is damaged, or of a dialect not known: export it again from LabVIEW"
    return InputRefused(f"{where}, line {at + 1}", what, remedy)


def _header(lines: Sequence[str], at: int, separator: str) -> tuple[Header, int]:
    """A header's keys, and the index of the line behind its end."""
    end = next((i for i in range(at, len(lines)) if lines[i].startswith(END)), len(lines))
    cells = (line.split(separator) for line in lines[at:end])
    return {key.strip(): values for key, *values in cells}, end + 1


def _cell(header: Header, key: str, i: int = 0) -> str:
    return "".join(header.get(key, ())[i : i + 1]).strip()


def _read_segment(
    lines: Sequence[str],
    start: int,
    separator: str,
    about: Header,
    series: dict[str, Parts],
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
    decimal = _cell(about, "Decimal_Separator") or usual
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
    # each channel has a clock before it and its own end, or all have the first
    several = columns.count(CLOCK) > 1
    places = [i for i in range(count) if columns[i] != CLOCK]
    for k, i in enumerate(places):
        clock, values = read[max(j for j in range(i) if columns[j] == CLOCK)], read[i]
        kept = np.isfinite(values) | np.isfinite(clock) if several else slice(None)
        place = i - 1 if several else k
        unit, step = _cell(header, "Y_Unit_Label", place), _cell(header, "Delta_X", place)
        one = base.Channel(
            name=columns[i],
            unit=base.unit_word(unit) or unit,
            rate_Hz=1 / step_s if (step_s := layout.value(step)) else None,
            values=values[kept],
        )
        series[columns[i]].append((base.Channel(name=CLOCK, values=clock[kept]), one))
    stated = map(Layout().value, header.get("Samples", ()))
    promised = int(max((v for v in stated if v is not None and v >= 1), default=1))
    lasting = sum(map(bool, rows))
    # under one heading, a multiple of them
    several_headings = (_cell(about, "Multi_Headings") or "No").casefold() != "no"
    return lasting < promised or (not several_headings and lasting % promised > 0)


def _is_lvm(head: bytes, name: str = "") -> bool:
    return head.lstrip(b"\xef\xbb\xbf").startswith(FIRST.encode())


READER = base.Reader(
    name="lvm",
    title="LabVIEW measurement text (LVM), one file per trial",
    recognises=_is_lvm,
    contents=contents,
)
