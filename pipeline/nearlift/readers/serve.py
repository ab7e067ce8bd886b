"""The reading child's side: it takes requests, one JSON object to a line, and answers each with
lengths, JSON and plain float64.

Its memory is limited, and it writes no file. Whatever a library raises over damaged bytes becomes
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
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, get_args

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.channel import Malformed, Names, RecordsDialect
from nearlift.readers.per_file import Format
from nearlift.readers.seam import ChannelSpec
from nearlift.reduction.conditions import Conditions
from nearlift.results.serial import decode

#: How the bytes of an answer's JSON are counted.
LENGTH = struct.Struct("<Q")

Answer = tuple[dict[str, Any], list[FloatArray]]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadContents:
    """Request for the channels of a file."""

    reader: str
    path: str
    dialect: RecordsDialect = field(default_factory=dict)
    names: Names = None

    def answers(self) -> Iterator[Answer]:
        """One answer, with all channels."""
        contents = _format(self.reader).contents(Path(self.path), self.dialect, self.names)
        channels = contents.channels
        about = {
            "channels": [{"name": c.name, "unit": c.unit, "rate_Hz": c.rate_Hz} for c in channels],
            "kind": contents.kind,
            "codes": contents.codes,
            "notes": contents.notes,
        }
        yield about, [c.values for c in channels]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReduceRecord:
    """Request for the row of a trial's record."""

    reader: str
    path: str
    spec: ChannelSpec
    conditions: Conditions
    trial: str
    source: str
    tare_after_N: float

    def answers(self) -> Iterator[Answer]:
        """One answer, without samples."""
        from nearlift.readers.per_file import record
        from nearlift.readers.row import row_of

        contents = _format(self.reader).contents
        whole = record(contents, self.spec, self.trial, Path(self.path), self.source)
        try:
            # damaged numbers may be anything
            with np.errstate(over="ignore", invalid="ignore"):
                row = row_of(whole, self.conditions, self.tare_after_N)
        except (InputRefused, MemoryError):
            raise
        except Exception as fault:
            raise Malformed(f"{type(fault).__name__}: {fault}") from None
        yield {"row": asdict(row)}, []


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadFields:
    """Request for the velocity fields of a file."""

    reader: str
    path: str

    def answers(self) -> Iterator[Answer]:
        """An answer for each field."""
        from nearlift.readers.piv.cases import dialect_of

        for raw in dialect_of(self.reader).read(Path(self.path)):
            about = {
                key: getattr(raw, key)
                for key in ("length_unit", "velocity_unit", "scale_m", "frame_time_s")
            }
            columns = [raw.x, raw.y, raw.u, raw.v, raw.good.astype(float)]
            yield {"field": about, "more": True}, columns
        yield {"end": True}, []


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadSpans:
    """Request for the rows of each trial of a long table; `columns`, the manifest's key and a
    column's name each, have to be there.
    """

    reader: ClassVar[str] = "Parquet"
    path: str
    columns: tuple[tuple[str, str], ...] = ()

    def answers(self) -> Iterator[Answer]:
        """One answer, with all trials."""
        from nearlift.readers import long_table

        trials, rows, ends = long_table.spans(Path(self.path), self.columns)
        yield {"trials": trials}, [*rows.T, ends]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadRows:
    """Request for columns of a long table from row `first` up to `end`, `size` rows at a time."""

    reader: ClassVar[str] = "Parquet"
    path: str
    columns: tuple[str, ...]
    first: int
    end: int
    size: int

    def answers(self) -> Iterator[Answer]:
        """An answer for each batch."""
        from nearlift.readers import long_table

        path = Path(self.path)
        for arrays in long_table.batches(path, self.columns, self.first, self.end, self.size):
            yield {"more": True}, arrays
        yield {"end": True}, []


Request = ReadContents | ReduceRecord | ReadFields | ReadSpans | ReadRows
REQUESTS: Mapping[str, type[Request]] = {kind.__name__: kind for kind in get_args(Request)}


def _format(name: str) -> Format:
    from nearlift import readers

    form = readers.reader(name).format
    assert form is not None
    return form


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
    """End with the parent, were it killed during a file: nobody is left to stop the clock."""
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
        yield from request.answers()
    except InputRefused as refusal:
        yield {"refused": [refusal.where, refusal.what, refusal.remedy]}, []
    except Malformed as fault:
        yield {"malformed": str(fault)}, []
    except MemoryError:
        yield {"malformed": "it needs more memory than its reader is allowed"}, []
    except Exception as fault:
        # libraries raise anything on damaged bytes; the child turns it into one kind
        what = (str(fault).splitlines() or [""])[0] or type(fault).__name__
        yield {"malformed": f"cannot be read as {request.reader}: {what}"}, []


def _limit(memory: int) -> None:
    """Bound this process, where the system knows how."""
    try:
        import resource
    except ImportError:
        return
    limits = {resource.RLIMIT_AS: memory, resource.RLIMIT_FSIZE: 0, resource.RLIMIT_CORE: 0}
    for kind, limit in limits.items():
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (limit, limit))
