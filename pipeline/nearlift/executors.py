"""Where independent tasks run: one `concurrent.futures.Executor` seam and nothing else.

A task is a top-level function of plain values, so that a process or a cluster can run it. Results come back in the order of
the tasks whatever the executor, the number of workers, or the order in which they finish.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from nearlift.errors import UsageError

Task = TypeVar("Task")
Result = TypeVar("Result")


class SerialExecutor(concurrent.futures.Executor):
    """Runs each task at once, in the calling thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> concurrent.futures.Future[Any]:
        """Run the task and return a finished future."""
        future: concurrent.futures.Future[Any] = concurrent.futures.Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as fault:  # the future carries it, as any executor's would
            future.set_exception(fault)
        return future


@contextlib.contextmanager
def open_executor(text: str) -> Iterator[concurrent.futures.Executor]:
    """The executor that ``--executor`` names: ``serial``, ``threads:N``, ``processes:N`` or ``dask:ADDRESS``."""
    kind, _, rest = text.partition(":")
    if kind == "serial" and not rest:
        yield SerialExecutor()
    elif kind in ("threads", "processes"):
        workers = _count(rest, text)
        if kind == "threads":
            with concurrent.futures.ThreadPoolExecutor(workers) as pool:
                yield pool
        else:
            with concurrent.futures.ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
                yield pool
    elif kind == "dask" and rest:
        try:
            import distributed
        except ImportError:
            raise UsageError("--executor", f"{text!r} needs the package distributed", 'pip install "nearlift[dask]"') from None
        cluster: Any = distributed.Client
        with cluster(rest) as client:
            # pure=False: dask would otherwise return one cached result for equal calls
            yield client.get_executor(pure=False, retries=2)
    else:
        raise UsageError("--executor", f"{text!r} is not an executor", "use serial, threads:N, processes:N or dask:ADDRESS")


def _count(text: str, whole: str) -> int:
    if text == "":
        return os.cpu_count() or 1
    if not text.isdigit() or int(text) < 1:
        raise UsageError("--executor", f"{whole!r} names no number of workers", "write threads:2")
    return int(text)


def ordered(executor: concurrent.futures.Executor, task: Callable[[Task], Result], specs: Iterable[Task], ahead: int = 8) -> Iterator[Result]:
    """Results of `task` over `specs`, in order, with at most `ahead` in flight, so that memory stays flat."""
    waiting: deque[concurrent.futures.Future[Result]] = deque()
    try:
        for spec in specs:
            waiting.append(executor.submit(task, spec))
            if len(waiting) >= ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()
