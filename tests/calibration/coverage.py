"""Coverage with shared errors in the records: intervals from the library beside those of lmfit as it is commonly used.

Every campaign is simulated record by record by the referee (`simulator`, its own forms), with errors that repeats do not show: a gain
per session and per throttle, one offset of every distance, a load cell that bends. Its manifest declares what was put in, the
library fits the trials, and the 68, 90 and 95 % intervals on each coefficient hold the truth or do not.

    nice python -m tests.calibration.coverage --n 400        writes docs/coverage.md
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import lmfit
import numpy as np
from scipy.stats import binom, norm, t
from tests.calibration import forms
from tests.calibration.simulator import Shared, Spec, simulate

from nearlift import campaign as manifests
from nearlift import catalogue
from nearlift.fitting import budget
from nearlift.fitting.least_squares import fit
from nearlift.results import Observations

LEVELS = (0.68, 0.9, 0.95)
DATUMS_MM = (0.2, 0.5)
BASE = {"ground": "sanchez_cuevas", "ceiling": "hsiao_chirarattananon", "sidewall": "sidewall_decay"}
SESSION_GAIN, THROTTLE_GAIN, CELL_GF = 0.003, 0.003, 1.5
GRAVITY = 9.8
#: Seeds of reported figures; any others are for trying things out.
REPORTED = 800_000
WAYS = ("declared", "ignored", "lmfit")


def manifest(datum_mm: float, throttle: bool = True) -> manifests.Campaign:
    """What the campaign's owner declares: exactly what was put in."""
    listed = [
        {"name": "session gain", "on": "gain", "value": f"{100 * SESSION_GAIN} percent", "scope": "session"},
        {"name": "distance datum", "on": "height", "value": f"{datum_mm} mm", "scope": "boundary"},
    ]
    if throttle:
        listed.append({"name": "throttle gain", "on": "gain", "value": f"{100 * THROTTLE_GAIN} percent", "scope": "throttle"})
    return manifests.parse(
        {
            "schema": "nearlift.campaign/1",
            "name": "coverage",
            "vehicle": {"name": "simulated", "rotors": 4, "rotor_radius": "23 mm", "rotor_spacing": "65 mm", "mass": "27 g"},
            "rig": {"held": "throttle", "distance_datum": "rotor plane", "distance_offset": "0 mm", "gravity": "9.8 m/s^2"},
            "load_cell": {"sample_rate": "1000 Hz", "tare": "0.1 s", "range": "1 kgf", "accuracy": f"{CELL_GF} gf"},
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
    """320 trials in four sessions: 20 stations, 4 throttles, 4 visits."""
    shared = Shared(
        session_gain=SESSION_GAIN,
        throttle_gain=THROTTLE_GAIN if throttle else 0.0,
        datum_m=1e-3 * datum_mm,
        cell_N=1e-3 * GRAVITY * CELL_GF,
        range_N=GRAVITY,
    )
    return Spec(boundary=boundary, realism=False, visits=4, sessions=4, samples=260, shared=shared)


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate with its standard uncertainty and the quantile of each level."""

    value: float
    u: float
    dof: float

    def covers(self, truth: float, level: float) -> bool:
        """Whether the two-sided interval at this level holds the truth."""
        quantile = t.ppf(0.5 + level / 2, self.dof) if np.isfinite(self.dof) else norm.ppf(0.5 + level / 2)
        return bool(abs(self.value - truth) <= quantile * self.u)


@dataclass(frozen=True, slots=True)
class Row:
    """One coefficient of one campaign: its truth, and what each way says."""

    boundary: str
    datum_mm: float
    name: str
    truth: float
    found: dict[str, Interval]


def declared(data: Observations, datum_mm: float, components: tuple[budget.Component, ...]) -> dict[str, Interval]:
    """The library's answer under a budget."""
    result = fit(catalogue.model(BASE[data.boundary]), data, components)
    return {name: Interval(e.value, e.u, result.noise.dof) for name, e in result.estimates.items()}


def with_lmfit(data: Observations) -> dict[str, Interval]:
    """lmfit as it is commonly used: Delta L per cell over the farthest station, each an error of its own, normal quantiles."""
    far = data.z_hat.max()
    reference = np.array([data.lift_N[(data.z_hat == far) & (data.throttle == x)].mean() for x in data.levels])
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
    return {name: Interval(p.value, p.stderr or np.nan, np.inf) for name, p in result.params.items()}


def _ground(z: np.ndarray, K_b: float) -> np.ndarray:
    return forms.ratio("ground", z, {"K_b": K_b}) - 1


def _ceiling(z: np.ndarray, alpha: float) -> np.ndarray:
    return forms.ratio("ceiling", z, {"alpha": alpha}) - 1


def _sidewall(z: np.ndarray, a: float, lambda_: float) -> np.ndarray:
    return forms.ratio("sidewall", z, {"a": a, "lambda_": lambda_}) - 1


LMFIT: dict[str, Callable[..., np.ndarray]] = {"ground": _ground, "ceiling": _ceiling, "sidewall": _sidewall}


def campaign(boundary: str, datum_mm: float, seed: int) -> list[Row]:
    """One campaign from records to intervals, in every way."""
    made = simulate(spec(boundary, datum_mm), seed)
    found = {
        "declared": declared(made.data, datum_mm, parts(datum_mm)),
        "ignored": declared(made.data, datum_mm, ()),
        "lmfit": with_lmfit(made.data),
    }
    return [Row(boundary, datum_mm, name, truth, {way: found[way][name] for way in WAYS}) for name, truth in made.truth.theta.items()]


def run(n: int, first: int, boundaries: tuple[str, ...] = forms.BOUNDARIES, datums_mm: tuple[float, ...] = DATUMS_MM) -> Iterator[Row]:
    """`n` campaigns of every boundary and datum, seeds from `first` on."""
    for i in range(n):
        for boundary in boundaries:
            for k, datum_mm in enumerate(datums_mm):
                yield from campaign(boundary, datum_mm, first + len(datums_mm) * i + k)


def band(n: int, level: float, chance: float) -> tuple[int, int]:
    """Counts between which a binomial of that level falls with this chance at least."""
    low, high = binom.interval(chance, n, level)
    return int(low), int(high)
