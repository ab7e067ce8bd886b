"""Where simulated campaigns run: every run of this folder takes ``--executor`` and goes through the
package's own executors.

A campaign is a pure function of its seed, and rows are put in order when all have come, so that
neither the executor, nor the number of workers, nor the death of one changes a figure. The workers
of a cluster need this repository: start them in its root, with ``pipeline`` and the root itself on
PYTHONPATH.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor

from nearlift.blas import default_to_one_thread
from nearlift.run.workers import open_executor


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
