"""Files that a C library parses (HDF5, MATLAB, netCDF, Parquet) or that claim sizes of their own
(TDMS) are read in a child process.

The child's memory and time are limited. It writes no file, loads no code from the folder of the
data, and answers in JSON and plain float64: no pickle, so that even a child that a file has taken
over could send nothing but numbers. Starting a child takes longer than reading a hundred files, so
one child serves many; a crash or a limit costs only the file that caused it.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import math
import subprocess
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Self

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers.channel import Channel, Contents, Malformed, Names, RecordsDialect
from nearlift.readers.child_process import Copy, serving
from nearlift.readers.per_file import Format, Reading
from nearlift.readers.serve import LENGTH, Answer, ReadContents, ReduceRecord, Request
from nearlift.results.serial import decode

if TYPE_CHECKING:
    from nearlift.readers.row import Row

#: Address space of the child, bytes, and time for one file, s.
MEMORY = 2 << 30
TIME_S = 120.0
#: Files after which a lasting child is ended, and files that it is asked for ahead of their turn,
#: so that it reads while records are reduced.
FILES, AHEAD = 1000, 3
#: Bytes that may wait in the pipe, where the system grants as many: several records, so that the
#: child need not wait at each.
PIPE = 1 << 20


@contextlib.contextmanager
def source(
    form: Format, worker: contextlib.AbstractContextManager[Child] | None = None
) -> Iterator[Reading]:
    """What reads files of a format: its own function, or a child process that runs it, a lasting
    one unless a `worker` is given.
    """
    if not form.child:
        yield form.contents
        return
    with worker or borrowed() as child:
        yield functools.partial(_contents, child, form.name)


def _contents(
    child: Child, reader: str, path: Path, dialect: RecordsDialect, names: Names
) -> Contents:
    """The contents of one file; raises as `Child.ask` does."""
    asked = ReadContents(reader=reader, path=str(path), dialect=dialect, names=names)
    [(answer, values)] = child.ask(asked)
    channels = tuple(
        Channel(**about, values=v) for about, v in zip(answer["channels"], values, strict=True)
    )
    codes, notes = tuple(answer["codes"]), tuple(answer["notes"])
    return Contents(channels=channels, kind=answer["kind"], codes=codes, notes=notes)


def rows(asked: Sequence[ReduceRecord]) -> Iterator[Row]:
    """The rows of records that a child reads and reduces, in the order in which they are asked for;
    no sample leaves the child.

    A file that is damaged, or that its reader crashed over, is MALFORMED.

    Raises
    ------
    InputRefused
        A record cannot be read in the way that the manifest asks for.
    """
    from nearlift.readers.row import Row
    from nearlift.reduction.record import Reduced

    lines = [line(request) for request in asked]
    with borrowed() as worker:
        for i, request in enumerate(asked):
            trial, source = request.trial, request.source
            try:
                [(answer, _)] = worker.ask(*lines[i : i + 1 + AHEAD])
            except Malformed as fault:
                malformed = Reduced(codes=("MALFORMED",))
                yield Row(trial=trial, source=source, reduced=malformed, fault=f"{source}: {fault}")
                continue
            # whose record it is, no child says
            yield replace(decode(Row, answer["row"]), trial=trial, source=source)


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


def start(number: int) -> None:
    """Start children ahead of need, while the caller has something else to do."""
    workers = [Child() for _ in range(number)]
    for worker in workers:
        worker.begin()
    with _lock:
        _idle.extend(workers)


@atexit.register
def dismiss() -> None:
    """End the idle children."""
    with _lock:
        while _idle:
            _idle.pop().end()


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
            self.process = serving(self.memory)
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

    def ask(self, request: Request | bytes, *later: Request | bytes) -> Iterator[Answer]:
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
        """End the child."""
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


def line(request: Request) -> bytes:
    """A request as the child reads it."""
    return json.dumps({"ask": type(request).__name__, **asdict(request)}).encode() + b"\n"


def _exactly(pipe: IO[bytes], n: int) -> bytes:
    content = pipe.read(n)
    if len(content) != n:
        raise EOFError
    return content


def _received(pipe: IO[bytes]) -> Answer:
    answer: dict[str, Any] = json.loads(
        _exactly(pipe, LENGTH.unpack(_exactly(pipe, LENGTH.size))[0])
    )
    return answer, [
        np.frombuffer(_exactly(pipe, 8 * n), dtype="<f8") for n in answer.pop("lengths")
    ]
