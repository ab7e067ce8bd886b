"""Velocity fields of exported grids in SI, and the files of a case."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.campaign.piv import Piv, PivCase
from nearlift.errors import InputRefused, ManifestError
from nearlift.flow.field import VelocityField, masked, on_grid, orient
from nearlift.readers.files import inside, source_of
from nearlift.readers.piv import FRAME, PIXEL, Raw, Setting, claimed_by, dialect_of, raws


def read(
    path: Path, setting: Setting | None = None, format_name: str | None = None
) -> Iterator[VelocityField]:
    """The fields of one file in SI, in the file's own axes; `InputRefused` where it cannot be read,
    or holds no velocities in known units.
    """
    dialect = claimed_by(path) if format_name is None else dialect_of(format_name)
    for i, raw in enumerate(raws(path, dialect)):
        yield to_si(raw, setting or Setting(), f"{path}, field {i + 1}" if i else str(path))


def to_si(raw: Raw, setting: Setting, where: str) -> VelocityField:
    """A field in SI on its grid, in the file's own axes; NaN where there is no vector.

    Raises
    ------
    InputRefused
        A unit is unknown or contradicts the manifest. Pixels have no scale, or displacements no
        frame time. Every vector is zero or missing. The grid is not rectangular and even.
    """
    scale_m = setting.scale_m if raw.stated.scale_m is None else raw.stated.scale_m
    per_length = _length(_agreed(raw, setting, "length_unit", where), scale_m, where)
    per_velocity = _velocity(
        _agreed(raw, setting, "velocity_unit", where),
        scale_m,
        raw.stated.frame_time_s or setting.frame_time_s,
        where,
    )
    u, v = np.asarray(raw.u, dtype=float), np.asarray(raw.v, dtype=float)
    nothing = (u == 0) & (v == 0)
    good = raw.good & np.isfinite(u) & np.isfinite(v) & ~nothing
    if not good.any():
        zero = len(u) and nothing.all()
        what = "every vector is zero" if zero else f"none of its {len(u)} vectors is valid"
        raise InputRefused(where, what, "check the mask and the flags of the export")
    columns = [np.where(good, per_velocity * u, np.nan), np.where(good, per_velocity * v, np.nan)]
    if raw.noise is not None:
        columns.append(np.where(good & (raw.noise > 0), abs(per_velocity) * raw.noise, np.nan))
    x, y, grids = on_grid(per_length * raw.x, per_length * raw.y, tuple(columns), where)
    noise = grids[2] if raw.noise is not None else None
    return VelocityField(x_m=x, y_m=y, vx_m_s=grids[0], vy_m_s=grids[1], u_m_s=noise)


def _agreed(raw: Raw, setting: Setting, key: str, where: str) -> str:
    """The unit of a file or of the manifest; both must agree."""
    stated, manifest = getattr(raw.stated, key), getattr(setting, key)
    if stated is None and manifest is None:
        example = '"mm"' if key == "length_unit" else '"m/s" (or "px/frame")'
        what = f"does not say its {key.replace('_', ' ')}"
        raise InputRefused(where, what, f"add {key} = {example} under [piv]")
    if None not in (stated, manifest) and _plain(stated) != _plain(manifest):
        what = f"says {stated!r} where the manifest's {key} is {manifest!r}"
        raise InputRefused(where, what, f"leave {key} out, or export in {manifest!r}")
    return _plain(manifest if stated is None else stated)


def _plain(unit: str) -> str:
    text = unit.strip().strip("[]()").replace(" ", "").replace("µ", "u")
    head, _, tail = text.partition("/")
    head = "px" if head.lower() in PIXEL else head
    tail = "frame" if tail.lower() in FRAME else tail
    return f"{head}/{tail}" if tail else head


def _length(unit: str, scale_m: float | None, where: str) -> float:
    """Metres in a unit of length, which may be the pixel."""
    if unit != "px":
        return _factor(unit, "length", where)
    if scale_m is None:
        what = "is in pixels, and nothing says how large a pixel is"
        raise InputRefused(where, what, 'add scale = "20 um/px" under [piv]')
    return scale_m


def _velocity(unit: str, scale_m: float | None, frame_time_s: float | None, where: str) -> float:
    """m/s in a unit of velocity, or of displacement between a pair's images."""
    head, _, tail = unit.partition("/")
    if tail not in ("frame", ""):
        if head != "px":
            return _factor(unit, "velocity", where)
        return _length(head, scale_m, where) / _factor(tail, "time", where)
    length = _length(head, scale_m, where)
    if frame_time_s is None:
        what = f"holds displacements ({unit}), not velocities"
        remedy = 'add frame_time = "100 us", the time between a pair\'s images'
        raise InputRefused(where, what, remedy)
    return length / frame_time_s


def _factor(unit: str, dimension: str, where: str) -> float:
    try:
        return units.to_si(unit, dimension, where)[0]
    except ManifestError as refusal:
        raise InputRefused(where, refusal.what, refusal.remedy) from None


def files_of(root: Path, case: PivCase) -> list[Path]:
    """Every file of a case, in the order of the numbers in their names.

    `ManifestError` where the pattern leads outside the campaign's folder, or matches nothing.
    `InputRefused` where a file leads outside by a link, or is no regular file.
    """
    where = f"piv case {case.name!r}: files"
    if Path(case.files).is_absolute() or ".." in Path(case.files).parts:
        what = f"{case.files!r} leads outside the campaign's folder"
        raise ManifestError(where, what, "put the files themselves into the folder")
    names = [source_of(root, path) for path in root.glob(case.files) if path.is_file()]
    if not names:
        what = f"no file matches {case.files!r} in {root}"
        raise ManifestError(where, what, 'write a pattern such as "piv/ground-3.4/*.txt"')
    return [inside(root, name, where)[0] for name in sorted(names, key=_natural)]


def _natural(name: str) -> list[str | int]:
    # every second part is a number
    return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"(\d+)", name))]


@dataclass
class Stream:
    """The fields of one case, one in memory at a time; `refused` lists files and their reasons."""

    root: Path
    piv: Piv
    case: PivCase
    files: list[Path]
    refused: list[tuple[str, InputRefused]] = field(default_factory=list)

    def __iter__(self) -> Iterator[VelocityField]:
        said = partial(self.piv.setting, self.case)
        setting = Setting(
            length_unit=said("length_unit"),
            velocity_unit=said("velocity_unit"),
            scale_m=said("scale"),
            frame_time_s=said("frame_time"),
        )
        lie = {name: said(name) for name in ("thrust", "across")}
        lie |= {"origin_m": said("origin"), "v_sign": said("v_sign", 1)}
        for path in self.files:
            try:
                for field in read(path, setting, said("format")):
                    yield masked(orient(field, **lie), said("mask", []))
            except InputRefused as refusal:
                self.refused.append((source_of(self.root, path), refusal))
