"""The simulated bench: which trial runs where and when, and everything that goes on around it. No
force is made here.

Written from published measurements (thrust, current, voltage and speed over throttle; the distances
of the paper's Table 1) and shares no code with nearlift.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

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
FROM_ONE = {
    "ground": (
        1.0,
        1.1,
        1.2,
        1.35,
        1.5,
        1.65,
        1.8,
        2.0,
        2.25,
        2.5,
        2.75,
        3.0,
        3.5,
        4.0,
        4.5,
        5.0,
        6.0,
        8.0,
        11.0,
        25.0,
    ),
    "ceiling": (
        0.1,
        0.12,
        0.15,
        0.18,
        0.22,
        0.26,
        0.3,
        0.36,
        0.42,
        0.5,
        0.6,
        0.75,
        0.9,
        1.1,
        1.4,
        1.8,
        2.5,
        4.0,
        7.0,
        11.0,
    ),
    "sidewall": (
        0.1,
        0.15,
        0.2,
        0.25,
        0.3,
        0.36,
        0.42,
        0.5,
        0.58,
        0.68,
        0.8,
        0.95,
        1.1,
        1.3,
        1.6,
        2.0,
        3.0,
        5.0,
        8.0,
        12.0,
    ),
}
DESIGNS = ("from_one", "percent_diameter", "mm")

# whole vehicle, bitcraze's table (C1)
_PWM = np.array([0.0, 0.25, 0.5, 0.75, 0.875, 0.9375])
_GRAM = np.array([0.0, 10.9, 24.4, 41.7, 51.9, 57.9])
_AMPERE = np.array([0.24, 0.94, 1.83, 3.06, 3.88, 4.44])
_RPM = np.array([0.0, 10885.0, 15924.0, 20539.0, 22598.0, 23882.0])


def stream(seed: int, *purpose: str) -> np.random.Generator:
    """A generator of its own for every purpose, so that one draw more somewhere moves nothing
    elsewhere.
    """
    return np.random.default_rng([seed, *(zlib.crc32(p.encode()) for p in purpose)])


def stations(boundary: str, design: str) -> np.ndarray:
    """Distances over rotor radius."""
    if design == "from_one":
        return np.array(FROM_ONE[boundary])
    unit = {"percent_diameter": 2 * RADIUS / 100, "mm": 1e-3}[design]
    return np.array(TABLE_1[boundary]) * unit / RADIUS


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What surrounds each trial, in run order; arrays of shape (n,).

    `supply_V`, `temperature_K` and `tilt_rad` are what is true; `reading` holds what the log says.
    `unit` holds patterns drawn once (a gain per session, a walk, a hidden covariate), which effects
    scale.
    """

    boundary: str
    radius_m: float
    z_hat: np.ndarray
    throttle: np.ndarray
    level: np.ndarray
    visit: np.ndarray
    session: np.ndarray
    start_s: np.ndarray
    session_s: np.ndarray
    gap_s: np.ndarray
    order: np.ndarray
    previous: np.ndarray
    approach: np.ndarray
    move_m: np.ndarray
    tilt_rad: np.ndarray
    charge: np.ndarray
    current_A: np.ndarray
    supply_V: np.ndarray
    temperature_K: np.ndarray
    lagged_K: np.ndarray
    speed_rpm: np.ndarray
    unit: dict[str, np.ndarray] = field(default_factory=dict)
    reading: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of trials."""
        return len(self.z_hat)


def shuffled(rng: np.random.Generator, n_stations: int, visits: int) -> np.ndarray:
    """Each station `visits` times in random order, never twice in a row."""
    order = rng.permutation(np.repeat(np.arange(n_stations), visits))
    for _ in range(1000):
        clash = np.flatnonzero(order[1:] == order[:-1]) + 1
        if not len(clash):
            return order
        for i in clash:
            j = rng.integers(len(order))
            order[i], order[j] = order[j], order[i]
    raise RuntimeError("no order without repeats found")


def wander(rng: np.random.Generator, time: np.ndarray, tau: float) -> np.ndarray:
    """An Ornstein-Uhlenbeck path of unit variance at the given times."""
    keep = np.exp(-np.diff(time, prepend=time[0] - 50 * tau) / tau)
    kicks = rng.standard_normal(len(time)) * np.sqrt(1 - keep**2)
    path = np.empty(len(time))
    last = 0.0
    for i, (k, w) in enumerate(zip(keep.tolist(), kicks.tolist(), strict=True)):
        last = k * last + w
        path[i] = last
    return path


def build(
    boundary: str,
    design: str,
    seed: int,
    *,
    visits: int = 15,
    sessions: int = 6,
    throttles: tuple[float, ...] = THROTTLES,
    every: int = 1,
    distances: int | None = None,
    order: str = "random",
    radius_m: float = RADIUS,
    experiments: bool = False,
) -> Bench:
    """A bench with its whole campaign planned and logged.

    Parameters
    ----------
    every : int
        Takes every so-manieth station, the farthest among them.
    distances : int or None
        Takes that many instead, from the nearest to the farthest.
    order : str
        "random": stations in random order, and a fifth of the visits overshoots and comes back, so
        that approach is not a function of distance at the ends; "swept": from the nearest to the
        farthest, again and again; "scattered": every trial at a height of its own, log-uniform.
    """
    rng = stream(seed, "bench", boundary)
    planned = stations(boundary, design)
    z_stations = (
        planned[::-every][::-1]
        if distances is None
        else planned[np.linspace(0, len(planned) - 1, distances).round().astype(int)]
    )
    k = 1 if order == "scattered" else len(throttles)
    if order == "scattered":
        low, high = np.log(z_stations[[0, -1]])
        z_visit = np.exp(rng.uniform(low, high, len(z_stations) * visits * len(throttles)))
    else:
        z_visit = z_stations[
            np.tile(np.arange(len(z_stations)), visits)
            if order == "swept"
            else shuffled(rng, len(z_stations), visits)
        ]
    n_visits = len(z_visit)
    n = n_visits * k
    visit = np.repeat(np.arange(n_visits), k)
    level = (
        rng.integers(len(throttles), size=n)
        if k == 1
        else np.concatenate([rng.permutation(k) for _ in range(n_visits)])
    )
    throttle = np.array(throttles)[level]
    move = np.diff(z_visit, prepend=z_stations[-1] * 0.5) * radius_m
    away = np.where(move >= 0, 1.0, -1.0) * np.where(
        rng.random(n_visits) < (0.0 if order == "swept" else 0.2), -1.0, 1.0
    )

    cuts = np.sort(
        np.round(
            np.arange(1, sessions) * n_visits / sessions + rng.uniform(-4, 4, sessions - 1)
        ).astype(int)
    )
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
    opening = start[np.searchsorted(session, np.arange(sessions))]
    session_s = start - opening[session]
    length = np.array([session_s[session == s].max() for s in range(sessions)])

    charge = session_s / length[session]
    current = np.interp(throttle, _PWM, _AMPERE)
    battery = rng.normal(0, 0.02, sessions)
    resistance = 0.07 * (1 + 0.3 * charge)
    supply = (
        4.1
        + battery[session]
        - 0.05 * (1 - np.exp(-charge / 0.05))
        - 0.3 * charge
        - 0.12 * charge**6
        - resistance * current
    )
    day = 1.3 * np.sin(2 * np.pi * (start / 86400 + rng.random()))
    temperature = (
        295.0
        + day
        + rng.uniform(0.3, 1.0) * (1 - np.exp(-session_s / 2000))
        + 0.25 * wander(rng, start, 1500.0)
    )
    lagged = np.empty(n)
    last = temperature[0]
    for i, weight in enumerate(1 - np.exp(-np.diff(start, prepend=start[0]) / 1200.0)):
        last += weight * (temperature[i] - last)
        lagged[i] = last
    tilt = np.radians(rng.normal(0, 0.8, n_visits)[visit] + rng.normal(0, 0.6, n))
    unit = {
        "session": _centred(rng.standard_normal(sessions))[session],
        "walk": _centred(wander(rng, np.arange(n) * 20.0, 5 * n)),
        "hidden": wander(rng, start, 4000.0),
        "state": rng.choice([-1.0, 1.0], n_visits)[visit],
        "step": (np.arange(n) >= int(n * rng.uniform(0.2, 0.8))).astype(float),
        "coin": np.full(n, float(rng.random() < 0.5)),
        "phase": np.full(n, rng.uniform(0, 2 * np.pi)),
        "bump_at": np.full(n, rng.uniform(0.2, 0.5)),
        "bump_level": np.full(n, float(rng.integers(len(throttles)))),
        "levelling": np.full(n, np.radians(rng.uniform(1, 3)) * rng.choice([-1, 1])),
    }
    # drawn apart, so that what was there before stays as it was
    later = stream(seed, "later", boundary)
    unit |= {
        "reader": _taken_in_turn(later, n_visits, 30, lambda i: (-1.0) ** i)[visit],
        "seating": _taken_in_turn(later, n_visits, 9, lambda _: later.exponential())[visit],
        "draught": _taken_in_turn(later, n_visits, 5, lambda i: i % 2)[visit],
        "range_at": np.full(n, later.uniform(0.35, 0.65)),
    }
    apart = stream(seed, "experiments", boundary)
    exchanged = np.sort(apart.choice(np.arange(1, n_visits), 2, replace=False))
    unit |= {
        "inverted": _taken_in_turn(apart, n_visits, 15, lambda i: i % 2)[visit],
        "turn": _taken_in_turn(apart, n_visits, 15, lambda i: i % 3 * np.pi / 2)[visit],
        "propeller": (np.searchsorted(exchanged, np.arange(n_visits), side="right") == 1.0)[
            visit
        ].astype(float),
    }
    reading = {
        "supply_V": supply + rng.normal(0, 0.003, n),
        "temperature_K": temperature + rng.normal(0, 0.03, n),
        "tilt_rad": tilt + np.radians(rng.normal(0, 0.05, n)),
    }
    if experiments:
        reading |= {
            "inverted": unit["inverted"],
            "turn_rad": unit["turn"],
            "other_propeller": unit["propeller"],
            "fountain_side": unit["state"],
        }
    return Bench(
        boundary=boundary,
        radius_m=radius_m,
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
        lagged_K=lagged,
        speed_rpm=np.interp(throttle, _PWM, _RPM),
        unit=unit,
        reading=reading,
    )


def levels_N(rng: np.random.Generator, throttles: tuple[float, ...]) -> np.ndarray:
    """Lift of the whole vehicle far from every boundary, per throttle; rigs differ by some per
    cent.
    """
    return (
        np.interp(throttles, _PWM, _GRAM)
        * 1e-3
        * GRAVITY
        * (1 + rng.normal(0, 0.03, len(throttles)))
    )


def _taken_in_turn(
    rng: np.random.Generator, visits: int, mean: float, value: Callable[[int], float]
) -> np.ndarray:
    """A value for each turn, and turns of random length (geometric, in visits)."""
    turn = np.cumsum(rng.random(visits) < 1 / mean)
    return np.array([value(i) for i in range(turn[-1] + 1)], dtype=float)[turn]


def _centred(x: np.ndarray) -> np.ndarray:
    x = x - x.mean()
    return x / max(float(np.sqrt(np.mean(x**2))), 1e-12)
