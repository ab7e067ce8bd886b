"""TSI Insight ``.vec``: one header line (TITLE, VARIABLES, auxiliary data), then comma rows x, y,
u, v, CHC.

CHC 1 is a measured vector; 2 is interpolated, everything else void. The header gives um per pixel
and us between images.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from nearlift.errors import InputRefused
from nearlift.readers.piv.vectors import Dialect, Raw, rows, text_of
from nearlift.units import NUMBER

MEASURED = 1


def sniff(head: bytes) -> bool:
    """A Tecplot-like header with a choice code."""
    return head.lstrip().startswith(b"TITLE=") and b"VARIABLES=" in head and b'"CHC"' in head


def read(path: Path) -> Iterator[Raw]:
    """The one field of a file."""
    header, _, body = text_of(path).partition("\n")
    listed = re.search(r"VARIABLES=((?:\s*\"[^\"]*\",?)+)", header)
    names = re.findall(r'"([^"]*)"', listed[1]) if listed else []
    columns = [name.split()[0].upper() for name in names if name.split()]
    if columns[:4] != ["X", "Y", "U", "V"] or "CHC" not in columns:
        raise InputRefused(
            f"{path}, line 1",
            f"lists the variables {names}, not X, Y, U, V, CHC",
            "export a two-component field",
        )
    table = rows(body.split("\n"), path, 2, ",")
    if table.shape[1] != len(columns):
        raise InputRefused(
            f"{path}, line 2",
            f"has {table.shape[1]} columns where the header names {len(columns)}",
            "export it again",
        )
    unit = [name.partition(" ")[2] or None for name in names]
    um = _number(header, "MicrometersPerPixelX", path)
    us = _number(header, "MicrosecondsPerDeltaT", path)
    yield Raw(
        *table[:, :4].T,
        good=table[:, columns.index("CHC")] == MEASURED,
        length_unit=unit[0],
        velocity_unit=unit[2],
        scale_m=None if um is None else 1e-6 * um,
        frame_time_s=None if us is None else 1e-6 * us,
    )


def _number(header: str, key: str, path: Path) -> float | None:
    text, end, _ = header.partition(f'{key}="')[2].partition('"')
    if not end:
        return None
    if not NUMBER.fullmatch(text):
        raise InputRefused(
            f"{path}, line 1", f"has {key} {text!r}, which is no number", "export it again"
        )
    value = float(text)
    return value if value > 0 else None


INSIGHT = Dialect(name="insight", title="TSI Insight .vec", sniff=sniff, read=read)
