"""Records that Python saved with ``numpy.savez``: one archive per trial, an array for each channel,
and ``rate_Hz``.

Units stand in the arrays' names: ``force[mN]``, ``supply[V]``. Archives carry a check sum (CRC-32),
so a cut or changed one is found out. Arrays of objects are pickles and are never loaded.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.readers.base import Channel, Contents, Reader, split_unit, wanted
from nearlift.readers.guarded import Malformed


def contents(path: Path, dialect: Mapping[str, Any], names: tuple[str, ...] | None) -> Contents:
    """The channels of one archive, at least those that `names` may mean; `Malformed` where it is
    damaged.
    """
    try:
        with path.open("rb") as file, np.lib.npyio.NpzFile(file, allow_pickle=False) as archive:
            arrays = {
                name: archive[name]
                for name in archive.files
                if name == "rate_Hz" or names is None or wanted(name, names)
            }
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as fault:
        raise Malformed(f"is no whole archive of plain arrays ({fault})") from None
    rate_Hz = float(arrays.pop("rate_Hz")) if "rate_Hz" in arrays else None
    for name, values in arrays.items():
        if values.ndim != 1 or values.dtype.kind not in "fiu":
            raise Malformed(f"array {name!r} is no series of numbers")
    channels = (
        Channel(name=n, unit=split_unit(n)[1], values=v.astype(float), rate_Hz=rate_Hz)
        for n, v in arrays.items()
    )
    return Contents(channels=tuple(channels), kind="a NumPy archive")


def recognises(head: bytes, name: str) -> bool:
    """Any zip may begin so; the suffix decides."""
    return head.startswith(b"PK\x03\x04") and name.endswith(".npz")


READER = Reader(
    name="npz",
    title="NumPy archives, one file per trial",
    recognises=recognises,
    contents=contents,
)
