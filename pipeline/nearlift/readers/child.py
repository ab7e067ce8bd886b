"""Files that a C library parses (HDF5, MATLAB, netCDF, Parquet) or that claim sizes of their own
(TDMS) are read in a child process.

The child may use so much memory and time, may write no file, loads no code from the folder of the
data, and speaks to its parent in JSON and plain float64: no pickle, so that even a child taken over
by a file could send nothing but numbers. A child takes longer to start than to read a hundred
files, so it serves many; a crash, or a limit reached, costs the one file that caused it.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import math
import os
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Self

import numpy as np

from nearlift import isolation
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.readers.channel import Channel, Contents, Malformed
from nearlift.readers.per_file import Format, Names
from nearlift.readers.seam import ChannelSpec
from nearlift.run import copies

if TYPE_CHECKING:
    from nearlift.readers.row import Row

#: Address space of the child, bytes, and time for one file, s.
MEMORY = 2 << 30
TIME_S = 120.0
#: Files after which a lasting child is let go, and files that it is asked for before their turn, so
#: that it reads while records are reduced.
FILES, AHEAD = 1000, 3
#: Bytes that may wait in the pipe, where the system grants as many: several records, so that the
#: child need not wait at each.
PIPE = 1 << 20
#: The folder that holds nearlift.
PACKAGE = str(Path(__file__).parents[2])
_LENGTH = struct.Struct("<Q")

Reading = Callable[[Path, Mapping[str, Any], Names], Contents]
Answer = tuple[dict[str, Any], list[FloatArray]]


@contextlib.contextmanager
def source(form: Format, time_s: float = TIME_S, memory: int = MEMORY) -> Iterator[Reading]:
    """What reads files of a format: its own function, or a child process that runs it."""
    if not form.child:
        yield form.contents
        return
    with Child(time_s, memory) as child:
        yield functools.partial(_contents, child, form.name)


def _contents(
    child: Child, reader: str, path: Path, dialect: Mapping[str, Any], names: Names
) -> Contents:
    """The contents of one file; raises as `Child.ask` does."""
    [(answer, values)] = child.ask(
        {"reader": reader, "path": str(path), "dialect": dict(dialect), "names": names}
    )
    channels = tuple(
        Channel(name=c["name"], unit=c["unit"], rate_Hz=c["rate_Hz"], values=v)
        for c, v in zip(answer["channels"], values, strict=True)
    )
    return Contents(
        channels=channels,
        kind=answer["kind"],
        codes=tuple(answer["codes"]),
        notes=tuple(answer["notes"]),
    )


@contextlib.contextmanager
def lasting(form: Format) -> Iterator[Reading]:
    """As `source`, by a child that is kept for whoever asks next; the last ones end with this
    process.
    """
    if not form.child:
        yield form.contents
        return
    with borrowed() as worker:
        yield functools.partial(_contents, worker, form.name)


def rows(asked: Sequence[Mapping[str, Any]]) -> Iterator[Row]:
    """The rows of records that a child reads and reduces, in the order in which they are asked for;
    no sample leaves the child.

    A file that is damaged, or that its reader crashed over, is MALFORMED.

    Raises
    ------
    InputRefused
        A record cannot be read in the way that the manifest asks for.
    """
    from nearlift.readers.row import Row
    from nearlift.reduction.record import Reduced, prepare

    # a child could not keep what it compiles
    prepare()
    lines = [line(request) for request in asked]
    with borrowed() as worker:
        for i, request in enumerate(asked):
            about = {"trial": request["trial"], "source": request["source"]}
            try:
                [(answer, _)] = worker.ask(*lines[i : i + 1 + AHEAD])
            except Malformed as fault:
                yield Row(
                    **about,
                    reduced=Reduced(codes=("MALFORMED",)),
                    fault=f"{request['source']}: {fault}",
                )
                continue
            reduced = Reduced(**{**answer["reduced"], "codes": tuple(answer["reduced"]["codes"])})
            yield Row(
                **about,
                reduced=reduced,
                samples=answer["samples"],
                notes=tuple(answer["notes"]),
                fault=answer["fault"],
            )


@contextlib.contextmanager
def borrowed() -> Iterator[Child]:
    """A child that nobody else uses meanwhile."""
    with _lock:
        worker = _idle.pop() if _idle else Child()
    try:
        yield worker
    except InputRefused:
        # a file that is refused leaves its reader as it was
        with _lock:
            _idle.append(worker)
        raise
    except BaseException:
        worker.end()
        raise
    # what libraries leak shall not add up to the limit
    if worker.files >= FILES:
        worker.end()
    with _lock:
        _idle.append(worker)


_lock = threading.Lock()
_idle: list[Child] = []


def start(number: int = 1) -> None:
    """Start children for whoever asks first, while the caller has something else to do."""
    workers = [Child() for _ in range(number)]
    for worker in workers:
        worker.begin()
    with _lock:
        _idle.extend(workers)


@atexit.register
def dismiss() -> None:
    """Let the children go that nobody uses."""
    with _lock:
        while _idle:
            _idle.pop().end()


def _fresh(environment: Mapping[str, str], memory: int) -> subprocess.Popen[bytes]:
    """A child in an interpreter of its own, which takes as long to be ready as to read a hundred
    files.
    """
    return subprocess.Popen(
        # -P: the current folder, which may be one of data, is no place to import from; -B: write
        # nothing
        [
            sys.executable,
            "-P",
            "-B",
            "-c",
            f"from nearlift.readers.child import serve; serve(0, 1, {memory})",
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **environment},
        # an interrupt at the terminal is the parent's to handle
        start_new_session=True,
    )


class Copy:
    """A child that begins as a copy of this process, ready at once; a process with threads is not
    copied, for their locks would stay locked.

    It has the interface of `subprocess.Popen`, as far as that is used here.
    """

    def __init__(self, environment: Mapping[str, str], memory: int) -> None:
        (requests, put), (get, answers) = os.pipe(), os.pipe()
        self.returncode: int | None = None
        self.pid = copies.fork(lambda: _as_if_fresh(environment, requests, answers, memory))
        os.close(requests)
        os.close(answers)
        self.stdin, self.stdout = os.fdopen(put, "wb"), os.fdopen(get, "rb")

    def poll(self) -> int | None:
        """The exit code, negative for a signal; None while it runs."""
        return self._status(os.WNOHANG)

    def wait(self) -> int | None:
        """The exit code, once it has ended."""
        return self._status(0)

    def kill(self) -> None:
        """End it at once."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)

    def _status(self, how: int) -> int | None:
        with _reaping:
            if self.returncode is None:
                try:
                    pid, status = os.waitpid(self.pid, how)
                except ChildProcessError:
                    # where nobody may wait for children, how they ended is lost
                    pid, status = self.pid, 0
                self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode


