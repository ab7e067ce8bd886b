"""Scores of a diagnosis on simulated campaigns, with exact binomial intervals.

    python -m tests.calibration.harness violations --count 20 --seed 900000
    python -m tests.calibration.harness records,ar_95 --count 201 --seed 700000 --out file.json

prints the tables; --out also writes file.json (figures and rows), file.md (tables) and, as it goes,
file.jsonl (a row per campaign; --resume continues it). What each figure counts is said in
docs/calibration.md. Seeds from 600000 on are for reporting; tune on others.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tests.calibration import forms, spread
from tests.calibration.assess import Diagnose, Row, assess, engine
from tests.calibration.figures import figures, markdown, peer_table
from tests.calibration.kinds import KINDS, REPORTED, chosen
from tests.calibration.streams import unordered

Job = tuple[str, str, int]
"""Kind, boundary, seed."""


def score(
    executor: Executor,
    kind: str,
    n: int,
    seeds: int | Iterable[int] = REPORTED,
    diagnose: Diagnose | None = engine,
    *,
    boundaries: tuple[str, ...] = forms.BOUNDARIES,
    peers: bool = False,
) -> dict[str, Any]:
    """Run `n` campaigns of one kind, the boundaries in turn, and return {"rows": [...], "figures":
    [...]}.

    Parameters
    ----------
    seeds : int or iterable of int
        The first of n consecutive seeds, or the seeds themselves.
    diagnose : callable or None
        Campaign to the diagnosis of its boundary; processes and clusters must be able to import it
        by name (or a `functools.partial` of such).
    """
    rows = sorted(
        run(executor, jobs(kind, n, seeds, boundaries), diagnose, peers), key=lambda r: r["seed"]
    )
    return {"rows": rows, "figures": [asdict(f) | {"passed": f.passed} for f in figures(rows)]}


def jobs(
    kind: str, n: int, seeds: int | Iterable[int], boundaries: tuple[str, ...] = forms.BOUNDARIES
) -> list[Job]:
    """`n` campaigns of one kind, in turn over those of the boundaries that it has."""
    mine = [b for b in boundaries if b in KINDS[kind].boundaries]
    wanted = range(seeds, seeds + n) if isinstance(seeds, int) else list(seeds)[:n]
    return [(kind, mine[i % len(mine)], seed) for i, seed in enumerate(wanted)] if mine else []


def run(
    executor: Executor, jobs: list[Job], diagnose: Diagnose | None, peers: bool = False
) -> Iterator[Row]:
    """Rows of jobs as they are done."""
    return unordered(executor, _assess, [(*job, diagnose, peers) for job in jobs])


def _assess(given: tuple[str, str, int, Diagnose | None, bool]) -> Row:
    return assess(*given)


def main(arguments: list[str] | None = None) -> int:
    """Run kinds of campaigns and write figures; exit code 1 if a promise is broken."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.calibration.harness", description=__doc__.split("\n")[0]
    )
    groups = ", ".join(dict.fromkeys(k.group for k in KINDS.values()))
    parser.add_argument(
        "kinds",
        help=(
            f"kinds or groups of kinds, comma separated; groups: {groups}; kinds:"
            f" {', '.join(KINDS)}"
        ),
    )
    parser.add_argument(
        "--count",
        type=int,
        default=201,
        help="campaigns of each kind, boundaries in turn (%(default)s)",
    )
    parser.add_argument("--boundaries", default=",".join(forms.BOUNDARIES))
    parser.add_argument(
        "--seed",
        type=int,
        default=REPORTED,
        help=f"first seed; {REPORTED} and above are for reporting",
    )
    spread.add_option(parser)
    parser.add_argument("--peers", action="store_true", help="run the rival methods too")
    parser.add_argument(
        "--only-peers", action="store_true", help="run nothing but the rival methods"
    )
    parser.add_argument(
        "--no-multiplicity", action="store_true", help="break the correction for many candidates"
    )
    parser.add_argument("--form-sd", type=float, default=None, help="form uncertainty; 0 breaks it")
    parser.add_argument(
        "--resume", action="store_true", help="keep the rows of an earlier, interrupted run"
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="file.json for figures and rows, with file.md and file.jsonl beside it",
    )
    given = parser.parse_args(arguments)
    boundaries = tuple(given.boundaries.split(","))
    try:
        kinds = chosen(given.kinds)
    except ValueError as fault:
        parser.error(str(fault))
    if unknown := {*boundaries} - {*forms.BOUNDARIES}:
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    if given.resume and not given.out:
        parser.error("--resume needs --out")
    options: dict[str, Any] = {"multiplicity": False} if given.no_multiplicity else {}
    if given.form_sd is not None:
        options["form_sd"] = given.form_sd
    diagnose = None if given.only_peers else partial(engine, **options) if options else engine
    log = given.out.with_suffix(".jsonl") if given.out else Path(os.devnull)
    log.parent.mkdir(parents=True, exist_ok=True)
    rows = (
        [json.loads(line) for line in log.read_text().splitlines()]
        if given.resume and log.exists()
        else []
    )
    done = {(r["kind"], r["boundary"], r["seed"]) for r in rows}
    # kinds in turn, so that an interrupted run has something of each
    listed = itertools.zip_longest(*(jobs(k, given.count, given.seed, boundaries) for k in kinds))
    wanted = [job for turn in listed for job in turn if job and job not in done]
    begun = time.perf_counter()
    with (
        spread.opened(given.executor) as executor,
        log.open("a" if given.resume else "w") as stream_out,
    ):
        for i, row in enumerate(
            run(executor, wanted, diagnose, given.peers or given.only_peers), 1
        ):
            rows.append(row)
            stream_out.write(json.dumps(row, default=_plain) + "\n")
            stream_out.flush()
            if i % 20 == 0 or i == len(wanted):
                print(f"{i} of {len(wanted)}, {time.perf_counter() - begun:.0f} s", file=sys.stderr)
    rows.sort(key=lambda r: (r["kind"], r["boundary"], r["seed"]))
    found, text = figures(rows), markdown(rows)
    if given.out:
        report = {
            "command": vars(given) | {"out": str(given.out)},
            "figures": [asdict(f) | {"passed": f.passed} for f in found],
            "peers": peer_table(rows),
            "rows": rows,
        }
        given.out.write_text(json.dumps(report, indent=1, default=_plain) + "\n")
        given.out.with_suffix(".md").write_text(text)
    print(text)
    return 1 if any(f.passed is False for f in found) else 0


def _plain(value: Any) -> Any:
    """numpy's scalars as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} in a row")


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.harness import main as run_main

    sys.exit(run_main())
