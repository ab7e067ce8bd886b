"""Coverage with shared errors in the records: intervals from the library beside those of lmfit as
it is commonly used.

Every campaign is simulated record by record by the referee (`simulator`, its own forms), with
errors that repeats do not show: a gain per session and per throttle, one offset of every distance,
a load cell that bends. Its manifest declares what was put in, the library fits the trials, and the
68, 90 and 95 % intervals on each coefficient hold the truth or do not.

    nice python -m tests.calibration.coverage --n 250        writes its section of docs/coverage.md
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Self

import lmfit
import numpy as np
from scipy.stats import beta, binom, norm, t
from tests.calibration import forms, pages, spread
from tests.calibration.simulator import Shared, Spec, simulate
from tests.calibration.streams import unordered
from tests.unit.manifests import CRAZYFLIE, RIG

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.likelihood import budget
from nearlift.results import Observations

LEVELS = (0.68, 0.9, 0.95)
DATUMS_MM = (0.2, 0.5)
BASE = {
    "ground": "sanchez_cuevas",
    "ceiling": "hsiao_chirarattananon",
    "sidewall": "sidewall_decay",
}
SESSION_GAIN, THROTTLE_GAIN, CELL_GF = 0.003, 0.003, 1.5
GRAVITY = 9.8
#: Seeds of reported figures; any others are for trying things out.
REPORTED = 800_000
WAYS = ("declared", "ignored", "lmfit")


def manifest(datum_mm: float, throttle: bool = True) -> manifests.Campaign:
    """What the campaign's owner declares: exactly what was put in."""
    listed = [
        {
            "name": "session gain",
            "on": "gain",
            "value": f"{100 * SESSION_GAIN} percent",
            "scope": "session",
        },
        {"name": "distance datum", "on": "height", "value": f"{datum_mm} mm", "scope": "boundary"},
    ]
    if throttle:
        listed.append(
            {
                "name": "throttle gain",
                "on": "gain",
                "value": f"{100 * THROTTLE_GAIN} percent",
                "scope": "throttle",
            }
        )
    return manifests.parse(
        {
            "schema": "nearlift.campaign/1",
            "name": "coverage",
            "vehicle": CRAZYFLIE | {"name": "simulated"},
            "rig": RIG,
            "load_cell": {
                "sample_rate": "1000 Hz",
                "tare": "0.1 s",
                "range": "1 kgf",
                "accuracy": f"{CELL_GF} gf",
            },
            "records": {
                "reader": "parquet",
                "files": "records.parquet",
                "force": {"column": "force", "unit": "N", "sign": 1},
            },
            "uncertainty": listed,
        }
    )


@cache
def parts(datum_mm: float, throttle: bool = True) -> tuple[budget.Component, ...]:
    """The budget that this manifest makes."""
    return budget.components(manifest(datum_mm, throttle))


def spec(boundary: str, datum_mm: float, throttle: bool = True) -> Spec:
    """160 trials in four sessions: 10 stations, 4 throttles, 4 visits."""
    shared = Shared(
        session_gain=SESSION_GAIN,
        throttle_gain=THROTTLE_GAIN if throttle else 0.0,
        datum_m=1e-3 * datum_mm,
        cell_N=1e-3 * GRAVITY * CELL_GF,
        range_N=GRAVITY,
    )
    return Spec(
        boundary=boundary, realism=False, visits=4, sessions=4, samples=260, every=2, shared=shared
    )


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate with its standard uncertainty and the two ends of its interval at each of
    `LEVELS`.
    """

    value: float
    u: float
    ends: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, value: float, u: float, dof: float) -> Self:
        """Value and uncertainty with the quantiles of Student's t."""
        quantiles = [
            t.ppf(0.5 + level / 2, dof) if np.isfinite(dof) else norm.ppf(0.5 + level / 2)
            for level in LEVELS
        ]
        return cls(
            float(value),
            float(u),
            tuple((float(value - q * u), float(value + q * u)) for q in quantiles),
        )

    def covers(self, truth: float, level: float) -> bool:
        """Whether the two-sided interval at this level holds the truth."""
        low, high = self.ends[LEVELS.index(level)]
        return bool(low <= truth <= high)


