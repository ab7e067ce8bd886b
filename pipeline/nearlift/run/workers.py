"""Executors: threads or processes share one campaign's trials.

A task is a top-level function of plain values, so that a process can run it. Results come in the
order of the tasks, whatever the executor and the number of workers.
"""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from typing import Any, TypeVar

from nearlift import blas, isolation
from nearlift.errors import UsageError

Task = TypeVar("Task")
Result = TypeVar("Result")


class SerialExecutor(futures.Executor):
    """Runs each task at once, in the calling thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Run the task and return a finished future."""
        future: futures.Future[Any] = futures.Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as fault:  # the future carries it, as any executor's would
            future.set_exception(fault)
        return future


class Processes(futures.ProcessPoolExecutor):
    """Fresh processes that import nothing from the current folder and end with this one."""

    def __init__(self, workers: int) -> None:
        import multiprocessing

        spawn = multiprocessing.get_context("spawn")
        # its queues start a resource tracker, which is an interpreter too
        with isolation.safe_path():
            super().__init__(workers, mp_context=spawn, initializer=_begin)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Run the task in a process, which may be started now and inherits the environment."""
        with isolation.safe_path():
            return super().submit(fn, *args, **kwargs)

    def end(self) -> None:
        """End the processes at once, whatever they do."""
        # this is no part of the library's interface before Python 3.14
        for process in list((self._processes or {}).values()):
            process.terminate()


def _begin() -> None:
    """Prepare a worker: it ends with its parent and has one BLAS thread."""
    isolation.end_with_parent()
    blas.default_to_one_thread()


@contextlib.contextmanager
def open_executor(text: str) -> Iterator[futures.Executor]:
    """The executor that ``--executor`` names within one campaign: ``serial``, ``threads:N`` or
    ``processes:N``. A cluster takes whole campaigns (`campaigns.run_campaigns`).
    """
    kind, _, count = text.partition(":")
    kinds: dict[str, Callable[[int], futures.Executor]] = {
        "serial": lambda _: SerialExecutor(),
        "threads": futures.ThreadPoolExecutor,
        "processes": Processes,
    }
    if kind == "dask" and count:
        what, remedy = "takes whole campaigns", "use serial, threads:N or processes:N"
    elif kind not in kinds or (kind == "serial" and count):
        what, remedy = "is not an executor", "use serial, threads:N, processes:N or dask:ADDRESS"
    elif count and not (count.isdigit() and int(count)):
        what, remedy = "names no number of workers", "write threads:2"
    else:
        pool = kinds[kind](int(count or os.cpu_count() or 1))
        try:
            yield pool
        except BaseException:
            if isinstance(pool, Processes):
                pool.end()
            # an interpreter that ends before the pool's own thread may print a traceback
            pool.shutdown(cancel_futures=True)
            raise
        pool.shutdown()
        return
    raise UsageError("--executor", f"{text!r} {what}", remedy)


def ordered(
    executor: futures.Executor,
    task: Callable[[Task], Result],
    specs: Iterable[Task],
    ahead: int = 8,
) -> Iterator[Result]:
    """Results of `task` over `specs`, in order, with at most `ahead` in flight, so that memory
    stays flat.
    """
    waiting: deque[futures.Future[Result]] = deque()
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
