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
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from queue import Empty, SimpleQueue

Files = dict[str, bytes]
Task = Callable[[], Files]
#: Hands a task over and waits; None if the drawer could not do it.
Ask = Callable[[Task], Files | None]
#: Takes a task, and returns what waits for its files.
Give = Callable[[Task], Callable[[], Files]]
#: What a drawer runs; `-P` keeps the current folder out of its imports.
PROGRAM = "from nearlift.report.drawers import serve; serve()"


@contextlib.contextmanager
def drawers(count: int) -> Iterator[Give]:
    """So many drawers, which begin at once to import what they need, and draw what they are given
    from the first task on. Whoever waits for files draws what none has begun.
    """
    waiting: SimpleQueue[tuple[Future[Files | None], Task] | None] = SimpleQueue()

    def work(ask: Ask) -> None:
        while (item := waiting.get()) is not None:
            answer, task = item
            answer.set_result(ask(task))

    def give(task: Task) -> Callable[[], Files]:
        answer: Future[Files | None] = Future()
        waiting.put((answer, task))
        return lambda: files(answer) or task()

    def files(answer: Future[Files | None]) -> Files | None:
        with contextlib.suppress(Empty):
            while not answer.done():
                item = waiting.get_nowait()
                assert item is not None
                other, task = item
                try:
                    other.set_result(task())
                except Exception as fault:  # whoever waits for it is told
                    other.set_exception(fault)
        return answer.result()

    with contextlib.ExitStack() as held:
        for _ in range(count):
            ask = held.enter_context(_drawer())
            threading.Thread(target=work, args=(ask,), daemon=True).start()
        try:
            yield give
        finally:
            with contextlib.suppress(Empty):
                while True:
                    waiting.get_nowait()
            for _ in range(count):
                waiting.put(None)


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
            except (pickle.PickleError, AttributeError, TypeError, EOFError, OSError):
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
