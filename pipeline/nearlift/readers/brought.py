"""The columns of a schedule that the pieces of a record bring: a level, a supply, a temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nearlift.errors import ManifestError, did_you_mean
from nearlift.manifest.segments import ColumnOfRecord, Segments
from nearlift.readers.columns import BESIDE, BY_NAME, KNOWN

if TYPE_CHECKING:
    from nearlift.manifest.campaign import Campaign

#: Columns of a schedule that pieces may bring.
BRINGABLE = tuple(k.name for k in KNOWN if k.kind == "quantity" and not k.name.startswith("lift"))


def brought(cut: Segments) -> dict[str, tuple[ColumnOfRecord, str]]:
    """The schedule's columns that pieces bring: the column of the record that says each, and the
    manifest's key for it.

    Raises
    ------
    ManifestError
        A name is none of the schedule's, a column has no unit, or two bring the same.
    """
    columns: dict[str, tuple[ColumnOfRecord, str]] = {}
    if cut.has_level:
        columns[cut.maps] = cut.level(), "segments"
    for name, column in cut.columns.items():
        key = f"segments.columns.{name}"
        if name not in BRINGABLE:
            hint = did_you_mean(name, BRINGABLE) or f"known are {', '.join(BRINGABLE)}"
            raise ManifestError(key, "is no column of a schedule that a record may have", hint)
        if name in columns:
            raise ManifestError(key, "is what the level says already", "take one of them away")
        columns[name] = column, key
        if name in BESIDE:
            # from the same samples
            columns[f"u_{name}"] = column, key
    for name, (column, key) in columns.items():
        column.linear(dimension_of(name), key)
    return columns


def brought_by(campaign: Campaign) -> tuple[str, ...]:
    """The schedule's columns that the pieces of a campaign's records bring; raises as `brought`."""
    if campaign.segments is not None:
        return tuple(brought(campaign.segments))
    flight = campaign.flight
    assert flight is not None
    names = ["distance", "throttle"]
    names += ["supply"] if flight.supply is not None else []
    return (*names, "tilt") if flight.tells_tilt else tuple(names)


def dimension_of(name: str) -> str:
    """The dimension of a schedule's column; empty for one that has none."""
    return BY_NAME[name].dimension if name in BY_NAME else ""
