"""Measured data of others for Figure 2: small CSV files, and cells of campaigns that were run in
the same workspace.
"""

from __future__ import annotations

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
        rows = pd.read_csv(path, dtype=str, comment="#", encoding="utf-8-sig").fillna("")
    except ValueError as fault:
        what = f"cannot be read: {str(fault).splitlines()[0]}"
        raise InputRefused(overlay.file, what, "save it as CSV in UTF-8") from None
    rows.columns = rows.columns.str.strip()
    missing = [c for c in COLUMNS if c not in rows]
    if missing or rows.empty:
        wanted = f"an overlay has the columns {', '.join(COLUMNS)} (fractions; u may be empty)"
        what = f"lacks {', '.join(missing)}" if missing else "holds no rows"
        raise InputRefused(overlay.file, what, wanted)
    points = rows[[*COLUMNS]].apply(pd.to_numeric, errors="coerce")
    least = {"z_hat": math.ulp(0.0), "delta_L": -math.inf, "u": 0.0}
    good = np.isfinite(points) & (points >= pd.Series(least))
    good["u"] |= rows["u"].str.strip() == ""
    for row, column in zip(*np.nonzero(~good.to_numpy()), strict=True):
        what = f"{COLUMNS[column]} = {rows[COLUMNS[column]][row]!r} cannot be drawn"
        raise InputRefused(f"{overlay.file}, row {row + 1}", what, "correct or remove that row")
    named = rows.get("boundary", pd.Series("", index=rows.index))
    points["boundary"] = named.replace("", overlay.boundary or "ground")
    return pd.DataFrame(points)
