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
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.channel import Contents, Malformed
from nearlift.readers.per_file import Format, Names
from nearlift.readers.seam import ChannelSpec

#: How the bytes of an answer's JSON are counted.
LENGTH = struct.Struct("<Q")

Answer = tuple[dict[str, Any], list[FloatArray]]


def serve(requests: int, answers: int, memory: int) -> None:
    """The child: reads requests, one JSON object to a line, until there are no more."""
    out = os.fdopen(os.dup(answers), "wb")
    # whatever a library prints must not stand between the answers
    os.dup2(2, 1)
    from nearlift import readers  # noqa: F401 - before memory is counted

    threading.Thread(target=_await_parents_end, args=(requests,), daemon=True).start()
    _limit(memory)
    for asked in os.fdopen(requests, "rb"):
        request = json.loads(asked)
        for answer, values in _answers(request):
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


def _answers(request: Mapping[str, Any]) -> Iterator[Answer]:
    name = request.get("piv") or request.get("reader") or "Parquet"
    try:
        read = (
            _read_fields
            if "piv" in request
            else (
                _read_table
                if "table" in request
                else _reduce
                if "spec" in request
                else _read_contents
            )
        )
        yield from read(name, Path(request["path"]), request)
    except InputRefused as refusal:
        yield {"refused": [refusal.where, refusal.what, refusal.remedy]}, []
    except Malformed as fault:
        yield {"malformed": str(fault)}, []
    except MemoryError:
        yield {"malformed": "it needs more memory than its reader is allowed"}, []
    except (
        Exception
    ) as fault:  # libraries raise anything on damaged bytes; the child turns it into one kind
        yield {"malformed": _unreadable(name, fault)}, []


def _unreadable(name: str, fault: Exception) -> str:
    told = (str(fault).splitlines() or [""])[0]
    return f"cannot be read as {name}: {told or type(fault).__name__}"


def _format(name: str) -> Format:
    from nearlift import readers

    form = readers.reader(name).format
    assert form is not None
    return form


def _read_contents(name: str, path: Path, request: Mapping[str, Any]) -> Iterator[Answer]:
    found = _format(name).contents(
        path, request["dialect"], None if request["names"] is None else tuple(request["names"])
    )
    listed = [{"name": c.name, "unit": c.unit, "rate_Hz": c.rate_Hz} for c in found.channels]
    yield (
        {"channels": listed, "kind": found.kind, "codes": found.codes, "notes": found.notes},
        [c.values for c in found.channels],
    )


def _reduce(name: str, path: Path, request: Mapping[str, Any]) -> Iterator[Answer]:
    from nearlift.readers.per_file import record
    from nearlift.readers.row import row_of
    from nearlift.reduction.conditions import Conditions, Limits

    def contents(path: Path, dialect: Mapping[str, Any], names: Names) -> Contents:
        try:
            return _format(name).contents(path, dialect, names)
        except (InputRefused, Malformed, MemoryError):
            raise
        except Exception as fault:
            raise Malformed(_unreadable(name, fault)) from None

    conditions = Conditions(
        **{**request["conditions"], "limits": Limits(**request["conditions"]["limits"])}
    )
    spec = ChannelSpec(**request["spec"])
    found = record(contents, spec, request["trial"], path, request["source"])
    try:
        # damaged numbers may be anything
        with np.errstate(over="ignore", invalid="ignore"):
            row = row_of(found, conditions, request["tare_after_N"])
    except (InputRefused, MemoryError):
        raise
    except Exception as fault:
        raise Malformed(f"{type(fault).__name__}: {fault}") from None
    reduced = {name: getattr(row.reduced, name) for name in row.reduced.__slots__}
    yield {"reduced": reduced, "samples": row.samples, "notes": row.notes, "fault": row.fault}, []


def _read_fields(name: str, path: Path, request: Mapping[str, Any]) -> Iterator[Answer]:
    from nearlift.readers.piv.sniff import dialect

    for raw in dialect(name).read(path):
        about = {
            key: getattr(raw, key)
            for key in ("length_unit", "velocity_unit", "scale_m", "frame_time_s")
        }
        yield {"field": about, "more": True}, [raw.x, raw.y, raw.u, raw.v, raw.good.astype(float)]
    yield {"end": True}, []


def _read_table(_: str, path: Path, request: Mapping[str, Any]) -> Iterator[Answer]:
    from nearlift.readers import long_table

    if request["table"] == "spans":
        trials, rows, ends = long_table.spans(
            path, [(key, name) for key, name in request["columns"]]
        )
        yield {"trials": trials}, [rows[:, 0], rows[:, 1], ends]
        return
    for arrays in long_table.batches(
        path, request["columns"], request["first"], request["end"], request["size"]
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
