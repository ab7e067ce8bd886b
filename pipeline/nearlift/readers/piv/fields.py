"""Velocity fields as files hold them, and their way into SI: units, scale, missing vectors, grid.

A vector that is exactly (0, 0) is none: correlating software writes that where it found nothing or
was told to look away, and no measured vector has it to all printed digits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import KW_ONLY, dataclass
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.declare import BoolArray, FloatArray
from nearlift.errors import InputRefused, ManifestError
from nearlift.flow.field import VelocityField, on_grid

PIXEL = ("px", "pix", "pixel", "pixels")
FRAME = ("frame", "frames", "dt", "pair")


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """What the manifest says of files: units that they lack, m per pixel, s between two images."""

    length_unit: str | None = None
    velocity_unit: str | None = None
    scale_m: float | None = None
    frame_time_s: float | None = None


@dataclass(frozen=True, slots=True)
class Raw:
    """One field as it stands in a file, rows (n,) in any order, units, scale and frame time None
    where the file does not say them.

    v is positive along the file's y unless the manifest says otherwise; `good` is what the file
    calls a measured vector, `noise` the standard uncertainty of a component, in the velocity's
    unit.
    """

    x: FloatArray
    y: FloatArray
    u: FloatArray
    v: FloatArray
    _: KW_ONLY
    good: BoolArray
    length_unit: str | None
    velocity_unit: str | None
    scale_m: float | None = None
    frame_time_s: float | None = None
    noise: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """One outside format: its name in ``[piv] format``, and a title for the catalogue.

    `recognises` judges a file by its first bytes; no two dialects claim one file.
    `read` gives the fields of a file, one in memory at a time. `child`: a library written in C
    parses it, which it does in a process of its own (`readers.guarded`).
    """

    name: str
    title: str
    recognises: Callable[[bytes], bool]
    read: Callable[[Path], Iterator[Raw]]
    child: bool = False


def settle(raw: Raw, setting: Setting, where: str) -> VelocityField:
    """A field in SI on its grid, in the file's own axes; what is no vector is nan. `InputRefused`
    where a unit is unknown or contradicts the manifest; pixels have no scale, displacements no
    frame time; every vector is zero or missing; the grid is not rectangular and even.
    """
    length = _one(raw.length_unit, setting.length_unit, "length_unit", '"mm"', where)
    velocity = _one(
        raw.velocity_unit, setting.velocity_unit, "velocity_unit", '"m/s" (or "px/frame")', where
    )
    per_length = _length(length, raw, setting, where)
    per_velocity = _velocity(velocity, raw, setting, where)
    u, v = np.asarray(raw.u, dtype=float), np.asarray(raw.v, dtype=float)
    nothing = (u == 0) & (v == 0)
    if len(u) and nothing.all():
        raise InputRefused(
            where,
            "every vector is zero",
            "an export that took the mask for validity? export it again",
        )
    good = raw.good & np.isfinite(u) & np.isfinite(v) & ~nothing
    if not good.any():
        raise InputRefused(
            where,
            f"none of its {len(u)} vectors is valid",
            "check the mask and the flags of the export",
        )
    columns = [np.where(good, per_velocity * u, np.nan), np.where(good, per_velocity * v, np.nan)]
    if raw.noise is not None:
        columns.append(np.where(good & (raw.noise > 0), abs(per_velocity) * raw.noise, np.nan))
    x, y, grids = on_grid(per_length * raw.x, per_length * raw.y, tuple(columns), where)
    return VelocityField(
        x_m=x,
        y_m=y,
        vx_m_s=grids[0],
        vy_m_s=grids[1],
        u_m_s=grids[2] if raw.noise is not None else None,
    )


def _one(said: str | None, manifest: str | None, key: str, example: str, where: str) -> str:
    if said is None and manifest is None:
        raise InputRefused(
            where, f"does not say its {key.replace('_', ' ')}", f"add {key} = {example} under [piv]"
        )
    if said is not None and manifest is not None and _plain(said) != _plain(manifest):
        raise InputRefused(
            where,
            f"says {said!r} where the manifest's {key} is {manifest!r}",
            f"leave {key} out, or export in {manifest!r}",
        )
    return _plain(said if said is not None else manifest or "")


def _plain(unit: str) -> str:
    text = unit.strip().strip("[]()").replace(" ", "").replace("µ", "u")
    head, _, tail = text.partition("/")
    head = "px" if head.lower() in PIXEL else head
    tail = "frame" if tail.lower() in FRAME else tail
    return f"{head}/{tail}" if tail else head


def _length(unit: str, raw: Raw, setting: Setting, where: str) -> float:
    """Metres in a unit of length, which may be the pixel."""
    if unit != "px":
        return _factor(unit, "length", where)
    scale = raw.scale_m if raw.scale_m is not None else setting.scale_m
    if scale is None:
        raise InputRefused(
            where,
            "is in pixels, and nothing says how large a pixel is",
            'add scale = "20 um/px" under [piv]',
        )
    return scale


def _velocity(unit: str, raw: Raw, setting: Setting, where: str) -> float:
    """m/s in a unit of velocity, or of displacement between a pair's images."""
    head, _, tail = unit.partition("/")
    if tail not in ("frame", ""):
        if head != "px":
            return _factor(unit, "velocity", where)
        return _length(head, raw, setting, where) / _factor(tail, "time", where)
    length = _length(head, raw, setting, where)
    frame_time = raw.frame_time_s or setting.frame_time_s
    if frame_time is None:
        raise InputRefused(
            where,
            f"holds displacements ({unit}), not velocities",
            'add frame_time = "100 us", the time between a pair\'s images',
        )
    return length / frame_time


def _factor(unit: str, dimension: str, where: str) -> float:
    try:
        return units.to_si(unit, dimension, where)[0]
    except ManifestError as refusal:
        raise InputRefused(where, refusal.what, refusal.remedy) from None
