"""What a file holds: format, channels, and the tables of a manifest for it."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from nearlift.commands.common import DIALECT, Call, declared, dialect_of, padded
from nearlift.commands.inspection import Inspection, inspect
from nearlift.commands.manifest_tables import block
from nearlift.declare import FloatArray
from nearlift.errors import UsageError
from nearlift.run.lock import size

#: A series as a line of bars, so wide.
BARS = "\u2581\u2582\u2583\u2584\u2585\u2586\u2587\u2588"
WIDTH = 24
#: What to do with a record of many lifts.
CUT = (
    "[segments] cuts it, and a row of trials.csv is then a record (`nearlift inspect --cuts"
    " CAMPAIGN` draws the cuts before anything is fitted)"
)


def sparkline(values: FloatArray) -> str:
    """The mean of each of so many stretches of a series as bars; a gap where there is no number."""
    if len(values) == 0:
        return ""
    parts = np.array_split(values, min(WIDTH, len(values)))
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


def described(inspected: Inspection) -> str:
    """The whole answer as text."""
    lines = [f"{inspected.path}: {inspected.contents.kind}, {size(inspected.bytes)}"]
    rows = [("channel", "unit", "samples", "rate, Hz", "lowest", "highest", "")]
    for c in inspected.contents.channels:
        known = c.values[np.isfinite(c.values)]
        low, high = (f"{known.min():.6g}", f"{known.max():.6g}") if len(known) else ("-", "-")
        rate = f"{c.rate_Hz:.6g}" if c.rate_Hz else "-"
        values = str(len(c.values)), rate, low, high, sparkline(c.values)
        rows.append((c.name, c.unit or "-", *values))
    lines += [f"  {line}" for line in padded(rows)]
    lines += [f"note: {note}" for note in inspected.contents.notes]
    for c in inspected.contents.channels:
        lost = int(np.count_nonzero(~np.isfinite(c.values)))
        if 0 < lost < len(c.values):
            lines.append(
                f"note: {lost} of {len(c.values)} samples of {c.name!r} hold no number (blank, NaN,"
                " OVER, #NV or the like)"
            )
    if "truncated" in inspected.contents.codes:
        lines.append(
            "note: the file ends within a line or a segment: it is cut off, or still being written"
        )
    if "dead_speed" in inspected.contents.codes:
        lines.append("note: a rotor's speed reads zero while there is lift")
    if inspected.doubt:
        lines.append(f"note: {inspected.doubt}")
    if inspected.ramp is not None:
        lines.append(f"note: the record {inspected.ramp.words}; {CUT}")
    return "\n".join(line.rstrip() for line in lines) + "\n\n" + block(inspected)


def as_json(inspected: Inspection) -> dict[str, object]:
    """The same for machines."""
    return {
        "file": str(inspected.path),
        "reader": inspected.reader,
        "kind": inspected.contents.kind,
        "bytes": inspected.bytes,
        "codes": list(inspected.contents.codes),
        "notes": list(inspected.contents.notes),
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


@declared("inspect")
@click.argument(
    "files", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="FILE..."
)
@DIALECT
@click.option(
    "--cuts",
    is_flag=True,
    help=(
        "Instead: cut records by [segments] of the manifest and draw them to"
        " reports/NAME/segments.png. FILE is a campaign's folder or one of its records."
    ),
)
def command(call: Call, files: tuple[Path, ...], dialect: str, cuts: bool) -> None:
    """Print channels, sparklines and the block to paste; or draw the cuts."""
    if cuts:
        from nearlift.commands.cuts import answer

        if dialect:
            raise UsageError(
                "--dialect", "was given with --cuts", "write it under [records] of the manifest"
            )
        answer(call, files)
        return
    inspected = [inspect(file, dialect_of(dialect)) for file in files]
    call.answers("files", [(as_json(one), described(one)) for one in inspected])
