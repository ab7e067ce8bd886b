"""The schedule of all pieces of a campaign's records.

A row of trials.csv is a record. Its pieces share the row's boundary, distance and session, and so
the visit of the traverse. Columns that the pieces bring, such as throttle, are added to the row's,
and the result is checked as any schedule.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.campaign.manifest import Campaign
from nearlift.campaign.segments import Segments
from nearlift.declare import FloatArray
from nearlift.readers.segments import CutPiece
from nearlift.schedule import (
    BY_NAME,
    RECORD_COLUMN,
    RESERVED,
    Schedule,
    TextColumn,
    dimension_of,
    of_columns,
    read_columns,
    rename_records,
)


def schedule_of_trials(
    campaign: Campaign, root: Path, pieces: Mapping[str, Sequence[CutPiece]]
) -> Schedule:
    """The schedule of the pieces of every record; a record without pieces has one row.

    Covariates include `record`, `piece`, and the means of the records' further columns. Raises as
    `read_schedule` does.
    """
    assert campaign.segments is not None
    read, notes = read_columns(campaign, root)
    rows, bring = rename_records(campaign, root, read)
    ids = rows["trial"].stripped().tolist()
    cut = [
        (i, piece) for i, record in enumerate(ids) for piece in pieces.get(record) or [CutPiece()]
    ]
    columns = {
        name: replace(
            column,
            texts=[column.texts[i] for i, _ in cut],
            lines=[column.lines[i] for i, _ in cut] if column.lines else (),
        )
        for name, column in rows.items()
    }
    file, lines = columns["trial"].file, columns["trial"].lines
    records = [ids[i] for i, _ in cut]
    trials = [piece for _, piece in cut]
    names = [f"{r}#{p.number}" if p.number else r for r, p in zip(records, trials, strict=True)]
    columns["trial"] = replace(columns["trial"], texts=names)
    # each record may have been set up differently
    columns.setdefault("session", TextColumn("session", records, file, lines))
    for name in bring:
        values = np.array([piece.brought.get(name, np.nan) for piece in trials])
        if name == campaign.segments.maps:
            _join_levels(campaign.segments, values)
        texts = ["" if value != value else repr(value) for value in values.tolist()]
        dimension = dimension_of(name)
        unit = units.SI[dimension] if dimension else ""
        columns[name] = TextColumn(name, texts, file, lines, unit)
    schedule = of_columns(campaign, root, columns, notes, bring)
    covariates = dict(schedule.covariates)
    if "start_s" in covariates:
        covariates["start_s"] = covariates["start_s"] + np.array([p.since_s for p in trials])
    covariates[RECORD_COLUMN] = np.array(records, dtype=object)
    covariates["piece"] = np.array([piece.number for piece in trials])
    covariates |= _further(trials, {*covariates, *RESERVED, *BY_NAME})
    return replace(schedule, covariates=covariates)


def _join_levels(cut: Segments, values: FloatArray) -> None:
    """Make levels within `hold` of each other one level, their median."""
    if not (cut.has_level and cut.hold > 0):
        return
    factor, _ = cut.level().linear(dimension_of(cut.maps), "segments")
    order = np.argsort(values)[: np.count_nonzero(np.isfinite(values))]
    first, reach = 0, cut.hold * abs(factor) * (1 + 1e-9)
    for k in range(1, len(order) + 1):
        wide = k < len(order) and values[order[k]] - values[order[first]] > reach
        if wide or k == len(order):
            values[order[first:k]] = np.median(values[order[first:k]])
            first = k


def _further(trials: Sequence[CutPiece], taken: Collection[str]) -> dict[str, FloatArray]:
    """Means and scatter of the records' further columns, NaN where a record has none; a column
    without a number anywhere is left out. A name that the schedule has for itself is made the
    record's.
    """
    columns: dict[str, FloatArray] = {}
    nothing = (np.nan, np.nan)
    for name in dict.fromkeys(name for piece in trials for name in piece.covariates):
        mean, scatter = np.array([piece.covariates.get(name, nothing) for piece in trials]).T
        if np.isfinite(mean).any():
            free = name if name not in taken else f"{RECORD_COLUMN} {name}"
            columns[free] = mean
            if np.isfinite(scatter).any():
                columns[f"sd_{free}"] = scatter
    return columns
