"""trials.csv to SI columns: which trial ran where, at which throttle, under which conditions, in
which order.

Strict: a column that the contract knows needs its unit, a cell that is no number is named with its
line. Any further column is kept under its own name. Whether the distances can be true is
`geometry`'s matter.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.campaign.manifest import Campaign
from nearlift.declare import FloatArray, IntArray
from nearlift.errors import ManifestError, did_you_mean
from nearlift.products import TRIALS
from nearlift.readers import columns
from nearlift.readers.columns import BY_NAME, KNOWN, ColumnTexts
from nearlift.readers.files import inside
from nearlift.readers.geometry import distances, share_is_plausible
from nearlift.readers.schedule_text import columns_of, text_of, unended

REQUIRED = ("trial", "boundary", "distance", "throttle")
MEANS = ("lift", "lift_sd", "n")
#: The last one read: a command wants it when it opens a campaign, and again when it ingests.
_last: list[tuple[Campaign, Path, str, Schedule]] = []


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """The trials of a campaign in run order; every array has one entry per trial.

    `z_m` is the recorded distance plus the datum's offset: rotor plane (sidewall: nearest blade
    tip) to boundary, inf in free air; `z_hat` the same over rotor radius. `throttle` is a fraction.
    `visit` counts the traverse's stops: consecutive trials at one boundary and distance, approached
    from one side, in one session. `covariates` are in SI, the unit in the name (`supply_V`), NaN
    where blank; columns that the contract does not name stand under their own name.

    `means` (`lift_N`, `lift_sd_N`, `n`) are there for ``reader = "means"`` only. `reached_m` are
    distances that the traverse itself reported, the datum's offset added; they only judge whether
    it arrived. `notes` are what the user should know.
    """

    trial: NDArray[Any]
    boundary: NDArray[Any]
    z_m: FloatArray
    z_hat: FloatArray
    throttle: FloatArray
    visit: IntArray
    covariates: Mapping[str, NDArray[Any]]
    means: Mapping[str, NDArray[Any]] | None = None
    reached_m: FloatArray | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.trial)

    @property
    def settings(self) -> dict[str, NDArray[Any]]:
        """Which trial, and how the rig was set for it: the first columns of trials.parquet."""
        names = ("trial", "boundary", "z_hat", "z_m", "throttle")
        return {name: getattr(self, name) for name in names}


def schedule_file(campaign: Campaign, root: Path) -> Path:
    """The schedule's path, checked to lie under `root`."""
    return inside(root, campaign.trials.file, "trials.file")


def read_schedule(campaign: Campaign, root: Path) -> Schedule:
    """Read and check the schedule of a campaign; `InputRefused` where the file is missing or no CSV
    text, or a distance cannot be true, `ManifestError` where a column is missing, without a unit,
    or holds what it may not, or two trials share an id.
    """
    path = schedule_file(campaign, root)
    text = text_of(path)
    for known, at, said, schedule in _last:
        if known is campaign and (at, said) == (path, text):
            return schedule
    schedule = parse_schedule(campaign, path, text)
    _last[:] = [(campaign, path, text, schedule)]
    return schedule


def parse_schedule(campaign: Campaign, path: Path, text: str) -> Schedule:
    """The schedule that such a text would be at that path; raises as `read_schedule` does."""
    cells, notes = columns_of(campaign, path, text), unended(path, text)
    if not campaign.cuts_records:
        return of_cells(campaign, path, cells, campaign.trials.units, notes)
    from nearlift.readers import expanded

    cells, missing = expanded.of_records(campaign, path, cells)
    return of_cells(campaign, path, cells, campaign.trials.units, notes, missing)


