"""A velocity grid of a PIV run, recognised by its file, and the [piv] section for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import tomlkit

from nearlift.errors import InputRefused
from nearlift.flow.field import on_grid
from nearlift.readers.base import Channel, Contents
from nearlift.readers.piv import DIALECTS, PIXEL, Setting, claimed_by, raws


class Grid(NamedTuple):
    """Format of a velocity grid, its columns, and the [piv] section that reads it."""

    format: str
    contents: Contents
    section: str


def grid_of(path: Path) -> Grid | None:
    """Velocity grid of a file, by its first field; None where it is none."""
    try:
        name = claimed_by(path)
        raw = next(iter(raws(path, name)))
        across, up, _ = on_grid(raw.x, raw.y, (raw.u,), str(path))
    except (InputRefused, StopIteration):
        return None
    length, speed = raw.stated.length_unit or "", raw.stated.velocity_unit or ""
    columns = {"x": (length, raw.x), "y": (length, raw.y), "u": (speed, raw.u), "v": (speed, raw.v)}
    contents = Contents(
        channels=tuple(Channel(name=n, unit=unit, values=v) for n, (unit, v) in columns.items()),
        kind=f"velocity grid, {DIALECTS[name].title}",
        notes=(f"{len(across)} x {len(up)} nodes: no record of force",),
    )
    return Grid(name, contents, _section(name, raw.stated, path.suffix))


def _section(form: str, stated: Setting, suffix: str) -> str:
    """[piv] of a manifest for files of this kind; facts that no file states are marked FILL IN."""
    length, velocity = stated.length_unit, stated.velocity_unit
    in_frames = velocity is None or "/" not in velocity or "px" in velocity
    known = {
        "length_unit": length is not None,
        "velocity_unit": velocity is not None,
        "scale": stated.scale_m is not None or not (length is None or length in PIXEL),
        "frame_time": stated.frame_time_s is not None or not in_frames,
    }
    doc = tomlkit.parse(Path(__file__).with_name("piv.toml").read_text(encoding="utf-8"))
    piv: Any = doc["piv"]
    piv["format"] = form
    for key in (key for key, is_known in known.items() if is_known):
        del piv[key]
    for case in piv["case"]:
        case["files"] += suffix
    return tomlkit.dumps(doc)
