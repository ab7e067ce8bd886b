"""Where independent tasks run: one `concurrent.futures.Executor` seam and nothing else.

A task is a top-level function of plain values, so that a process or a cluster can run it. Results come back in the order of
the tasks whatever the executor, the number of workers, or the order in which they finish.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import functools
import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from nearlift.errors import InputRefused, UsageError

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


class LastingProcesses(concurrent.futures.Executor):
    """Processes that outlive the death of one of them (by the kernel, for want of memory, say): lost tasks run again.

    Tasks are pure, so a second run gives the same answer. A task that loses its process `TRIES` times is refused.
    """

    TRIES = 3

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._lock = threading.Lock()
        self._pool = self._new()

    def _new(self) -> concurrent.futures.ProcessPoolExecutor:
        return concurrent.futures.ProcessPoolExecutor(self._workers, mp_context=multiprocessing.get_context("spawn"))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> concurrent.futures.Future[Any]:
        """Run the task in a process; the future survives that process."""
        answer: concurrent.futures.Future[Any] = concurrent.futures.Future()
        self._start(answer, functools.partial(fn, *args, **kwargs), 1)
        return answer

    def _start(self, answer: concurrent.futures.Future[Any], task: Callable[[], Any], attempt: int) -> None:
        with self._lock:
            pool = self._pool
            try:
                running = pool.submit(task)
            except BrokenProcessPool:
                pool = self._pool = self._new()
                running = pool.submit(task)

        def ended(done: concurrent.futures.Future[Any]) -> None:
            if answer.cancelled():
                return
            if done.cancelled():
                answer.cancel()
                return
            fault = done.exception()
            if fault is None:
                answer.set_result(done.result())
            elif not isinstance(fault, BrokenProcessPool):
                answer.set_exception(fault)
            elif attempt < self.TRIES:
                self._start(answer, task, attempt + 1)
            else:
                answer.set_exception(
                    InputRefused("--executor", f"a worker process died {attempt} times over one task", "use fewer workers (memory?), or serial")
                )

        running.add_done_callback(ended)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes; what waits is finished first unless it is to be cancelled."""
        self._pool.shutdown(wait=wait, cancel_futures=cancel_futures)


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
            with LastingProcesses(workers) as lasting:
                yield lasting
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
