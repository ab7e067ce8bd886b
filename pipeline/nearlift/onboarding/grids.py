"""A velocity grid of a PIV run, recognised by its file, and the [piv] section for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from nearlift.errors import InputRefused
from nearlift.flow.field import on_grid
from nearlift.readers.base import Channel, Contents
from nearlift.readers.piv import PIXEL, Raw, claimed_by, raws

TEMPLATE = """\
[piv]
format   = "FILL IN"
control  = "free"                      # the case far from every boundary
length_unit   = "FILL IN"              # mm | m | px: the files do not say
velocity_unit = "FILL IN"              # m/s | px/frame: the files do not say
scale      = "FILL IN um/px"           # only where lengths are in pixels
frame_time = "FILL IN us"              # only where the files hold displacements
thrust   = "FILL IN"                   # its direction in the files: +x | -x | +y | -y
origin   = ["FILL IN mm", "FILL IN mm"]   # in the files: midway between the rotors
rotors   = ["FILL IN mm", "FILL IN mm"]   # axes in the light sheet, from there
[[piv.case]]
name     = "free"
boundary = "none"
files    = "piv/free/*"
[[piv.case]]
name     = "ground-1"
boundary = "ground"                    # ground | ceiling
z_hat    = "FILL IN"                   # a number: distance over rotor radius
files    = "piv/ground-1/*"
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """The first field of a file: its format, its nodes across and up, and what it says of units."""

    format: str
    title: str
    nodes: tuple[int, int]
    raw: Raw

    @property
    def contents(self) -> Contents:
        """Its columns as channels."""
        raw, stated = self.raw, self.raw.stated
        length, speed = stated.length_unit or "", stated.velocity_unit or ""
        lengths, speeds = {"x": raw.x, "y": raw.y}, {"u": raw.u, "v": raw.v}
        columns = [(n, length, v) for n, v in lengths.items()]
        columns += [(n, speed, v) for n, v in speeds.items()]
        return Contents(
            channels=tuple(Channel(name=n, unit=unit, values=v) for n, unit, v in columns),
            kind=f"velocity grid, {self.title}",
            notes=(f"{self.nodes[0]} x {self.nodes[1]} nodes: no record of force",),
        )


def grid_of(path: Path) -> Grid | None:
    """The file as a velocity grid; None where it is none."""
    try:
        dialect = claimed_by(path)
        for raw in raws(path, dialect):
            across, up, _ = on_grid(raw.x, raw.y, (raw.u,), str(path))
            nodes = len(across), len(up)
            return Grid(format=dialect.name, title=dialect.title, nodes=nodes, raw=raw)
    except InputRefused:
        pass
    return None


def piv_section(grid: Grid, path: Path) -> str:
    """[piv] of a manifest for files of this kind, with what no file says marked FILL IN."""
    file, doc = grid.raw.stated, tomlkit.parse(TEMPLATE)
    piv: Any = doc["piv"]
    piv["format"] = grid.format
    length, velocity = file.length_unit, file.velocity_unit
    stated = {
        "length_unit": length is not None,
        "velocity_unit": velocity is not None,
        "scale": file.scale_m is not None or not (length is None or length in PIXEL),
        "frame_time": file.frame_time_s is not None
        or not (velocity is None or "/" not in velocity or "px" in velocity),
    }
    for key in (key for key, known in stated.items() if known):
        del piv[key]
    for case in piv["case"]:
        case["files"] += path.suffix
    return tomlkit.dumps(doc)
