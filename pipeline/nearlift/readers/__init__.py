"""Outside formats to records, one file per format: the one place for foreign units and dialects."""

from __future__ import annotations

import functools
import importlib
from typing import TYPE_CHECKING

from nearlift.errors import ManifestError, did_you_mean
from nearlift.plugins import gather

if TYPE_CHECKING:
    from nearlift.readers.seam import Reader

#: Each built-in reader by name: the module whose `READER` it is, imported when it is asked for.
BUILT_IN = {
    "parquet": "parquet",
    "csv": "csv_trial",
    "text": "text",
    "rcbenchmark": "rcbenchmark",
    "flight-stand": "flight_stand",
    "crazyflie": "crazyflie",
    "sheet": "sheet",
    "lvm": "lvm",
    "tdms": "tdms",
    "mat": "mat",
    "hdf5": "hdf5",
    "means": "means",
}
GROUP = "nearlift.readers"

__all__ = ["BUILT_IN", "built_in", "reader", "readers"]


def built_in(name: str) -> Reader:
    """The built-in reader of that name."""
    declared: Reader = importlib.import_module(f"{__name__}.{BUILT_IN[name]}").READER
    return declared


@functools.cache
def readers() -> tuple[Reader, ...]:
    """The built-in readers, then those of installed packages: entry points `nearlift.readers`."""
    from nearlift.readers.seam import Reader

    return gather(GROUP, Reader, map(built_in, BUILT_IN))


@functools.cache
def reader(name: str) -> Reader:
    """The reader of that name; `ManifestError` with the nearest name where there is none."""
    # nothing is overridden, so what packages add need not be known
    if name in BUILT_IN:
        return built_in(name)
    known = {r.name: r for r in readers()}
    if name not in known:
        hint = did_you_mean(name, known) or f"readers are {', '.join(known)}"
        raise ManifestError("records.reader", f"no reader is called {name!r}", hint)
    return known[name]
