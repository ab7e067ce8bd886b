"""A schedule of records made one of trials, once every record has been cut into its pieces.

A row of the schedule is a record, and all its pieces share what the row says: boundary, distance,
session, and so the visit of the traverse. What the pieces bring themselves (a throttle, a supply)
takes its place among the columns, and everything is then checked as any schedule is.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import units
from nearlift.errors import ManifestError
from nearlift.manifest.campaign import Campaign
from nearlift.manifest.segments import Segments
from nearlift.readers.brought import brought_by, dimension_of
from nearlift.readers.columns import KNOWN, Cells
from nearlift.readers.schedule import Schedule, of_cells, reserved, schedule_file
from nearlift.readers.schedule_text import columns_of, text_of, unended
from nearlift.readers.segments import PieceOfRecord

#: The column of a schedule, and of trials.parquet, with the record that a trial is a piece of.
RECORD_COLUMN = "record"
#: Mean and scatter of a column that a record does not have.
NOTHING = (np.nan, np.nan)


def of_records(
    campaign: Campaign, path: Path, cells: Mapping[str, Cells]
) -> tuple[dict[str, Cells], tuple[str, ...]]:
    """The columns of a schedule of records under the names of one of trials, and which of those
    that every trial needs the pieces will bring.

    Raises
    ------
    ManifestError
        There is no column `record`, or the schedule says what the pieces bring.
    """
    bring = brought_by(campaign)
    table = "flight" if campaign.segments is None else "segments"
    if RECORD_COLUMN not in cells or "trial" in cells:
        what = "has a column 'trial'" if "trial" in cells else "has no column 'record'"
        raise ManifestError(
            str(path), what, f"with [{table}] a row is a record: call the column of its ids record"
        )
    for name in bring:
        if name in cells:
            raise ManifestError(
                str(path),
                f"the column {name!r} says what every piece of a record brings by [{table}]",
                f"take the column away, or the key under [{table}]"
                + (" (maps, columns)" if table == "segments" else ""),
            )
    return {"trial" if name == RECORD_COLUMN else name: own for name, own in cells.items()}, bring


def schedule_of_trials(
    campaign: Campaign, root: Path, pieces: Mapping[str, Sequence[PieceOfRecord]]
) -> Schedule:
    """The schedule of the pieces of every record; a record without one has a row by itself.

    Covariates also are `record`, `piece`, and the means of the records' further columns.

    Raises
    ------
    InputRefused, ManifestError
        As `read_schedule`, of what the pieces bring as well.
    """
    path = schedule_file(campaign, root)
    text = text_of(path)
    whole, bring = of_records(campaign, path, columns_of(campaign, path, text))
    ids = [record.strip() for record in whole["trial"].texts]
    rows = [(i, piece) for i, record in enumerate(ids) for piece in (pieces.get(record) or (None,))]
    given = {n: u for n, u in campaign.trials.units.items() if n not in bring}
    cells: dict[str, Cells] = {}
    for name, own in whole.items():
        texts = [own.texts[i] for i, _ in rows]
        cells[name] = replace(own, texts=texts, lines=[own.lines[i] for i, _ in rows if own.lines])
    lines = cells["trial"].lines
    names = [ids[i] if piece is None else f"{ids[i]}#{piece.number}" for i, piece in rows]
    cells["trial"] = replace(cells["trial"], texts=names)
    if "session" not in cells:
        # a record is set up anew, and nothing says that two of them were set up alike
        cells["session"] = Cells("session", [ids[i] for i, _ in rows], path.name, lines)
    for name, values in _together(campaign.segments, bring, rows).items():
        texts = ["" if v != v else repr(float(v)) for v in values]
        cells[name] = Cells(name, texts, path.name, lines)
        if dimension := dimension_of(name):
            given[name] = units.SI[dimension]
    schedule = of_cells(campaign, path, cells, given, unended(path, text), bring)
    covariates = dict(schedule.covariates)
    since = np.array([0.0 if piece is None else piece.since_s for _, piece in rows])
    if "start_s" in covariates:
        covariates["start_s"] = covariates["start_s"] + since
    covariates[RECORD_COLUMN] = np.array([ids[i] for i, _ in rows], dtype=object)
    covariates["piece"] = np.array([0 if p is None else p.number for _, p in rows], dtype=np.int64)
    covariates |= _further(rows, {*covariates, *reserved(), *(k.name for k in KNOWN)})
    return replace(schedule, covariates=covariates)


def _together(
    cut: Segments | None, bring: Sequence[str], rows: Sequence[tuple[int, PieceOfRecord | None]]
) -> dict[str, NDArray[Any]]:
    """What pieces bring, by column; levels within `hold` of each other are one level."""
    found = {
        name: np.array([np.nan if p is None else p.brought[name] for _, p in rows])
        for name in bring
    }
    if cut is not None and cut.has_level and cut.hold > 0:
        factor, _ = cut.level().linear(dimension_of(cut.maps), "segments")
        values = found[cut.maps]
        order = np.argsort(values)[: np.count_nonzero(np.isfinite(values))]
        first = 0
        for k in range(1, len(order) + 1):
            wide = k < len(order) and values[order[k]] - values[order[first]] > cut.hold * abs(
                factor
            ) * (1 + 1e-9)
            if wide or k == len(order):
                values[order[first:k]] = np.median(values[order[first:k]])
                first = k
    return found


def _further(
    rows: Sequence[tuple[int, PieceOfRecord | None]], taken: Collection[str]
) -> dict[str, NDArray[Any]]:
    """Means and scatter of the records' further columns, NaN where a record has none; a column
    without a number anywhere is left out. A name that the schedule has for itself is made the
    record's.
    """
    names = dict.fromkeys(name for _, p in rows if p is not None for name in p.covariates)
    found: dict[str, NDArray[Any]] = {}
    for name in names:
        of = [NOTHING if p is None else p.covariates.get(name, NOTHING) for _, p in rows]
        mean, scatter = np.fromiter(chain.from_iterable(of), float, 2 * len(of)).reshape(-1, 2).T
        if np.isfinite(mean).any():
            own = name if name not in taken else f"{RECORD_COLUMN} {name}"
            found[own] = mean
            if np.isfinite(scatter).any():
                found[f"sd_{own}"] = scatter
    return found
