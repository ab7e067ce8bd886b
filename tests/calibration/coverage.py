"""Coverage of intervals with errors that trials share, next to lmfit as it is commonly used.

The independent simulator makes every campaign record by record. Two kinds: *stated*, with a gain
per session and per throttle, an offset of every distance and a load cell that bends, all stated in
the manifest; *few visits*, whose trials share an unstated gain of 0.5 %.

    nice python -m tests.calibration.coverage --count 250          tables of docs/coverage.md
    nice python -m tests.calibration.coverage --few --count 48     its last table
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import replace
from functools import cache
from pathlib import Path

import lmfit
import numpy as np
import pandas as pd
from scipy.stats import binom, t
from tests.calibration import forms, programs
from tests.calibration.figures import clopper_pearson, table, write
from tests.calibration.programs import Row
from tests.calibration.simulator import Shared, Spec, simulate
from tests.unit.manifests import CRAZYFLIE, RIG

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.likelihood import budget
from nearlift.results import Observations

LEVELS = (68, 90, 95)
#: Distance datums of the stated kind, mm; distances and visits of each of few visits.
DATUMS = {"0.2 mm": 0.2, "0.5 mm": 0.5}
FEW = {"4x2": (4, 2), "5x2": (5, 2), "9x1": (9, 1), "6x3": (6, 3)}
SESSION_GAIN, THROTTLE_GAIN, VISIT_GAIN, CELL_GF = 0.003, 0.003, 0.005, 1.5
GRAVITY = 9.8
#: Seeds of reported figures; any others are for trials.
REPORTED = 800_000
JOB, GROUP = ("design", "boundary", "seed"), ["design", "boundary", "name"]

Ends = dict[str, float]
"""value, u, and lo and hi at each of `LEVELS`."""


@cache
def components(datum_mm: float, throttle: bool = True) -> tuple[budget.Component, ...]:
    """The budget of a manifest that states the errors as they are put in."""
    stated = [
        {"on": "gain", "value": f"{100 * SESSION_GAIN} percent", "scope": "session"},
        {"on": "height", "value": f"{datum_mm} mm", "scope": "boundary"},
        {"on": "gain", "value": f"{100 * THROTTLE_GAIN} percent", "scope": "throttle"},
    ][: 2 + throttle]
    cell = {"sample_rate": "1000 Hz", "tare": "0.1 s", "range": "1 kgf"}
    force = {"column": "force", "unit": "N", "sign": 1}
    campaign = manifests.parse(
        {
            "schema": "nearlift.campaign/1",
            "name": "coverage",
            "vehicle": CRAZYFLIE | {"name": "simulated"},
            "rig": RIG,
            "load_cell": cell | {"accuracy": f"{CELL_GF} gf"},
            "records": {"reader": "parquet", "files": "records.parquet", "force": force},
            "uncertainty": [{"name": f"{s['scope']} {s['on']}", **s} for s in stated],
        }
    )
    return budget.components(campaign)


def spec(boundary: str, design: str, throttle: bool = True) -> Spec:
    """Stated: 160 trials in four sessions, 10 stations, 4 throttles, 4 visits. Few: four throttles
    at each of a few visits, one session.
    """
    common = {"boundary": boundary, "realism": False, "samples": 260}
    if design in FEW:
        distances, visits = FEW[design]
        shared = Shared(visit_gain=VISIT_GAIN)
        return Spec(**common, visits=visits, sessions=1, distances=distances, shared=shared)
    shared = Shared(
        session_gain=SESSION_GAIN,
        throttle_gain=THROTTLE_GAIN if throttle else 0.0,
        datum_m=1e-3 * DATUMS[design],
        cell_N=1e-3 * GRAVITY * CELL_GF,
        range_N=GRAVITY,
    )
    return Spec(**common, visits=4, sessions=4, every=2, shared=shared)


def interval(value: float, u: float, dof: float = np.inf) -> Ends:
    """A two-sided interval at each level, by Student's t."""
    ends = {"value": value, "u": u}
    for level in LEVELS:
        half = t(dof).ppf(0.5 + level / 200) * u
        ends |= {f"lo{level}": value - half, f"hi{level}": value + half}
    return ends


