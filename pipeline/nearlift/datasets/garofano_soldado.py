"""Garofano-Soldado et al.: the MATLAB script of their figures as the table that
`datasets.garofano_soldado_table` makes a campaign of.

The script assigns, per configuration, a row of mean forces and one of standard deviations; the
heights stand in `z` as multiples of R.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from nearlift.datasets import garofano_soldado_table
from nearlift.errors import InputRefused

#: Of the table that the published numbers make, 149 rows as `table` writes them.
NUMBERS_SHA256 = "73877bf965146079ee3b7990bd62a96ae6dcfe45038ee6afe61a227a211a9802"
ROW = re.compile(
    r"^(?P<std>std_)?(?P<case>Fz(?P<alpha>\d+)(?P<facing>_minbeta|_beta)?(?P<beta>\d+)?)\s*=\s*\[(?P<values>[^\[\]]*)\]",
    re.M,
)
HEIGHTS = re.compile(r"^(?P<name>z\w*)\s*=\s*\[(?P<values>[^\[\]]*)\]", re.M)
RADIUS = re.compile(r"^R\s*=\s*(?P<value>[\d.]+)", re.M)
#: How the two rotors stand to each other, by what the name of a case says of it.
FACING = {None: "coplanar", "_beta": "back_to_back", "_minbeta": "face_to_face"}


def convert(files: dict[str, Path], folder: Path, name: str) -> None:
    """Write the campaign, once the numbers are known to be those that were published; a name that
    ends with ``-axes`` wants the force along the rotors' axes.

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
    garofano_soldado_table.convert(
        rows, folder / "campaign", along_axes=name.endswith("-axes"), name=name
    )
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
    lines = [",".join(garofano_soldado_table.COLUMNS)]
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
