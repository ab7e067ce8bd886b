"""Coverage of campaigns with few visits: what a visit's trials share has to be told from a handful
of them.

Simulated record by record by the referee, with a gain error of 0.5 % that the trials of a visit
share, undeclared, on top of the usual scatter of trials, of force and of heights.

    nice python -m tests.calibration.few --n 60        writes its section of docs/coverage.md
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.calibration import forms, pages, spread
from tests.calibration.coverage import BASE, LEVELS, Row, band, clopper_pearson, covered, intervals
from tests.calibration.simulator import Shared, Spec, simulate

from nearlift import catalogue
from nearlift.fit.least_squares import fit
from nearlift.run.workers import ordered

#: Distances and visits of each.
DESIGNS = {"4x2": (4, 2), "5x2": (5, 2), "9x1": (9, 1), "6x3": (6, 3)}
VISIT_GAIN = 0.005
REPORTED = 900_000


def spec(boundary: str, design: str) -> Spec:
    """Four throttles at each visit, one session."""
    distances, visits = DESIGNS[design]
    shared = Shared(visit_gain=VISIT_GAIN)
    return Spec(
        boundary=boundary,
        realism=False,
        visits=visits,
        sessions=1,
        samples=260,
        distances=distances,
        shared=shared,
    )


Job = tuple[str, str, int]
"""Design, boundary, seed."""


def campaign(job: Job) -> list[Row]:
    """One campaign from records to intervals; `ignored` is the same fit with what visits share left
    out.
    """
    design, boundary, seed = job
    made = simulate(spec(boundary, design), seed)
    model = catalogue.model(BASE[boundary])
    right = fit(model, made.data)
    # the same trials, each taken for a visit of its own
    apart = fit(model, replace(made.data, visit=np.arange(made.data.n))).noise
    found = {"declared": intervals(right), "ignored": intervals(fit(model, made.data, (), apart))}
    return [
        Row(boundary, 0.0, seed, name, truth, {way: i[name] for way, i in found.items()})
        for name, truth in made.truth.theta.items()
    ]


def run(
    executor: Executor,
    n: int,
    first: int,
    designs: tuple[str, ...] = tuple(DESIGNS),
    boundaries: tuple[str, ...] = forms.BOUNDARIES,
) -> dict[str, list[Row]]:
    """`n` campaigns of every design and boundary."""
    found: dict[str, list[Row]] = {d: [] for d in designs}
    jobs: list[Job] = [(d, b, first + i) for d in designs for b in boundaries for i in range(n)]
    for job, rows in zip(jobs, ordered(executor, campaign, jobs), strict=True):
        found[job[0]] += rows
    return found


def groups(rows: dict[str, list[Row]]) -> dict[tuple[str, str, str], list[Row]]:
    """Rows by design, boundary and coefficient."""
    keys = [(d, b, name) for d in rows for b in forms.BOUNDARIES for name in forms.COEFFICIENTS[b]]
    found = {
        (d, b, name): [r for r in rows[d] if (r.boundary, r.name) == (b, name)]
        for d, b, name in keys
    }
    return {key: mine for key, mine in found.items() if mine}


def check(rows: dict[str, list[Row]], way: str, chance: float) -> None:
    """Raise where intervals of a design and coefficient hold the truth too seldom; too often is no
    fault of so few visits.
    """
    for key, mine in groups(rows).items():
        for level in LEVELS:
            low, count = band(len(mine), level, chance)[0], covered(mine, way, level)
            assert count >= low, (
                f"{way}, {key}: {count} of {len(mine)} intervals of {level:.0%} hold the truth; by"
                f" chance at least {low}"
            )


def table(rows: dict[str, list[Row]]) -> str:
    """Shares that cover, what is stated beside what is made, and the width."""
    head = [
        "distances x visits",
        "",
        "68%",
        "90%",
        "95%",
        "90%, visit scatter left out",
        "stated / actual",
        "half-width of 90 % / 1.645 actual",
    ]
    text = f"| {' | '.join(head)} |\n|{'---|' * len(head)}\n"
    for (design, boundary, name), mine in groups(rows).items():
        cells = [design, f"{boundary}, {name.rstrip('_')}"]
        for level in LEVELS:
            count = covered(mine, "declared", level)
            ends = " to ".join(f"{x:.0%}" for x in clopper_pearson(count, len(mine)))
            cells.append(
                f"{count / len(mine):.0%} ({ends})" if level == 0.9 else f"{count / len(mine):.0%}"
            )
        cells.append(f"{covered(mine, 'ignored', 0.9) / len(mine):.0%}")
        actual = float(np.sqrt(np.mean([(r.found["declared"].value - r.truth) ** 2 for r in mine])))
        stated = float(np.median([r.found["declared"].u for r in mine]))
        wide = float(np.median([np.ptp(r.found["declared"].ends[1]) for r in mine])) / 2 / 1.645
        cells += [f"{stated / actual:.2f}", f"{wide / actual:.2f}"]
        text += f"| {' | '.join(cells)} |\n"
    return text


SECTION = """## Few visits

    nice python -m tests.calibration.few --n {n}

{n} campaigns of each design and boundary, records as above, one session, nothing stated. Each visit runs the four throttles once; its trials share an unstated gain error of 0.5 %. By chance (99 %) a share of 90 % over
{n} is above {low:.0%}. Intervals hold slightly less often than stated, since few visits hardly determine their scatter.

{table}"""


def main() -> None:
    """Run, and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=60)
    parser.add_argument("--first", type=int, default=REPORTED)
    spread.add_option(parser)
    parser.add_argument("--out", type=Path, default=Path("docs/coverage.md"))
    given = parser.parse_args()
    with spread.opened(given.executor) as executor:
        made = table(run(executor, given.n, given.first))
    section = SECTION.format(n=given.n, low=band(given.n, 0.9, 0.99)[0] / given.n, table=made)
    pages.write(given.out, "few visits", section)
    sys.stdout.write(made)


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.few import main as run_main

    run_main()
