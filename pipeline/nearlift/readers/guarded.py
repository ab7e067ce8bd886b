"""Guarded process: another process reads files that a library parses, with limited memory and time.

Foreign bytes can crash a C library, keep it busy without end, or unpack to any size. All this costs
the one file that caused it. The process serves file after file, since its start takes about a
second. It writes no file, imports nothing from the current folder, and ends with its parent. Its
answers are bounded, and hold nothing but numbers, texts and the package's own types
(docs/decisions.md#one-guarded-process-by-its-own-pipe).
"""

from __future__ import annotations

import atexit
import contextlib
import io
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from nearlift import blas, isolation
from nearlift.errors import NearliftError

#: Address space of the process and the longest answer, bytes.
MEMORY, LONGEST_ANSWER = 1 << 30, 128 << 20
#: Time for one file, s: of the processor, and by the clock.
CPU_S, WALL_S = 60, 120.0
#: Files after which a new process is started: what libraries leak must not add up to the limit.
FILES = 1000
#: The folder that holds nearlift.
PACKAGE = str(Path(__file__).parents[2])
#: The functions of numpy that build an array from a pickle.
ARRAYS = {"_frombuffer", "_reconstruct", "ndarray", "dtype", "scalar"}
#: Whether this is the process that serves: what is guarded in it already is simply called.
_serving = False

Asked = ParamSpec("Asked")
Answer = TypeVar("Answer")


class Malformed(Exception):
    """A file that contradicts itself: its trial is rejected, the campaign goes on."""


class Guarded:
    """Calls of functions in a process of their own, one at a time.

    The process starts with the first call, and again after each call that ended it.
    """

    def __init__(self, memory: int = MEMORY, cpu_s: int = CPU_S, wall_s: float = WALL_S) -> None:
        self.memory, self.cpu_s, self.wall_s = memory, cpu_s, wall_s
        self.process: subprocess.Popen[bytes] | None = None
        self._link: Connection[Any, Any] | None = None
        self._lock, self._files = threading.Lock(), 0
        #: The end of a pipe that closes when this process ends, however it ends.
        self._lifeline = -1

    def __call__(
        self, function: Callable[Asked, Answer], *arguments: Asked.args, **named: Asked.kwargs
    ) -> Answer:
        """The answer of a module's function, or the exception that it raises.

        Raises
        ------
        NearliftError, Malformed
            As the function does.
        Malformed
            It raised anything else, crashed, came to a limit, or answered at too great length.
        """
        if _serving:
            return function(*arguments, **named)
        with self._lock:
            # a relative path is of the folder that is the current one now
            asked = pickle.dumps((os.getcwd(), function, arguments, named))  # noqa: PTH109
            error, answer = self._answer(asked)
        if error is None:
            result: Answer = answer
            return result
        fault = error.__new__(error, *answer[0])
        fault.__dict__.update(answer[1])
        raise fault

    def start(self) -> subprocess.Popen[bytes]:
        """The process, started unless it runs."""
        if self.process is None:
            ours, theirs = socket.socketpair()
            life, self._lifeline = os.pipe()
            arguments = f"{theirs.fileno()}, {life}, {self.memory}, {self.cpu_s}"
            code = f"from nearlift.readers import guarded; guarded.serve({arguments})"
            with theirs:
                self.process = subprocess.Popen(
                    # -P: no imports from the current folder; -B: no bytecode is written
                    [sys.executable, "-P", "-B", "-c", code],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    pass_fds=(theirs.fileno(), life),
                    env={**os.environ, **_environment()},
                    # an interrupt at the terminal is the parent's to handle
                    start_new_session=True,
                )
            os.close(life)
            self._link = Connection(ours.detach())
        return self.process

    def _answer(self, asked: bytes) -> tuple[type[Exception] | None, Any]:
        """The class of the exception, if any, and the answer."""
        if self._files >= FILES:
            self.close()
        process, why = self.start(), ""
        assert self._link is not None
        self._files += 1
        try:
            self._link.send_bytes(asked)
            if self._link.poll(self.wall_s):
                answer = self._link.recv_bytes(LONGEST_ANSWER + 4096)
                outcome: tuple[type[Exception] | None, Any] = _Unpickler(io.BytesIO(answer)).load()
                return outcome
            why = f"its reader was stopped after {self.wall_s:g} s"
        except Exception:
            # a process that closes its end takes a moment to end
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(1.0)
        except BaseException:
            # an interrupt leaves an answer behind, which is not the next file's
            self.close()
            raise
        self.close()
        if process.returncode == -getattr(signal, "SIGXCPU", 0):
            why = f"its reader was stopped after {self.cpu_s} s of computing"
        crashed = f"its reader crashed (exit code {process.returncode})"
        raise Malformed(why or f"{crashed}, at most {self.memory >> 20} MiB of memory allowed")

    def close(self) -> None:
        """End the process; one that ended by itself keeps its exit code."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
        self.forget()

    def forget(self) -> None:
        """Leave the process: to its end, or to the one of which this is a copy."""
        if self._link is not None:
            self._link.close()
            os.close(self._lifeline)
        self.process, self._link, self._files = None, None, 0


#: The process that all files share.
run = Guarded()
atexit.register(run.close)


def _in_a_copy() -> None:
    """Leave the process to the one of which this is a copy, as is the lock of its threads."""
    run.forget()
    run._lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_a_copy)


def _environment() -> dict[str, str]:
    return {
        isolation.SAFE_PATH: "1",
        # HDF5 would load filters from where this points
        "HDF5_PLUGIN_PRELOAD": "::",
        # it reserves no address space ahead
        "ARROW_DEFAULT_MEMORY_POOL": "system",
        **dict.fromkeys(blas.VARIABLES, "1"),
        "PYTHONPATH": os.pathsep.join(p for p in (PACKAGE, os.environ.get("PYTHONPATH", "")) if p),
    }


class _Unpickler(pickle.Unpickler):
    """Arrays and the package's own types; a process taken over by a file can send nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        if module in ("nearlift", "numpy") or module.startswith(("nearlift.", "numpy.")):
            kind = super().find_class(module, name)
            if name in ARRAYS if module.startswith("numpy") else isinstance(kind, type):
                return kind
        raise pickle.UnpicklingError(f"{module}.{name} is no answer")


