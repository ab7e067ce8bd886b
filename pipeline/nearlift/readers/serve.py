"""The reading child's side: it takes requests, one JSON object to a line, and answers each with
lengths, JSON and plain float64.

It may use so much memory, and writes no file. Whatever a library raises over damaged bytes becomes
one kind of answer.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import struct
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.channel import Contents, Malformed, Names, RecordsDialect
from nearlift.readers.per_file import Format
from nearlift.readers.seam import ChannelSpec
from nearlift.reduction.conditions import Conditions
from nearlift.results.serial import decode

#: How the bytes of an answer's JSON are counted.
LENGTH = struct.Struct("<Q")

Answer = tuple[dict[str, Any], list[FloatArray]]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadContents:
    """A file's channels are asked for."""

    reader: str
    path: str
    dialect: RecordsDialect = field(default_factory=dict)
    names: Names = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReduceRecord:
    """The row of a trial's record is asked for."""

    reader: str
    path: str
    spec: ChannelSpec
    conditions: Conditions
    trial: str
    source: str
    tare_after_N: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadFields:
    """The velocity fields of a file are asked for."""

    reader: str
    path: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadSpans:
    """Whose rows are whose in a long table is asked for: manifest's keys and columns wanted."""

    reader: ClassVar[str] = "Parquet"
    path: str
    columns: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadRows:
    """Columns of a long table from row `first` up to `end` are asked for, `size` at a time."""

    reader: ClassVar[str] = "Parquet"
    path: str
    columns: tuple[str, ...]
    first: int
    end: int
    size: int


Request = ReadContents | ReduceRecord | ReadFields | ReadSpans | ReadRows
REQUESTS: Mapping[str, type[Request]] = {
    kind.__name__: kind for kind in (ReadContents, ReduceRecord, ReadFields, ReadSpans, ReadRows)
}


def serve(requests: int, answers: int, memory: int) -> None:
    """The child: reads requests, one JSON object to a line, until there are no more."""
    out = os.fdopen(os.dup(answers), "wb")
    # whatever a library prints must not stand between the answers
    os.dup2(2, 1)
    from nearlift import readers  # noqa: F401 - before memory is counted

    threading.Thread(target=_await_parents_end, args=(requests,), daemon=True).start()
    _limit(memory)
    for asked in os.fdopen(requests, "rb"):
        for answer, values in _answers(asked):
            head = json.dumps(answer | {"lengths": [len(v) for v in values]}).encode()
            out.write(LENGTH.pack(len(head)) + head)
            for array in values:
                out.write(np.ascontiguousarray(array, dtype="<f8").data)
            out.flush()


def _await_parents_end(requests: int) -> None:
    """End with the parent, were it killed while a file is being read: nobody is left to stop the
    clock.
    """
    # Windows has no such call; there the child ends with its answer, which nobody takes
    if hasattr(select, "poll"):
        lifeline = select.poll()
        # the other end closed is told unasked
        lifeline.register(requests, 0)
        lifeline.poll()
        os._exit(1)


def _answers(asked: bytes) -> Iterator[Answer]:
    content = json.loads(asked)
    request = decode(REQUESTS[content.pop("ask")], content)
    try:
        yield from _read(request)
    except InputRefused as refusal:
        yield {"refused": [refusal.where, refusal.what, refusal.remedy]}, []
    except Malformed as fault:
        yield {"malformed": str(fault)}, []
    except MemoryError:
        yield {"malformed": "it needs more memory than its reader is allowed"}, []
    except Exception as fault:
        # libraries raise anything on damaged bytes; the child turns it into one kind
        yield {"malformed": _unreadable(request.reader, fault)}, []


def _read(request: Request) -> Iterator[Answer]:
    if isinstance(request, ReadContents):
        return _read_contents(request)
    if isinstance(request, ReduceRecord):
        return _reduce(request)
    if isinstance(request, ReadFields):
        return _read_fields(request)
    return _read_spans(request) if isinstance(request, ReadSpans) else _read_rows(request)


def _unreadable(name: str, fault: Exception) -> str:
    told = (str(fault).splitlines() or [""])[0]
    return f"cannot be read as {name}: {told or type(fault).__name__}"


def _format(name: str) -> Format:
    from nearlift import readers

    form = readers.reader(name).format
    assert form is not None
    return form


def _read_contents(asked: ReadContents) -> Iterator[Answer]:
    found = _format(asked.reader).contents(Path(asked.path), asked.dialect, asked.names)
    listed = [{"name": c.name, "unit": c.unit, "rate_Hz": c.rate_Hz} for c in found.channels]
    yield (
        {"channels": listed, "kind": found.kind, "codes": found.codes, "notes": found.notes},
        [c.values for c in found.channels],
    )


def _reduce(asked: ReduceRecord) -> Iterator[Answer]:
    from nearlift.readers.per_file import record
    from nearlift.readers.row import row_of

    def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
        try:
            return _format(asked.reader).contents(path, dialect, names)
        except (InputRefused, Malformed, MemoryError):
            raise
        except Exception as fault:
            raise Malformed(_unreadable(asked.reader, fault)) from None

    found = record(contents, asked.spec, asked.trial, Path(asked.path), asked.source)
    try:
        # damaged numbers may be anything
        with np.errstate(over="ignore", invalid="ignore"):
            row = row_of(found, asked.conditions, asked.tare_after_N)
    except (InputRefused, MemoryError):
        raise
    except Exception as fault:
        raise Malformed(f"{type(fault).__name__}: {fault}") from None
    reduced = {name: getattr(row.reduced, name) for name in row.reduced.__slots__}
    yield {"reduced": reduced, "samples": row.samples, "notes": row.notes, "fault": row.fault}, []


def _read_fields(asked: ReadFields) -> Iterator[Answer]:
    from nearlift.readers.piv.sniff import dialect

    for raw in dialect(asked.reader).read(Path(asked.path)):
        about = {
            key: getattr(raw, key)
            for key in ("length_unit", "velocity_unit", "scale_m", "frame_time_s")
        }
        yield {"field": about, "more": True}, [raw.x, raw.y, raw.u, raw.v, raw.good.astype(float)]
    yield {"end": True}, []


def _read_spans(asked: ReadSpans) -> Iterator[Answer]:
    from nearlift.readers import long_table

    trials, rows, ends = long_table.spans(Path(asked.path), asked.columns)
    yield {"trials": trials}, [rows[:, 0], rows[:, 1], ends]


def _read_rows(asked: ReadRows) -> Iterator[Answer]:
    from nearlift.readers import long_table

    for arrays in long_table.batches(
        Path(asked.path), asked.columns, asked.first, asked.end, asked.size
    ):
        yield {"more": True}, arrays
    yield {"end": True}, []


def _limit(memory: int) -> None:
    """Bound this process, where the system knows how."""
    try:
        import resource
    except ImportError:
        return
    for kind, limit in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (limit, limit))
