"""Processes that draw figures beside this one: matplotlib keeps one state per process, so threads
cannot share it.

A drawer is a fresh interpreter that is sent one task after another; it imports neither the caller's
program nor anything from the current folder. What it does not answer is drawn here.
"""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future

Files = dict[str, bytes]
Task = Callable[[], Files]
#: Hands a task over and waits; None if the drawer could not do it.
Ask = Callable[[Task], Files | None]
#: What a drawer runs; `-P` keeps the current folder out of its imports.
PROGRAM = "from nearlift.report.figures.drawers import serve; serve()"


@contextlib.contextmanager
def drawers(count: int) -> Iterator[list[Ask]]:
    """So many drawers, which begin at once to import what they need."""
    with contextlib.ExitStack() as held:
        yield [held.enter_context(_drawer()) for _ in range(count)]


def drawn(tasks: Sequence[Task], others: Sequence[Ask]) -> Iterator[Files]:
    """The files of each task, in order: this process draws from the first on, `others` from the
    last on, which they begin before the first is asked for.
    """
    answers: list[Future[Files | None]] = [Future() for _ in tasks]
    left = deque(range(len(tasks)))

    def work(ask: Ask) -> None:
        # whoever takes the last leaves the others an empty list
        with contextlib.suppress(IndexError):
            while True:
                i = left.pop()
                answers[i].set_result(ask(tasks[i]))

    for ask in others:
        threading.Thread(target=work, args=(ask,), daemon=True).start()
    return _in_order(tasks, left, answers)


def _in_order(
    tasks: Sequence[Task], left: deque[int], answers: Sequence[Future[Files | None]]
) -> Iterator[Files]:
    for i, task in enumerate(tasks):
        try:
            left.remove(i)
        except ValueError:
            yield answers[i].result() or task()
        else:
            yield task()


@contextlib.contextmanager
def _drawer() -> Iterator[Ask]:
    with subprocess.Popen(
        [sys.executable, "-P", "-c", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        given, answers = process.stdin, process.stdout

        def ask(task: Task) -> Files | None:
            try:
                given.write(pickle.dumps(task))
                given.flush()
                files: Files = pickle.load(answers)
            except (pickle.PicklingError, AttributeError, TypeError, EOFError, OSError):
                # what no other process can import, or a drawer that died
                return None
            return files

        try:
            yield ask
        finally:
            process.kill()
            # what it no longer took
            with contextlib.suppress(OSError):
                given.close()


def serve() -> None:
    """A drawer's life: tasks from standard input, their files to standard output."""
    import nearlift.report.registry  # noqa: F401  all that tasks need, while none has come

    with contextlib.suppress(EOFError):
        while True:
            pickle.dump(pickle.load(sys.stdin.buffer)(), sys.stdout.buffer)
            sys.stdout.buffer.flush()
