"""An inspected file as text and as JSON: format, channels, and the tables of a manifest for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.onboarding import grids, manifest
from nearlift.onboarding.inspection import Inspection
from nearlift.rounding import bytes_text

#: A series as a line of so many bars.
BARS = "\u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588"
WIDTH = 24
CUT = (
    "[segments] cuts it, and a row of trials.csv is then a record (`nearlift inspect --cuts"
    " CAMPAIGN` draws the cuts before anything is fitted)"
)
CODES = {
    "truncated": "the file ends within a line or a segment: it is cut off, or still being written",
    "dead_speed": "a rotor's speed reads zero while there is lift",
}


def sparkline(values: FloatArray) -> str:
    """The means of stretches of a series as bars; a gap where there is no number."""
    if len(values) == 0:
        return ""
    parts = np.array_split(values, min(WIDTH, len(values)))
    means = np.array(
        [np.mean(p[np.isfinite(p)]) if np.isfinite(p).any() else np.nan for p in parts]
    )
    known = means[np.isfinite(means)]
    low, span = (float(known.min()), float(np.ptp(known))) if len(known) else (0.0, 0.0)
    # a constant is drawn in the middle
    place = np.where(np.isfinite(means), (means - low) / span if span > 0 else 0.5, 0)
    return "".join(
        " " if not np.isfinite(m) else BARS[min(int(p * len(BARS)), len(BARS) - 1)]
        for m, p in zip(means, place, strict=True)
    )


def channel_rows(inspected: Inspection) -> list[tuple[str, ...]]:
    """The channels as rows of a table."""
    rows: list[tuple[str, ...]] = [
        ("channel", "unit", "samples", "rate, Hz", "lowest", "highest", "")
    ]
    for c in inspected.contents.channels:
        known = c.values[np.isfinite(c.values)]
        low, high = (f"{known.min():.6g}", f"{known.max():.6g}") if len(known) else ("-", "-")
        rate = f"{c.rate_Hz:.6g}" if c.rate_Hz else "-"
        values = str(len(c.values)), rate, low, high, sparkline(c.values)
        rows.append((c.name, c.unit or "-", *values))
    return rows


def notes(inspected: Inspection) -> list[str]:
    """Remarks for the user."""
    said = list(inspected.contents.notes)
    for c in inspected.contents.channels:
        lost = int(np.count_nonzero(~np.isfinite(c.values)))
        if 0 < lost < len(c.values):
            said.append(
                f"{lost} of {len(c.values)} samples of {c.name!r} hold no number (blank, NaN, OVER,"
                " #NV or the like)"
            )
    said += [words for code, words in CODES.items() if code in inspected.contents.codes]
    if inspected.doubt:
        said.append(inspected.doubt)
    if inspected.wraps:
        said.append(
            f"the force jumps by {inspected.wraps:.6g} from one sample to the next and stays there:"
            " a counter of the converter that wraps, and no force"
        )
    if inspected.ramp is not None:
        said.append(f"the record {inspected.ramp.words}; {CUT}")
    if inspected.table is None:
        said += [
            f"{channel.name!r} may be the {name}: `nearlift new DIR --from FILES` takes it along"
            for name, (channel, _) in inspected.further.items()
        ]
    return said


def padded(rows: Sequence[Sequence[str]]) -> list[str]:
    """A line for each row, in columns; the last cell is as long as it is."""
    *wide, _ = (max(map(len, column)) for column in zip(*rows, strict=True))
    return [
        "  ".join((*(cell.ljust(w) for cell, w in zip(row, wide, strict=False)), row[-1])).rstrip()
        for row in rows
    ]


def described(inspected: Inspection) -> str:
    """The whole answer as text."""
    rows = padded(channel_rows(inspected))
    about = f"{inspected.path}: {inspected.contents.kind}, {bytes_text(inspected.bytes)}"
    lines = [about, *(f"  {row}" for row in rows), *(f"note: {note}" for note in notes(inspected))]
    return "\n".join(line.rstrip() for line in lines) + "\n\n" + block(inspected)


def block(inspected: Inspection) -> str:
    """The tables of a manifest for the file."""
    if inspected.grid is not None:
        return grids.piv_block(inspected.grid, inspected.path)
    if (table := inspected.table) is None:
        return manifest.records_tables([inspected], cell=False)
    schedule = table.schedule(table.row_ids(), means=table.means)
    other = [
        f"{table.names[place]} -> {name}"
        for name, (place, _) in table.meant.items()
        if table.names[place] != name
    ]
    what = "FILE" if table.means else "RECORDS FILE"
    how = f"# `nearlift new DIR --from {what}` makes trials.csv of it ({', '.join(other)})\n"
    trials = manifest.trials_table(schedule)
    return f"{manifest.MEANS if table.means else ''}\n{how if other else ''}{trials}".lstrip()


def as_json(inspected: Inspection) -> dict[str, Any]:
    """The answer for machines."""
    return {
        "file": str(inspected.path),
        "reader": inspected.reader,
        "kind": inspected.contents.kind,
        "bytes": inspected.bytes,
        "codes": list(inspected.contents.codes),
        "notes": notes(inspected),
        "channels": [
            {
                "name": c.name,
                "unit": c.unit,
                "samples": len(c.values),
                "rate_Hz": c.rate_Hz,
                "lowest": float(np.nanmin(c.values)) if np.isfinite(c.values).any() else None,
                "highest": float(np.nanmax(c.values)) if np.isfinite(c.values).any() else None,
            }
            for c in inspected.contents.channels
        ],
        "force": inspected.force.name if inspected.force else None,
        "sweep": None if inspected.ramp is None else inspected.ramp.words,
        "piv": None if inspected.grid is None else inspected.grid.format,
        "means": inspected.table is not None and inspected.table.means,
        "records": block(inspected),
    }
