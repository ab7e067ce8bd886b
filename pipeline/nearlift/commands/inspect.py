"""What a file holds: format, channels with unit, rate, range and a sparkline, and the [records]
block to paste into a manifest.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np

from nearlift import readers
from nearlift.commands.common import DIALECT, Call, declared
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError, UsageError, brief
from nearlift.manifest import toml
from nearlift.readers import child, csv_trial
from nearlift.readers.channel import (
    AS_FORCE,
    FORCE_UNITS,
    Channel,
    Contents,
    Malformed,
    fold,
    split_unit,
)
from nearlift.readers.dialect import NoNames
from nearlift.readers.per_file import Format
from nearlift.readers.text import TEXT, with_rate
from nearlift.run.lock import size

BARS = "\u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588"
WIDTH = 24
#: Words that a force channel is called by, the surest first.
FORCE_WORDS = (
    "thrust",
    "force fz",
    "lift",
    "load cell",
    "loadcell",
    "weight",
    "force",
    "kraft",
    "schub",
    "cell",
    "fz",
)
CLOCK_UNITS = ("s", "ms", "us")
HEAD = 1 << 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """One file's contents, the reader that reads it, and what may be the force and its clock;
    `columns` of a text that names none.
    """

    path: Path
    reader: str
    contents: Contents
    force: Channel | None
    clock: Channel | None
    bytes: int
    columns: int = 0
    dialect: Mapping[str, Any] = field(default_factory=dict)


def inspect(path: Path, dialect: Mapping[str, Any] | None = None) -> Found:
    """What a file holds; `dialect` as ``[records] dialect`` takes it.

    Raises
    ------
    InputRefused
        It is no regular file, is empty, damaged, or of no format known.
    ManifestError
        The dialect has a key that the file's format does not know.
    """
    said = dict(dialect or {})
    if not path.exists():
        raise InputRefused(str(path), "is missing", "name a file that an instrument wrote")
    if not path.is_file():
        raise InputRefused(
            str(path),
            "is not a regular file",
            "a record is a plain file, no folder, pipe or device",
        )
    length = path.stat().st_size
    if length == 0:
        raise InputRefused(str(path), "is empty", "it was never written, or the disk was full")
    with path.open("rb") as file:
        head = file.read(HEAD)
    columns = 0
    form = recognised(head, path.name)
    try:
        contents = _contents(form, path, said)
    except NoNames as refusal:
        # numbers without names: shown under names that say so
        columns = refusal.columns
        contents = _contents(
            form, path, {**said, "columns": [f"column {i + 1}" for i in range(columns)]}
        )
    force = likely_force(contents)
    clock = likely_clock(contents, force)
    reader = (
        csv_trial.READER.name
        if form is TEXT and not said and _plain_csv(path, force or contents.channels[0], clock)
        else form.name
    )
    return Found(
        path=path,
        reader=reader,
        contents=contents,
        force=force,
        clock=clock,
        bytes=length,
        columns=columns,
        dialect=said,
    )


def _plain_csv(path: Path, force: Channel, clock: Channel | None) -> bool:
    """Whether the stricter and faster reader of plain CSV reads the same numbers."""
    try:
        values, times, _ = csv_trial.parse(
            path.read_bytes(), str(path), force.name, clock.name if clock else None
        )
    except InputRefused:
        return False
    return np.array_equal(values, force.values, equal_nan=True) and (
        clock is None or (times is not None and np.array_equal(times, clock.values, equal_nan=True))
    )


def dialect_of(text: str) -> dict[str, Any]:
    """What a manifest would read of ``dialect = { text }``; the braces may stand there.

    Raises
    ------
    UsageError
        It is no TOML.
    """
    plain = text.strip()
    try:
        found: dict[str, Any] = toml.loads(
            b"dialect = " + (plain if plain.startswith("{") else f"{{ {plain} }}").encode(), "it"
        )["dialect"]
    except ManifestError as fault:
        remedy = """such as --dialect 'separator = "semicolon", decimal = ","'"""
        raise UsageError(
            "--dialect", f"{brief(repr(text))} is not as a manifest has it: {fault.what}", remedy
        ) from None
    return found


def recognised(head: bytes, name: str) -> Format:
    """The format of a file; text where no other claims it."""
    for reader in readers.readers():
        if reader.format is not None and reader.format.recognises(head, name.casefold()):
            return reader.format
    return TEXT


def _contents(form: Format, path: Path, dialect: Mapping[str, Any]) -> Contents:
    try:
        with child.source(form) as read:
            found = read(path, form.checked_dialect(dialect), None)
    except Malformed as fault:
        raise InputRefused(str(path), str(fault), "copy it anew from the rig") from None
    if not found.channels:
        raise InputRefused(
            str(path), "holds no channel of numbers", "it has a header and no samples, or only text"
        )
    return with_rate(found) if form is TEXT else found


def likely_force(contents: Contents) -> Channel | None:
    """The channel that may be the load cell: in a unit of force, or called so."""

    def rank(channel: Channel) -> int:
        plain = fold(split_unit(channel.name)[0])
        word = next((len(FORCE_WORDS) - i for i, w in enumerate(FORCE_WORDS) if w in plain), 0)
        if channel.unit in FORCE_UNITS:
            return 100 + word
        # a gram is a force only to what is called one
        return word if word and channel.unit in ("", "count", *AS_FORCE) else 0

    best = max(contents.channels, key=rank, default=None)
    if best is not None and rank(best):
        return best
    return contents.channels[0] if len(contents.channels) == 1 else None


def likely_clock(contents: Contents, force: Channel | None) -> Channel | None:
    """The channel that may be the clock of the force."""
    group = force.name.rpartition(".")[0] if force is not None and "." in force.name else ""
    clocks = [
        c
        for c in contents.channels
        if c.unit in ("", *CLOCK_UNITS)
        and fold(split_unit(c.name)[0].rsplit(".", 1)[-1]) in ("t", "time", "x_value", "zeit")
    ]
    own = [c for c in clocks if c.name.rpartition(".")[0] == group]
    return next(iter(own or clocks), None)


def sparkline(values: FloatArray, width: int = WIDTH) -> str:
    """The mean of each of so many stretches of a series, as bars; a gap where there is no
    number.
    """
    if len(values) == 0:
        return ""
    parts = np.array_split(values, min(width, len(values)))
    means = np.array(
        [np.mean(p[np.isfinite(p)]) if np.isfinite(p).any() else np.nan for p in parts]
    )
    known = means[np.isfinite(means)]
    low, span = (float(known.min()), float(np.ptp(known))) if len(known) else (0.0, 0.0)
    # what stands still is drawn in the middle
    place = np.where(np.isfinite(means), (means - low) / span if span > 0 else 0.5, 0)
    return "".join(
        " " if not np.isfinite(m) else BARS[min(int(p * len(BARS)), len(BARS) - 1)]
        for m, p in zip(means, place, strict=True)
    )


def described(found: Found) -> str:
    """The whole answer as text."""
    lines = [f"{found.path}: {found.contents.kind}, {size(found.bytes)}"]
    rows = [("channel", "unit", "samples", "rate, Hz", "lowest", "highest", "")]
    for c in found.contents.channels:
        known = c.values[np.isfinite(c.values)]
        low, high = (f"{known.min():.6g}", f"{known.max():.6g}") if len(known) else ("-", "-")
        rows.append(
            (
                c.name,
                c.unit or "-",
                str(len(c.values)),
                f"{c.rate_Hz:.6g}" if c.rate_Hz else "-",
                low,
                high,
                sparkline(c.values),
            )
        )
    widths = [max(len(row[i]) for row in rows) for i in range(6)]
    lines += [
        "  "
        + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=False))
        + "  "
        + row[6]
        for row in rows
    ]
    lines += [f"note: {note}" for note in found.contents.notes]
    for c in found.contents.channels:
        lost = int(np.count_nonzero(~np.isfinite(c.values)))
        if 0 < lost < len(c.values):
            lines.append(
                f"note: {lost} of {len(c.values)} samples of {c.name!r} hold no number (blank, NaN,"
                " OVER, #NV or the like)"
            )
    if "truncated" in found.contents.codes:
        lines.append(
            "note: the file ends within a line or a segment: it is cut off, or still being written"
        )
    if "dead_speed" in found.contents.codes:
        lines.append("note: a rotor's speed reads zero while there is lift")
    return "\n".join(line.rstrip() for line in lines) + "\n\n" + records_block(found)


def records_block(found: Found, files: str | None = None) -> str:
    """The [load_cell] and [records] tables of a manifest, with what cannot be known
    marked FILL IN.
    """
    pattern = (
        files
        if files is not None
        else (found.path.name if found.reader == "parquet" else f"{{trial}}{found.path.suffix}")
    )
    rates = {
        c.rate_Hz for c in ([found.force] if found.force is not None else found.contents.channels)
    }
    rate = rates.pop() if len(rates) == 1 else None
    why = "the file does not say" if rates <= {None} else "that of the force: the channels differ"
    lines = [
        "[load_cell]",
        (
            f'sample_rate = "{rate:.6g} Hz"'
            if rate
            else f'sample_rate = "FILL IN Hz"           # {why}'
        ),
    ]
    lines += [
        (
            'tare        = "FILL IN s"            # rotors-stopped head of every record; "0 s":'
            ' already tared; "none": nobody knows'
        ),
        "",
    ]
    lines += [
        "[records]",
        f'reader = "{found.reader}"',
        f"files  = {json.dumps(pattern, ensure_ascii=False)}",
    ]
    if found.force is None:
        names = ", ".join(c.name for c in found.contents.channels[:8])
        lines.append(
            f'force  = {{ column = "FILL IN", unit = "FILL IN", sign = 1 }}   # one of: {names}'
        )
    else:
        unit = AS_FORCE.get(found.force.unit, found.force.unit)
        column = json.dumps(found.force.name, ensure_ascii=False)
        if unit == "count":
            lines.append(
                f'force  = {{ column = {column}, unit = "count", sign = 1, calibration = {{ gain ='
                ' "FILL IN mN/count", offset = "FILL IN count" } }'
            )
        else:
            told = [] if unit in FORCE_UNITS else ["the file does not say the unit"]
            if _pulls_down(found.force):
                told.append("sign = -1 if lift makes these numbers negative")
            remark = "   # " + "; ".join(told) if told else ""
            lines.append(
                f"force  = {{ column = {column}, unit ="
                f' "{unit if unit in FORCE_UNITS else "FILL IN"}", sign = 1 }}{remark}'
            )
    named = {"columns": [c.name for c in found.contents.channels]} if found.columns else {}
    if dialect := {**found.dialect, **named}:
        # texts, whole numbers, booleans and lists of texts are the same in JSON
        items = ", ".join(
            f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in dialect.items()
        )
        lines.append(
            f"dialect = {{ {items} }}"
            + ("   # the file names none: FILL IN what they are" if named else "")
        )
    if found.clock is not None and found.clock is not found.force:
        lines.append(
            f"time   = {{ column = {json.dumps(found.clock.name, ensure_ascii=False)}, unit ="
            f' "{found.clock.unit or "FILL IN"}" }}'
        )
    return "\n".join(lines) + "\n"


def _pulls_down(force: Channel) -> bool:
    """Whether the force's largest numbers are negative."""
    known = force.values[np.isfinite(force.values)]
    return len(known) > 0 and -float(known.min()) > 3 * abs(float(known.max()))


def as_json(found: Found) -> dict[str, Any]:
    """The same for machines."""
    return {
        "file": str(found.path),
        "reader": found.reader,
        "kind": found.contents.kind,
        "bytes": found.bytes,
        "codes": list(found.contents.codes),
        "notes": list(found.contents.notes),
        "channels": [
            {
                "name": c.name,
                "unit": c.unit,
                "samples": len(c.values),
                "rate_Hz": c.rate_Hz,
                "lowest": float(np.nanmin(c.values)) if np.isfinite(c.values).any() else None,
                "highest": float(np.nanmax(c.values)) if np.isfinite(c.values).any() else None,
            }
            for c in found.contents.channels
        ],
        "force": found.force.name if found.force else None,
        "records": records_block(found),
    }


@declared("inspect")
@click.argument("file", type=click.Path(path_type=Path))
@DIALECT
def command(call: Call, file: Path, dialect: str) -> None:
    """Channels, sparklines and the block to paste."""
    found = inspect(file, dialect_of(dialect))
    call.answer(as_json(found), described(found))
