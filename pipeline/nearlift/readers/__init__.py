"""Outside formats to records: the only place for foreign units and dialects. One file per format,
listed here.
"""

from __future__ import annotations

import difflib
import functools
import importlib
from typing import TYPE_CHECKING

from nearlift.errors import ManifestError
from nearlift.plugins import gather

if TYPE_CHECKING:
    from nearlift.readers.seam import Reader

#: Each built-in reader by name: the module that declares it, imported when it is asked for, and
#: what it is called there.
BUILT_IN = {
    "parquet": ("parquet", "PARQUET"),
    "csv": ("csv_trial", "CSV"),
    "text": ("text", "TEXT_READER"),
    "rcbenchmark": ("rcbenchmark", "RCBENCHMARK_READER"),
    "flight-stand": ("flight_stand", "FLIGHT_STAND_READER"),
    "crazyflie": ("crazyflie", "CRAZYFLIE_READER"),
    "crazyflie-usd": ("usd", "USD_READER"),
    "lvm": ("lvm", "LVM_READER"),
    "tdms": ("tdms", "TDMS_READER"),
    "mat": ("mat", "MAT_READER"),
    "hdf5": ("hdf5", "HDF5_READER"),
    "means": ("means", "MEANS"),
}
GROUP = "nearlift.readers"

__all__ = ["BUILT_IN", "built_in", "reader", "readers"]


def built_in(name: str) -> Reader:
    """The built-in reader of that name."""
    module, value = BUILT_IN[name]
    found: Reader = getattr(importlib.import_module(f"{__name__}.{module}"), value)
    return found


@functools.cache
def readers() -> tuple[Reader, ...]:
    """Every reader: the built-in ones, then those of installed packages (entry points
    `nearlift.readers`, one `Reader` each).
    """
    from nearlift.readers.seam import Reader

    return gather(GROUP, Reader, map(built_in, BUILT_IN))


@functools.cache
def reader(name: str) -> Reader:
    """The reader of that name.

    Raises
    ------
    ManifestError
        There is none; the nearest name is proposed.
    """
    # nothing is overridden, so what packages add need not be known
    if name in BUILT_IN:
        return built_in(name)
    known = {r.name: r for r in readers()}
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"readers are {', '.join(known)}"
        raise ManifestError("records.reader", f"no reader is called {name!r}", hint)
    return known[name]
