"""Checks of trials against the whole campaign: quality codes, refusals and notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.campaign.manifest import Campaign
from nearlift.reduction import outliers, plausibility, quality

Table = dict[str, NDArray[Any]]


def record_codes(
    columns: Table, codes: list[list[str]], owners: NDArray[np.object_], campaign: Campaign
) -> None:
    """Add to `codes` those of records that are like others' or have another length.

    `columns` are rows of trials in run order, `owners` the record of each.
    """
    if campaign.cuts_records:
        _duplicates(columns, codes, owners, ("source_sha256",))
    elif campaign.records.reader != "means":
        cell, missing = campaign.load_cell, campaign.quality.missing
        samples = columns["samples"]
        planned = None
        if cell.record and cell.sample_rate:
            planned = round(cell.record * cell.sample_rate)
            plausibility.planned_length(samples, cell.record, cell.sample_rate, missing)
        plausibility.lengths(columns["n"], codes, missing, samples, planned)
        # trials of one long table are distinguished by their numbers
        _duplicates(columns, codes, owners, ("source_sha256", "lift_N", "sd_N"))


def _duplicates(
    rows: Mapping[str, NDArray[Any]],
    codes: Sequence[list[str]],
    owners: NDArray[np.object_],
    same: tuple[str, ...],
) -> None:
    """Reject a trial whose columns `same` are those of an earlier one of another owner."""
    first: dict[tuple[object, ...], str] = {}
    columns = [rows[name].tolist() for name in same]
    for i in np.flatnonzero(rows["n"]).tolist():
        key = tuple(column[i] for column in columns)
        if first.setdefault(key, owners[i]) != owners[i]:
            codes[i].append("DUPLICATE")


def _same(table: Table, campaign: Campaign) -> list[str]:
    """Whose record each duplicate is; of records that are cut, once for all pieces."""
    first: dict[tuple[str, float], str] = {}
    notes: dict[str, None] = {}
    for record, sha, lift, text in zip(
        table["record" if campaign.cuts_records else "trial"],
        table["source_sha256"],
        table["lift_N"].tolist(),
        table["quality"],
        strict=True,
    ):
        owner = first.setdefault((sha, lift), record)
        if "DUPLICATE" in text.split():
            notes[f"the record of {record} is that of {owner}, byte for byte"] = None
    return list(notes)


def _mark(table: Table, name: str, marked: NDArray[np.bool_]) -> None:
    """Add a quality code to the marked trials."""
    table["quality"] = np.array(
        [
            quality.joined([*text.split(), name]) if mark else text
            for text, mark in zip(table["quality"], marked, strict=True)
        ],
        dtype=object,
    )


def unit_of(campaign: Campaign) -> tuple[str, str]:
    """The unit that forces were read in, and its key."""
    series = campaign.records.force
    return (
        (series.unit, "records.force.unit")
        if series is not None
        else (campaign.trials.units.get("lift", "N"), "trials.units.lift")
    )


def judge(table: Table, campaign: Campaign) -> list[str]:
    """Check trials against each other; adds codes to `table`, and returns notes."""
    weight = campaign.vehicle.mass * campaign.rig.gravity
    unit, key = unit_of(campaign)
    plausibility.against_weight(table, weight, unit, key)
    _mark(table, "IMPLAUSIBLE", plausibility.implausible(table["lift_N"], weight))
    _mark(table, "NO_LIFT", plausibility.without_lift(table))
    _mark(table, "other_throttle", plausibility.other_throttle(table))
    notes = [
        *_same(table, campaign),
        *plausibility.odd_weight(table, weight, unit, key),
        *plausibility.mostly_unsettled(table),
    ]
    notes += plausibility.overstated(table, campaign)
    for side in dict.fromkeys(table["boundary"].tolist()):
        notes += _outlying(table, side)
    for side, lower, upper, below, above in plausibility.not_rising(table):
        here = (table["boundary"] == side) & (table["throttle"] == upper)
        far = here & (table["z_hat"] == table["z_hat"][here].max())
        _mark(table, "not_rising", far)
        place = f"far from the {side}" if side != "none" else "in free air"
        step = f"{below:.4g} N at {100 * lower:.4g} %, {above:.4g} N at {100 * upper:.4g} %"
        notes.append(
            f"{place} the lift does not rise with throttle: {step} (battery, order of the sweep, or"
            " a wrong label?)"
        )
    return notes


def _outlying(table: Table, side: str) -> list[str]:
    """Mark the trials that repeats and neighbours contradict, and say of each how far off it is."""
    mine = np.flatnonzero(
        (table["boundary"] == side) & ~quality.rejected(table["quality"]) & (table["lift_N"] > 0)
    )
    z_hat, throttle, visit = (table[name][mine] for name in ("z_hat", "throttle", "visit"))
    seen = outliers.screen(np.log(table["lift_N"][mine]), z_hat, throttle, visit)
    mask = np.zeros(len(table["quality"]), dtype=bool)
    mask[mine[seen.outlying]] = True
    _mark(table, "outlying", mask)
    return [
        f"{table['trial'][mine[i]]} lifts {100 * np.expm1(seen.departure[i]):+.3g} % against its"
        f" repeats and neighbours, {abs(seen.sigmas[i]):.0f} times their scatter: noise does not"
        " reach so far; look at its record and its row"
        for i in np.flatnonzero(seen.outlying)
    ]
