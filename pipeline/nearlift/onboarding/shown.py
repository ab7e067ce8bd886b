"""An inspected file as text and as JSON: format, channels, and the tables of a manifest for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import tomlkit

from nearlift.declare import FloatArray
from nearlift.onboarding import proposal
from nearlift.onboarding.inspection import Inspection
from nearlift.rounding import bytes_text

#: Signs of a sparkline, from low to high, and its length.
BARS, WIDTH = "\u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588", 24
CODES = {
    "truncated": "the file ends within a line or a segment: it is cut off, or still being written",
    "dead_speed": "a rotor's speed reads zero while there is lift",
}


def sparkline(values: FloatArray) -> str:
    """Means of stretches of a series as bars; a gap where there is no number."""
    stretches = np.array_split(values, min(WIDTH, len(values))) if len(values) else []
    known = [part[np.isfinite(part)] for part in stretches]
    means = [float(part.mean()) if len(part) else None for part in known]
    low = min((m for m in means if m is not None), default=0.0)
    span = max((m for m in means if m is not None), default=0.0) - low
    # a constant is drawn in the middle
    steps = [None if m is None else (m - low) / span if span > 0 else 0.5 for m in means]
    return "".join(" " if s is None else BARS[min(int(s * len(BARS)), 7)] for s in steps)


def channels(inspected: Inspection) -> list[dict[str, Any]]:
    """Channels: name, unit, samples, rate and range."""
    rows = []
    for c in inspected.contents.channels:
        known = c.values[np.isfinite(c.values)]
        ends = (float(known.min()), float(known.max())) if len(known) else (None, None)
        row = {"name": c.name, "unit": c.unit, "samples": len(c.values), "rate_Hz": c.rate_Hz}
        rows.append({**row, "lowest": ends[0], "highest": ends[1]})
    return rows


def notes(inspected: Inspection) -> list[str]:
    """Remarks for the user."""
    contents, remarks = inspected.contents, list(inspected.contents.notes)
    for c in contents.channels:
        lost = int(np.count_nonzero(~np.isfinite(c.values)))
        if 0 < lost < len(c.values):
            remarks.append(
                f"{lost} of {len(c.values)} samples of {c.name!r} hold no number (blank, NaN, OVER,"
                " #NV or the like)"
            )
    remarks += [words for code, words in CODES.items() if code in contents.codes]
    remarks += [inspected.doubt] if inspected.doubt else []
    if inspected.wraps:
        remarks.append(
            f"the force jumps by {inspected.wraps:.6g} from one sample to the next and stays there:"
            " a counter of the converter that wraps, and no force"
        )
    if inspected.ramp is not None:
        remarks.append(
            f"the record {inspected.ramp.words}; [segments] cuts it, and a row of trials.csv is"
            " then a record (`nearlift inspect --cuts CAMPAIGN` draws the cuts before anything is"
            " fitted)"
        )
    if inspected.table is None:
        remarks += [
            f"{channel.name!r} may be the {name}: `nearlift new DIR --from FILES` takes it along"
            for name, (channel, _) in inspected.further.items()
        ]
    return remarks


def block(inspected: Inspection) -> str:
    """Tables of a manifest for the file."""
    if inspected.grid is not None:
        return inspected.grid.section
    if (table := inspected.table) is None:
        return tomlkit.dumps(proposal.for_records([inspected], cell=False))
    records = f"{tomlkit.dumps(proposal.for_means())}\n" if table.means else ""
    renamed = ", ".join(f"{h} -> {name}" for name, h in table.written.items() if h != name)
    if renamed:
        source = "FILE" if table.means else "RECORDS FILE"
        records += f"# `nearlift new DIR --from {source}` makes trials.csv of it ({renamed})\n"
    schedule = table.schedule(table.row_ids(), means=table.means)
    return records + tomlkit.dumps(proposal.for_trials(schedule))


def described(inspected: Inspection) -> str:
    """Whole answer as text."""
    size = bytes_text(inspected.path.stat().st_size)
    rows: list[tuple[str, ...]] = [("channel", "unit", "samples", "rate, Hz", "lowest", "highest")]
    for c in channels(inspected):
        numbers = (c["rate_Hz"], c["lowest"], c["highest"])
        shown = ("-" if n is None else f"{n:.6g}" for n in numbers)
        rows.append((c["name"], c["unit"] or "-", str(c["samples"]), *shown))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    bars = ["", *(sparkline(c.values) for c in inspected.contents.channels)]
    lines = [f"{inspected.path}: {inspected.contents.kind}, {size}"]
    for row, bar in zip(rows, bars, strict=True):
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        lines.append(f"  {'  '.join(cells)}  {bar}".rstrip())
    lines += [f"note: {note}" for note in notes(inspected)]
    return "\n".join(lines) + "\n\n" + block(inspected)


def as_json(inspected: Inspection) -> dict[str, Any]:
    """Answer for machines."""
    return {
        "file": str(inspected.path),
        "reader": inspected.reader,
        "kind": inspected.contents.kind,
        "bytes": inspected.path.stat().st_size,
        "codes": list(inspected.contents.codes),
        "notes": notes(inspected),
        "channels": channels(inspected),
        "force": inspected.force.name if inspected.force else None,
        "sweep": None if inspected.ramp is None else inspected.ramp.words,
        "piv": None if inspected.grid is None else inspected.grid.format,
        "means": inspected.table is not None and inspected.table.means,
        "records": block(inspected),
    }
