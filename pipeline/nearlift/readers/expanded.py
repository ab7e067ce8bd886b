"""A schedule of records made one of trials, once every record has been cut into its pieces.

A row of the schedule is a record, and all its pieces share what the row says: boundary, distance,
session, and so the visit of the traverse. What the pieces bring themselves (a throttle, a supply)
takes its place among the columns, and everything is then checked as any schedule is.
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
from nearlift.errors import ManifestError
from nearlift.readers.columns import KNOWN, ColumnTexts, Numbers, brought_by, dimension_of
from nearlift.readers.schedule import Schedule, of_cells, reserved, schedule_file
from nearlift.readers.schedule_text import columns_of, text_of, unended
from nearlift.readers.segments import Pieces

#: The column of a schedule, and of trials.parquet, with the record that a trial is a piece of.
RECORD_COLUMN = "record"
#: What stands for the pieces of a record without any.
NO_PIECE = Pieces(number=np.zeros(1, dtype=np.int64), since_s=np.zeros(1))


def of_records(
    campaign: Campaign, path: Path, cells: Mapping[str, ColumnTexts]
) -> tuple[dict[str, ColumnTexts], tuple[str, ...]]:
    """The columns of a schedule of records under the names of one of trials, and which of those
    that every trial needs the pieces will bring; `ManifestError` where there is no column `record`,
    or the schedule says what the pieces bring.
    """
    bring = brought_by(campaign)
    if RECORD_COLUMN not in cells or "trial" in cells:
        what = "has a column 'trial'" if "trial" in cells else "has no column 'record'"
        raise ManifestError(
            str(path), what, "with [segments] a row is a record: call the column of its ids record"
        )
    for name in bring:
        if name in cells:
            raise ManifestError(
                str(path),
                f"the column {name!r} says what every piece of a record brings by [segments]",
                "take the column away, or the key under [segments] (maps, columns)",
            )
    renamed = {"trial" if name == RECORD_COLUMN else name: cells[name] for name in cells}
    return renamed, bring


def schedule_of_trials(campaign: Campaign, root: Path, pieces: Mapping[str, Pieces]) -> Schedule:
    """The schedule of the pieces of every record; a record without one has a row by itself.

    Covariates also are `record`, `piece`, and the means of the records' further columns. Raises as
    `read_schedule` does, of what the pieces bring as well.
    """
    path = schedule_file(campaign, root)
    text = text_of(path)
    whole, bring = of_records(campaign, path, columns_of(campaign, path, text))
    ids = [record.strip() for record in whole["trial"].texts]
    cut = [pieces.get(record) or NO_PIECE for record in ids]
    row_of = [i for i, record in enumerate(cut) for _ in range(len(record))]
    given = {n: u for n, u in campaign.trials.units.items() if n not in bring}
    cells: dict[str, ColumnTexts] = {}
    for name, column in whole.items():
        texts = [column.texts[i] for i in row_of]
        at = [column.lines[i] for i in row_of if column.lines]
        cells[name] = replace(column, texts=texts, lines=at)
    lines = cells["trial"].lines
    numbers = np.concatenate([record.number for record in cut])
    records = [ids[i] for i in row_of]
    names = [f"{r}#{n}" if n else r for r, n in zip(records, numbers.tolist(), strict=True)]
    cells["trial"] = replace(cells["trial"], texts=names)
    if "session" not in cells:
        # a record is set up anew, and nothing says that two of them were set up alike
        cells["session"] = ColumnTexts("session", records, path.name, lines)
    assert campaign.segments is not None
    for name, values in _together(campaign.segments, bring, cut).items():
        cells[name] = ColumnTexts(name, Numbers(values), path.name, lines)
        if dimension := dimension_of(name):
            given[name] = units.SI[dimension]
    schedule = of_cells(campaign, path, cells, given, unended(path, text), bring)
    covariates = dict(schedule.covariates)
    if "start_s" in covariates:
        since = np.concatenate([record.since_s for record in cut])
        covariates["start_s"] = covariates["start_s"] + since
    covariates[RECORD_COLUMN] = np.array(records, dtype=object)
    covariates["piece"] = numbers
    covariates |= _further(cut, {*covariates, *reserved(), *(k.name for k in KNOWN)})
    return replace(schedule, covariates=covariates)


def _together(
    cut: Segments, bring: Sequence[str], pieces: Sequence[Pieces]
) -> dict[str, FloatArray]:
    """What pieces bring, by column; levels within `hold` of each other are one level."""
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
