"""The simulated bench: which trial runs where and when, and everything that goes on around it. No
force is made here.

Written from published measurements (thrust, current, voltage and speed over throttle; the distances
of the paper's Table 1) and shares no code with nearlift.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
RADIUS = 0.023
SPACING = 0.065
GRAVITY = 9.8
THROTTLES = (0.25, 0.5, 0.75, 0.92)

# Table 1, in whatever unit it is read
TABLE_1 = {
    "ceiling": (5, 6, 7, 8, 9, 10, 11, 12, 14, 15, 18, 22, 25, 29, 34, 38, 55, 68, 90, 525),
    "ground": (57, 58, 59, 60, 61, 62, 63, 64, 66, 68, 70, 74, 77, 82, 86, 90, 108, 121, 142, 577),
    "sidewall": (15, 16, 17, 18, 19, 21, 22, 23, 24, 26, 28, 32, 35, 40, 44, 48, 66, 79, 101, 535),
}
# distances over rotor radius
FROM_ONE = {
    "ground": "1 1.1 1.2 1.35 1.5 1.65 1.8 2 2.25 2.5 2.75 3 3.5 4 4.5 5 6 8 11 25",
    "ceiling": ".1 .12 .15 .18 .22 .26 .3 .36 .42 .5 .6 .75 .9 1.1 1.4 1.8 2.5 4 7 11",
    "sidewall": ".1 .15 .2 .25 .3 .36 .42 .5 .58 .68 .8 .95 1.1 1.3 1.6 2 3 5 8 12",
}

# whole vehicle, bitcraze's table (C1)
_PWM = np.array([0.0, 0.25, 0.5, 0.75, 0.875, 0.9375])
_GRAM = np.array([0.0, 10.9, 24.4, 41.7, 51.9, 57.9])
_AMPERE = np.array([0.24, 0.94, 1.83, 3.06, 3.88, 4.44])
_RPM = np.array([0.0, 10885.0, 15924.0, 20539.0, 22598.0, 23882.0])


def stream(seed: int, *purpose: str) -> np.random.Generator:
    """A generator for each purpose, so that one draw more in one place moves nothing elsewhere."""
    return np.random.default_rng([seed, *(zlib.crc32(p.encode()) for p in purpose)])


@dataclass(frozen=True, kw_only=True)
class Shared:
    """Standard deviations of errors that many trials share, each drawn once per element of its
    scope; 0 is none.
    """

    session_gain: float = 0.0
    throttle_gain: float = 0.0
    visit_gain: float = 0.0
    datum_m: float = 0.0  # one offset of every distance
    rotor_radius: float = 0.0  # in the manifest, as a fraction
    spacing_m: float = 0.0  # in the manifest
    # half-width of the cell's uniform departure from its line at `range_N`, with force squared
    cell_N: float = 0.0
    range_N: float = 9.8


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of trials; by default normal, independent, all alike."""

    tails: float = np.inf  # degrees of freedom of a Student t of unit variance
    # standard deviation at the farthest, or nearest, distance over that at the other end, linear in
    # log distance between
    far: float = 1.0
    near: float = 1.0
    sessions: float = 0.0  # standard deviation of the log of a factor on each session's scatter
    correlation: float = 0.0  # with the error of the trial before
    # rms of a gain that is an Ornstein-Uhlenbeck process over so many trials, or a random walk
    wander: float = 0.0
    trials: float = np.inf
    outliers: float = 0.0  # share of trials that are off by 5 to 10 standard deviations
    bad_visit: float = 0.0  # standard deviations by which all of one visit are off together
    lost: float = 0.0  # share of trials that are missing
    lost_sessions: int = 0
    rail: float = 0.0  # share of trials beyond the amplifier's range: their means are too small
    # scatter of a cell as published, a fraction of lift; such a table has no covariates, no order
    table: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Spec:
    """What to simulate.

    `design` is "from_one" (stations from z_hat = 1, ceiling and sidewall from 0.1),
    "percent_diameter" or "mm" (readings of Table 1). `order` is "random" (a fifth of the visits
    overshoots and comes back), "swept" (from the nearest to the farthest, again and again) or
    "scattered" (every trial at a height of its own, log-uniform). With `errors` trials are simulated
    and no records; `realism`, `sink` and the gains of `shared` then do not apply.
    """

    boundary: str
    effects: tuple[tuple[str, float], ...] = ()  # names in `forms` with their rho
    foreign: bool = False  # whether named effects take their foreign form
    design: str = "from_one"
    realism: bool = True  # t6 tails, 0.3 % outliers, an unstated random gain of 0.03 %
    visits: int = 15
    sessions: int = 6
    throttles: tuple[float, ...] = THROTTLES
    spread: float = 0.2  # of coefficients about the published ones, a fraction either way
    # fraction by which heating lowers lift within a record, in proportion to load; L_inf absorbs
    # its mean, so that only records show it
    sink: float = 0.0
    samples: int | None = None  # running samples per record; 260 to 500 if None
    every: int = 1  # take each n-th station, the farthest among them
    distances: int | None = None  # takes that many instead, from the nearest to the farthest
    shared: Shared = Shared()
    declared: bool = False  # whether the manifest states errors of datum, radius and spacing
    errors: Errors | None = None
    order: str = "random"
    radius_m: float = RADIUS  # a larger rotor is the same vehicle, larger
    height_m: float | None = None  # standard deviation of a visit's height; 0.02 to 0.1 mm if None
    experiments: bool = False  # log the columns by which `forms.EXPERIMENTS` can be identified

    @property
    def spacing_m(self) -> float:
        """Spacing of adjacent rotors."""
        return self.radius_m * SPACING / RADIUS


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What surrounds each trial, in run order; arrays of shape (n,).

    `supply_V`, `temperature_K` and `tilt_rad` are true; `reading` holds what the log says. `unit`
    holds patterns drawn once (a gain per session, a walk, a hidden covariate), which effects scale.
    """

    boundary: str
    radius_m: float
    z_hat: Array
    throttle: Array
    level: Array
    visit: Array
    session: Array
    start_s: Array
    session_s: Array
    gap_s: Array
    order: Array
    previous: Array
    approach: Array
    move_m: Array
    tilt_rad: Array
    charge: Array
    current_A: Array
    supply_V: Array
    temperature_K: Array
    lagged_K: Array
    speed_rpm: Array
    unit: dict[str, Array]
    reading: dict[str, Array]

    @property
    def n(self) -> int:
        """Number of trials."""
        return len(self.z_hat)


def wander(rng: np.random.Generator, time: Array, tau: float) -> Array:
    """An Ornstein-Uhlenbeck path of unit variance at the given times."""
    keep = np.exp(-np.diff(time, prepend=time[0] - 50 * tau) / tau)
    kicks = rng.standard_normal(len(time)) * np.sqrt(1 - keep**2)
    path = [0.0]
    for k, kick in zip(keep.tolist(), kicks.tolist(), strict=True):
        path.append(k * path[-1] + kick)
    return np.array(path[1:])


def _lagging(value: Array, time: Array, tau: float) -> Array:
    """The value as a body of that time constant follows it."""
    path = [value[0]]
    for v, w in zip(value, 1 - np.exp(-np.diff(time, prepend=time[0]) / tau), strict=True):
        path.append(path[-1] + w * (v - path[-1]))
    return np.array(path[1:])


def stations(spec: Spec) -> Array:
    """Distances over rotor radius."""
    if spec.design == "from_one":
        planned = np.array(FROM_ONE[spec.boundary].split(), dtype=float)
    else:
        unit = {"percent_diameter": 2 * RADIUS / 100, "mm": 1e-3}[spec.design]
        planned = np.array(TABLE_1[spec.boundary]) * unit / RADIUS
    if spec.distances is None:
        return planned[:: -spec.every][::-1]
    return planned[np.linspace(0, len(planned) - 1, spec.distances).round().astype(int)]


def _visits(spec: Spec, planned: Array, rng: np.random.Generator) -> Array:
    """Distance of each visit; in random order never the same twice in a row."""
    if spec.order == "scattered":
        low, high = np.log(planned[[0, -1]])
        size = len(planned) * spec.visits * len(spec.throttles)
        return np.exp(rng.uniform(low, high, size))
    if spec.order == "swept":
        return np.tile(planned, spec.visits)
    order = rng.permutation(np.repeat(np.arange(len(planned)), spec.visits))
    for _ in range(1000):
        clash = np.flatnonzero(order[1:] == order[:-1]) + 1
        if not len(clash):
            return planned[order]
        for i in clash:
            j = rng.integers(len(order))
            order[i], order[j] = order[j], order[i]
    raise RuntimeError("no order without repeats")


def build(spec: Spec, seed: int) -> Bench:
    """A bench with its whole campaign planned and logged."""
    boundary, sessions, throttles = spec.boundary, spec.sessions, spec.throttles
    rng = stream(seed, "bench", boundary)
    planned = stations(spec)
    k = 1 if spec.order == "scattered" else len(throttles)
    z_visit = _visits(spec, planned, rng)
    n_visits = len(z_visit)
    n = n_visits * k
    visit = np.repeat(np.arange(n_visits), k)
    if k == 1:
        level = rng.integers(len(throttles), size=n)
    else:
        level = np.concatenate([rng.permutation(k) for _ in range(n_visits)])
    throttle = np.array(throttles)[level]
    move = np.diff(z_visit, prepend=planned[-1] * 0.5) * spec.radius_m
    overshoots = rng.random(n_visits) < (0.0 if spec.order == "swept" else 0.2)
    away = np.where(move >= 0, 1.0, -1.0) * np.where(overshoots, -1.0, 1.0)

    cuts = np.arange(1, sessions) * n_visits / sessions + rng.uniform(-4, 4, sessions - 1)
    cuts = np.sort(np.round(cuts).astype(int))
    session_of_visit = np.searchsorted(cuts, np.arange(n_visits), side="right")
    first = np.concatenate([[True], np.diff(session_of_visit) > 0])
    pause = 4.0 + rng.exponential(4.0, n)  # between trials, the load off
    pause[::k] += 3.0 + np.abs(move) / 0.02
    night = np.arange(sessions) % 2 == 0
    breaks = np.where(night, rng.uniform(13, 17, sessions) * 3600, rng.uniform(900, 3000, sessions))
    pause[::k][first] += breaks[session_of_visit[first]]
    pause[0] = 5.0
    start = np.cumsum(pause + 12.0) - 12.0
    session = session_of_visit[visit]
    session_s = start - start[np.searchsorted(session, np.arange(sessions))][session]
    length = np.array([session_s[session == s].max() for s in range(sessions)])

    charge = session_s / length[session]
    current = np.interp(throttle, _PWM, _AMPERE)
    battery = rng.normal(0, 0.02, sessions)
    falls = 0.05 * (1 - np.exp(-charge / 0.05)), 0.3 * charge, 0.12 * charge**6
    supply = 4.1 + battery[session] - falls[0] - falls[1] - falls[2]
    supply = supply - 0.07 * (1 + 0.3 * charge) * current
    temperature = 295.0 + 1.3 * np.sin(2 * np.pi * (start / 86400 + rng.random()))
    temperature = temperature + rng.uniform(0.3, 1.0) * (1 - np.exp(-session_s / 2000))
    temperature = temperature + 0.25 * wander(rng, start, 1500.0)
    tilt = np.radians(rng.normal(0, 0.8, n_visits)[visit] + rng.normal(0, 0.6, n))
    unit = _patterns(spec, seed, rng, visit, session, start)
    reading = {
        "supply_V": supply + rng.normal(0, 0.003, n),
        "temperature_K": temperature + rng.normal(0, 0.03, n),
        "tilt_rad": tilt + np.radians(rng.normal(0, 0.05, n)),
    }
    if spec.experiments:
        logged = {"inverted": "inverted", "turn_rad": "turn"}
        logged |= {"other_propeller": "propeller", "fountain_side": "state"}
        reading |= {name: unit[pattern] for name, pattern in logged.items()}
    return Bench(
        boundary=boundary,
        radius_m=spec.radius_m,
        z_hat=z_visit[visit],
        throttle=throttle,
        level=level,
        visit=visit,
        session=session,
        start_s=start,
        session_s=session_s,
        gap_s=pause,
        order=np.tile(np.arange(k), n_visits),
        previous=np.maximum(np.arange(n) - 1, 0),
        approach=away[visit],
        move_m=np.abs(move)[visit],
        tilt_rad=tilt,
        charge=charge,
        current_A=current,
        supply_V=supply,
        temperature_K=temperature,
        lagged_K=_lagging(temperature, start, 1200.0),
        speed_rpm=np.interp(throttle, _PWM, _RPM),
        unit=unit,
        reading=reading,
    )


def _patterns(
    spec: Spec, seed: int, rng: np.random.Generator, visit: Array, session: Array, start: Array
) -> dict[str, Array]:
    """Patterns drawn once that effects scale."""
    n, n_visits = len(visit), visit[-1] + 1
    unit = {
        "session": _centred(rng.standard_normal(spec.sessions))[session],
        "walk": _centred(wander(rng, np.arange(n) * 20.0, 5 * n)),
        "hidden": wander(rng, start, 4000.0),
        "state": rng.choice([-1.0, 1.0], n_visits)[visit],
        "step": (np.arange(n) >= int(n * rng.uniform(0.2, 0.8))).astype(float),
        "coin": np.full(n, float(rng.random() < 0.5)),
        "phase": np.full(n, rng.uniform(0, 2 * np.pi)),
        "bump_at": np.full(n, rng.uniform(0.2, 0.5)),
        "bump_level": np.full(n, float(rng.integers(len(spec.throttles)))),
        "levelling": np.full(n, np.radians(rng.uniform(1, 3)) * rng.choice([-1, 1])),
    }

    def turns(rng: np.random.Generator, mean: int, value: Callable[[int], float]) -> Array:
        """A value for each turn, and turns of random length (geometric, in visits)."""
        turn = np.cumsum(rng.random(n_visits) < 1 / mean)
        return np.array([value(i) for i in range(turn[-1] + 1)], dtype=float)[turn][visit]

    # generators of their own, which leave all other draws as they are
    later, apart = stream(seed, "later", spec.boundary), stream(seed, "experiments", spec.boundary)
    exchanged = np.sort(apart.choice(np.arange(1, n_visits), 2, replace=False))
    return unit | {
        "reader": turns(later, 30, lambda i: (-1.0) ** i),
        "seating": turns(later, 9, lambda _: later.exponential()),
        "draught": turns(later, 5, lambda i: i % 2),
        "range_at": np.full(n, later.uniform(0.35, 0.65)),
        "inverted": turns(apart, 15, lambda i: i % 2),
        "turn": turns(apart, 15, lambda i: i % 3 * np.pi / 2),
        "propeller": (np.searchsorted(exchanged, visit, side="right") == 1).astype(float),
    }


def levels_N(rng: np.random.Generator, throttles: tuple[float, ...]) -> Array:
    """Lift of the whole vehicle far from every boundary, per throttle; rigs differ by per cents."""
    error = 1 + rng.normal(0, 0.03, len(throttles))
    return np.interp(throttles, _PWM, _GRAM) * 1e-3 * GRAVITY * error


def _centred(x: Array) -> Array:
    x = x - x.mean()
    return x / max(float(np.sqrt(np.mean(x**2))), 1e-12)
