"""Results of tasks as they end, for runs of hours that keep each as it comes."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


def unordered(
    executor: concurrent.futures.Executor,
    task: Callable[[Task], Result],
    specs: Iterable[Task],
    ahead: int = 64,
) -> Iterator[Result]:
    """Results of `task` over `specs` as they end, so that a caller may keep each; with at most
    `ahead` in flight.
    """
    waiting: set[concurrent.futures.Future[Result]] = set()
    try:
        for spec in specs:
            waiting.add(executor.submit(task, spec))
            yield from _ended(waiting, 0 if len(waiting) < ahead else None)
        while waiting:
            yield from _ended(waiting, None)
    finally:
        for future in waiting:
            future.cancel()


def _ended(
    waiting: set[concurrent.futures.Future[Result]], timeout_s: float | None
) -> Iterator[Result]:
    """Results of those that have ended, which wait no longer."""
    for future in concurrent.futures.wait(
        waiting, timeout_s, concurrent.futures.FIRST_COMPLETED
    ).done:
        waiting.remove(future)
        yield future.result()
