"""Outside formats to records, one file per format: the one place for foreign units and dialects."""

from __future__ import annotations

import functools
import importlib
from typing import TYPE_CHECKING

from nearlift.errors import ManifestError, did_you_mean
from nearlift.plugins import gather

if TYPE_CHECKING:
    from nearlift.readers.base import Reader

#: Built-in readers by name: module, and its value.
BUILT_IN = {
    "parquet": "parquet.READER",
    "csv": "text.CSV",
    "text": "text.TEXT",
    "rcbenchmark": "stands.RCBENCHMARK",
    "flight-stand": "stands.FLIGHT_STAND",
    "crazyflie": "stands.CRAZYFLIE",
    "sheet": "text.SHEET",
    "lvm": "lvm.READER",
    "tdms": "tdms.READER",
    "mat": "mat.READER",
    "hdf5": "hdf5.READER",
    "means": "means.READER",
}
GROUP = "nearlift.readers"

__all__ = ["BUILT_IN", "built_in", "reader", "readers"]


def built_in(name: str) -> Reader:
    """The built-in reader of that name, its module imported now."""
    module, _, value = BUILT_IN[name].partition(".")
    reader: Reader = getattr(importlib.import_module(f"{__name__}.{module}"), value)
    return reader


@functools.cache
def readers() -> tuple[Reader, ...]:
    """The built-in readers, then those of installed packages: entry points `nearlift.readers`."""
    from nearlift.readers.base import Reader

    return gather(GROUP, Reader, map(built_in, BUILT_IN))


@functools.cache
def reader(name: str) -> Reader:
    """The reader of that name; `ManifestError` with the nearest name where there is none."""
    # nothing is overridden, so the readers of packages are asked last
    if name in BUILT_IN:
        return built_in(name)
    known = {r.name: r for r in readers()}
    if name not in known:
        hint = did_you_mean(name, known) or f"readers are {', '.join(known)}"
        raise ManifestError("records.reader", f"no reader is called {name!r}", hint)
    return known[name]
