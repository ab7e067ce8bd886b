"""An inspected file as text and as JSON: format, channels, and the tables of a manifest for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import tomlkit

from nearlift.declare import FloatArray
from nearlift.onboarding import proposal
from nearlift.onboarding.grids import piv_section
from nearlift.onboarding.inspection import Inspection
from nearlift.rounding import bytes_text

#: A series as a line of so many bars.
BARS = "\u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588"
WIDTH = 24
CODES = {
    "truncated": "the file ends within a line or a segment: it is cut off, or still being written",
    "dead_speed": "a rotor's speed reads zero while there is lift",
}


def sparkline(values: FloatArray) -> str:
    """The means of stretches of a series as bars; a gap where there is no number."""
    parts = np.array_split(values, min(WIDTH, len(values))) if len(values) else []
    means = np.array([_mean(part) for part in parts])
    known = means[np.isfinite(means)]
    low, span = (float(known.min()), float(np.ptp(known))) if len(known) else (0.0, 0.0)
    # a constant is drawn in the middle
    place = np.where(np.isfinite(means), (means - low) / span if span > 0 else 0.5, np.nan)
    return "".join(
        BARS[min(int(p * len(BARS)), len(BARS) - 1)] if np.isfinite(p) else " " for p in place
    )


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else np.nan


def channels(inspected: Inspection) -> list[dict[str, Any]]:
    """The channels: name, unit, samples, rate and range."""
    return [
        {
            "name": c.name,
            "unit": c.unit,
            "samples": len(c.values),
            "rate_Hz": c.rate_Hz,
            "lowest": float(np.nanmin(c.values)) if np.isfinite(c.values).any() else None,
            "highest": float(np.nanmax(c.values)) if np.isfinite(c.values).any() else None,
        }
        for c in inspected.contents.channels
    ]


def _lines(inspected: Inspection) -> list[str]:
    """The channels as a table with a line each."""
    rows: list[tuple[str, ...]] = [("channel", "unit", "samples", "rate, Hz", "lowest", "highest")]
    for c in channels(inspected):
        numbers = (c["rate_Hz"], c["lowest"], c["highest"])
        shown = ("-" if n is None else f"{n:.6g}" for n in numbers)
        rows.append((c["name"], c["unit"] or "-", str(c["samples"]), *shown))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    cells = ("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows)
    bars = ["", *(sparkline(c.values) for c in inspected.contents.channels)]
    return [f"  {line}  {bar}".rstrip() for line, bar in zip(cells, bars, strict=True)]


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
    said += [inspected.doubt] if inspected.doubt else []
    if inspected.wraps:
        said.append(
            f"the force jumps by {inspected.wraps:.6g} from one sample to the next and stays there:"
            " a counter of the converter that wraps, and no force"
        )
    if inspected.ramp is not None:
        said.append(
            f"the record {inspected.ramp.words}; [segments] cuts it, and a row of trials.csv is"
            " then a record (`nearlift inspect --cuts CAMPAIGN` draws the cuts before anything is"
            " fitted)"
        )
    if inspected.table is None:
        said += [
            f"{channel.name!r} may be the {name}: `nearlift new DIR --from FILES` takes it along"
            for name, (channel, _) in inspected.further.items()
        ]
    return said


def block(inspected: Inspection) -> str:
    """The tables of a manifest for the file."""
    if inspected.grid is not None:
        return piv_section(inspected.grid, inspected.path)
    if (table := inspected.table) is None:
        return tomlkit.dumps(proposal.for_records([inspected], cell=False))
    schedule = table.schedule(table.row_ids(), means=table.means)
    other = [
        f"{table.names[place]} -> {name}"
        for name, (place, _) in table.meant.items()
        if table.names[place] != name
    ]
    what = "FILE" if table.means else "RECORDS FILE"
    how = f"# `nearlift new DIR --from {what}` makes trials.csv of it ({', '.join(other)})\n"
    records = f"{tomlkit.dumps(proposal.for_means())}\n" if table.means else ""
    return f"{records}{how if other else ''}{tomlkit.dumps(proposal.for_trials(schedule))}"


def described(inspected: Inspection) -> str:
    """The whole answer as text."""
    about = f"{inspected.path}: {inspected.contents.kind}, {bytes_text(inspected.bytes)}"
    lines = [about, *_lines(inspected), *(f"note: {note}" for note in notes(inspected))]
    return "\n".join(lines) + "\n\n" + block(inspected)


def as_json(inspected: Inspection) -> dict[str, Any]:
    """The answer for machines."""
    return {
        "file": str(inspected.path),
        "reader": inspected.reader,
        "kind": inspected.contents.kind,
        "bytes": inspected.bytes,
        "codes": list(inspected.contents.codes),
        "notes": notes(inspected),
        "channels": channels(inspected),
        "force": inspected.force.name if inspected.force else None,
        "sweep": None if inspected.ramp is None else inspected.ramp.words,
        "piv": None if inspected.grid is None else inspected.grid.format,
        "means": inspected.table is not None and inspected.table.means,
        "records": block(inspected),
    }
