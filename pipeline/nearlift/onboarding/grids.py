"""A velocity grid of a PIV run, recognised by its file, and the [piv] section for it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from nearlift.errors import InputRefused
from nearlift.flow.field import on_grid
from nearlift.readers.base import Channel, Contents
from nearlift.readers.piv import PIXEL, Raw, claimed_by, raws


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
        raw, across = self.raw, self.raw.length_unit or ""
        speed = raw.velocity_unit or ""
        columns = (
            ("x", across, raw.x),
            ("y", across, raw.y),
            ("u", speed, raw.u),
            ("v", speed, raw.v),
        )
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


def piv_block(grid: Grid, path: Path) -> str:
    """[piv] of a manifest for files of this kind, with what no file says marked FILL IN."""
    raw = grid.raw
    lines = [
        "[piv]",
        f'format   = "{grid.format}"',
        'control  = "free"                      # the case far from every boundary',
    ]
    length, velocity = raw.length_unit, raw.velocity_unit
    if length is None:
        lines.append('length_unit   = "FILL IN"          # mm | m | px: the files do not say')
    if velocity is None:
        lines.append('velocity_unit = "FILL IN"          # m/s | px/frame: the files do not say')
    if raw.scale_m is None and (length is None or length in PIXEL):
        lines.append('scale      = "FILL IN um/px"       # only where lengths are in pixels')
    if raw.frame_time_s is None and (velocity is None or "/" not in velocity or "px" in velocity):
        lines.append('frame_time = "FILL IN us"          # only where the files hold displacements')
    lines += [
        'thrust   = "FILL IN"                   # its direction in the files: +x | -x | +y | -y',
        'origin   = ["FILL IN mm", "FILL IN mm"]   # in the files: midway between the rotors',
        'rotors   = ["FILL IN mm", "FILL IN mm"]   # axes in the light sheet, from there',
    ]
    pattern = json.dumps(f"piv/free/*{path.suffix}", ensure_ascii=False)
    other = json.dumps(f"piv/ground-1/*{path.suffix}", ensure_ascii=False)
    lines += [
        "[[piv.case]]",
        'name     = "free"',
        'boundary = "none"',
        f"files    = {pattern}",
        "[[piv.case]]",
        'name     = "ground-1"',
        'boundary = "ground"                    # ground | ceiling',
        'z_hat    = "FILL IN"                   # a number: distance over rotor radius',
        f"files    = {other}",
    ]
    return "\n".join(lines) + "\n"