def of_cells(
    campaign: Campaign,
    path: Path,
    cells: Mapping[str, ColumnTexts],
    given: Mapping[str, str],
    notes: list[str],
    missing: Collection[str] = (),
) -> Schedule:
    """The schedule of so many columns of text; raises as `read_schedule` does.

    `given` are the columns' units, `notes` what is said of the file already, `missing` the required
    columns that pieces of records will bring, or blanks in which no piece did.
    """
    _named(path, cells, given, missing)
    trial = columns.ids(cells["trial"])
    boundary = columns.boundaries(cells["boundary"])
    throttle = np.full(len(trial), np.nan)
    if "throttle" in cells:
        column, unit = cells["throttle"], given.get("throttle")
        blank = "throttle" in missing
        throttle = columns.quantity(column, BY_NAME["throttle"], unit, blank=blank)
        share_is_plausible("throttle", throttle, column, unit or "")
    z_m = distances(
        campaign, cells.get("distance"), boundary, given.get("distance"), "distance" in missing
    )

    covariates: dict[str, NDArray[Any]] = {}
    means: dict[str, NDArray[Any]] = {}
    notes = list(notes)
    for name, column in cells.items():
        known, unit = BY_NAME.get(name), given.get(name)
        if name in REQUIRED:
            continue
        if known is None:
            if name in reserved():
                raise ManifestError(
                    str(path), f"the column {name!r} has the name of a result", "rename it"
                )
            covariates[name] = columns.further(column)
            others = [k.name for k in KNOWN if k.name not in cells]
            hint = did_you_mean(name, others)
            notes += [f"{path.name}: column {name!r} is kept as it is; {hint}"] if hint else []
        elif name == "start":
            covariates[known.inside] = columns.seconds(column, unit)
        elif name == "tare_after" and unit == "count":
            covariates[known.inside] = columns.counts(campaign, column)
        elif known.kind == "text":
            covariates[known.inside] = np.array([t.strip() for t in column.texts], dtype=object)
        else:
            values = (
                columns.plain(column, name)
                if known.kind == "plain"
                else columns.quantity(column, known, unit, blank=name != "lift")
            )
            share_is_plausible(name, values, column, unit or "")
            (means if name in MEANS else covariates)[known.inside] = values
    means_wanted = campaign.records.reader == "means"
    if means_wanted and "lift_N" not in means:
        raise ManifestError(
            str(path),
            "has no column 'lift'",
            'reader = "means" takes the mean lift of every trial from it; add lift, and its unit'
            " under [trials.units]",
        )
    if means and not means_wanted:
        raise ManifestError(
            str(path),
            f'the column {next(n for n in MEANS if n in cells)!r} belongs to reader = "means"',
            f"rename it; here the lift comes from the {campaign.records.reader} records",
        )
    approach, session = covariates.get("approach"), covariates.get("session")
    if "start_s" in covariates:
        notes += _backwards(cells["start"], covariates["start_s"], session)
    reached = covariates.pop("reached_m", None)
    if reached is not None:
        offset = [0.0 if side == "none" else campaign.rig.offset(side) for side in boundary]
        reached = reached + np.array(offset)
    if "sidewall" in boundary and campaign.rig.datum("sidewall") == "rotor plane":
        notes.append(
            "sidewall distances are taken as wall to nearest blade tip; say so with distance_datum"
            ' = { sidewall = "blade tip" }'
        )
    return Schedule(
        trial=trial,
        boundary=boundary,
        z_m=z_m,
        z_hat=z_m / campaign.vehicle.rotor_radius,
        throttle=throttle,
        visit=visits(boundary, z_m, approach, session, ordered=campaign.trials.order == "run"),
        covariates=covariates,
        means=means if means_wanted else None,
        reached_m=reached,
        notes=tuple(notes),
    )


def visits(
    boundary: NDArray[Any],
    z_m: FloatArray,
    approach: FloatArray | None = None,
    session: NDArray[Any] | None = None,
    *,
    ordered: bool = True,
) -> IntArray:
    """Counter of the traverse's stops, from 0: it moves on where boundary, distance, side of
    approach or session change.

    Where nobody knows the order of the rows, those that agree in all of these are one stop,
    wherever they stand in the table.
    """
    if len(boundary) == 0:
        return np.zeros(0, dtype=np.int64)
    if not ordered:
        same = [boundary.astype(str), z_m, *(x for x in (approach, session) if x is not None)]
        labels = np.stack([np.unique(x, return_inverse=True)[1] for x in same])
        _, first, label = np.unique(labels, axis=1, return_index=True, return_inverse=True)
        return np.argsort(np.argsort(first))[label].astype(np.int64)
    moved = (boundary[1:] != boundary[:-1]) | (z_m[1:] != z_m[:-1])
    if approach is not None:
        moved = moved | (
            (approach[1:] != approach[:-1]) & np.isfinite(approach[1:]) & np.isfinite(approach[:-1])
        )
    if session is not None:
        # a new session is a new approach to the distance, even to the same one
        moved = moved | (session[1:] != session[:-1])
    return np.concatenate([[0], np.cumsum(moved)]).astype(np.int64)


def _named(
    path: Path, cells: Mapping[str, ColumnTexts], given: Mapping[str, str], missing: Collection[str]
) -> None:
    """Refuse a schedule that lacks a column, or a unit for one that neither exists nor is known."""
    for name in given:
        if name not in cells and name not in BY_NAME:
            raise ManifestError(
                f"trials.units.{name}",
                "no column has that name",
                did_you_mean(name, [*cells, *BY_NAME]) or f"columns are {', '.join(cells)}",
            )
    # where all trials are in free air there is no distance
    free_air = "boundary" in cells and all(t.strip() == "none" for t in cells["boundary"].texts)
    for name in REQUIRED:
        needed = name not in missing and not (name == "distance" and free_air)
        if name not in cells and needed:
            hint = did_you_mean(name, [c for c in cells if c not in BY_NAME])
            raise ManifestError(
                str(path),
                f"has no column {name!r}",
                hint.replace("did you mean", "is it")
                or f"add it, or set it for all under [trials.constants]: {name} = ...",
            )


def _backwards(cells: ColumnTexts, start_s: FloatArray, session: NDArray[Any] | None) -> list[str]:
    """A note on trials of a session that began before the one above them."""
    known = np.flatnonzero(np.isfinite(start_s))
    earlier = np.diff(start_s[known]) < 0
    if session is not None:
        earlier &= session[known][1:] == session[known][:-1]
    if not earlier.any():
        return []
    row = int(known[1:][earlier][0])
    others = f", as do {earlier.sum() - 1} more" if earlier.sum() > 1 else ""
    note = (
        f"{cells.at(row)}: {cells.texts[row].strip()} lies before the row above{others}: rows"
        " stand in the order in which they were run"
    )
    return [note]


def reserved() -> set[str]:
    """Names that a further column may not have."""
    return {c.name for c in TRIALS.columns} | {k.inside for k in KNOWN} | {"u_height_m"}
