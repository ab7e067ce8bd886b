"""Outside formats to records: the only place for foreign units and dialects. One file per format, listed here."""

from __future__ import annotations

import difflib
import functools

from nearlift.errors import ManifestError
from nearlift.plugins import gather
from nearlift.readers.crazyflie import CRAZYFLIE_READER
from nearlift.readers.csv_trial import CSV
from nearlift.readers.flight_stand import FLIGHT_STAND_READER
from nearlift.readers.hdf5 import HDF5_READER
from nearlift.readers.lvm import LVM_READER
from nearlift.readers.mat import MAT_READER
from nearlift.readers.means import MEANS
from nearlift.readers.parquet import PARQUET
from nearlift.readers.rcbenchmark import RCBENCHMARK_READER
from nearlift.readers.schedule import Schedule, read_schedule
from nearlift.readers.seam import Piece, Plan, Reader, Record
from nearlift.readers.tdms import TDMS_READER
from nearlift.readers.text import TEXT_READER
from nearlift.readers.usd import USD_READER

READERS: tuple[Reader, ...] = (
    PARQUET,
    CSV,
    TEXT_READER,
    RCBENCHMARK_READER,
    FLIGHT_STAND_READER,
    CRAZYFLIE_READER,
    USD_READER,
    LVM_READER,
    TDMS_READER,
    MAT_READER,
    HDF5_READER,
    MEANS,
)

__all__ = ["READERS", "Piece", "Plan", "Reader", "Record", "Schedule", "read_schedule", "reader", "readers"]


@functools.cache
def readers() -> tuple[Reader, ...]:
    """Every reader: the built-in ones, then those of installed packages (entry points `nearlift.readers`, one `Reader` each)."""
    return gather("nearlift.readers", Reader, READERS)


def reader(name: str) -> Reader:
    """The reader of that name.

    Raises
    ------
    ManifestError
        There is none; the nearest name is proposed.
    """
    known = {r.name: r for r in readers()}
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"readers are {', '.join(known)}"
        raise ManifestError("records.reader", f"no reader is called {name!r}", hint)
    return known[name]
