"""Scores of a diagnosis on simulated campaigns, with exact binomial intervals.

    python -m tests.calibration.harness violations --count 20 --seed 900000
    python -m tests.calibration.harness records,ar_95 --seed 700000 --out rows.jsonl

prints the tables; --out keeps a row per campaign. docs/calibration.md defines each figure. Seeds
from 600000 on are for reporting; tune on others.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterable
from concurrent.futures import Executor
from functools import partial

from tests.calibration import programs
from tests.calibration.assess import Diagnose, assess, engine
from tests.calibration.figures import figures, markdown
from tests.calibration.kinds import KINDS, REPORTED, chosen
from tests.calibration.programs import Row

Job = tuple[str, str, int]
KEYS = ("kind", "boundary", "seed")


def jobs(kind: str, seeds: Iterable[int]) -> list[Job]:
    """Kind, boundary and seed of a campaign for each seed, the kind's boundaries in turn."""
    turns = itertools.cycle(KINDS[kind].boundaries)
    return [(kind, boundary, seed) for boundary, seed in zip(turns, seeds, strict=False)]


def score(
    executor: Executor, kind: str, seeds: Iterable[int], diagnose: Diagnose = engine
) -> list[Row]:
    """Rows of one kind's campaigns, by seed; processes and clusters must be able to import
    `diagnose` by name (or a `functools.partial` of such).
    """
    task = partial(_assess, diagnose=diagnose)
    rows = programs.collect(executor, task, jobs(kind, seeds), KEYS)
    return sorted(rows, key=lambda row: row["seed"])


def _assess(job: Job, diagnose: Diagnose) -> list[Row]:
    return [assess(*job, diagnose)]


def main(arguments: list[str] | None = None) -> int:
    """Run kinds of campaigns and print figures; exit code 1 if a promise is broken."""
    parser = programs.parser(__doc__, REPORTED)
    parser.add_argument("kinds", type=chosen, help="kinds or groups of kinds, comma separated")
    given = parser.parse_args(arguments)
    seeds = range(given.seed, given.seed + given.count)
    # kinds in turn, so that an interrupted run has something of each
    turns = zip(*(jobs(kind, seeds) for kind in given.kinds), strict=True)
    task = partial(_assess, diagnose=engine)
    with programs.opened(given.executor) as executor:
        listed = itertools.chain.from_iterable(turns)
        rows = programs.collect(executor, task, listed, KEYS, given.out)
    rows.sort(key=lambda row: [row[key] for key in KEYS])
    print(markdown(rows))
    return int(any(passed is False for passed in figures(rows)["passed"]))


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.harness import main as run_main

    sys.exit(run_main())
