"""Processes that draw figures: matplotlib keeps one state per process, so threads cannot share it.

A drawer is a fresh interpreter that is sent its share and answers into a file; it imports neither
the caller's program nor anything from the current folder. What it does not answer is drawn here.
"""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial

Files = dict[str, bytes]
Task = Callable[[], Files]
#: What a drawer runs; `-P` keeps the current folder out of its imports.
PROGRAM = "import pickle, sys; pickle.load(sys.stdin.buffer)()"


def drawn(tasks: Sequence[Task], workers: int) -> Iterator[Files]:
    """The files of each task, in order, drawn by this process and `workers` - 1 others."""
    workers = max(min(workers, len(tasks)), 1)
    with contextlib.ExitStack() as held:
        shares = [held.enter_context(_drawer(tasks[i::workers])) for i in range(1, workers)]
        here = [task() for task in tasks[::workers]]
        files = [iter(here), *(iter(share()) for share in shares)]
        for i, task in enumerate(tasks):
            answer = next(files[i % workers], None)
            yield task() if answer is None else answer


@contextlib.contextmanager
def _drawer(share: Sequence[Task]) -> Iterator[Callable[[], list[Files]]]:
    """A process that draws a share; calling what is handed over waits for its files."""
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as answers:
        try:
            pickle.dump(partial(_draw, list(share)), given)
        except (pickle.PicklingError, AttributeError):
            # a function that no other process can import
            yield list
            return
        given.seek(0)
        with subprocess.Popen(
            [sys.executable, "-P", "-c", PROGRAM],
            stdin=given,
            stdout=answers,
            stderr=subprocess.DEVNULL,
        ) as process:

            def wait() -> list[Files]:
                process.wait()
                answers.seek(0)
                try:
                    files: list[Files] = pickle.load(answers)
                except (EOFError, pickle.UnpicklingError):
                    return []
                return files

            try:
                yield wait
            finally:
                process.kill()


def _draw(share: Sequence[Task]) -> None:
    pickle.dump([task() for task in share], sys.stdout.buffer)
