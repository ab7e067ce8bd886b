"""Campaign folder of a DataFrame of trials."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomlkit

from nearlift import units
from nearlift.errors import UsageError, did_you_mean
from nearlift.reduction import quality
from nearlift.schedule import BY_NAME, KNOWN, OF_TRIALS, RADII

if TYPE_CHECKING:
    import pandas as pd

#: Columns without which there is no trial.
NEEDED = ("boundary", "distance", "throttle", "lift")


def columns_of(frame: pd.DataFrame) -> dict[str, tuple[str, str]]:
    """Column of the frame -> name and unit in a schedule; columns that it cannot use are left out.

    Raises
    ------
    UsageError
        A needed column is missing, or a unit is not known.
    """
    inside = {k.inside: (k.name, units.SI.get(k.dimension, "")) for k in KNOWN}
    inside |= {
        "z_m": ("distance", "m"),
        "throttle": ("throttle", "fraction"),
        "humidity": ("humidity", "fraction"),
    }
    columns = {}
    for column in map(str, frame.columns):
        if column in inside:
            columns[column] = inside[column]
        elif column not in OF_TRIALS:
            columns[column] = _with_unit(column)
    if "z_hat" in frame and "distance" not in {name for name, _ in columns.values()}:
        columns["z_hat"] = ("distance", RADII)
    named = {name for name, _ in columns.values()}
    for name in NEEDED:
        if name not in named:
            example = {"distance": "z_m", "lift": "lift_N"}.get(name, name)
            raise UsageError(
                "trials",
                f"there is no column of the {name}",
                did_you_mean(example, list(map(str, frame.columns))) or f"name it {example!r}",
            )
    return columns


def _with_unit(column: str) -> tuple[str, str]:
    """Name and unit of a column such as ``z_mm`` or ``lift_sd_gf``; others keep their name."""
    name, _, unit = column.rpartition("_")
    name = "distance" if name == "z" else name
    if name not in BY_NAME or not unit:
        return column, ""
    dimension = BY_NAME[name].dimension
    if not dimension:
        return column, ""
    usual = [*units.USUAL.get(dimension, ()), units.SI[dimension]]
    if (unit, dimension) not in units.COMMON and unit not in usual:
        raise UsageError(
            f"column {column!r}", f"{unit} is no known unit of {dimension}", f"use {usual[0]}"
        )
    return name, unit


def write_campaign(
    folder: Path,
    frame: pd.DataFrame,
    columns: Mapping[str, tuple[str, str]],
    name: str,
    vehicle: Mapping[str, object],
    held: str,
    sections: Mapping[str, Mapping[str, object]],
) -> Path:
    """Write campaign.toml and trials.csv for a frame of trials; returns the campaign's folder.

    ``u_lift_N`` and `n` become the standard deviation of `n` samples. Trials with a rejecting
    quality code are left out. Distances are from the boundary to the rotor plane.
    """
    if "quality" in frame:
        frame = frame[~quality.rejected(frame["quality"].fillna("").to_numpy(dtype=object))]
    table = frame[list(columns)].rename(columns={c: n for c, (n, _) in columns.items()})
    if "trial" not in table:
        table.insert(0, "trial", [f"t{i:05d}" for i in range(len(table))])
    units_of = {n: unit for n, unit in columns.values() if unit}
    if "u_lift_N" in frame:
        table["lift_sd"] = frame["u_lift_N"] * np.sqrt(frame.get("n", 1))
        units_of["lift_sd"] = "N"
    table["distance"] = table["distance"].where(np.isfinite(table["distance"].astype(float)))
    document = {
        "schema": "nearlift.campaign/1",
        "name": name,
        "vehicle": {key: value for key, value in vehicle.items() if value is not None},
        # gravity only enters simulated flights
        "rig": {
            "held": held,
            "distance_datum": "rotor plane",
            "distance_offset": "0 mm",
            "gravity": "9.80665 m/s^2",
        },
        "records": {"reader": "means"},
        "trials": {"units": units_of},
    }
    for section, content in sections.items():
        document[section] = {**document.get(section, {}), **content}  # type: ignore[dict-item]
    root = folder / "raw"
    root.mkdir()
    (root / "campaign.toml").write_text(tomlkit.dumps(document), encoding="utf-8")
    table.to_csv(root / "trials.csv", index=False)
    return root
