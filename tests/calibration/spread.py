"""Simulated campaigns on the package's executors: every program of this folder takes ``--executor``.

A campaign is a pure function of its seed, so rows depend neither on the executor nor on the number
of workers. The workers of a cluster need this repository: start them in its root, with ``pipeline``
and the root itself on PYTHONPATH.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, as_completed, wait
from typing import TypeVar

from nearlift.blas import default_to_one_thread
from nearlift.run.workers import open_executor

Task = TypeVar("Task")
Result = TypeVar("Result")
IN_FLIGHT = 64


def add_option(parser: argparse.ArgumentParser) -> None:
    """``--executor``, by default a process for every processor."""
    parser.add_argument(
        "--executor",
        default="processes",
        help="serial, threads:N, processes:N or dask:ADDRESS (%(default)s)",
    )


@contextlib.contextmanager
def opened(text: str) -> Iterator[Executor]:
    """That executor; the processes that it starts have one thread of linear algebra each."""
    default_to_one_thread()
    with open_executor(text) as executor:
        yield executor


def unordered(
    executor: Executor, task: Callable[[Task], Result], specs: Iterable[Task]
) -> Iterator[Result]:
    """Results of `task` over `specs` as they end, so that a run of hours can keep each."""
    waiting: set[Future[Result]] = set()
    for spec in specs:
        waiting.add(executor.submit(task, spec))
        done, waiting = wait(
            waiting, 0 if len(waiting) < IN_FLIGHT else None, return_when=FIRST_COMPLETED
        )
        yield from (future.result() for future in done)
    yield from (future.result() for future in as_completed(waiting))
