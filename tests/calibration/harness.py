"""Scores of a diagnosis on simulated campaigns, with exact binomial intervals.

    python -m tests.calibration.harness violations --count 20 --seed 900000
    python -m tests.calibration.harness records,ar_95 --count 201 --seed 700000 --out file.json

prints the tables; --out also writes file.json (figures and rows), file.md (tables) and, as it goes,
file.jsonl (a row per campaign; --resume continues it). docs/calibration.md defines each figure.
Seeds from 600000 on are for reporting; tune on others.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tests.calibration import forms, spread
from tests.calibration.assess import Diagnose, Row, assess, engine
from tests.calibration.figures import figures, markdown
from tests.calibration.kinds import KINDS, REPORTED, chosen

Job = tuple[str, str, int]
"""Kind, boundary, seed."""


def score(
    executor: Executor,
    kind: str,
    n: int,
    seeds: int | Iterable[int] = REPORTED,
    diagnose: Diagnose = engine,
) -> list[Row]:
    """Rows of `n` campaigns of one kind, the boundaries in turn, by seed.

    Parameters
    ----------
    seeds : int or iterable of int
        The first of n consecutive seeds, or the seeds themselves.
    diagnose : callable
        Campaign to the diagnosis of its boundary; processes and clusters must be able to import it
        by name (or a `functools.partial` of such).
    """
    return sorted(run(executor, jobs(kind, n, seeds), diagnose), key=lambda r: r["seed"])


def jobs(
    kind: str, n: int, seeds: int | Iterable[int], boundaries: Iterable[str] = forms.BOUNDARIES
) -> list[Job]:
    """`n` campaigns of one kind, in turn over those of the boundaries that it has."""
    mine = [b for b in boundaries if b in KINDS[kind].boundaries]
    wanted = range(seeds, seeds + n) if isinstance(seeds, int) else list(seeds)[:n]
    return [(kind, mine[i % len(mine)], seed) for i, seed in enumerate(wanted)] if mine else []


def run(
    executor: Executor, jobs: list[Job], diagnose: Diagnose | None, peers: bool = False
) -> Iterator[Row]:
    """Rows of jobs as they are done."""
    return spread.unordered(executor, _assess, [(*job, diagnose, peers) for job in jobs])


def _assess(given: tuple[str, str, int, Diagnose | None, bool]) -> Row:
    return assess(*given)


def main(arguments: list[str] | None = None) -> int:
    """Run kinds of campaigns and write figures; exit code 1 if a promise is broken."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.calibration.harness", description=__doc__.split("\n")[0]
    )
    parser.add_argument("kinds", help="kinds or groups of kinds, comma separated")
    parser.add_argument("--count", type=int, default=201, help="campaigns of each kind")
    parser.add_argument("--boundaries", default=",".join(forms.BOUNDARIES), help="in turn")
    parser.add_argument("--seed", type=int, default=REPORTED, help="the first")
    spread.add_option(parser)
    parser.add_argument("--peers", action="store_true", help="run the rival methods too")
    parser.add_argument("--only-peers", action="store_true", help="run no diagnosis")
    parser.add_argument("--no-multiplicity", action="store_true", help="break the search")
    parser.add_argument("--form-sd", type=float, help="form uncertainty; 0 breaks it")
    parser.add_argument("--resume", action="store_true", help="keep the rows of --out")
    parser.add_argument("--out", type=Path, help="file.json; file.md and file.jsonl with it")
    given = parser.parse_args(arguments)
    boundaries = given.boundaries.split(",")
    try:
        kinds = chosen(given.kinds)
    except ValueError as fault:
        parser.error(str(fault))
    if unknown := {*boundaries} - {*forms.BOUNDARIES}:
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    options: dict[str, Any] = {"multiplicity": False} if given.no_multiplicity else {}
    if given.form_sd is not None:
        options["form_sd"] = given.form_sd
    diagnose = None if given.only_peers else partial(engine, **options)
    log = given.out.with_suffix(".jsonl") if given.out else Path(os.devnull)
    log.parent.mkdir(parents=True, exist_ok=True)
    kept = log.read_text().splitlines() if given.resume and log.exists() else []
    rows = [json.loads(line) for line in kept]
    done = {(r["kind"], r["boundary"], r["seed"]) for r in rows}
    # kinds in turn, so that an interrupted run has something of each
    listed = itertools.zip_longest(*(jobs(k, given.count, given.seed, boundaries) for k in kinds))
    wanted = [job for turn in listed for job in turn if job and job not in done]
    peers = given.peers or given.only_peers
    with (
        spread.opened(given.executor) as executor,
        log.open("a" if given.resume else "w") as stream,
    ):
        for i, row in enumerate(run(executor, wanted, diagnose, peers), 1):
            rows.append(row)
            stream.write(json.dumps(row, default=np.generic.item) + "\n")
            stream.flush()
            if i % 20 == 0 or i == len(wanted):
                print(f"{i} of {len(wanted)}", file=sys.stderr)
    rows.sort(key=lambda r: (r["kind"], r["boundary"], r["seed"]))
    found, text = figures(rows), markdown(rows)
    if given.out:
        report = {"figures": found.reset_index().to_dict("records"), "rows": rows}
        given.out.write_text(json.dumps(report, indent=1, default=np.generic.item) + "\n")
        given.out.with_suffix(".md").write_text(text)
    print(text)
    return int(any(passed is False for passed in found["passed"]))


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.harness import main as run_main

    sys.exit(run_main())
