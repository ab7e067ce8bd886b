"""Where independent tasks run: one `concurrent.futures.Executor` seam and nothing else.

A task is a top-level function of plain values, so that a process or a cluster can run it. Results
come back in the order of the tasks whatever the executor, the number of workers, or the order in
which they finish.
"""

from __future__ import annotations

import contextlib
import functools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from typing import Any, TypeVar

from nearlift import blas, isolation
from nearlift.errors import InputRefused, UsageError

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


class Threads(futures.ThreadPoolExecutor):
    """Threads of this process, as many as `workers`."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self.workers = workers


class LastingProcesses(futures.Executor):
    """Processes that outlive the death of one of them (by the kernel, for want of memory, say): the
    task that it ran runs again.

    Each worker is a pool of one process, since a pool of several fails as a whole when one dies,
    and with it all that waits. So a death costs the task that it interrupts and no other. Tasks are
    pure: a second run gives the same answer. A task that loses its process `TRIES` times is
    refused.
    """

    TRIES = 3

    def __init__(self, workers: int) -> None:
        self._threads = futures.ThreadPoolExecutor(workers, thread_name_prefix="nearlift-process")
        self._mine = threading.local()
        self._all: list[futures.ProcessPoolExecutor] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Run the task in a process; the future survives that process."""
        return self._threads.submit(self._outlive, functools.partial(fn, *args, **kwargs))

    def _outlive(self, task: Callable[[], Any]) -> Any:
        from concurrent.futures.process import BrokenProcessPool

        for _ in range(self.TRIES):
            try:
                return self._process().submit(task).result()
            except BrokenProcessPool:
                self._mine.process = None
        raise InputRefused(
            "--executor",
            f"a worker process died {self.TRIES} times over one task",
            "use fewer workers (memory?), or serial",
        )

    def _process(self) -> futures.ProcessPoolExecutor:
        """The process of this thread, started when it is first needed."""
        process: futures.ProcessPoolExecutor | None = getattr(self._mine, "process", None)
        if process is None:
            import multiprocessing

            spawn = multiprocessing.get_context("spawn")
            with isolation.safe_path():
                process = futures.ProcessPoolExecutor(1, mp_context=spawn, initializer=_begin)
                # the first task starts the process, and with it the environment is settled
                process.submit(os.getpid)
            self._mine.process = process
            self._all.append(process)
        return process

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes; what waits is finished first unless it is to be cancelled."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        if wait:
            for process in self._all:
                process.shutdown()
        # without waiting, each process ends with the thread that it belongs to
        self._all.clear()


def _begin() -> None:
    """A worker ends with its parent; it has one BLAS thread, since every core has its worker."""
    isolation.end_with_parent()
    blas.default_to_one_thread()


@contextlib.contextmanager
def open_executor(text: str) -> Iterator[futures.Executor]:
    """The executor that ``--executor`` names: ``serial``, ``threads:N``, ``processes:N`` or
    ``dask:ADDRESS``.
    """
    kind, _, rest = text.partition(":")
    if kind == "serial" and not rest:
        yield SerialExecutor()
    elif kind in ("threads", "processes"):
        executor = Threads if kind == "threads" else LastingProcesses
        with executor(_count(rest, text)) as pool:
            yield pool
    elif kind == "dask" and rest:
        with _client(rest, text) as client:
            # pure=False: dask would otherwise return one cached result for equal calls
            yield client.get_executor(pure=False, retries=2)
    else:
        raise UsageError(
            "--executor",
            f"{text!r} is not an executor",
            "use serial, threads:N, processes:N or dask:ADDRESS",
        )


def threads_of(text: str) -> int:
    """How many threads of this process will work; 0 where other processes do."""
    kind, _, rest = text.partition(":")
    return 1 if kind == "serial" else _count(rest, text) if kind == "threads" else 0


#: Time for a scheduler to answer, s.
ANSWER_S = 10.0


def _client(address: str, whole: str) -> Any:
    """The connection to a dask scheduler.

    Raises
    ------
    UsageError
        The package is missing, or nobody answers.
    """
    import asyncio

    try:
        import distributed
    except ImportError:
        raise UsageError(
            "--executor", f"{whole!r} needs the package distributed", 'pip install "nearlift[dask]"'
        ) from None

    library: Any = distributed

    async def answer() -> None:
        arguments = library.Security().get_connection_args("client")
        link = await asyncio.wait_for(
            library.comm.connect(address, timeout=ANSWER_S, **arguments), ANSWER_S
        )
        link.abort()

    try:
        # asked first, since a client that could not connect goes on complaining; in a thread, since
        # a notebook has a loop of its own
        with futures.ThreadPoolExecutor(1) as one:
            one.submit(lambda: asyncio.run(answer())).result()
        return library.Client(address)
    except (OSError, ValueError, TypeError) as fault:
        raise UsageError(
            "--executor",
            f"no dask scheduler answers at {address!r}:"
            f" {str(fault) or f'nothing came within {ANSWER_S:g} s'}",
            "start one (dask scheduler) and give the address that it prints: dask:tcp://HOST:8786",
        ) from None


def _count(text: str, whole: str) -> int:
    if text == "":
        return os.cpu_count() or 1
    if not text.isdigit() or int(text) < 1:
        raise UsageError("--executor", f"{whole!r} names no number of workers", "write threads:2")
    return int(text)


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
