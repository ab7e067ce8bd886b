"""Noise that resembles itself from trial to trial: what `fit` makes of it, beside one who knows its
covariance.

nice python -m tests.calibration.drifting --n 14        writes its section of docs/coverage.md
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import Executor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tests.calibration import forms, oracle, pages, spread
from tests.calibration.coverage import BASE, clopper_pearson, intervals
from tests.calibration.simulator import Errors, Spec, simulate

from nearlift import catalogue
from nearlift.fit.least_squares import fit
from nearlift.run.workers import ordered

#: Correlation of a trial's error with the next one's.
CORRELATIONS = (0.0, 0.5, 0.9, 0.97)
VISITS = (5, 15)
REPORTED = 950_000

Job = tuple[float, str, int]
"""Correlation, boundary, seed."""


class Row(NamedTuple):
    """The headline coefficient's 90 % interval: whether it holds the truth, and its width over that
    of generalised least squares.
    """

    holds: bool
    over_ideal: float


def campaign(job: Job) -> Row:
    """One campaign without effects, fitted by the library and by the one who knows the covariance
    of its errors.
    """
    correlation, boundary, seed = job
    errors = Errors(correlation=correlation)
    made = simulate(
        Spec(boundary=boundary, realism=False, visits=VISITS[seed % 2], errors=errors), seed
    )
    name = forms.HEADLINE[boundary]
    low, high = intervals(fit(catalogue.model(BASE[boundary]), made.data))[name].ends[1]
    ideal = np.ptp(oracle.fit(made, ()).interval(name))
    return Row(bool(low <= made.truth.theta[name] <= high), float((high - low) / ideal))


def table(executor: Executor, n: int, first: int) -> str:
    """A line for each correlation: `n` campaigns at every boundary."""
    text = (
        "| correlation of successive trials | 90 % intervals that hold | width over ideal: 10,"
        " 50, 90 % of campaigns |\n|---|---|---|\n"
    )
    for correlation in CORRELATIONS:
        jobs = [(correlation, b, first + i) for b in forms.BOUNDARIES for i in range(n)]
        rows = list(ordered(executor, campaign, jobs))
        count = sum(row.holds for row in rows)
        ends = " to ".join(f"{x:.0%}" for x in clopper_pearson(count, len(rows)))
        widths = ", ".join(
            f"{x:.2f}" for x in np.quantile([row.over_ideal for row in rows], (0.1, 0.5, 0.9))
        )
        text += f"| {correlation:g} | {count} of {len(rows)} ({ends}) | {widths} |\n"
    return text


SECTION = """## Noise that drifts between trials

    nice python -m tests.calibration.drifting --n {n}

{count} campaigns a line, {n} at each boundary, of 400 or 1200 trials without effects, with first-order relative errors from trial to trial. Ideal is generalised least squares with the true covariance.

{table}
"""


def main() -> None:
    """Run, and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=14)
    parser.add_argument("--first", type=int, default=REPORTED)
    spread.add_option(parser)
    parser.add_argument("--out", type=Path, default=Path("docs/coverage.md"))
    given = parser.parse_args()
    with spread.opened(given.executor) as executor:
        made = table(executor, given.n, given.first)
    section = SECTION.format(n=given.n, count=3 * given.n, table=made)
    pages.write(given.out, "drifting", section)
    sys.stdout.write(made)


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.drifting import main as run_main

    run_main()
