"""Campaign folder of a DataFrame of trials."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomlkit

from nearlift import units
from nearlift.errors import UsageError, did_you_mean
from nearlift.onboarding import headings
from nearlift.reduction import quality
from nearlift.schedule import BY_NAME, KNOWN, OF_TRIALS, RADII

if TYPE_CHECKING:
    import pandas as pd

#: Columns without which there is no trial, with an example of each.
NEEDED = {"boundary": "boundary", "distance": "z_m", "throttle": "throttle", "lift": "lift_N"}
#: Columns of trials.parquet whose unit is not in the name.
INSIDE = {k.inside: (k.name, units.SI.get(k.dimension, "")) for k in KNOWN} | {
    "z_m": ("distance", "m"),
    "throttle": ("throttle", "fraction"),
    "humidity": ("humidity", "fraction"),
}
#: Rig of a table: distances are from the boundary to the rotor plane; gravity only enters flights.
RIG = {
    "distance_datum": "rotor plane",
    "distance_offset": "0 mm",
    "gravity": "9.80665 m/s^2",
}


def columns_of(frame: pd.DataFrame) -> dict[str, tuple[str, str]]:
    """Column of the frame -> name and unit in a schedule; columns that it cannot use are left out.

    Units are those of trials.parquet, or follow the name, as in ``z_mm`` and ``lift_sd_gf``.

    Raises
    ------
    UsageError
        A needed column is missing, or a unit is not known.
    """
    columns, names = {}, [*map(str, frame.columns)]
    for column in (c for c in names if c in INSIDE or c not in OF_TRIALS):
        name, _, unit = column.rpartition("_")
        known = BY_NAME.get("distance" if name == "z" else name)
        if column in INSIDE:
            columns[column] = INSIDE[column]
        elif known is None or not known.dimension:
            columns[column] = column, ""
        elif written := headings.unit_of(known.name, unit):
            columns[column] = known.name, written
        else:
            usual = units.usual(known.dimension)
            what = f"{unit} is no known unit of {known.dimension}"
            raise UsageError(f"column {column!r}", what, f"use {usual[0]}")
    if "z_hat" in frame and "distance" not in {name for name, _ in columns.values()}:
        columns["z_hat"] = ("distance", RADII)
    for name in NEEDED.keys() - {name for name, _ in columns.values()}:
        example = NEEDED[name]
        remedy = did_you_mean(example, names) or f"name it {example!r}"
        raise UsageError("trials", f"there is no column of the {name}", remedy)
    return columns


def write_campaign(
    folder: Path,
    frame: pd.DataFrame,
    vehicle: Mapping[str, object],
    held: str,
    sections: Mapping[str, Any],
) -> Path:
    """Write campaign.toml and trials.csv for a frame of trials; returns the campaign's folder.

    ``u_lift_N`` and `n` become the standard deviation of `n` samples. Trials with a rejecting
    quality code are left out. `UsageError` as of `columns_of`.
    """
    columns = columns_of(frame)
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
    tables = {name: value for name, value in sections.items() if isinstance(value, Mapping)}
    document: dict[str, Any] = {
        "schema": "nearlift.campaign/1",
        "name": vehicle["name"],
        **{name: value for name, value in sections.items() if name not in tables},
        "vehicle": {key: value for key, value in vehicle.items() if value is not None},
        "rig": {"held": held, **RIG},
        "records": {"reader": "means"},
        "trials": {"units": units_of},
    }
    for section, content in tables.items():
        document[section] = {**document.get(section, {}), **content}
    root = folder / "raw"
    root.mkdir()
    (root / "campaign.toml").write_text(tomlkit.dumps(document), encoding="utf-8")
    table.to_csv(root / "trials.csv", index=False)
    return root
