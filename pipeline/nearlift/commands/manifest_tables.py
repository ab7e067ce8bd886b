"""The tables of a manifest for a record, a velocity grid or a table of trials."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from nearlift.commands import grids, meaning
from nearlift.commands.inspection import Inspection
from nearlift.commands.tables import Table
from nearlift.readers.channel import AS_FORCE, FORCE_UNITS, Channel

#: [records] of a table of means.
MEANS = '[records]\nreader = "means"                     # mean lifts in the schedule, no samples\n'


def block(inspected: Inspection) -> str:
    """The tables of a manifest for the file."""
    if inspected.grid is not None:
        return grids.piv_block(inspected.grid, inspected.path)
    if inspected.table is not None:
        return trials_block(inspected.table)
    return records_block(inspected)


def _clock(channel: Channel) -> str:
    column = json.dumps(channel.name, ensure_ascii=False)
    return f'time   = {{ column = {column}, unit = "{channel.unit or "FILL IN"}" }}'


def trials_block(table: Table) -> str:
    """[trials] of a table of trials, [records] of mean lifts, and how columns are to be called."""
    _, section = table.schedule(table.row_ids(), means=table.means)
    other = [
        f"{table.names[place]} -> {name}"
        for name, (place, _) in table.meant.items()
        if table.names[place] != name
    ]
    what = "FILE" if table.means else "RECORDS FILE"
    how = f"# `nearlift new DIR --from {what}` makes trials.csv of it ({', '.join(other)})\n"
    return f"{MEANS if table.means else ''}\n{how if other else ''}{section}".lstrip()


def records_block(inspected: Inspection, files: str | None = None) -> str:
    """[load_cell] and [records] of a manifest, with what cannot be known marked FILL IN."""
    pattern = (
        files
        if files is not None
        else inspected.path.name
        if inspected.reader == "parquet"
        else f"{{{'trial' if inspected.ramp is None else 'record'}}}{inspected.path.suffix}"
    )
    force, clock, doubt = inspected.force, inspected.clock, inspected.doubt
    channels = inspected.contents.channels
    rates = {c.rate_Hz for c in ([force] if force is not None else channels)}
    rate = rates.pop() if len(rates) == 1 else None
    why = "the file does not say" if rates <= {None} else "that of the force: the channels differ"
    lines = [
        "[load_cell]",
        (
            f'sample_rate = "{rate:.6g} Hz"'
            if rate and not doubt
            else f'sample_rate = "FILL IN Hz"           # {doubt or why}'
        ),
        (
            'tare        = "FILL IN s"            # rotors-stopped head of every record; "0 s":'
            ' already tared; "none": nobody knows'
        ),
        "",
        "[records]",
        f'reader = "{inspected.reader}"',
        f"files  = {json.dumps(pattern, ensure_ascii=False)}",
    ]
    if force is None:
        names = ", ".join(c.name for c in channels[:8])
        lines.append(
            f'force  = {{ column = "FILL IN", unit = "FILL IN", sign = 1 }}   # one of: {names}'
        )
    else:
        unit = AS_FORCE.get(force.unit, force.unit)
        column = json.dumps(force.name, ensure_ascii=False)
        if unit == "count":
            lines.append(
                f'force  = {{ column = {column}, unit = "count", sign = 1, calibration = {{ gain ='
                ' "FILL IN mN/count", offset = "FILL IN count" } }'
            )
        else:
            remarks = [] if unit in FORCE_UNITS else ["the file does not say the unit"]
            known = force.values[np.isfinite(force.values)]
            if len(known) and -float(known.min()) > 3 * abs(float(known.max())):
                remarks.append("sign = -1 if lift makes these numbers negative")
            remark = "   # " + "; ".join(remarks) if remarks else ""
            lines.append(
                f"force  = {{ column = {column}, unit ="
                f' "{unit if unit in FORCE_UNITS else "FILL IN"}", sign = 1 }}{remark}'
            )
    named = {"columns": [c.name for c in channels]} if inspected.columns else {}
    if dialect := {**inspected.dialect, **named}:
        # texts, whole numbers, booleans and lists of texts are the same in JSON
        items = ", ".join(
            f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in dialect.items()
        )
        lines.append(
            f"dialect = {{ {items} }}"
            + ("   # the file names none: FILL IN what they are" if named else "")
        )
    # a clock whose unit cannot be right is left out
    if clock is not None and clock is not force and not doubt:
        seconds = None if clock.unit else meaning.clock_rate(replace(clock, unit="s"))
        remark = f"   # in s the rate is {seconds:.6g} Hz" if seconds else ""
        lines.append(_clock(clock) + remark)
    cut = "" if inspected.ramp is None or files is not None else f"\n{inspected.ramp.segments}"
    return "\n".join(lines) + "\n" + cut