@dataclass(frozen=True, slots=True)
class Row:
    """One coefficient of one campaign: its truth, and what each way says."""

    boundary: str
    datum_mm: float
    seed: int
    name: str
    truth: float
    found: dict[str, Interval]

    def write(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def read(cls, line: str) -> Row:
        """The row of such a line."""
        given = json.loads(line)
        return cls(
            **{
                **given,
                "found": {
                    way: Interval(i["value"], i["u"], tuple(map(tuple, i["ends"])))
                    for way, i in given["found"].items()
                },
            }
        )


def answers(
    data: Observations, components: tuple[budget.Component, ...]
) -> dict[str, dict[str, Interval]]:
    """The library's answer under a budget, and with the same noise when what is shared is
    ignored.
    """
    model = catalogue.model(BASE[data.boundary])
    right = fit(model, data, components)
    return {"declared": intervals(right), "ignored": intervals(fit(model, data, (), right.noise))}


def intervals(found: LeastSquaresFit) -> dict[str, Interval]:
    """The intervals of a fit, by the quantiles that it reports its own 90 % with."""
    made = {
        name: Interval.of(e.value, e.u, dof)
        for (name, e), dof in zip(found.estimates.items(), found.effective, strict=True)
    }
    for name, e in found.estimates.items():
        assert np.allclose(made[name].ends[1], (e.lo90, e.hi90)), (
            "these are not the intervals that the library reports"
        )
    return made


def with_lmfit(data: Observations) -> dict[str, Interval]:
    """lmfit as it is commonly used: Delta L per cell over the farthest station, each an error of
    its own, normal quantiles.
    """
    far = data.z_hat.max()
    reference = np.array(
        [data.lift_N[(data.z_hat == far) & (data.throttle == x)].mean() for x in data.levels]
    )
    delta = data.lift_N / reference[data.level] - 1
    cell, index = np.unique(np.stack([data.z_hat, data.throttle]), axis=1, return_inverse=True)
    mean = np.bincount(index.ravel(), delta) / np.bincount(index.ravel())
    near = cell[0] < far
    model = lmfit.Model(LMFIT[data.boundary])
    nominal = forms.COEFFICIENTS[data.boundary]
    parameters = model.make_params(**nominal)
    for name in set(nominal) - {"K_b"}:
        parameters[name].min = 1e-6
    result = model.fit(mean[near], parameters, z=cell[0][near])
    return {
        name: Interval.of(p.value, p.stderr or np.nan, np.inf) for name, p in result.params.items()
    }


def _ground(z: np.ndarray, K_b: float) -> np.ndarray:
    return forms.ratio("ground", z, {"K_b": K_b}) - 1


def _ceiling(z: np.ndarray, alpha: float) -> np.ndarray:
    return forms.ratio("ceiling", z, {"alpha": alpha}) - 1


def _sidewall(z: np.ndarray, a: float, lambda_: float) -> np.ndarray:
    return forms.ratio("sidewall", z, {"a": a, "lambda_": lambda_}) - 1


LMFIT: dict[str, Callable[..., np.ndarray]] = {
    "ground": _ground,
    "ceiling": _ceiling,
    "sidewall": _sidewall,
}


Job = tuple[str, float, int]
"""Boundary, datum in mm, seed."""


def campaign(job: Job) -> list[Row]:
    """One campaign from records to intervals, in every way."""
    boundary, datum_mm, seed = job
    made = simulate(spec(boundary, datum_mm), seed)
    found = {**answers(made.data, parts(datum_mm)), "lmfit": with_lmfit(made.data)}
    return [
        Row(boundary, datum_mm, seed, name, truth, {way: found[way][name] for way in WAYS})
        for name, truth in made.truth.theta.items()
    ]


def run(
    executor: Executor,
    n: int,
    first: int,
    boundaries: tuple[str, ...] = forms.BOUNDARIES,
    rows: Path | None = None,
) -> list[Row]:
    """`n` campaigns of every boundary and datum, seeds from `first` on; finished ones are kept in
    the file `rows` and not run again.
    """
    found: dict[Job, list[Row]] = {}
    for r in (
        [] if rows is None or not rows.is_file() else map(Row.read, rows.read_text().splitlines())
    ):
        found.setdefault((r.boundary, r.datum_mm, r.seed), []).append(r)
    datums = list(enumerate(DATUMS_MM, first))
    jobs: list[Job] = [
        (b, datum_mm, seed + len(DATUMS_MM) * i)
        for i in range(n)
        for b in boundaries
        for seed, datum_mm in datums
    ]
    for new in unordered(executor, campaign, [job for job in jobs if job not in found]):
        found[new[0].boundary, new[0].datum_mm, new[0].seed] = new
        if rows is not None:
            with rows.open("a", encoding="utf-8") as file:
                file.writelines(r.write() + "\n" for r in new)
    return [r for job in jobs for r in found[job]]


def band(n: int, level: float, chance: float) -> tuple[int, int]:
    """Counts between which a binomial of that level falls with this chance at least."""
    low, high = binom.interval(chance, n, level)
    return int(low), int(high)


Key = tuple[str, float, str]


def groups(rows: list[Row]) -> dict[Key, list[Row]]:
    """Rows by boundary, datum and coefficient, in the order of `forms.BOUNDARIES`."""
    keys = [
        (b, d, name) for b in forms.BOUNDARIES for d in DATUMS_MM for name in forms.COEFFICIENTS[b]
    ]
    found = {key: [r for r in rows if (r.boundary, r.datum_mm, r.name) == key] for key in keys}
    return {key: mine for key, mine in found.items() if mine}


def covered(rows: list[Row], way: str, level: float) -> int:
    """How many intervals of that level hold the truth."""
    return sum(r.found[way].covers(r.truth, level) for r in rows)


def pooled(rows: list[Row]) -> dict[tuple[str, str], list[Row]]:
    """Rows by boundary and coefficient, both data together."""
    keys = dict.fromkeys((b, name) for b, _, name in groups(rows))
    return {(b, name): [r for r in rows if (r.boundary, r.name) == (b, name)] for b, name in keys}


def check(rows: list[Row], way: str, chance: float) -> None:
    """Raise where a share that covers leaves its binomial band, at either datum or at both
    together.
    """
    for key, mine in [*groups(rows).items(), *pooled(rows).items()]:
        for level in LEVELS:
            low, high = band(len(mine), level, chance)
            count = covered(mine, way, level)
            assert low <= count <= high, (
                f"{way}, {key}: {count} of {len(mine)} intervals of {level:.0%} hold the truth; by"
                f" chance {low} to {high}"
            )


def clopper_pearson(count: int, n: int) -> tuple[float, float]:
    """95 % interval of a share."""
    low = beta.ppf(0.025, count, n - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, n - count) if count < n else 1.0
    return float(low), float(high)


PAGE = """## Stated shared errors

    nice python -m tests.calibration.coverage --n {n} --rows out/coverage.jsonl

{n} simulated campaigns of each boundary and each datum, by the independent simulator of [calibration](calibration.md): 10 stations from one radius (0.12 at the ceiling, 0.15 at the sidewall) to 25 (12), 4 throttles, 4
visits, 160 trials in four sessions; scatter of trials (0.3 to 0.6 %), of force (0.1 to 0.5 mN) and of visit heights (0.02 to 0.1 mm). In addition, drawn once per element, and stated in the manifest:

| Error | Standard uncertainty | Shared by |
|---|---|---|
| gain | 0.3 % | session |
| gain | 0.3 % | throttle |
| distance datum | 0.2 mm or 0.5 mm | boundary |
| load cell's departure from its line | 1.5 gf at 1 kgf (half-width, uniform), with the square of force | campaign |

*nearlift* has the stated budget; *shared ignored* is the same likelihood without it; *lmfit* is `lmfit.Model(...).fit` on Delta L per cell over the farthest station, with independent errors. Share of intervals that hold
the truth, with Clopper-Pearson 95 % limits. By chance (99 %) a share of 68 % is between {low68:.1%} and {high68:.1%} over {n} campaigns, one of 90 % between {low90:.1%} and {high90:.1%}, one of 95 % between {low95:.1%} and
{high95:.1%}; over both datums between {low68b:.1%} and {high68b:.1%}, {low90b:.1%} and {high90b:.1%}, {low95b:.1%} and {high95b:.1%}.

{table}
Stated uncertainty (median) and actual error (rms). Pull is (estimate - truth) / stated; its mean should be 0 and its standard deviation 1:

{errors}
The gain per throttle moves no coefficient, since L_inf is free per throttle (`test_a_gain_per_throttle_moves_no_coefficient`).
{remarks}"""


def tables(rows: list[Row]) -> tuple[str, str]:
    """The two tables of the page: shares that cover, and errors stated and made."""
    head = ["", "", *(f"{d:g} mm" for d in DATUMS_MM), "both", "shared ignored", "lmfit"]
    first = f"| {' | '.join(head)} |\n|{'---|' * len(head)}\n"
    second = (
        "| | datum | | nearlift: stated, actual | pull: mean, sd | lmfit: stated, actual"
        " |\n|---|---|---|---|---|---|\n"
    )
    for boundary, name in dict.fromkeys((b, n) for b, _, n in groups(rows)):
        both = [r for r in rows if (r.boundary, r.name) == (boundary, name)]
        for level in LEVELS:
            cells = [f"{boundary}, {name.rstrip('_')}", f"{level:.0%}"]
            for mine in (*([r for r in both if r.datum_mm == d] for d in DATUMS_MM), both):
                count = covered(mine, "declared", level)
                cells.append(
                    f"{count / len(mine):.1%}"
                    f" ({' to '.join(f'{x:.1%}' for x in clopper_pearson(count, len(mine)))})"
                )
            cells[-1] = f"**{cells[-1].replace(' (', '** (')}"
            cells += [
                f"{covered(both, way, level) / len(both):.1%}" for way in ("ignored", "lmfit")
            ]
            first += f"| {' | '.join(cells)} |\n"
    for (boundary, datum_mm, name), mine in groups(rows).items():
        stated = {way: float(np.median([r.found[way].u for r in mine])) for way in WAYS}
        actual = {
            way: float(np.sqrt(np.mean([(r.found[way].value - r.truth) ** 2 for r in mine])))
            for way in WAYS
        }
        pull = np.array(
            [(r.found["declared"].value - r.truth) / r.found["declared"].u for r in mine]
        )
        second += (
            f"| {boundary} | {datum_mm:g} mm | {name.rstrip('_')} | {stated['declared']:.2g},"
            f" {actual['declared']:.2g} | "
        )
        second += (
            f"{pull.mean():+.2f}, {pull.std(ddof=1):.2f} | {stated['lmfit']:.2g},"
            f" {actual['lmfit']:.2g} |\n"
        )
    return first, second


REMARKS = """\
The ceiling needs the [integral over the height error](uncertainty.md#height-errors): by the slope alone the 90 % interval held the truth in two of three of 15 campaigns. The sidewall's lambda is covered slightly too often; its
flat curve hardly determines the scatter of heights.
"""


def main() -> None:
    """Run, and write the section."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=250)
    parser.add_argument("--first", type=int, default=REPORTED)
    parser.add_argument(
        "--rows", type=Path, help="keeps finished campaigns; given again, they are not run again"
    )
    spread.add_option(parser)
    parser.add_argument("--out", type=Path, default=Path("docs/coverage.md"))
    given = parser.parse_args()
    with spread.opened(given.executor) as executor:
        rows = run(executor, given.n, given.first, rows=given.rows)
    shares, errors = tables(rows)
    bands = {
        f"{end}{100 * level:.0f}{mark}": band(size, level, 0.99)[i] / size
        for level in LEVELS
        for i, end in enumerate(("low", "high"))
        for mark, size in (("", given.n), ("b", given.n * len(DATUMS_MM)))
    }
    page = PAGE.format(
        n=given.n, first=given.first, table=shares, errors=errors, remarks=REMARKS, **bands
    )
    pages.write(given.out, "shared errors", page)
    sys.stdout.write(shares + "\n" + errors)


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.coverage import main as run_main

    run_main()
