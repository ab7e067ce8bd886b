"""RCbenchmark 1520, 1580 and 1585: CSV with a byte order mark, units in the names, a trailing
comma.

The unit of `Thrust` follows a preference of the user (gf, kgf, N): it is read from the header and
held against the manifest's. The clock of averaged step tests runs backwards between its first rows;
the order of the rows is kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nearlift.readers import stand
from nearlift.readers.channel import Contents
from nearlift.readers.per_file import Format, Names, reader_of

NEEDED = {"time", "esc signal", "thrust", "voltage"}


def _known(names: set[str]) -> bool:
    return names >= NEEDED


def contents(path: Path, dialect: Mapping[str, Any], names: Names) -> Contents:
    """The channels of an RCbenchmark file; raises as `stand.contents`."""
    return stand.contents(
        path,
        names,
        title="RCbenchmark 15xx",
        known=_known,
        texts=("app message",),
        speeds=lambda n: n.startswith("motor") and "speed" in n,
    )


RCBENCHMARK = Format(
    name="rcbenchmark",
    title="RCbenchmark 15xx CSV, one file per trial",
    recognises=lambda head, name: _known(stand.bare(stand.header(head))),
    contents=contents,
)
RCBENCHMARK_READER = reader_of(RCBENCHMARK)
