"""Flights by setting and gusts, in blocks that give the same result in any order."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError
from nearlift.flight.simulation.control import AWAY
from nearlift.flight.simulation.curve import NODES, Curves
from nearlift.flight.simulation.groups import Groups
from nearlift.results import IntArray

Scheme = Literal["euler", "semi-implicit", "rk4"]
#: An executor's map.
Spread = Callable[[Callable[[int], Any], Iterable[int]], Iterable[Any]]
#: Largest block of flights: long compared with a call, short enough to share among threads.
BLOCK = 50
#: Number of blocks into which few flights are divided.
LEAST_BLOCKS = 4
#: Heights that nobody asked for.
UNTRACKED: FloatArray = np.empty((0, 0))


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSetting:
    """A set-point with its lift curve and controller, whose f0 allows for the boundary there, as in
    the paper: `curve` is a row of the tables, `droop` the relative change of lift by the end of the
    flight as the supply sags (linear in time).
    """

    target_z_hat: float
    groups: Groups
    curve: int = 0
    droop: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """Settings to be flown at one boundary with one time step; all share hold, correlation,
    duration, motor lag and estimator delay.

    With `common` gusts, flight f meets the same ones in every setting, which makes differences far
    better known than rates; without, each setting meets its own, so that rates are independent.
    """

    boundary: Boundary
    settings: Sequence[FlightSetting]
    curves: Curves
    scheme: Scheme
    steps_per_hold: int
    common: bool = True

    @property
    def weather(self) -> Groups:
        """Groups whose hold, correlation, duration, lag and delay all settings share."""
        return self.settings[0].groups

    @property
    def holds(self) -> int:
        """Number of held gusts in a flight."""
        return max(round(self.weather.duration / self.weather.hold), 1)

    @property
    def step(self) -> float:
        """Time step in sqrt(r/g)."""
        return self.weather.hold / self.steps_per_hold

    @property
    def salts(self) -> NDArray[np.uint64]:
        """Salt of each setting's gusts: empty where they are common."""
        return np.arange(1, len(self.settings) + 1 if not self.common else 1, dtype=np.uint64)

    def columns(self) -> tuple[FloatArray, IntArray]:
        """Settings as the compiled loop reads them, (WIDTH, n), and the start of each one's table;
        raises ManifestError if they differ in hold, correlation, duration, lag or delay.
        """
        times = {
            (g.hold, g.correlation, g.duration, g.motor_lag, g.delay)
            for g in (s.groups for s in self.settings)
        }
        if len(times) > 1:
            raise ManifestError(
                "simulate",
                "settings of one plan differ in hold, correlation, duration, lag or delay",
                "fly them as plans of their own",
            )
        side = AWAY[self.boundary]
        rows = []
        near = self.curves.at(np.array([s.target_z_hat for s in self.settings]))
        for i, s in enumerate(self.settings):
            g = s.groups
            most = np.sqrt(g.most_lift)
            gains = (g.alpha, g.beta, g.gamma, g.delta / np.sqrt(near[s.curve, i]))
            rows.append((s.target_z_hat, *gains, g.noise, side, s.droop, g.contact, most))
        which = np.array([2 * NODES * s.curve for s in self.settings], dtype=np.int64)
        return np.ascontiguousarray(np.array(rows, dtype=float).T), which


def steps_per_hold(hold_s: float, step_s: float) -> int:
    """Number of steps in a hold.

    Raises
    ------
    ManifestError
        The step is no whole part of the hold; says the nearest that is.
    """
    n = max(round(hold_s / step_s), 1)
    if abs(n * step_s - hold_s) > 1e-9 * hold_s:
        raise ManifestError(
            "simulate.step",
            f"{step_s:g} s is no whole part of the {hold_s:g} s for which a gust is held",
            f"the nearest is {hold_s / n:g} s",
        )
    return n


def _block(
    first: int, *, plan: FlightPlan, end: int, size: int, key: int, track: FloatArray = UNTRACKED
) -> NDArray[np.int32]:
    from nearlift.flight.simulation import kernel

    columns, which = plan.columns()
    ended = np.empty((len(plan.settings), min(size, end - first)), dtype=np.int32)
    weather = plan.weather
    memory = float(np.exp(-weather.hold / weather.correlation)) if weather.correlation > 0 else 0.0
    kernel.fly(
        np.uint64(key),
        first,
        plan.holds,
        plan.steps_per_hold,
        plan.step,
        kernel.SCHEMES[plan.scheme],
        memory,
        columns,
        which,
        plan.salts,
        plan.curves.packed(),
        plan.curves.low,
        plan.curves.per_radius,
        weather.motor_lag,
        weather.delay / plan.step,
        ended,
        track,
    )
    return ended


def fly(plan: FlightPlan, flights: int, key: int, spread: Spread = map) -> NDArray[np.int32]:
    """Hold in which each flight crashed, or -1: shape (settings, flights).

    With common gusts, flight f meets the same ones in every setting and every plan with this key.
    `spread` is an executor's map; the result does not depend on it.
    """
    # blocks of equal size, or one worker would fly nearly all of few flights
    size = min(BLOCK, math.ceil(flights / LEAST_BLOCKS))
    block = functools.partial(_block, plan=plan, end=flights, size=size, key=key)
    return np.concatenate(list(spread(block, range(0, flights, size))), axis=1)


def trace(plan: FlightPlan, flight: int, key: int) -> FloatArray:
    """Heights of one flight at the start and after every hold, (settings, holds + 1); nan once
    crashed.
    """
    track = np.full((len(plan.settings), plan.holds + 1), np.nan)
    _block(flight, plan=plan, end=flight + 1, size=1, key=key, track=track)
    return track
