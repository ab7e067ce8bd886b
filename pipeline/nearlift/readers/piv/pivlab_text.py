"""PIVlab's ASCII chart: up to three header lines, each of which may be missing, then x, y, u, v, vector type, further columns.

Vector type 1 is measured, 0 masked, 2 interpolated. Line 2 gives the two conversion factors; where it and the units of line 3
disagree, the factors are right: PIVlab writes m/s above displacements in metres, then both factors are equal.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers.piv.seam import Dialect, Raw, rows, text_of
from nearlift.readers.words import NUMBER

MEASURED = 1
FACTORS = re.compile(
    r"conversion factor xy \(px -> m\):\s*(" + NUMBER.pattern + r").*conversion factor uv \(px/frame -> m/s\):\s*(" + NUMBER.pattern + r")(?![\d.])"
)
NAME = re.compile(r"\s*([^\[\],;\t]+?)\s*\[([^\]]*)\]")


def sniff(head: bytes) -> bool:
    """Its name, its factors, or its column names."""
    first = head.split(b"\n")[0]
    return first.startswith((b"PIVlab", b"FRAME:")) or (b"[" in first and b"Vector type" in first)


def read(path: Path) -> Iterator[Raw]:
    """The one field of a file."""
    lines = text_of(path).split("\n")
    header = [line for line in lines[:3] if re.match(r"\s*(PIVlab|FRAME:|x\s*\[)", line)]
    scale = next((i for i, line in enumerate(header) if "conversion factor" in line), None)
    factors = None if scale is None else FACTORS.search(header[scale])
    if scale is not None and factors is None:
        raise InputRefused(f"{path}, line {scale + 1}", "has conversion factors that are no numbers", "export it again")
    names = next((NAME.findall(line) for line in header if re.match(r"\s*x\s*\[", line)), [])
    body = lines[len(header) :]
    data = next((line for line in body if line.strip()), "")
    separator = "," if "," in data else "\t" if "\t" in data else None
    table = rows(body, path, len(header) + 1, separator)
    if table.shape[1] < 5 or (names and len(names) != table.shape[1]):
        raise InputRefused(
            f"{path}, line {len(header) + 1}", f"has {table.shape[1]} columns, not x, y, u, v, vector type and what follows", "export it again"
        )
    length, velocity = _units(names, factors)
    noise = next((i for i, (name, unit) in enumerate(names) if name.lower().startswith("uncertainty") and "/" in unit), None)
    yield Raw(
        x=table[:, 0],
        y=table[:, 1],
        u=table[:, 2],
        v=table[:, 3],
        good=table[:, 4] == MEASURED,
        length_unit=length,
        velocity_unit=velocity,
        noise=None if noise is None else np.abs(table[:, noise]),
    )


def _units(names: list[tuple[str, str]], factors: re.Match[str] | None) -> tuple[str | None, str | None]:
    length, velocity = (names[0][1], names[2][1]) if len(names) >= 4 else (None, None)
    if factors is None:
        return length, velocity
    xy, uv = float(factors[1]), float(factors[2])
    if xy == 1 and uv == 1:
        return "px", "px/frame"
    if xy == uv:
        return length or "m", "m/frame"
    return length or "m", velocity or "m/s"


PIVLAB = Dialect(name="pivlab", title="PIVlab ASCII chart", sniff=sniff, read=read)
