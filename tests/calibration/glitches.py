"""Single trials gone wrong in a small campaign, and campaigns in which none has: what the screen
says of both.

Run as ``python -m tests.calibration.glitches``; it prints a section of docs/damage.md. The
campaigns are the referee's, reduced from records (`simulator`), written as a table of means and
read again by ingest, so that a glitch passes whatever judges a trial. A glitch *matters* if it
moves the headline by more than the standard uncertainty that it has without the glitch; it is
*told* if the trial is rejected, carries a remark, or is named by the fit, alone or with its visit.
"""

from __future__ import annotations

import csv
import functools
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.calibration import spread
from tests.calibration.bench import RADIUS, SPACING
from tests.calibration.simulator import Shared, Spec, simulate
from tests.calibration.streams import unordered

from nearlift.campaign import manifest as manifest
from nearlift.errors import NearliftError
from nearlift.fit import screening
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget
from nearlift.observed import choice, observe
from nearlift.results import Observations
from nearlift.run.engine import Job
from nearlift.run.workers import SerialExecutor
from nearlift.stages import ingest
from nearlift.stages.ingest import TRIALS

#: Reported; the screen was tuned on 700000 to 710099.
FIRST_SEED = 720_000
#: Campaigns that the glitches take in turn.
BENCHES = 10
#: Remarks that name a trial's lift as odd.
REMARKS = {"outlying", "other_throttle"}


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What ingest and fit make of one campaign: trials rejected, remarked on, and named; trials of
    visits named; the headline.
    """

    told: frozenset[str]
    visits: frozenset[str]
    value: float
    u: float
    failed: str = ""


def answer(data: Observations, folder: Path) -> Answer:
    """Write the trials as a table of means, in the order given, and put it through ingest, the base
    fit and the screen.
    """
    write(data, folder)
    given = manifest.load(folder)
    job = Job(
        root=folder,
        campaign=given,
        processed=folder / "processed",
        reports=folder / "reports",
        executor=SerialExecutor(),
    )
    told = {trial for trial, _ in ingest.run(job).rejected}
    table = job.read(TRIALS)
    told |= {
        str(t)
        for t, text in zip(table["trial"], table["quality"], strict=True)
        if REMARKS & set(text.split())
    }
    outlying = table["trial"][["outlying" in text.split() for text in table["quality"]]]
    parts = budget.components(given)
    try:
        fitted = fit(choice(given, data.boundary)[0], observe(table, given, data.boundary), parts)
    except NearliftError as fault:
        return Answer(
            told=frozenset(told), visits=frozenset(), value=np.nan, u=np.nan, failed=str(fault)
        )
    suspects = screening.screen(fitted, parts, outlying).suspects
    told |= {s.id for s in suspects if s.kind == "trial"}
    visits = {t for s in suspects if s.kind == "visit" for t in s.trials}
    headline = fitted.estimates[fitted.names[0]]
    return Answer(
        told=frozenset(told), visits=frozenset(visits), value=headline.value, u=headline.u
    )


def write(data: Observations, folder: Path) -> None:
    """campaign.toml and trials.csv."""
    datum = "blade tip" if data.boundary == "sidewall" else "rotor plane"
    (folder / "campaign.toml").write_text(f"""schema = "nearlift.campaign/1"
name = "glitch"
simulated = true
vehicle = {{ name = "bench", rotors = 4, rotor_radius = "{1e3 * RADIUS} mm", rotor_spacing = "{1e3 * SPACING} mm", mass = "27 g" }}
rig = {{ held = "throttle", distance_datum = "{datum}", distance_offset = "0 mm", gravity = "9.8 m/s^2" }}
records = {{ reader = "means" }}
[trials.units]
distance = "mm"
throttle = "fraction"
lift = "N"
lift_sd = "N"
[trials.constants]
boundary = "{data.boundary}"
[[uncertainty]]
name = "distance datum"
on = "height"
value = "0.1 mm"
scope = "boundary"
""")
    with (folder / "trials.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(
            ["trial", "distance", "throttle", "approach", "session", "lift", "lift_sd", "n"]
        )
        n = np.maximum(np.round(data.n_eff), 2)
        columns = (
            data.z_hat * RADIUS * 1e3,
            data.throttle,
            data.covariates["approach"],
            data.session,
            data.lift_N,
            data.u_lift_N * np.sqrt(n),
        )
        for trial, count, *numbers in zip(data.trial, n, *columns, strict=True):
            rows.writerow([trial, *(f"{x:.9g}" for x in numbers), int(count)])


Glitch = Callable[[Observations, np.random.Generator], tuple[Observations, list[int]]]


def times(factor: float) -> Glitch:
    """One mean lift times a factor."""

    def glitch(data: Observations, rng: np.random.Generator) -> tuple[Observations, list[int]]:
        i = int(rng.integers(data.n))
        return _replaced(
            data, lift_N=np.where(np.arange(data.n) == i, factor * data.lift_N, data.lift_N)
        ), [i]

    return glitch


def visit_times(factor: float) -> Glitch:
    """All lifts of one visit times a factor."""

    def glitch(data: Observations, rng: np.random.Generator) -> tuple[Observations, list[int]]:
        mine = data.visit == rng.integers(data.visit.max() + 1)
        return (
            _replaced(data, lift_N=np.where(mine, factor * data.lift_N, data.lift_N)),
            np.flatnonzero(mine).tolist(),
        )

    return glitch


def swapped(name: str) -> Glitch:
    """Two trials that differ in throttle (of one visit) or distance change their labels."""

    def glitch(data: Observations, rng: np.random.Generator) -> tuple[Observations, list[int]]:
        values = getattr(data, name).copy()
        i = int(rng.integers(data.n))
        others = np.flatnonzero(
            (values != values[i]) & ((data.visit == data.visit[i]) | (name == "z_hat"))
        )
        j = int(rng.choice(others))
        values[[i, j]] = values[[j, i]]
        return _replaced(data, **{name: values}), [i, j]

    return glitch


def _replaced(data: Observations, **changes: np.ndarray) -> Observations:
    from dataclasses import replace

    return replace(data, **changes)


#: Name, what is done, how often.
GLITCHES: tuple[tuple[str, Glitch, int], ...] = (
    ("lift x 1.1", times(1.1), 20),
    ("lift x 1.03", times(1.03), 15),
    ("lift x 10", times(10.0), 10),
    ("lift x 0.5", times(0.5), 5),
    ("sign", times(-1.0), 10),
    ("throttle labels of two trials swapped", swapped("throttle"), 15),
    ("distances of two trials swapped", swapped("z_hat"), 10),
    ("one visit 2 % off", visit_times(1.02), 15),
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One glitch: what it was, whether it mattered, whether it was told, and by how many standard
    uncertainties it moved the headline.
    """

    name: str
    matters: bool
    told: bool
    shift_in_u: float


