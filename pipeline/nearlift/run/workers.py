"""Executors: threads or processes share one campaign's trials.

A task is a top-level function of plain values, so that a process can run it. Results come in the
order of the tasks, whatever the executor and the number of workers.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from functools import partial
from itertools import islice
from types import ModuleType
from typing import Any, TypeVar

from nearlift import blas, isolation
from nearlift.errors import UsageError

#: The executor by default; the size of raw files, bytes, from which on other processes are worth
#: their start (0.4 s); and how many it starts at most.
AUTO, LARGE, MOST = "auto", 32 << 20, 3
#: The warning of the process that removes the semaphores of a killed one.
TIDIED = "ignore::UserWarning:multiprocessing.resource_tracker"

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


class Withdrawable(futures.Future[Any]):
    """A future that may be cancelled while its pool breaks."""

    def set_exception(self, exception: BaseException | None) -> None:
        """Set it, unless the future was cancelled."""
        # before Python 3.12 the pool fails over a cancelled one: all others would wait without end
        with contextlib.suppress(futures.InvalidStateError):
            super().set_exception(exception)


class Processes(futures.ProcessPoolExecutor):
    """Fresh processes that import nothing from the current folder and end with this one. If none
    can be started, tasks run in the calling thread.

    With `program` they import the running program, as its own tasks need; without a guard
    (``__name__ == "__main__"``) this runs it again.
    """

    ready = cannot_start = False

    def __init__(self, workers: int, program: bool = True) -> None:
        import multiprocessing

        self.workers, self.program = workers, program
        spawn = multiprocessing.get_context("spawn")
        # its queues start a resource tracker, which is an interpreter too
        with _beginning(program):
            super().__init__(workers, mp_context=spawn, initializer=_begin)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Run the task in a process, which may be started now and inherits the environment."""
        if not self.cannot_start:
            try:
                with _beginning(self.program):
                    future = super().submit(fn, *args, **kwargs)
                future.__class__ = Withdrawable
                return future
            except OSError:
                self.cannot_start = True
        return SerialExecutor().submit(fn, *args, **kwargs)

    def load(self, names: Iterable[str]) -> None:
        """Let each process import these modules, while this one goes on; `ready` says whether there
        are processes then.
        """
        names = tuple(names)
        try:
            for _ in range(self.workers if names else 0):
                self.submit(isolation.load, names)
                self.ready = not self.cannot_start
        except futures.BrokenExecutor:
            # figures are drawn here
            self.ready = False

    def end(self) -> None:
        """End the processes at once, whatever they do."""
        # this is no part of the library's interface before Python 3.14
        for process in list((self._processes or {}).values()):
            process.terminate()


@contextlib.contextmanager
def _beginning(program: bool) -> Iterator[None]:
    """Processes begun meanwhile are isolated, and never hear Ctrl-C, which their parent does."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    main = sys.modules["__main__"]
    sys.warnoptions.append(TIDIED)
    if not program:
        sys.modules["__main__"] = ModuleType("__main__")
    try:
        with isolation.safe_path():
            yield
    finally:
        sys.modules["__main__"] = main
        sys.warnoptions.remove(TIDIED)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    """Prepare a worker: it ends with its parent and has one BLAS thread."""
    isolation.end_with_parent()
    blas.default_to_one_thread()


@contextlib.contextmanager
def open_executor(text: str, size: int = 0) -> Iterator[futures.Executor]:
    """The executor that ``--executor`` names within one campaign: ``serial``, ``threads:N``,
    ``processes:N``, or ``auto``, which suits raw files of so many bytes. A cluster takes whole
    campaigns (`campaigns.run_campaigns`).
    """
    automatic = text == AUTO
    if automatic:
        others = min((os.cpu_count() or 1) - 1, MOST)
        text = f"processes:{others}" if others and size > LARGE else "threads:2"
    kind, _, count = text.partition(":")
    kinds: dict[str, Callable[[int], futures.Executor]] = {
        "serial": lambda _: SerialExecutor(),
        "threads": futures.ThreadPoolExecutor,
        # a program that only calls the command line need not be guarded
        "processes": partial(Processes, program=not automatic),
    }
    if kind == "dask" and count:
        what, remedy = "takes whole campaigns", "use serial, threads:N or processes:N"
    elif kind not in kinds or (kind == "serial" and count):
        what, remedy = "is not an executor", "use serial, threads:N, processes:N or dask:ADDRESS"
    elif count and not (count.isdigit() and int(count)):
        what, remedy = "names no number of workers", "write threads:2"
    else:
        pool: futures.Executor = SerialExecutor()
        # without semaphores, as where there is no /dev/shm, there are no processes
        with contextlib.suppress(OSError, ImportError, NotImplementedError):
            pool = kinds[kind](int(count or os.cpu_count() or 1))
        try:
            yield pool
        finally:
            # every result that was wanted is there
            if isinstance(pool, Processes):
                pool.end()
            # an interpreter that ends before the pool's own thread may print a traceback
            pool.shutdown(cancel_futures=True)
        return
    raise UsageError("--executor", f"{text!r} {what}", remedy)


@contextlib.contextmanager
def for_compiled_code(executor: futures.Executor) -> Iterator[futures.Executor]:
    """The executor, or as many threads where it has processes: compiled code leaves the interpreter
    free, and would be loaded by each process.
    """
    if not isinstance(executor, Processes):
        yield executor
        return
    with futures.ThreadPoolExecutor(executor.workers + 1) as pool:
        yield pool


def ordered(
    executor: futures.Executor,
    task: Callable[[Task], Result],
    specs: Iterable[Task],
    ahead: int = 8,
) -> Iterator[Result]:
    """Results of `task` over `specs`, in order, with at most `ahead` in flight, so that memory
    stays flat.
    """
    rest, waiting = iter(specs), deque[futures.Future[Result]]()
    try:
        waiting.extend(executor.submit(task, spec) for spec in islice(rest, ahead))
        while waiting:
            yield waiting.popleft().result()
            waiting.extend(executor.submit(task, spec) for spec in islice(rest, 1))
    finally:
        for future in waiting:
            future.cancel()


def shared(
    executor: Processes,
    task: Callable[[Task], Result],
    specs: Iterable[Task],
    ahead: int = 512,
    first: Callable[[], None] = lambda: None,
) -> Iterator[Result]:
    """`ordered` results to which this process contributes, once it has done something else
    `first`: it takes what no other has begun, from the end.
    """
    rest, here = iter(specs), SerialExecutor()
    waiting: deque[tuple[Task, futures.Future[Result]]] = deque()

    def submit(count: int) -> None:
        waiting.extend((spec, executor.submit(task, spec)) for spec in islice(rest, count))

    def take_one() -> bool:
        for i in reversed(range(len(waiting))):
            spec, future = waiting[i]
            if future.cancel():
                waiting[i] = spec, here.submit(task, spec)
                return True
        return False

    try:
        submit(ahead)
        first()
        while waiting:
            while not waiting[0][1].done() and take_one():
                pass
            yield waiting.popleft()[1].result()
            submit(1)
    finally:
        for _, future in waiting:
            future.cancel()
