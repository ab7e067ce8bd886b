"""Work shared with copies of this process, which are ready in milliseconds and do not take turns,
as threads of one interpreter do.

Only a process with one thread is copied: the locks of others would stay locked in the copy. What a
copy does not answer is done here.
"""

from __future__ import annotations

import contextlib
import functools
import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import IO, TypeVar

#: What asks a process to end.
INTERRUPTS = (signal.SIGINT, signal.SIGTERM)

Task = TypeVar("Task")
Result = TypeVar("Result")


def alone() -> bool:
    """Whether this process has a single thread, by the system's own count, which knows those of
    libraries as well.
    """
    try:
        return sys.platform == "linux" and len(os.listdir("/proc/self/task")) == 1  # noqa: PTH208
    except OSError:
        return False


def fork(life: Callable[[], object]) -> int:
    """The number of a copy of this process, which does nothing but `life` and ends; raises OSError
    where the system allows none.
    """
    # an interrupt must not find the copy where this process stands
    before = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPTS)
    try:
        pid = os.fork()
        if pid == 0:
            try:
                for number in INTERRUPTS:
                    signal.signal(number, signal.SIG_DFL)
                signal.pthread_sigmask(signal.SIG_UNBLOCK, INTERRUPTS)
                life()
            finally:
                os._exit(1)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return pid


@contextlib.contextmanager
def copied(work: Callable[[IO[bytes]], object]) -> Iterator[IO[bytes] | None]:
    """What a copy of this process writes that does `work`; it ends early where the work fails. None
    where the system allows no copy.
    """
    answers, end = os.pipe()

    def life() -> None:
        os.close(answers)
        with open(end, "wb") as file:  # noqa: PTH123
            work(file)

    try:
        pid = fork(life)
    except OSError:
        os.close(end)
        os.close(answers)
        yield None
        return
    os.close(end)
    with open(answers, "rb") as file:  # noqa: PTH123
        try:
            yield file
        finally:
            # it is done, or nobody listens any more; where nobody may wait for children, it is gone
            # once it has ended
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                if os.waitpid(pid, os.WNOHANG)[0] == 0:
                    os.kill(pid, signal.SIGKILL)
                    os.waitpid(pid, 0)


def shared_out(
    task: Callable[[Task], Result], specs: Sequence[Task], workers: int
) -> Iterator[Result]:
    """Results of `task` over `specs`, in order, this process being one of the workers; raises as
    `task` does.
    """

    def work(share: Sequence[Task], answers: IO[bytes]) -> None:
        for spec in share:
            pickle.dump(task(spec), answers)
            answers.flush()

    with contextlib.ExitStack() as held:
        others = [
            held.enter_context(copied(functools.partial(work, specs[i::workers])))
            for i in range(1, min(workers, len(specs)))
        ]
        for i, spec in enumerate(specs):
            turn = i % workers
            yield task(spec) if turn == 0 else _next(others[turn - 1], task, spec)


def _next(answers: IO[bytes] | None, task: Callable[[Task], Result], spec: Task) -> Result:
    """A copy's next answer; found here if it has none, and then none behind it."""
    if answers is not None:
        with contextlib.suppress(EOFError, pickle.UnpicklingError):
            result: Result = pickle.load(answers)
            return result
    return task(spec)
