"""A process that serves requests (`readers.serve`): a copy of this one where safe, or a new one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path

from nearlift import blas, isolation
from nearlift.readers.serve import serve
from nearlift.run import copies

#: The folder that holds nearlift.
PACKAGE = str(Path(__file__).parents[2])


def serving(memory: int) -> subprocess.Popen[bytes] | Copy:
    """A process of at most so many bytes of memory, started."""
    environment = {
        isolation.SAFE_PATH: "1",
        # HDF5 would load filters from wherever this points
        "HDF5_PLUGIN_PRELOAD": "::",
        "ARROW_DEFAULT_MEMORY_POOL": "system",
        **dict.fromkeys(blas.VARIABLES, "1"),
        "PYTHONPATH": os.pathsep.join(p for p in (PACKAGE, os.environ.get("PYTHONPATH", "")) if p),
    }
    if copies.alone():
        return Copy(environment, memory)
    # an interpreter takes as long to be ready as to read a hundred files; -P: the current folder,
    # which may be one of data, is no place to import from; -B: write nothing
    code = f"from nearlift.readers.serve import serve; serve(0, 1, {memory})"
    return subprocess.Popen(
        [sys.executable, "-P", "-B", "-c", code],
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
