"""ULog of PX4, by pyulog; read in a child process.

A channel is called ``topic.field``, an element of an array ``topic.field[2]``, those of a second
instance ``topic_1.field``; a topic's clock is ``topic.time``, in s. pyulog reads past damage: a cut
within a message, stamps out of nowhere and lost rows leave its flag of corruption down. So the
messages' own lengths are added up here, and each topic's stamps have to lie within the log's.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nearlift.readers.channel import Channel, Contents, Malformed, Names, RecordsDialect, of_topic
from nearlift.readers.hdf5 import library
from nearlift.readers.per_file import Format, reader_of

MAGIC = b"ULog\x01\x12\x35"
HEAD = 16
#: Types of messages that there are (B, F, I, M, P, Q, A, R, D, L, C, S, O).
KNOWN = frozenset(b"BFIMPQARDLCSO")
#: Longest log, s: a stamp farther from the first is none.
LONGEST_S = 24 * 3600.0


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a log; `Malformed` where it contradicts its own structure."""
    pyulog = library("pyulog", "ulog")
    data = path.read_bytes()
    whole = _is_whole(data)
    log = pyulog.ULog(str(path))
    if log.file_corruption:
        raise Malformed("is corrupt: pyulog skipped a part of it")
    begun = 1e-6 * log.start_timestamp
    channels: list[Channel] = []
    for topic in log.data_list:
        group = topic.name + (f"_{topic.multi_id}" if topic.multi_id else "")
        stamps = 1e-6 * np.asarray(topic.data["timestamp"], dtype=np.float64)
        if np.any((stamps < begun - LONGEST_S) | (stamps > begun + LONGEST_S)):
            raise Malformed(f"has a stamp of {group} that lies a day from its start")
        fields = ((name, values) for name, values in topic.data.items() if name != "timestamp")
        for channel in of_topic(group, stamps, fields, names):
            if (n := len(channel.values)) != len(stamps):
                raise Malformed(f"has {n} of {channel.name} for {len(stamps)} stamps")
            channels.append(channel)
    return Contents(channels=tuple(channels), kind="ULog", codes=() if whole else ("truncated",))


def _is_whole(data: bytes) -> bool:
    """Whether the log ends with a message; refuses what is none of its messages before that.

    A message is its length (u16), its type (a letter), and so many bytes.
    """
    at, size = HEAD, len(data)
    if size < HEAD or not data.startswith(MAGIC):
        raise Malformed(f"ends after {size} bytes, or does not begin as ULog does")
    while at + 3 <= size:
        if data[at + 2] not in KNOWN:
            raise Malformed(f"has no message at byte {at}")
        at += 3 + (data[at] | data[at + 1] << 8)
    return at == size


READER = reader_of(
    Format(
        name="ulog",
        title="ULog of PX4, a flight per file (extra)",
        recognises=lambda head, name: head.startswith(MAGIC),
        contents=contents,
        child=True,
    )
)
