"""LaVision DaVis text: ``#DaVis 8.1.6 2D-vector 32 64 64 "position" "mm" ... "velocity" "m/s"``,
then tab rows x, y, u, v.

Decimals may be commas, as the PC that exported was set. A missing vector is written ``0 -0``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers.piv.vectors import Dialect, Raw, rows, text_of


def sniff(head: bytes) -> bool:
    """The name in the first line."""
    return head.startswith(b"#DaVis")


def read(path: Path) -> Iterator[Raw]:
    """The one field of a file."""
    header, _, body = text_of(path).partition("\n")
    quantities = re.findall(r'"([^"]*)"\s+"([^"]*)"', header)
    size = re.search(r"2D-vector\s+\d+\s+(\d{1,9})\s+(\d{1,9})\b", header)
    if size is None or len(quantities) < 3:
        raise InputRefused(
            f"{path}, line 1",
            "is not the header of a two-component vector field",
            "export 2D vectors as text",
        )
    comma, point = "," in body, "." in body
    if comma and point:
        raise InputRefused(
            str(path), "mixes decimal commas and points", "export it with one of the two"
        )
    lines = body.split("\n")
    table = rows(lines, path, 2, "\t", comma=comma)
    if table.shape[1] < 4 or len(table) != int(size[1]) * int(size[2]):
        raise InputRefused(
            str(path),
            f"has {len(table)} rows of {table.shape[1]}, its header promises {size[1]} x {size[2]}"
            " vectors",
            "it was cut off: export it again",
        )
    what, unit = quantities[2]
    yield Raw(
        *table[:, :4].T,
        good=np.ones(len(table), dtype=bool),
        length_unit=quantities[0][1],
        velocity_unit=f"{unit}/frame" if what.lower() == "displacement" else unit,
    )


DAVIS = Dialect(name="davis", title="LaVision DaVis text", sniff=sniff, read=read)
