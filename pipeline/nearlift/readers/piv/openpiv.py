"""OpenPIV text. New: a line ``# x y u v flags mask``; old: five columns without a header, the fifth
the signal-to-noise ratio.

flags 0 is a measured vector (1 invalid, 2 interpolated); mask 1 is masked, so a column of zeros
masks nothing. The files say no unit: pixels, millimetres and metres, displacements and velocities
all occur, so the manifest must say.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers.piv.vectors import Dialect, Raw, rows, text_of

NEW = ("x", "y", "u", "v", "flags", "mask")
OLD_COLUMNS = 5


def sniff(head: bytes) -> bool:
    """The header of the new form, or five blank-separated numbers of which the fifth is no flag."""
    first = head.split(b"\n")[0].decode("latin-1")
    if first.startswith("#"):
        return tuple(first.lstrip("# ").split()[:4]) == NEW[:4]
    return _numbers(first) == OLD_COLUMNS


def _numbers(line: str) -> int:
    try:
        return len([float(cell) for cell in line.split()])
    except ValueError:
        return 0


def read(path: Path) -> Iterator[Raw]:
    """The one field of a file."""
    text = text_of(path)
    first, _, rest = text.partition("\n")
    if first.startswith("#"):
        names = first.lstrip("# ").split()
        if tuple(names[:4]) != NEW[:4]:
            raise InputRefused(
                f"{path}, line 1",
                f"names {names}, not {' '.join(NEW)}",
                "export it with OpenPIV's own save",
            )
        table = rows(rest.split("\n"), path, 2, None)
        if table.shape[1] != len(names):
            raise InputRefused(
                f"{path}, line 2",
                f"has {table.shape[1]} columns where the header names {len(names)}",
                "export it again",
            )
        good = np.ones(len(table), dtype=bool)
        if "flags" in names:
            good &= table[:, names.index("flags")] == 0
        if "mask" in names:
            good &= table[:, names.index("mask")] == 0
    else:
        table = rows(text.split("\n"), path, 1, None)
        if table.shape[1] != OLD_COLUMNS:
            raise InputRefused(
                f"{path}, line 1",
                f"has {table.shape[1]} columns and no header",
                f"the old form has {OLD_COLUMNS}: x y u v s2n",
            )
        if np.isin(table[:, 4], (0, 1, 2)).all():
            raise InputRefused(
                str(path),
                "has a fifth column of flags, and no header says whether 0 or 1 is a good vector",
                'save it with a header, or say format = "pivlab" if PIVlab wrote it (there 1 is'
                " good)",
            )
        good = np.isfinite(table[:, 4])
    yield Raw(*table[:, :4].T, good=good, length_unit=None, velocity_unit=None)


OPENPIV = Dialect(
    name="openpiv", title="OpenPIV text, with or without header", sniff=sniff, read=read
)
