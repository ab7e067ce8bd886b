"""Dantec DynamicStudio export, CSV or TAB: ``>>*HEADER*<<`` with ``FileID:DSExport.CSV``,
``>>*DATA*<<``, a line of names, rows.

Columns are found by name and unit (``X (mm)[mm]``, ``U[m/s]``): their order differs between two and
three components. Status 0 is a measured vector; any other was rejected, substituted or masked.
Written after descriptions and parsers of the format: no export of the software itself was at hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers.piv.vectors import PIXEL, Dialect, Raw, rows, text_of

HEADER, DATA = ">>*HEADER*<<", ">>*DATA*<<"


def sniff(head: bytes) -> bool:
    """The first mark."""
    return head.lstrip(b"\xef\xbb\xbf").lstrip().startswith(HEADER.encode())


def read(path: Path) -> Iterator[Raw]:
    """The one field of a file."""
    lines = text_of(path).split("\n")
    marks = [i for i, line in enumerate(lines) if line.strip().strip(";,").startswith(DATA)]
    if len(marks) != 1 or marks[0] + 2 >= len(lines):
        raise InputRefused(
            str(path),
            f"has {len(marks)} lines {DATA} with rows after them",
            "export one field per file",
        )
    at = marks[0]
    header = "\n".join(lines[:at])
    tabs = "DSExport.TAB" in header or "\t" in lines[at + 1]
    separator = "\t" if tabs else ";" if ";" in lines[at + 1] else ","
    names = [
        name.strip().strip('"') for name in lines[at + 1].strip().strip(separator).split(separator)
    ]
    first = lines[at + 2]
    comma = separator != "," and bool(re.search(r"\d,\d", first))
    table = rows(lines[at + 2 :], path, at + 3, separator, comma=comma)
    if table.shape[1] != len(names):
        raise InputRefused(
            f"{path}, line {at + 3}",
            f"has {table.shape[1]} columns where line {at + 2} names {len(names)}",
            "export it again",
        )
    size = re.search(
        r"GridSize\s*+[:;]\s*+\{?\s*+Width\s*+=\s*+(\d{1,9})\s*+,\s*+Height\s*+=\s*+(\d{1,9})\b",
        header,
    )
    if size is not None and int(size[1]) * int(size[2]) != len(table):
        raise InputRefused(
            str(path),
            f"has {len(table)} rows, its header promises {size[1]} x {size[2]}",
            "it was cut off: export it again",
        )
    (i, length), (j, _) = _column(names, "x", path), _column(names, "y", path)
    (k, velocity), (m, _) = _column(names, "u", path), _column(names, "v", path)
    status = next((n for n, name in enumerate(names) if name.lower().startswith("status")), None)
    yield Raw(
        *table[:, [i, j, k, m]].T,
        good=np.ones(len(table), dtype=bool) if status is None else table[:, status] == 0,
        length_unit=length,
        velocity_unit=f"{velocity}/frame" if "/" not in velocity else velocity,
    )


def _column(names: list[str], letter: str, path: Path) -> tuple[int, str]:
    """Position and unit of ``X (mm)[mm]`` and the like: rather in metres than in pixels."""
    fitting = []
    for i, name in enumerate(names):
        match = re.fullmatch(
            r"\s*+([A-Za-z])\s*+(?:\([^)]*+\)\s*+|(?<=\s)\w++\s*+)?\[([^\]]++)\]\s*+", name
        )
        if match and match[1].lower() == letter:
            fitting.append((match[2].lower().split("/")[0] in PIXEL, i, match[2]))
    if not fitting:
        raise InputRefused(
            str(path),
            f"names no column {letter.upper()} with a unit among {', '.join(names)}",
            "export positions and components with units",
        )
    _, i, unit = min(fitting)
    return i, unit


DANTEC = Dialect(
    name="dantec", title="Dantec DynamicStudio export, CSV or TAB", sniff=sniff, read=read
)