#: A number that was given back may be another process's.
_reaping = threading.Lock()


def _as_if_fresh(environment: Mapping[str, str], requests: int, answers: int, memory: int) -> None:
    """The copy's life: it forgets what it has from the original, and serves."""
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDWR)
    kept = [os.dup2(old, new) for new, old in enumerate((requests, answers, nothing))]
    os.closerange(len(kept), os.sysconf("SC_OPEN_MAX"))
    os.environ.update(environment)
    sys.dont_write_bytecode = True
    here = str(Path.cwd())
    sys.path[:] = [PACKAGE, *(p for p in sys.path if p not in ("", here))]
    serve(0, 1, memory)


class Child:
    """The process, started when the first file comes and again after each that killed it; `files`
    counts the questions put to it.
    """

    def __init__(self, time_s: float = TIME_S, memory: int = MEMORY) -> None:
        self.time_s, self.memory = time_s, memory
        self.process: subprocess.Popen[bytes] | Copy | None = None
        self.files = 0
        #: Requests that wait for their answers, and until when the first one's may take
        #: (time.monotonic).
        self._sent: deque[bytes] = deque()
        self._until = math.inf
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def begin(self) -> subprocess.Popen[bytes] | Copy:
        """The process, started unless it runs."""
        if self.process is None:
            environment = {
                isolation.SAFE_PATH: "1",
                # HDF5 would load filters from wherever this points
                "HDF5_PLUGIN_PRELOAD": "::",
                "ARROW_DEFAULT_MEMORY_POOL": "system",
                "OPENBLAS_NUM_THREADS": "1",
                "OMP_NUM_THREADS": "1",
                "PYTHONPATH": os.pathsep.join(
                    p for p in (PACKAGE, os.environ.get("PYTHONPATH", "")) if p
                ),
            }
            self.process = (
                Copy(environment, self.memory)
                if copies.alone()
                else _fresh(environment, self.memory)
            )
            with contextlib.suppress(ImportError, AttributeError, OSError):
                import fcntl

                fcntl.fcntl(self.process.stdout, fcntl.F_SETPIPE_SZ, PIPE)  # type: ignore[arg-type]
            self._ended = threading.Event()
        return self.process

    def _watch(self, process: subprocess.Popen[bytes] | Copy, ended: threading.Event) -> None:
        """Kill the process once an answer is overdue."""
        while not ended.wait(min(max(self._until - time.monotonic(), 0.0), self.time_s)):
            if time.monotonic() >= self._until:
                process.kill()
                return

    def ask(
        self, request: Mapping[str, Any] | bytes, *later: Mapping[str, Any] | bytes
    ) -> Iterator[Answer]:
        """The answers to one request, as they come; one request at a time. The child may begin with
        `later` ones, which are asked for next.

        A request that is asked for more than once on its way may be given as its `line`.

        Raises
        ------
        Malformed
            The file is damaged, or its reader crashed or came to a limit.
        InputRefused
            As the reader itself does.
        """
        more = True
        lines = [r if isinstance(r, bytes) else line(r) for r in (request, *later)]
        if self._sent and self._sent[0] != lines[0]:
            # it is about to answer another question
            self.end()
        try:
            while more:
                answer, values = self._answer(lines)
                lines, more = [], answer.get("more", False)
                if "refused" in answer:
                    raise InputRefused(*answer["refused"])
                if "malformed" in answer:
                    raise Malformed(answer["malformed"])
                if "end" not in answer:
                    yield answer, values
        finally:
            # who no longer listens must not hear the rest as the answer to another question
            if more:
                self.end()

    def _answer(self, lines: list[bytes]) -> Answer:
        """Put those requests that have not been put yet, and wait for the next answer."""
        process = self.begin()
        if not self.files:
            # not before: a copy of this process is made only while it has no other thread
            threading.Thread(target=self._watch, args=(process, self._ended), daemon=True).start()
        self.files += 1
        assert process.stdin is not None
        assert process.stdout is not None
        self._until = until = time.monotonic() + self.time_s
        # a child that is dead may have answered before it died of a later file
        with contextlib.suppress(OSError):
            for request in lines[len(self._sent) :]:
                self._sent.append(request)
                process.stdin.write(request)
            process.stdin.flush()
        try:
            answer, values = _received(process.stdout)
        except (OSError, EOFError, ValueError):
            self.end()
            if time.monotonic() >= until:
                raise Malformed(f"its reader was stopped after {self.time_s:g} s") from None
            raise Malformed(
                f"its reader crashed (exit code {process.returncode}), at most {self.memory >> 20}"
                " MiB of memory allowed"
            ) from None
        finally:
            self._until = math.inf
        if not answer.get("more"):
            self._sent.popleft()
        return answer, values

    def end(self) -> None:
        """Let the child go."""
        process, self.process, self.files = self.process, None, 0
        self._sent.clear()
        self._ended.set()
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()


def line(request: Mapping[str, Any]) -> bytes:
    """A request as the child reads it."""
    return json.dumps(request).encode() + b"\n"


def _exactly(pipe: IO[bytes], n: int) -> bytes:
    content = pipe.read(n)
    if len(content) != n:
        raise EOFError
    return content


def _received(pipe: IO[bytes]) -> Answer:
    answer: dict[str, Any] = json.loads(
        _exactly(pipe, _LENGTH.unpack(_exactly(pipe, _LENGTH.size))[0])
    )
    return answer, [
        np.frombuffer(_exactly(pipe, 8 * n), dtype="<f8") for n in answer.pop("lengths")
    ]


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
            out.write(_LENGTH.pack(len(head)) + head)
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
    from nearlift.readers.row import Conditions, row_of
    from nearlift.reduction.record import Limits

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
