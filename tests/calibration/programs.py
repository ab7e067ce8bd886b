"""What the programs of this folder share: options, executors, and rows that are kept as they come.

A campaign is a pure function of its seed, so rows depend neither on the executor nor on the number
of workers. The workers of a cluster need this repository: start them in its root, with ``pipeline``
and the root itself on PYTHONPATH.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from nearlift.blas import default_to_one_thread
from nearlift.run.workers import open_executor, ordered

Row = dict[str, Any]
Job = TypeVar("Job")
IN_FLIGHT = 64


def parser(doc: str | None, seed: int, count: int = 201) -> argparse.ArgumentParser:
    """``--count`` campaigns from ``--seed`` on, rows kept in ``--out``, on an ``--executor``."""
    made = argparse.ArgumentParser(description=(doc or "").split("\n")[0])
    made.add_argument("--count", type=int, default=count, help="campaigns (%(default)s)")
    made.add_argument("--seed", type=int, default=seed, help="the first (%(default)s)")
    made.add_argument("--out", type=Path, help="file.jsonl of rows; those in it are not run again")
    made.add_argument(
        "--executor",
        default="processes",
        help="serial, threads:N, processes:N or dask:ADDRESS (%(default)s)",
    )
    return made


@contextlib.contextmanager
def opened(text: str) -> Iterator[Executor]:
    """That executor; the processes that it starts have one thread of linear algebra each."""
    default_to_one_thread()
    with open_executor(text) as executor:
        yield executor


def read(out: Path | None) -> list[Row]:
    """The rows of a file; none where there is no file."""
    text = out.read_text(encoding="utf-8") if out and out.is_file() else ""
    return [json.loads(line) for line in text.splitlines()]


def collect(
    executor: Executor,
    task: Callable[[Job], list[Row]],
    jobs: Iterable[Job],
    keys: tuple[str, ...],
    out: Path | None = None,
) -> list[Row]:
    """Rows of `task` over `jobs`, tuples of a row's fields `keys`; those of jobs that the file `out`
    holds are read from it, all others appended to it.
    """
    rows = read(out)
    done = {tuple(row[key] for key in keys) for row in rows}
    todo = [job for job in jobs if job not in done]
    for i, made in enumerate(ordered(executor, task, todo, ahead=IN_FLIGHT), 1):
        rows += made
        if out:
            with out.open("a", encoding="utf-8") as file:
                file.writelines(json.dumps(row, default=np.generic.item) + "\n" for row in made)
            if i % 20 == 0 or i == len(todo):
                print(f"{i} of {len(todo)}", file=sys.stderr)
    return rows
