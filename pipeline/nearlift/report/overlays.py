"""Measured data of others for Figure 2, as the manifest names them.

They are small CSV files, and cells of campaigns that were run in the same workspace.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path, PurePath

import numpy as np

from nearlift.campaign.choices import Overlay
from nearlift.campaign.manifest import Campaign
from nearlift.errors import InputRefused, ManifestError
from nearlift.report.evidence import Columns
from nearlift.run import tables
from nearlift.stages.reduce import LIFT

COLUMNS = ("z_hat", "delta_L", "u")
MAX_BYTES = 5_000_000


def read(root: Path, campaign: Campaign, processed: Path) -> tuple[tuple[Overlay, Columns], ...]:
    """Every overlay of the manifest, as fractions; `processed` has the workspace's products.

    Raises
    ------
    ManifestError
        A file is missing, or lies outside the campaign's folder; a data set was not run.
    InputRefused
        A file is too large, lacks a column, or holds a cell that is no number.
    """
    return tuple(
        (overlay.model_copy(update={"boundary": boundary}), table)
        for overlay in campaign.report.overlay
        for boundary, table in _tables(root, overlay, processed).items()
    )


def _tables(root: Path, overlay: Overlay, processed: Path) -> dict[str, Columns]:
    """Points by boundary."""
    if overlay.file.endswith(".csv"):
        table = _table(_inside(root, overlay), overlay.file)
        boundaries = table.pop("boundary")
        boundaries[boundaries == ""] = overlay.boundary or "ground"
    else:
        lift = processed / overlay.file / LIFT.file
        if PurePath(overlay.file).name != overlay.file or not lift.is_file():
            raise ManifestError(
                "report.overlay",
                f"{overlay.file!r} is no CSV file, and no campaign of that name was run here",
                f"nearlift data get {overlay.file}, then nearlift run {overlay.file}",
            )
        cells = tables.read_table(lift, LIFT)
        known = np.isfinite(cells["delta_L"]) & np.isfinite(cells["z_hat"])
        boundaries = cells["boundary"][known]
        named = {"z_hat": "z_hat", "delta_L": "delta_L", "u": "u_delta_L"}
        table = {to: np.asarray(cells[column][known], float) for to, column in named.items()}
    wanted = [overlay.boundary] if overlay.boundary else sorted(set(boundaries.tolist()))
    return {
        b: {n: x[boundaries == b] for n, x in table.items()}
        for b in wanted
        if (boundaries == b).any()
    }


def _inside(root: Path, overlay: Overlay) -> Path:
    path = (root / overlay.file).resolve()
    if not path.is_relative_to(root.resolve()):
        raise ManifestError(
            "report.overlay.file",
            f"{overlay.file!r} lies outside the campaign's folder",
            "copy it into the folder",
        )
    if not path.is_file():
        raise ManifestError(
            "report.overlay.file",
            f"there is no file {overlay.file!r} in {root}",
            "correct the name, or leave the overlay out",
        )
    if path.stat().st_size > MAX_BYTES:
        raise InputRefused(
            overlay.file,
            f"has {path.stat().st_size} bytes",
            f"an overlay is a few points: at most {MAX_BYTES} bytes",
        )
    return path


def _table(path: Path, name: str) -> Columns:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as fault:
        raise InputRefused(
            name, f"is not UTF-8 text ({fault.reason} at byte {fault.start})", "save it as UTF-8"
        ) from None
    lines = [
        (i, line)
        for i, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    rows = list(csv.DictReader([line for _, line in lines]))
    missing = [c for c in COLUMNS if not rows or c not in rows[0]]
    if missing:
        wanted = f"an overlay has the columns {', '.join(COLUMNS)} (fractions; u may be empty)"
        raise InputRefused(name, f"lacks {', '.join(missing)}" if rows else "holds no rows", wanted)
    table = {
        c: np.array(
            [_number(row[c], c, name, i) for (i, _), row in zip(lines[1:], rows, strict=True)]
        )
        for c in COLUMNS
    }
    return {**table, "boundary": np.array([row.get("boundary") or "" for row in rows], object)}


def _number(text: str | None, column: str, name: str, line: int) -> float:
    cell = (text or "").strip()
    if column == "u" and not cell:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if (
        not math.isfinite(value)
        or (column == "z_hat" and value <= 0)
        or (column == "u" and value < 0)
    ):
        kind = {"z_hat": "a distance", "delta_L": "a number", "u": "an uncertainty"}[column]
        raise InputRefused(
            f"{name}, line {line}",
            f"{column} = {cell!r} is not {kind} that can be drawn",
            "correct or remove that line",
        )
    return value