def intervals(made: LeastSquaresFit) -> dict[str, Ends]:
    """Intervals of a fit, by the quantiles of the 90 % interval that it reports itself."""
    ends = {}
    for (name, e), dof in zip(made.estimates.items(), made.effective, strict=True):
        ends[name] = interval(e.value, e.u, dof)
        assert np.allclose((ends[name]["lo90"], ends[name]["hi90"]), (e.lo90, e.hi90))
    return ends


def answers(data: Observations, parts: tuple[budget.Component, ...]) -> dict[str, dict[str, Ends]]:
    """nearlift's intervals under a budget, and with the same noise without it."""
    model = catalogue.model(catalogue.default_base(data.boundary, 4))
    right = fit(model, data, parts)
    return {"nearlift": intervals(right), "ignored": intervals(fit(model, data, (), right.noise))}


def with_lmfit(data: Observations) -> dict[str, Ends]:
    """lmfit as it is commonly used: Delta L per cell over the farthest station, independent
    errors, normal quantiles.
    """
    cells = pd.DataFrame({"z": data.z_hat, "throttle": data.throttle, "lift": data.lift_N})
    mean = cells.groupby(["throttle", "z"])["lift"].mean()
    far = mean.xs(data.z_hat.max(), level="z")
    delta = (mean / far - 1).drop(index=data.z_hat.max(), level="z")
    z = delta.index.get_level_values("z").to_numpy()

    def residual(p: lmfit.Parameters) -> np.ndarray:
        return forms.ratio(data.boundary, z, p.valuesdict()) - 1 - delta.to_numpy()

    parameters = lmfit.create_params(**forms.COEFFICIENTS[data.boundary])
    for name in set(parameters) - {"K_b"}:
        parameters[name].min = 1e-6
    result = lmfit.minimize(residual, parameters)
    return {name: interval(p.value, p.stderr or np.nan) for name, p in result.params.items()}


def campaign(job: tuple[str, str, int]) -> list[Row]:
    """One campaign from records to intervals: a row for each coefficient and way."""
    design, boundary, seed = job
    made = simulate(spec(boundary, design), seed)
    if design in DATUMS:
        ways = answers(made.data, components(DATUMS[design])) | {"lmfit": with_lmfit(made.data)}
    else:
        model = catalogue.model(catalogue.default_base(boundary, 4))
        # the same trials, each taken for a visit of its own
        apart = fit(model, replace(made.data, visit=np.arange(made.data.n))).noise
        right, ignored = fit(model, made.data), fit(model, made.data, (), apart)
        ways = {"nearlift": intervals(right), "ignored": intervals(ignored)}
    one = dict(zip(JOB, job, strict=True))
    return [
        one | {"name": name, "truth": truth, "way": way} | ends[name]
        for way, ends in ways.items()
        for name, truth in made.truth.theta.items()
    ]


def run(
    executor: Executor, seeds: range, designs: Iterable[str], out: Path | None = None
) -> pd.DataFrame:
    """Rows of a campaign of every seed, design and boundary."""
    jobs = [(d, b, seed) for seed in seeds for d in designs for b in forms.BOUNDARIES]
    data = pd.DataFrame(programs.collect(executor, campaign, jobs, JOB, out))
    return data[data["design"].isin(list(designs)) & data["seed"].isin(seeds)]


def holds(rows: pd.DataFrame, level: int) -> pd.Series:
    """Whether each interval of that level holds the truth."""
    return rows["truth"].between(rows[f"lo{level}"], rows[f"hi{level}"])


def band(n: int, level: int, chance: float) -> tuple[int, int]:
    """Counts between which a binomial of that level is with at least this chance."""
    low, high = binom.interval(chance, n, level / 100)
    return int(low), int(high)


