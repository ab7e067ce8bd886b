"""Bags of ROS 2 in SQLite (.db3), which it recorded in before MCAP; read in a child process.

Messages are in CDR, and decoded by the definitions that the bag holds, as bags do since ROS 2 Iron.
Channels and clocks are called as those of MCAP.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from nearlift.errors import InputRefused
from nearlift.readers.channel import Contents, Malformed, Names, RecordsDialect
from nearlift.readers.hdf5 import library
from nearlift.readers.mcap import channels_of
from nearlift.readers.per_file import Format, reader_of

MAGIC = b"SQLite format 3\0"


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a bag; raises as `channels_of`, and `InputRefused` without definitions of
    messages.
    """
    place = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(place, uri=True)) as bag:
            if bag.execute("PRAGMA quick_check").fetchone() != ("ok",):
                raise Malformed("its pages do not hang together: it is cut off or damaged")
            channels = channels_of(_messages(bag, path), dialect, names)
    except sqlite3.DatabaseError as fault:
        raise Malformed(f"is no whole SQLite file: {fault}") from None
    return Contents(channels=channels, kind="ROS 2 bag in SQLite")


def _messages(bag: sqlite3.Connection, path: Path) -> Iterator[tuple[str, int, Any]]:
    decoders = library("mcap_ros2.decoder", "mcap").DecoderFactory()
    tables = {name for (name,) in bag.execute("SELECT name FROM sqlite_master")}
    if not {"topics", "messages"} <= tables:
        raise Malformed("has no tables of topics and messages")
    definitions: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        rows = "topic_type, encoding, encoded_message_definition"
        definitions = {
            kind: (encoding, text)
            for kind, encoding, text in bag.execute(f"SELECT {rows} FROM message_definitions")
        }
    read = {}
    for number, name, kind, form in bag.execute(
        "SELECT id, name, type, serialization_format FROM topics"
    ):
        encoding, text = definitions.get(kind, ("", ""))
        schema = SimpleNamespace(id=number, name=kind, encoding=encoding, data=text.encode())
        decode = decoders.decoder_for(form, schema) if text else None
        if decode is not None:
            read[number] = (name, decode)
    if not read:
        raise InputRefused(
            str(path),
            "holds no definitions of its messages, as bags of ROS 2 before Iron",
            "`ros2 bag convert` makes MCAP of it, which does",
        )
    for number, logged, data in bag.execute(
        "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
    ):
        if number in read:
            name, decode = read[number]
            yield name, logged, decode(data)


READER = reader_of(
    Format(
        name="rosbag",
        title="a bag of ROS 2 in SQLite, a flight per file (extra mcap)",
        recognises=lambda head, name: head.startswith(MAGIC),
        contents=contents,
        options={"stamps": str},
        child=True,
    )
)
