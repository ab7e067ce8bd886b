"""Simulated flights: tables of lift, and the moment at which each flight crashes.

Gusts are addressed by flight: flight f meets the same ones in every setting, block and order. By
these common random numbers differences are far better known than rates.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused
from nearlift.flight import Ratio
from nearlift.flight.kernel import NODES
from nearlift.flight.vehicle import LIFT_SIGN, Groups

#: An executor's map.
Spread = Callable[[Callable[[int], Any], Iterable[int]], Iterable[Any]]
#: z_hat above which every table is constant; lift there is within 0.5 % of L_inf for the declared
#: models at their declared parameters.
TOP = 16.0
#: Largest block of flights, and number of blocks into which few flights are divided.
BLOCK, LEAST_BLOCKS = 50, 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """Tables (m, NODES) of L / L_inf over a common range of z_hat, from `low` to `TOP`.

    The ratio is constant beyond both, so `low` is the bound that the paper sets to 0.5.
    """

    low: float
    values: FloatArray

    def at(self, z_hat: FloatArray) -> FloatArray:
        """Every table at heights (n,): shape (m, n)."""
        nodes = np.linspace(self.low, TOP, NODES)
        return np.stack([np.interp(z_hat, nodes, row) for row in self.values])


def tabulate(ratios: Sequence[Ratio], low: float) -> Curves:
    """Tables of several functions of z_hat, each constant below `low`.

    Raises
    ------
    InputRefused
        A ratio has no positive value somewhere in it.
    """
    z_hat = np.linspace(low, TOP, NODES)
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.stack([ratio(z_hat) for ratio in ratios])
    bad = ~(np.isfinite(values) & (values > 0))
    if bad.any():
        what = f"L / L_inf has no value at z_hat = {z_hat[bad.any(axis=0)].max():.3g}"
        raise InputRefused("simulate", what, "choose another `base`")
    return Curves(low=low, values=values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """Flights at one boundary, and how they are integrated.

    The controller's f0 allows for the boundary at the set-point, as in the paper. `runge_kutta` is
    of order 4, else explicit Euler. `key` addresses the gusts. `spread` is an executor's map over
    blocks of flights; no result depends on it.
    """

    boundary: Boundary
    groups: Groups
    runge_kutta: bool
    hold_s: float
    steps_per_hold: int
    flights: int
    key: int
    spread: Spread = map

    @property
    def step_s(self) -> float:
        """Time step."""
        return self.hold_s / self.steps_per_hold

    @property
    def holds(self) -> int:
        """Number of held gusts in a flight."""
        return max(round(self.groups.duration / self.groups.hold), 1)

    def ended(
        self, curves: Curves, target_z_hat: ArrayLike, curve: ArrayLike = 0, droop: ArrayLike = 0.0
    ) -> NDArray[np.int32]:
        """Hold in which each flight crashed, or -1: shape (..., flights).

        Set-points, rows of `curves`, and `droop` are broadcast against each other. `droop` is the
        relative change of lift by the end of a flight, linear in time as the supply sags.
        """
        shape, block = self._blocks(curves, target_z_hat, curve, droop)
        # blocks of equal size, or one worker would fly nearly all of few flights
        size = min(BLOCK, math.ceil(self.flights / LEAST_BLOCKS))
        block = functools.partial(block, size=size, flights=self.flights)
        blocks = self.spread(block, range(0, self.flights, size))
        return np.concatenate(list(blocks), axis=1).reshape(*shape, self.flights)

    def trace(
        self, curves: Curves, target_z_hat: ArrayLike, curve: ArrayLike, flight: int
    ) -> FloatArray:
        """Heights of one flight at the start and after every hold, (..., holds + 1); nan once
        crashed.
        """
        shape, block = self._blocks(curves, target_z_hat, curve, 0.0)
        track = np.full((math.prod(shape), self.holds + 1), np.nan)
        block(flight, size=1, flights=flight + 1, track=track)
        return track.reshape(*shape, -1)

    def _blocks(
        self, curves: Curves, target_z_hat: ArrayLike, curve: ArrayLike, droop: ArrayLike
    ) -> tuple[tuple[int, ...], Callable[..., NDArray[np.int32]]]:
        """Shape of the settings, and the function that flies a block of flights with them."""
        g = self.groups
        settings = np.broadcast_arrays(target_z_hat, curve, droop)
        target, row, sag = (x.ravel() for x in settings)
        ratio = curves.at(target)[row, np.arange(len(row))]
        columns = (
            *(target, g.alpha, g.beta, g.gamma, g.delta / np.sqrt(ratio)),
            *(g.noise, LIFT_SIGN[self.boundary], sag, g.contact, np.sqrt(g.most_lift)),
        )
        # value at and change over each step, tables one behind the other
        tables = np.stack(
            [curves.values, np.diff(curves.values, axis=1, append=curves.values[:, -1:])], axis=-1
        )
        law = (
            self.steps_per_hold,
            g.hold / self.steps_per_hold,
            self.runge_kutta,
            np.stack([np.broadcast_to(column, len(row)) for column in columns]),
            2 * NODES * row.astype(np.int64),
            tables.ravel(),
            curves.low,
            (NODES - 1) / (TOP - curves.low),
        )
        memory = math.exp(-g.hold / g.correlation) if g.correlation > 0 else 0.0
        fly = functools.partial(_block, key=self.key, holds=self.holds, memory=memory, law=law)
        return settings[0].shape, fly


def _block(
    first: int,
    *,
    size: int,
    flights: int,
    key: int,
    holds: int,
    memory: float,
    law: tuple[Any, ...],
    track: FloatArray | None = None,
) -> NDArray[np.int32]:
    """Hold in which each flight of one block crashed: of plain values, for any worker.

    `memory` is the correlation of gusts from hold to hold, `law` the compiled loop's last
    arguments.
    """
    from nearlift.flight import kernel

    numbers = range(first, min(first + size, flights))
    ended = np.empty((law[3].shape[1], len(numbers)), dtype=np.int32)
    drawn = np.stack([normals(key, flight, holds) for flight in numbers])
    for k in range(1, holds if memory else 0):
        drawn[:, k] = memory * drawn[:, k - 1] + math.sqrt(1 - memory**2) * drawn[:, k]
    kernel.fly(drawn, ended, np.empty((0, 0)) if track is None else track, *law)
    return ended


def normals(key: int, flight: int, n: int) -> FloatArray:
    """First `n` standard normals of a flight, a function of key and flight alone."""
    return np.random.Generator(np.random.Philox(key=[key, flight])).standard_normal(n)
