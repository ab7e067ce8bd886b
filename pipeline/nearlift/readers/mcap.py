"""MCAP, which ROS 2 records its bags in, by the mcap library; read in a child process.

Messages in CDR (ROS 2) or JSON. A channel is called ``/topic.field``, an element of an array
``/topic.field[2]``; a topic's clock is ``/topic.time``, in s: the stamp in a message's header, when
it was measured, or with ``dialect = { stamps = "log" }`` and where there is no header the time at
which it was written, which comes later.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.errors import ManifestError
from nearlift.readers.channel import Channel, Contents, Malformed, Names, RecordsDialect, of_topic
from nearlift.readers.hdf5 import library
from nearlift.readers.per_file import Format, reader_of

MAGIC = b"\x89MCAP0\r\n"
#: Arrays longer than this are pictures and clouds, no series.
LONGEST_ARRAY = 64
#: What counts nanoseconds.
NANO = 1e-9


def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
    """The channels of a bag; raises as `channels_of`, and as the library where it is cut off."""
    reading = library("mcap.reader", "mcap")
    ros = library("mcap_ros2.decoder", "mcap")
    with path.open("rb") as file:
        reader = reading.make_reader(file, decoder_factories=[_Json(), ros.DecoderFactory()])
        messages = (
            (topic.topic, message.log_time, decoded)
            for _, topic, message, decoded in reader.iter_decoded_messages()
        )
        return Contents(channels=channels_of(messages, dialect, names), kind="MCAP")


def channels_of(
    messages: Iterable[tuple[str, int, Any]], dialect: RecordsDialect, names: Names
) -> tuple[Channel, ...]:
    """The channels of messages: topic, when each was written in ns, and what it holds; `Malformed`
    where one is of another layout than those before it, `ManifestError` of unknown `stamps`.
    """
    stamps = dialect.get("stamps", "header")
    if stamps not in ("header", "log"):
        raise ManifestError(
            "records.dialect.stamps", f"{stamps!r} is no stamp", 'write "header" or "log"'
        )
    topics: dict[str, dict[str, list[float]]] = {}
    for topic, logged, decoded in messages:
        row = dict(_numbers("", decoded))
        stamp = _stamp(row) if stamps == "header" else None
        row["time"] = NANO * logged if stamp is None else stamp
        if topic not in topics:
            topics[topic] = {"time": [], **{field: [] for field in row}}
        columns = topics[topic]
        if row.keys() != columns.keys():
            raise Malformed(f"has messages of two layouts on {topic}")
        for field, value in row.items():
            columns[field].append(value)
    channels = []
    for topic, columns in topics.items():
        clock = np.array(columns.pop("time"))
        channels += of_topic(topic, clock, columns.items(), names)
    return tuple(channels)


class _Json:
    """Decodes messages in JSON, as mcap's factories do."""

    def decoder_for(self, encoding: str, schema: Any) -> Any:
        """What turns bytes into an object; None of another encoding."""
        return json.loads if encoding == "json" else None


def _stamp(row: Mapping[str, float]) -> float | None:
    """The stamp in a message's header, s."""
    nano = row.get("header.stamp.nanosec", row.get("header.stamp.nsec"))
    seconds = row.get("header.stamp.sec")
    if seconds is None or nano is None or seconds + nano <= 0:
        return None
    return seconds + NANO * nano


def _numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Every number of a message under its path."""
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _numbers(f"{name}.{key}" if name else str(key), inner)
    elif isinstance(value, list | tuple | np.ndarray):
        if len(value) <= LONGEST_ARRAY:
            for k, inner in enumerate(value):
                yield from _numbers(f"{name}[{k}]", inner)
    elif slots := getattr(value, "__slots__", None):
        for key in slots:
            yield from _numbers(f"{name}.{key}" if name else key, getattr(value, key))


READER = reader_of(
    Format(
        name="mcap",
        title="MCAP, as ROS 2 records it, a flight per file (extra)",
        recognises=lambda head, name: head.startswith(MAGIC),
        contents=contents,
        options={"stamps": str},
        child=True,
    )
)