def spec(seed: int) -> Spec:
    """A campaign like the demo's, 176 trials near the ground; every other one with a supply that
    sags and that no manifest mentions.
    """
    effects = (("supply_sag", 0.6),) if seed % 2 else ()
    return Spec(
        boundary="ground",
        effects=effects,
        design="from_one",
        realism=False,
        visits=4,
        sessions=3,
        distances=11,
    )


@functools.cache
def clean(bench: int) -> tuple[Observations, Answer]:
    """A campaign without a glitch, and what is said of it."""
    data = simulate(spec(FIRST_SEED + bench), FIRST_SEED + bench).data
    with tempfile.TemporaryDirectory() as folder:
        return data, answer(data, Path(folder))


def one(given: tuple[str, int]) -> Row:
    """One glitch in the campaign of a seed."""
    name, seed = given
    glitch = next(g for n, g, _ in GLITCHES if n == name)
    data, before = clean(seed % BENCHES)
    spoilt, trials = glitch(data, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        after = answer(spoilt, Path(folder))
    shift = abs(after.value - before.value) / before.u
    names = {str(data.trial[i]) for i in trials}
    # a trial that was named without the glitch tells nothing of it
    told = bool(names & ((after.told - before.told) | (after.visits - before.visits)))
    return Row(
        name=name,
        matters=not shift <= 1,
        told=told or bool(after.failed and names & after.told),
        shift_in_u=float(shift),
    )


def jobs(share: int = 1) -> list[tuple[str, int]]:
    """Every glitch with its seed; one in `share`."""
    listed = [(name, count) for name, _, count in GLITCHES for count in range(count)]
    return [(name, FIRST_SEED + i) for i, (name, _) in enumerate(listed)][::share]


#: Null campaigns: as the demo's in size, with normal noise or t6 and strays; and whole ones.
NULLS: dict[str, Spec] = {
    "176 trials, normal": Spec(
        boundary="ground", realism=False, visits=4, sessions=3, distances=11
    ),
    "176 trials, t6 and 0.3 % strays": Spec(
        boundary="ground", realism=True, visits=4, sessions=3, distances=11
    ),
    "176 trials, visits have 1 % in common": Spec(
        boundary="ground",
        realism=False,
        visits=4,
        sessions=3,
        distances=11,
        shared=Shared(visit_gain=0.01),
    ),
    "48 trials, one visit of each stop": Spec(
        boundary="ground", realism=False, visits=1, sessions=2, distances=12
    ),
    "1200 trials, normal": Spec(boundary="ground", realism=False),
    "1200 trials, t6 and 0.3 % strays": Spec(boundary="ground", realism=True),
}


def null(given: tuple[str, int]) -> tuple[str, int, int]:
    """Which campaign, whether it carries a named trial, and whether a named visit."""
    name, seed = given
    with tempfile.TemporaryDirectory() as folder:
        found = answer(simulate(NULLS[name], seed).data, Path(folder))
    return name, int(bool(found.told)), int(bool(found.visits))


def glitched(executor: Executor, share: int = 1) -> Iterator[Row]:
    """Rows as they are done."""
    return unordered(executor, one, jobs(share))


def section(rows: list[Row], nulls: list[tuple[str, int, int]]) -> str:
    """Two tables in Markdown."""
    lines = [
        "| glitch | trials | reported | moves the headline by more than u | of these not reported |",
        "|---|--:|--:|--:|--:|",
    ]
    for name in dict.fromkeys(name for name, _, _ in GLITCHES):
        mine = [r for r in rows if r.name == name]
        matter = [r for r in mine if r.matters]
        lines.append(
            f"| {name} | {len(mine)} | {sum(r.told for r in mine)} | {len(matter)} |"
            f" {sum(not r.told for r in matter)} |"
        )
    matter = [r for r in rows if r.matters]
    lines.append(
        f"| all | {len(rows)} | {sum(r.told for r in rows)} | {len(matter)} |"
        f" {sum(not r.told for r in matter)} |"
    )
    lines += [
        "",
        "| null campaigns | number | with a trial named | with a visit named |",
        "|---|--:|--:|--:|",
    ]
    for name in NULLS:
        found = [row for row in nulls if row[0] == name]
        lines.append(
            f"| {name} | {len(found)} | {sum(r[1] for r in found)} | {sum(r[2] for r in found)} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the section."""
    given = sys.argv[1:] or ["processes"]
    with spread.opened(given[0]) as executor:
        rows = list(glitched(executor))
        nulls = list(
            unordered(
                executor, null, [(name, FIRST_SEED + i) for name in NULLS for i in range(100)]
            )
        )
    print(section(rows, nulls))


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.glitches import main as run_main

    run_main()
