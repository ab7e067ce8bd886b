"""TDMS of National Instruments, by nptdms.

A channel is called ``group/channel``. Unit from `unit_string` or `NI_UnitDescription`, rate from
`wf_increment`. A file is called truncated if its last segment is incomplete, or its segments'
lengths do not add up to its own. A file cut exactly between two segments shows it only by the
number of its samples. So state `record` under [load_cell]. An index file next to it is never used:
it may be older.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from nearlift.readers import base
from nearlift.readers.guarded import Malformed

LEAD_IN, TAGS = 28, (b"TDSm", b"TDSh")
#: What a writer puts for the length of a segment that it has not finished.
UNFINISHED = 0xFFFFFFFFFFFFFFFF


def contents(path: Path, dialect: base.RecordsDialect, names: base.Names) -> base.Contents:
    """The channels of a TDMS file; `Malformed` where it contradicts its own structure."""
    nptdms = base.library("nptdms", "tdms")
    channels = []
    # by handle: given a path, nptdms would use an index file next to it
    with path.open("rb") as file:
        if file.read(4) not in TAGS:
            raise Malformed("does not begin as TDMS does")
        file.seek(0)
        tdms = nptdms.TdmsFile.open(file)
        for channel in (channel for group in tdms.groups() for channel in group.channels()):
            name, stated = f"{channel.group_name}/{channel.name}", channel.properties
            if channel.dtype.kind not in "iuf" or not base.wanted(name, names):
                continue
            unit = str(stated.get("unit_string") or stated.get("NI_UnitDescription") or "")
            step = stated.get("wf_increment")
            steady = isinstance(step, (int, float, np.number)) and float(step) > 0
            channels.append(
                base.Channel(
                    name=name,
                    unit=base.unit_word(unit) or unit,
                    rate_Hz=1 / float(step) if steady else None,
                    values=np.asarray(channel[:], dtype=np.float64),
                )
            )
        cut = tdms.file_status.incomplete_final_segment or not is_whole(file)
    return base.Contents(channels=tuple(channels), kind="TDMS", codes=("truncated",) if cut else ())


def is_whole(file: BinaryIO) -> bool:
    """Whether the segments' own lengths add up to the file's.

    nptdms's flag misses a cut within a segment's head. A lead-in is a tag, a table of contents, a
    version, and the bytes to the next lead-in and to the samples. Bit 6 of the table of contents
    means big endian.
    """
    size, at = file.seek(0, 2), 0
    while at + LEAD_IN <= size:
        file.seek(at)
        lead = file.read(LEAD_IN)
        following = int.from_bytes(lead[12:20], "big" if lead[4] & 0x40 else "little")
        if following == UNFINISHED:
            return False
        at += LEAD_IN + following
    return at == size


READER = base.Reader(
    name="tdms",
    title=(
        "TDMS of National Instruments: a file per trial, or one for all with groups named by trial"
        " (extra)"
    ),
    recognises=lambda head, name: head.startswith(TAGS),
    contents=contents,
    guarded=True,
)
