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
from nearlift.readers.segments import Pieces
from nearlift.schedule import (
    BY_NAME,
    RECORD_COLUMN,
    RESERVED,
    Schedule,
    TextColumn,
    columns_of,
    dimension_of,
    of_columns,
    rename_records,
    schedule_file,
    text_of,
    unended,
)

#: Placeholder for a record without pieces.
NO_PIECE = Pieces(number=np.zeros(1, dtype=np.int64), since_s=np.zeros(1))


def schedule_of_trials(campaign: Campaign, root: Path, pieces: Mapping[str, Pieces]) -> Schedule:
    """The schedule of the pieces of every record; a record without pieces has one row.

    Covariates include `record`, `piece`, and the means of the records' further columns. Raises as
    `read_schedule` does.
    """
    assert campaign.segments is not None
    path = schedule_file(campaign, root)
    text = text_of(path)
    rows, bring = rename_records(campaign, path, columns_of(campaign, path, text))
    ids = rows["trial"].stripped().tolist()
    cut = [pieces.get(record) or NO_PIECE for record in ids]
    row_of = [i for i, record in enumerate(cut) for _ in range(len(record))]
    columns = {
        name: replace(
            column,
            texts=[column.texts[i] for i in row_of],
            lines=[column.lines[i] for i in row_of] if column.lines else (),
        )
        for name, column in rows.items()
    }
    lines = columns["trial"].lines
    numbers = np.concatenate([record.number for record in cut])
    records = [ids[i] for i in row_of]
    names = [f"{r}#{n}" if n else r for r, n in zip(records, numbers.tolist(), strict=True)]
    columns["trial"] = replace(columns["trial"], texts=names)
    # each record may have been set up differently
    columns.setdefault("session", TextColumn("session", records, path.name, lines))
    for name, values in _together(campaign.segments, bring, cut).items():
        texts = ["" if value != value else repr(value) for value in values.tolist()]
        dimension = dimension_of(name)
        unit = units.SI[dimension] if dimension else ""
        columns[name] = TextColumn(name, texts, path.name, lines, unit)
    schedule = of_columns(campaign, path, columns, unended(path, text), bring)
    covariates = dict(schedule.covariates)
    if "start_s" in covariates:
        since = np.concatenate([record.since_s for record in cut])
        covariates["start_s"] = covariates["start_s"] + since
    covariates[RECORD_COLUMN] = np.array(records, dtype=object)
    covariates["piece"] = numbers
    covariates |= _further(cut, {*covariates, *RESERVED, *BY_NAME})
    return replace(schedule, covariates=covariates)


def _together(
    cut: Segments, bring: Sequence[str], pieces: Sequence[Pieces]
) -> dict[str, FloatArray]:
    """The columns that pieces bring; levels within `hold` of each other are one level."""
    parts = [(len(record), record.brought) for record in pieces]
    columns = {name: _joined(name, parts) for name in bring}
    if cut.has_level and cut.hold > 0:
        factor, _ = cut.level().linear(dimension_of(cut.maps), "segments")
        values = columns[cut.maps]
        order = np.argsort(values)[: np.count_nonzero(np.isfinite(values))]
        first, reach = 0, cut.hold * abs(factor) * (1 + 1e-9)
        for k in range(1, len(order) + 1):
            wide = k < len(order) and values[order[k]] - values[order[first]] > reach
            if wide or k == len(order):
                values[order[first:k]] = np.median(values[order[first:k]])
                first = k
    return columns


def _further(pieces: Sequence[Pieces], taken: Collection[str]) -> dict[str, FloatArray]:
    """Means and scatter of the records' further columns, NaN where a record has none; a column
    without a number anywhere is left out. A name that the schedule has for itself is made the
    record's.
    """
    columns: dict[str, FloatArray] = {}
    for name in dict.fromkeys(name for record in pieces for name in record.covariates):
        mean = _joined(name, [(len(record), record.covariates) for record in pieces])
        scatter = _joined(name, [(len(record), record.scatter) for record in pieces])
        if np.isfinite(mean).any():
            free = name if name not in taken else f"{RECORD_COLUMN} {name}"
            columns[free] = mean
            if np.isfinite(scatter).any():
                columns[f"sd_{free}"] = scatter
    return columns


def _joined(name: str, parts: Sequence[tuple[int, Mapping[str, FloatArray]]]) -> FloatArray:
    """A column of all records' pieces, NaN for those of a record that lacks it."""
    return np.concatenate([columns.get(name, np.full(n, np.nan)) for n, columns in parts])
