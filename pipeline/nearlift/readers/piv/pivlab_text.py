"""PIVlab's ASCII chart: up to three header lines, each of which may be missing, then x, y, u, v,
vector type, further columns.

Vector type 1 is measured, 0 masked, 2 interpolated. Line 2 gives the two conversion factors; where
it and the units of line 3 disagree, the factors are right: PIVlab writes m/s above displacements in
metres, then both factors are equal.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.errors import InputRefused
from nearlift.readers.piv.vectors import Dialect, Raw, rows, text_of

MEASURED = 1
#: Begins where a name may, lest every letter of a long one be a start of its own.
NAME = re.compile(r"(?<![^\[\],;\t])([^\[\],;\t]++)\[([^\[\]]*+)\]")


def sniff(head: bytes) -> bool:
    """Its name, its factors, or its column names."""
    first = head.split(b"\n")[0]
    return first.startswith((b"PIVlab", b"FRAME:")) or (b"[" in first and b"Vector type" in first)


def read(path: Path) -> Iterator[Raw]:
    """The one field of a file."""
    lines = text_of(path).split("\n")
    header = [line for line in lines[:3] if re.match(r"\s*(PIVlab|FRAME:|x\s*\[)", line)]
    scale = next((i for i, line in enumerate(header) if "conversion factor" in line), None)
    factors = None if scale is None else _factors(header[scale])
    if scale is not None and factors is None:
        raise InputRefused(
            f"{path}, line {scale + 1}",
            "has conversion factors that are no numbers",
            "export it again",
        )
    named = next((line for line in header if re.match(r"\s*x\s*\[", line)), "")
    names = [(name.strip(), unit) for name, unit in NAME.findall(named)]
    body = lines[len(header) :]
    data = next((line for line in body if line.strip()), "")
    separator = "," if "," in data else "\t" if "\t" in data else None
    table = rows(body, path, len(header) + 1, separator)
    if table.shape[1] < 5 or (names and len(names) != table.shape[1]):
        raise InputRefused(
            f"{path}, line {len(header) + 1}",
            f"has {table.shape[1]} columns, not x, y, u, v, vector type and what follows",
            "export it again",
        )
    length, velocity = _units(names, factors)
    noise = [
        np.abs(table[:, i])
        for i, (name, unit) in enumerate(names)
        if name.lower().startswith("uncertainty") and "/" in unit
    ]
    yield Raw(
        *table[:, :4].T,
        good=table[:, 4] == MEASURED,
        length_unit=length,
        velocity_unit=velocity,
        noise=noise[0] if noise else None,
    )


def _factors(line: str) -> tuple[float, float] | None:
    """What a pixel and a pixel per frame are in m and m/s; None where either is no number."""
    _, _, length = line.partition("conversion factor xy (px -> m):")
    length, _, velocity = length.partition("conversion factor uv (px/frame -> m/s):")
    xy, uv = units.measure(length)[0], units.measure(velocity)
    return None if xy is None or uv[0] is None or uv[1].startswith(".") else (xy, uv[0])


def _units(
    names: list[tuple[str, str]], factors: tuple[float, float] | None
) -> tuple[str | None, str | None]:
    length, velocity = (names[0][1], names[2][1]) if len(names) >= 4 else (None, None)
    if factors is None:
        return length, velocity
    xy, uv = factors
    if xy == 1 and uv == 1:
        return "px", "px/frame"
    if xy == uv:
        return length or "m", "m/frame"
    return length or "m", velocity or "m/s"


PIVLAB = Dialect(name="pivlab", title="PIVlab ASCII chart", sniff=sniff, read=read)