def check(rows: pd.DataFrame, way: str, chance: float, *, narrow_only: bool = False) -> None:
    """Raise where a share is outside its binomial band, for each design and over all together."""
    mine = rows[rows["way"] == way]
    for keys in (GROUP, GROUP[1:]):
        for key, group in mine.groupby(keys):
            for level in LEVELS:
                low, high = band(len(group), level, chance)
                count = int(holds(group, level).sum())
                inside = low <= count and (narrow_only or count <= high)
                assert inside, (
                    f"{way}, {key}: {count} of {len(group)} intervals of {level} % hold the truth;"
                    f" by chance {low} to {high}"
                )


# tables


def _share(rows: pd.DataFrame, level: int, limits: bool = True) -> str:
    held = holds(rows, level)
    ends = " to ".join(f"{x:.1%}" for x in clopper_pearson(int(held.sum()), len(held)))
    return f"{held.mean():.1%}" + (f" ({ends})" if limits else "")


def _errors(rows: pd.DataFrame) -> tuple[float, float, pd.Series]:
    """Median stated and rms actual error, and the pulls."""
    error = rows["value"] - rows["truth"]
    return float(rows["u"].median()), float(np.sqrt((error**2).mean())), error / rows["u"]


def _grouped(rows: pd.DataFrame, keys: list[str]) -> Iterable[tuple[str, str, dict]]:
    """Design, coefficient and the rows of each way."""
    for (*design, boundary, name), group in rows.groupby(keys, sort=False):
        yield "".join(design), f"{boundary}, {name.rstrip('_')}", dict(iter(group.groupby("way")))


def share_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Shares of stated campaigns that hold the truth."""
    return pd.DataFrame(
        {"coefficient": name, "level": f"{level} %"}
        | {d: _share(way["nearlift"].query("design == @d"), level) for d in DATUMS}
        | {"both": f"**{_share(way['nearlift'], level)}**"}
        | {"shared ignored": _share(way["ignored"], level, limits=False)}
        | {"lmfit": _share(way["lmfit"], level, limits=False)}
        for _, name, way in _grouped(rows, GROUP[1:])
        for level in LEVELS
    )


def error_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Errors of stated campaigns, stated and actual."""
    lines = []
    for design, name, way in _grouped(rows, GROUP):
        stated, actual, pull = _errors(way["nearlift"])
        theirs = _errors(way["lmfit"])
        lines.append(
            {
                "coefficient": name,
                "datum": design,
                "nearlift: stated, actual": f"{stated:.2g}, {actual:.2g}",
                "pull: mean, sd": f"{pull.mean():+.2f}, {pull.std():.2f}",
                "lmfit: stated, actual": f"{theirs[0]:.2g}, {theirs[1]:.2g}",
            }
        )
    return pd.DataFrame(lines)


def few_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Shares of few visits that hold the truth, stated over actual error, and the width."""
    lines = []
    for design, name, way in _grouped(rows, GROUP):
        ours = way["nearlift"]
        stated, actual, _ = _errors(ours)
        half = float((ours["hi90"] - ours["lo90"]).median()) / 2 / 1.645
        lines.append(
            {"distances x visits": design, "coefficient": name}
            | {f"{level} %": _share(ours, level, limits=level == 90) for level in LEVELS}
            | {"90 %, visit scatter left out": _share(way["ignored"], 90, limits=False)}
            | {"stated / actual": f"{stated / actual:.2f}"}
            | {"half-width of 90 % / 1.645 actual": f"{half / actual:.2f}"}
        )
    return pd.DataFrame(lines)


def main() -> None:
    """Run one of the kinds, and write its tables."""
    parser = programs.parser(__doc__, REPORTED)
    parser.add_argument("--few", action="store_true", help="few visits, not stated errors")
    given = parser.parse_args()
    made = {"few visits": few_table} if given.few else {"shares": share_table}
    made |= {} if given.few else {"errors": error_table}
    seeds = range(given.seed, given.seed + given.count)
    with programs.opened(given.executor) as executor:
        rows = run(executor, seeds, FEW if given.few else DATUMS, given.out)
    for name, columns in made.items():
        write(Path(__file__).parents[2] / "docs" / "coverage.md", name, table(columns(rows)))


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.coverage import main as run_main

    run_main()
