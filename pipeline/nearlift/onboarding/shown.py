"""An inspected file as text and as JSON: format, channels, and the tables of a manifest for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import tomlkit

from nearlift.onboarding import proposal
from nearlift.onboarding.inspection import Inspection
from nearlift.reduction import quality
from nearlift.rounding import bytes_text


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
    remarks += [quality.CODES[code] for code in contents.codes]
    if inspected.clock is not None and inspected.rows_per_stamp > 1:
        remarks.append(
            f"each time of {inspected.clock.name!r} has {inspected.rows_per_stamp} rows: several"
            " sensors in one file, of which keep one as a file of its own; or the clock is too"
            " coarse: state the rate"
        )
    remarks += [inspected.doubt] if inspected.doubt else []
    if inspected.wraps:
        remarks.append(
            f"the force jumps by {inspected.wraps:.6g} from one sample to the next:"
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
    return records + tomlkit.dumps(proposal.for_trials(table.schedule()))


def described(inspected: Inspection) -> str:
    """Whole answer as text."""
    size = bytes_text(inspected.path.stat().st_size)
    listed = pd.DataFrame(channels(inspected)).replace({"unit": {"": "-"}})
    listed = listed.astype({"rate_Hz": float, "lowest": float, "highest": float})
    listed.columns = ["channel", "unit", "samples", "rate, Hz", "lowest", "highest"]
    table = listed.to_string(index=False, na_rep="-", float_format="{:.6g}".format)
    lines = [f"{inspected.path}: {inspected.contents.kind}, {size}", table]
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
