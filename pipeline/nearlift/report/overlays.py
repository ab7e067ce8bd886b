"""Measured data of others for Figure 2: small CSV files, and cells of campaigns that were run in
the same workspace.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path, PurePath

import numpy as np
import pandas as pd

from nearlift.campaign.choices import Overlay
from nearlift.campaign.manifest import Campaign
from nearlift.errors import InputRefused, ManifestError
from nearlift.report.evidence import Columns
from nearlift.run import tables
from nearlift.stages.reduce import LIFT

COLUMNS = ("z_hat", "delta_L", "u")
MAX_BYTES = 5_000_000


def read(root: Path, campaign: Campaign, processed: Path) -> tuple[tuple[Overlay, Columns], ...]:
    """Every overlay of the manifest, by boundary, as fractions; `processed` has the workspace's
    products.

    Raises
    ------
    ManifestError
        A file is missing, or lies outside the campaign's folder; a data set was not run.
    InputRefused
        A file is too large, lacks a column, or holds a cell that is no number.
    """
    drawn = []
    for overlay in campaign.report.overlay:
        of_file = overlay.file.endswith(".csv")
        table = _file(root, overlay) if of_file else _cells(overlay, processed)
        for boundary, points in table.groupby("boundary"):
            if overlay.boundary in (None, boundary):
                columns: Columns = {n: points[n].to_numpy(dtype=float) for n in COLUMNS}
                drawn.append((overlay.model_copy(update={"boundary": boundary}), columns))
    return tuple(drawn)


def _cells(overlay: Overlay, processed: Path) -> pd.DataFrame:
    """Cells of a campaign that was run in the workspace."""
    lift = processed / overlay.file / LIFT.file
    if PurePath(overlay.file).name != overlay.file or not lift.is_file():
        raise ManifestError(
            "report.overlay",
            f"{overlay.file!r} is no CSV file, and no campaign of that name was run here",
            f"nearlift data get {overlay.file}, then nearlift run {overlay.file}",
        )
    cells = pd.DataFrame(tables.read_table(lift, LIFT)).rename(columns={"u_delta_L": "u"})
    known = np.isfinite(cells["delta_L"]) & np.isfinite(cells["z_hat"])
    return pd.DataFrame(cells[known])


def _file(root: Path, overlay: Overlay) -> pd.DataFrame:
    """Points of a CSV file."""
    path = (root / overlay.file).resolve()
    inside = path.is_relative_to(root.resolve())
    if not inside or not path.is_file():
        what = f"there is no file {overlay.file!r} in {root}"
        raise ManifestError(
            "report.overlay.file",
            what if inside else f"{overlay.file!r} lies outside the campaign's folder",
            "correct the name, or copy the file into the folder",
        )
    if path.stat().st_size > MAX_BYTES:
        remedy = f"an overlay is a few points: at most {MAX_BYTES} bytes"
        raise InputRefused(overlay.file, f"has {path.stat().st_size} bytes", remedy)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as fault:
        what = f"is not UTF-8 text ({fault.reason} at byte {fault.start})"
        raise InputRefused(overlay.file, what, "save it as UTF-8") from None
    kept = [(i, s) for i, s in enumerate(lines, 1) if s.strip() and not s.startswith("#")]
    rows = list(csv.DictReader(line for _, line in kept))
    if missing := [c for c in COLUMNS if not rows or c not in rows[0]]:
        wanted = f"an overlay has the columns {', '.join(COLUMNS)} (fractions; u may be empty)"
        what = f"lacks {', '.join(missing)}" if rows else "holds no rows"
        raise InputRefused(overlay.file, what, wanted)
    points = [
        {c: _number(row[c], c, f"{overlay.file}, line {i}") for c in COLUMNS}
        | {"boundary": row.get("boundary") or overlay.boundary or "ground"}
        for (i, _), row in zip(kept[1:], rows, strict=True)
    ]
    return pd.DataFrame(points)


def _number(text: str | None, column: str, place: str) -> float:
    cell = (text or "").strip()
    if column == "u" and not cell:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    low = {"z_hat": math.ulp(0.0), "u": 0.0}.get(column, -math.inf)
    if not (math.isfinite(value) and value >= low):
        what = f"{column} = {cell!r} cannot be drawn"
        raise InputRefused(place, what, "correct or remove that line")
    return value
