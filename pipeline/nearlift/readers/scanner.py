"""Calls the compiled scanner of plain decimal CSV (`readers.scan_kernel`)."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence

import numpy as np

from nearlift.declare import FloatArray
from nearlift.native import POINTER, TEXT, WHOLE, Kernel, address

ARGUMENTS = TEXT, *(WHOLE,) * 5, POINTER, POINTER, WHOLE, WHOLE, POINTER, POINTER
SCAN = Kernel("nearlift.readers.scan_kernel", "scan", *ARGUMENTS)
IRREGULAR = -1
POWERS = 10.0 ** np.arange(19)
#: Words of both columns' layouts.
LAYOUTS = 32
#: Rows of which a thread keeps the memory.
MOST_KEPT = 1 << 20


class _Room:
    """Where one file is scanned to, and where that stands in memory."""

    def __init__(self, rows: int) -> None:
        self.columns = np.empty((2, rows))
        self.layouts = np.empty(LAYOUTS, dtype=np.uint64)
        self.places = [address(values) for values in (*self.columns, self.layouts)]


def _room_for(rows: int) -> _Room:
    """A thread's room, kept from file to file: to get fresh memory takes longer than to fill it."""
    room: _Room | None = getattr(_kept, "room", None)
    if room is None or rows > room.columns.shape[1]:
        room = _Room(rows)
        # a file that is far larger than a record shall not hold its memory for ever
        if rows <= MOST_KEPT:
            _kept.room = room
    return room


_kept = threading.local()
_powers = address(POWERS)


def scan(text: bytes, at: int, columns: int, wanted: Sequence[int]) -> list[FloatArray] | None:
    """One or two wanted columns of the rows of `text` after byte `at`, None where a line is not
    plain. They last until this thread scans again.

    Bytes before `at` are the header; there must be some.
    """
    if at < 1 or at > len(text) or sys.byteorder != "little":
        return None
    low, high = min(wanted), max(wanted)
    # before, between and behind them
    others = low, max(high - low - 1, 0), columns - 1 - high
    # a row has at least a digit and a separator per column
    rows = (len(text) - at) // (2 * columns) + 1
    room = _room_for(rows)
    room.layouts.fill(0)
    *filled, layouts = room.places
    pair = int(high != low)
    count = SCAN(text, len(text), at, *others, *filled, rows, pair, _powers, layouts)
    if count == IRREGULAR:
        return None
    return [room.columns[int(place != low)][:count] for place in wanted]
