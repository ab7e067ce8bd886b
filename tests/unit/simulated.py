"""Trials of one boundary from a formula written out here, for tests of fits and diagnosis."""

import dataclasses

import numpy as np

from nearlift import catalogue
from nearlift.likelihood.budget import Component
from nearlift.loop.diagnose import diagnose, set_up
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.results import Observations

GROUND = catalogue.model("sanchez_cuevas")
RADIUS = 0.023
STATIONS = (1.14, 1.3, 1.5, 1.8, 2.2, 2.84, 4.0, 6.0, 9.0, 11.5)
THROTTLES = (0.25, 0.5, 0.75, 0.92)
L_INF = dict(zip(THROTTLES, 9.8e-3 * np.array([10.9, 24.4, 41.7, 56.2]), strict=True))
GEOMETRY = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}


def sanchez_cuevas(z, K_b=2.0):
    def image(h):
        return z / np.sqrt((h**2 + 4 * z**2) ** 3)

    d, b = GEOMETRY["spacing_hat"], GEOMETRY["diagonal_hat"]
    return 1 / (1 - 1 / (16 * z**2) - image(d) - 0.5 * image(np.sqrt(2) * d) - 2 * K_b * image(b))


def hsiao(z, alpha=0.125):
    return 0.5 + 0.5 * np.sqrt(1 + alpha / z**2)


def part(
    on: str = "height", standard: float = 2e-4, scope: str = "boundary", **more: object
) -> Component:
    """A stated uncertainty."""
    stated = {"on": on, "standard": standard, "distribution": "normal", "scope": scope}
    return Component(**{"name": f"{on} by {scope}"} | stated | more)


def campaign(
    seed,
    *,
    boundary="ground",
    ratio=sanchez_cuevas,
    stations=STATIONS,
    visits=4,
    relative=0.004,
    force=3e-4,
    height=0.1e-3,
    gain=None,
    datum=0.0,
    session_gain=0.0,
):
    """Trials with a visit's throttles in random order; `gain(covariates)` multiplies lift."""
    rng = np.random.default_rng(seed)
    z = np.repeat(rng.permutation(np.repeat(stations, visits)), len(THROTTLES))
    throttle = np.concatenate([rng.permutation(THROTTLES) for _ in range(len(z) // len(THROTTLES))])
    n = len(z)
    visit = np.repeat(np.arange(n // len(THROTTLES)), len(THROTTLES))
    session = np.minimum(np.arange(n) * 5 // n, 4)
    start = np.arange(n) * 21.0
    supply = 4.05 - 0.35 * ((np.arange(n) * 5 / n) % 1) - 0.25 * throttle + rng.normal(0, 0.01, n)
    covariates = {
        "start_s": start,
        "supply_V": supply,
        "temperature_K": 295.0 + 1.5 * np.sin(start / 9000.0) + rng.normal(0, 0.1, n),
        "approach": np.where(np.diff(z, prepend=z[0]) >= 0, 1.0, -1.0),
        "tilt_rad": rng.normal(0, 0.015, n),
    }
    true_z = z + (rng.normal(0, height, n // len(THROTTLES))[visit] + datum) / RADIUS
    level = np.array([L_INF[t] for t in throttle])
    lift = level * ratio(true_z) * (1 + rng.normal(0, relative, n)) + rng.normal(0, force, n)
    lift = lift * (1 + session_gain * rng.normal(size=5)[session])
    if gain is not None:
        lift = lift * gain(covariates)
    return Observations(
        boundary=boundary,
        trial=np.array([f"t{i:04d}" for i in range(n)], dtype=object),
        z_hat=z,
        lift_N=lift,
        u_lift_N=np.full(n, 1e-4),
        n_eff=np.full(n, 50.0),
        throttle=throttle,
        visit=visit,
        session=session,
        radius_m=RADIUS,
        geometry=GEOMETRY,
        covariates=covariates,
    )


def problem(data, base=GROUND, parts=(), **options) -> SearchProblem:
    """The search problem of these trials, with options of the search by keyword."""
    return set_up(data, base, parts, Options(**options))[0]


def findings(data, base=GROUND, parts=(), *, confirm=True, effects=None, **options):
    """The diagnosis as diagnosis.json holds it, with options of the search by keyword."""
    return diagnose(
        data, base, parts, Options(**options), effects=effects, confirm=confirm
    ).findings.content


def restated(explanation, **fields):
    """The explanation with other fields; `log_evidence` by both readings of its form."""
    if "log_evidence" in fields:
        log = fields.pop("log_evidence")
        fields |= {"exact": log, "discrepant": log, "other_forms": 0.0}
        fields["unnamed"] = log - explanation.over_none
    if "over_none" in fields:
        fields["unnamed"] = explanation.log_evidence - fields.pop("over_none")
    return dataclasses.replace(explanation, **fields)
