"""Schedules: which station, throttle and side of approach, in which order, when, and on which
battery.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.randomness import generator

#: The paper's: percent of full throttle as fractions, and visits of each station.
THROTTLES = (0.25, 0.5, 0.75, 0.92)
VISITS = 15
#: A full battery, what a session takes from it, and how differently they start; V.
FULL_V, FALLS_V, SCATTER_V = 4.0, 0.15, 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSchedule:
    """A schedule in run order, one entry per trial, SI.

    Attributes
    ----------
    trial, boundary : object arrays of str
    recorded_m : float array
        What the traverse shows; `z_m` is that plus the datum's offset.
    throttle : float array
    visit : int array
        Counter of the traverse's stops.
    approach : float array
        +1 where the last move was away from the boundary, -1 towards it.
    session : int array
        From 1; a battery each, where there are batteries.
    start_s : float array
    further : dict of float arrays
        Covariates that are logged, SI and by their inside names (`supply_V`).
    """

    trial: NDArray[Any]
    boundary: NDArray[Any]
    recorded_m: FloatArray
    z_m: FloatArray
    throttle: FloatArray
    visit: NDArray[np.int64]
    approach: FloatArray
    session: NDArray[np.int64]
    start_s: FloatArray
    further: dict[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.trial)


def randomised(
    recorded_m: Mapping[Boundary, Sequence[float] | FloatArray],
    *,
    seed: int,
    offset_m: Mapping[Boundary, float] | None = None,
    throttles: Sequence[float] = THROTTLES,
    visits: int = VISITS,
    sessions: int = 5,
    trial_s: float = 20.0,
    move_s: float = 8.0,
) -> TrialSchedule:
    """Each station visited so many times in a random order, every throttle run at each visit in a
    random order.

    Boundaries follow one another, and each is run in `sessions` sessions of equal length, changed
    between visits. `trial_s` and `move_s` are the usual times from trial to trial and for a move of
    the traverse; starts scatter by a twentieth about them.

    Returns
    -------
    TrialSchedule
        Never two visits of one station in a row, which would be one visit.
    """
    trials = []
    clock, stop, battery = 0.0, 0, 0
    for side, distances in recorded_m.items():
        rng = generator(seed, "design", side)
        order = _order(np.asarray(distances, dtype=float), visits, rng)
        # the traverse comes from its far end
        before = np.inf
        per_session = -(-len(order) // sessions)
        for i, distance in enumerate(order):
            way = 1.0 if distance > before else -1.0
            clock += move_s * (1 + 0.05 * rng.standard_normal())
            if i % per_session == 0:
                battery += 1
                clock += 300.0
            for level in rng.permutation(np.asarray(throttles, dtype=float)):
                trials.append((side, distance, level, stop, way, battery, clock))
                clock += trial_s * (1 + 0.05 * rng.standard_normal())
            before = distance
            stop += 1
    sides, stations, levels, stops, ways, batteries, starts = zip(*trials, strict=True)
    shown = np.array(stations)
    shift = np.array([(offset_m or {}).get(side, 0.0) for side in sides])
    width = max(4, len(str(len(sides) - 1)))
    return TrialSchedule(
        trial=np.array([f"t{i:0{width}d}" for i in range(len(sides))], dtype=object),
        boundary=np.array(sides, dtype=object),
        recorded_m=shown,
        z_m=shown + shift,
        throttle=np.array(levels),
        visit=np.array(stops, dtype=np.int64),
        approach=np.array(ways),
        session=np.array(batteries, dtype=np.int64),
        start_s=np.round(starts, 2),
    )


def _order(distances: FloatArray, visits: int, rng: np.random.Generator) -> FloatArray:
    """Rounds over all stations, each in a random order; the end of one never meets itself at the
    start of the next.

    A station that occurs several times in `distances` is visited so many times a round, and not
    twice running if that can be helped.
    """
    rounds: list[FloatArray] = []
    for _ in range(visits):
        turn = rng.permutation(distances)
        if len(np.unique(distances)) < len(distances):
            for _ in range(100):
                if not np.any(turn[1:] == turn[:-1]) and not (rounds and turn[0] == rounds[-1][-1]):
                    break
                turn = rng.permutation(distances)
        elif rounds and len(turn) > 1 and turn[0] == rounds[-1][-1]:
            turn[[0, -1]] = turn[[-1, 0]]
        rounds.append(turn)
    return np.concatenate(rounds)


def balanced(design: TrialSchedule, *, seed: int) -> TrialSchedule:
    """Visits with throttles in Williams's orders: over a few visits each throttle follows
    each other one equally often.

    What one trial leaves behind for the next (creep, heat) then falls on all throttles alike.
    """
    rng = generator(seed, "design", "throttles")
    levels, throttle = np.unique(design.throttle), design.throttle.copy()
    orders, turn = _williams(len(levels)), list[NDArray[np.int64]]()
    for visit in np.unique(design.visit):
        if not turn:
            # the numbering of the throttles is drawn again for each square
            turn = [
                rng.permutation(len(levels))[row] for row in orders[rng.permutation(len(orders))]
            ]
        throttle[design.visit == visit] = levels[turn.pop()]
    return dataclasses.replace(design, throttle=throttle)


def _williams(count: int) -> NDArray[np.int64]:
    """Orders of `count` things, each following each other one equally often: `count` rows, or twice
    as many if it is odd.
    """
    first = np.array([(j + 1) // 2 if j % 2 else (count - j // 2) % count for j in range(count)])
    rows = (first + np.arange(count)[:, None]) % count
    return np.vstack([rows, rows[:, ::-1]]) if count % 2 else rows


def from_both_sides(design: TrialSchedule, *, overshoot_m: float, seed: int) -> TrialSchedule:
    """Each station approached equally often from either side, by driving past it where the last
    station lies on the wrong one.

    Adds ``further["via_m"]``, the recorded distance to go to first (nan: go straight). The side is
    free only between the nearest and the farthest station: no visit is closer, or
    farther, than the campaign does anyway.
    """
    rng = generator(seed, "design", "sides")
    approach, via = design.approach.copy(), np.full(len(design), np.nan)
    for side in dict.fromkeys(design.boundary):
        at_side = design.boundary == side
        near, far = design.recorded_m[at_side].min(), design.recorded_m[at_side].max()
        for distance in np.unique(design.recorded_m[at_side]):
            stops = np.unique(design.visit[at_side & (design.recorded_m == distance)])
            wanted = rng.permutation(np.resize([1.0, -1.0], len(stops)))
            for stop, sign in zip(stops, wanted, strict=True):
                here = design.visit == stop
                past = np.clip(distance - sign * overshoot_m, near, far)
                if approach[here][0] != sign and abs(past - distance) >= overshoot_m / 2:
                    approach[here], via[here] = sign, past
    return dataclasses.replace(design, approach=approach, further={**design.further, "via_m": via})


def battery_V(design: TrialSchedule, *, seed: int) -> FloatArray:
    """Supply of each trial, a battery per session: it falls by `FALLS_V`, fast at both ends, and
    each starts a little differently.
    """
    rng = generator(seed, "battery")
    volts = np.empty(len(design))
    for session in np.unique(design.session):
        here = design.session == session
        t = design.start_s[here] - design.start_s[here][0]
        x = t / max(t[-1], 1.0)
        start = FULL_V + SCATTER_V * rng.standard_normal()
        volts[here] = (
            start
            - FALLS_V * (0.35 * (1 - np.exp(-6 * x)) + 0.35 * x + 0.3 * x**4)
            + 0.1 * SCATTER_V * rng.standard_normal(len(t))
        )
    return np.round(volts, 4)


def bench_V(design: TrialSchedule, *, seed: int) -> FloatArray:
    """Supply of each trial on a bench supply, which holds its voltage."""
    return np.round(FULL_V + 0.001 * generator(seed, "bench").standard_normal(len(design)), 4)