# ---- in the process


def serve(fd: int, lifeline: int, memory: int, cpu_s: int) -> None:
    """Answer calls until the other end closes."""
    global _serving
    _serving = True
    _end_with(lifeline)
    # macOS has no limit of address space: only time is bounded there
    for kind, most in (("AS", memory), ("FSIZE", 0), ("CORE", 0)):
        _limit(kind, most, most)
    with Connection(fd) as link, contextlib.suppress(EOFError, OSError):
        while True:
            asked = link.recv_bytes()
            _limit("CPU", int(sum(os.times()[:2])) + 1 + cpu_s)
            link.send_bytes(_answer(asked))


def _answer(asked: bytes) -> bytes:
    """The answer to one call, or the exception: its class, arguments and attributes."""
    try:
        folder, function, arguments, named = pickle.loads(asked)
        os.chdir(folder)
        content = pickle.dumps((None, function(*arguments, **named)), protocol=5)
        if len(content) <= LONGEST_ANSWER:
            return content
        most = LONGEST_ANSWER >> 20
        fault: Exception = Malformed(
            f"it unpacks to more than {most} MB; cut it into shorter files"
        )
    except (NearliftError, Malformed) as known:
        fault = known
    except MemoryError:
        fault = Malformed("it needs more memory than its reader is allowed")
    except Exception as other:
        # libraries raise anything on damaged bytes
        what = (str(other).splitlines() or [""])[0] or type(other).__name__
        fault = Malformed(f"cannot be read: {what}")
    return pickle.dumps((type(fault), (fault.args, fault.__dict__)), protocol=5)


def _end_with(lifeline: int) -> None:
    """End this process when the other end of the pipe closes, even within a call into C."""
    with contextlib.suppress(ImportError, AttributeError, OSError):
        import fcntl

        # the system sends SIGIO, which ends a process that does not handle it
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(lifeline, fcntl.F_SETFL, os.O_ASYNC | os.O_NONBLOCK)
        with contextlib.suppress(BlockingIOError):
            if not os.read(lifeline, 1):
                # closed before it was watched
                os._exit(1)


def _limit(kind: str, soft: int, hard: int | None = None) -> None:
    """Bound a resource of this process, where the system can."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        limit = getattr(resource, f"RLIMIT_{kind}")
        resource.setrlimit(limit, (soft, resource.getrlimit(limit)[1] if hard is None else hard))
