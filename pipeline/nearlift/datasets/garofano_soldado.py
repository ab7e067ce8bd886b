"""Garofano-Soldado et al.: the MATLAB script of their figures as a table, and the table as a
campaign of means.

The script assigns, per configuration, a row of mean forces and one of standard deviations; the
heights are in `z`, in units of R. The table (``thrust_vs_height.csv``) has 15 tilt configurations
at ten heights. Neither the order of the runs, the number of samples, nor the spacing of the rotors
is published. The campaign leaves out order and spacing. It takes the standard deviation as that of
the mean, which is cautious.
"""

from __future__ import annotations

import hashlib
import math
import re
from pathlib import Path

from nearlift.datasets.tables import read_rows, write_campaign
from nearlift.errors import InputRefused, UsageError

COLUMNS = ("case", "config", "alpha_deg", "beta_deg", "z_over_R", "z_m", "Fz_N", "Fz_std_N")
NOTES = {
    False: "vertical force as measured",
    True: (
        "vertical force over cos(alpha) cos(beta): thrust along the rotors' axes if it does not"
        " care about tilt"
    ),
}
#: Of the table that the published numbers make, 149 rows as `table` writes them.
NUMBERS_SHA256 = "73877bf965146079ee3b7990bd62a96ae6dcfe45038ee6afe61a227a211a9802"
ROW = re.compile(
    r"^(?P<std>std_)?(?P<case>Fz(?P<alpha>\d+)(?P<facing>_minbeta|_beta)?(?P<beta>\d+)?)\s*=\s*\[(?P<values>[^\[\]]*)\]",
    re.M,
)
HEIGHTS = re.compile(r"^(?P<name>z\w*)\s*=\s*\[(?P<values>[^\[\]]*)\]", re.M)
RADIUS = re.compile(r"^R\s*=\s*(?P<value>[\d.]+)", re.M)
#: Tilt of the two rotors relative to each other, by what the name of a case says of it.
FACING = {None: "coplanar", "_beta": "back_to_back", "_minbeta": "face_to_face"}


def convert(files: dict[str, Path], folder: Path, name: str) -> None:
    """Write the campaign, once the numbers are known to be those that were published.

    A name that ends with ``-axes`` asks for the force along the rotors' axes.

    Raises
    ------
    InputRefused
        The script is not what it was.
    """
    (script,) = files.values()
    text = table(script.read_text(encoding="utf-8", errors="replace"), str(script))
    if hashlib.sha256(text.encode()).hexdigest() != NUMBERS_SHA256:
        raise InputRefused(
            str(script),
            "holds other numbers than those that are known here",
            "compare it with the paper; delete it to fetch it again",
        )
    (folder / "published").mkdir()
    rows = folder / "published" / "thrust_vs_height.csv"
    rows.write_text(text, encoding="utf-8")
    write_table(rows, folder / "campaign", along_axes=name.endswith("-axes"), name=name)
    for made in (folder / "campaign").iterdir():
        made.rename(folder / made.name)
    (folder / "campaign").rmdir()


def table(script: str, where: str) -> str:
    """The numbers as CSV: case, configuration, tilts in degrees, height over R and in m, force and
    its standard deviation in N.

    Raises
    ------
    InputRefused
        There is no radius, no row, or a row without its standard deviations or its heights.
    """
    radius = RADIUS.search(script)
    rows = {(row["std"] or "") + row["case"]: row for row in ROW.finditer(script)}
    if radius is None or not rows:
        raise InputRefused(where, "has no rows Fz... or no R", "it is not the published script")
    grids = [
        [float(cell.split("*")[0]) for cell in row["values"].split(",")]
        for row in HEIGHTS.finditer(script)
    ]
    lines = [",".join(COLUMNS)]
    for case, row in rows.items():
        if row["std"]:
            continue
        forces, spreads = (
            _numbers(rows[name]["values"]) if name in rows else [] for name in (case, f"std_{case}")
        )
        heights = next((grid for grid in grids if len(grid) == len(forces)), [])
        if not heights or len(spreads) != len(forces):
            raise InputRefused(
                where,
                f"{case} has {len(forces)} forces, {len(spreads)} standard deviations and no such"
                " heights",
                "it is not whole",
            )
        alpha, beta, config = row["alpha"], row["beta"] or "0", FACING[row["facing"]]
        lines += [
            f"{case},{config},{alpha},{beta},{z!r},{z * float(radius['value'])!r},{force!r},{spread!r}"
            for z, force, spread in zip(heights, forces, spreads, strict=True)
        ]
    return "\n".join(lines) + "\n"


def _numbers(cells: str) -> list[float]:
    return [float(cell) for cell in cells.split()]


def write_table(
    table: Path, folder: Path, *, along_axes: bool = False, name: str | None = None
) -> Path:
    """Write the table, ``thrust_vs_height.csv``, as a campaign into a new or empty folder; return
    the folder.

    With `along_axes` the force is divided by cos(alpha) cos(beta). The campaign has the `name`, or
    that of the folder. `InputRefused` where the table lacks a column, or a cell is no number.
    `UsageError` where the folder holds something.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            str(folder),
            "is not empty" if folder.is_dir() else "is a file",
            "name a new folder; nothing is ever overwritten",
        )
    lines = ["trial,distance,session,tilt,beta,lift,lift_sd"]
    for number, row in enumerate(read_table(table), 2):
        try:
            alpha, beta, z_m, force, spread = (
                float(row[c]) for c in ("alpha_deg", "beta_deg", "z_m", "Fz_N", "Fz_std_N")
            )
        except ValueError as fault:
            raise InputRefused(f"{table}, line {number}", str(fault), "correct that cell") from None
        share = math.cos(math.radians(alpha)) * math.cos(math.radians(beta)) if along_axes else 1.0
        # tilted towards each other counts positive
        facing = {"face_to_face": 1, "coplanar": 0, "back_to_back": -1}.get(row["config"])
        if facing is None:
            raise InputRefused(
                f"{table}, line {number}",
                f"{row['config']!r} is no known configuration",
                "coplanar, face_to_face or back_to_back",
            )
        trial = f"{row['case']}-{float(row['z_over_R']):g}"
        lines.append(
            f"{trial},{z_m:.6g},{row['case']},{facing * alpha:g},{beta:g},{force / share:.6g},{spread / share:.6g}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    note = NOTES[along_axes]
    write_campaign(folder, "garofano_soldado", lines, name=name or folder.name, note=note)
    return folder


def read_table(table: Path) -> list[dict[str, str]]:
    """Rows of the table, unchanged."""
    if not table.is_file():
        raise InputRefused(
            str(table), "is missing", "name the published table, thrust_vs_height.csv"
        )
    return read_rows(table, COLUMNS)
