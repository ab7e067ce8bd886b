"""Outside formats to records: the only place for foreign units and dialects. One file per format, listed here."""

from __future__ import annotations

import difflib
import functools

from nearlift import catalogue
from nearlift.errors import ManifestError
from nearlift.readers.csv_trial import CSV
from nearlift.readers.means import MEANS
from nearlift.readers.parquet import PARQUET
from nearlift.readers.schedule import Schedule, read_schedule
from nearlift.readers.seam import Piece, Plan, Reader, Record

READERS: tuple[Reader, ...] = (PARQUET, CSV, MEANS)

__all__ = ["READERS", "Piece", "Plan", "Reader", "Record", "Schedule", "read_schedule", "reader", "readers"]


@functools.cache
def readers() -> tuple[Reader, ...]:
    """Every reader: the built-in ones, then those of installed packages (entry points `nearlift.readers`, one `Reader` each)."""
    return catalogue.gather("nearlift.readers", Reader, READERS)


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
