"""The motors' lag: what they do of what they were told, and the time constant at which their lift
follows it best.

A motor follows its command as a first-order system does. The time constant is found on a grid: at
each of its values log lift is fitted by the filtered command, the supply, the climb and smooth
curves of height, with a level for each stretch of flight; how far the best value moves when
stretches are left out is its uncertainty, since neighbouring samples are not independent of each
other. Lag trades with climb (0.6 % per m/s for every 10 ms), so both are free at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.manifest.flight_log import LONGEST_LAG_S

#: Time constants that are tried, s.
GRID = np.linspace(0.0, LONGEST_LAG_S, 41)
#: Samples that are averaged before they are fitted, s: noise of an accelerometer is faster.
BLOCK_S = 0.02
#: Decay lengths of the smooth curves of height, in rotor radii.
DECAYS = (1.0, 3.0)
#: A flight is parted into stretches of so long, s, that are left out in turn.
STRETCH_S = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Moments:
    """Sums of squares and products of one stretch of flight at each time constant, (T, k, k), less
    their means: log lift first, then what it is fitted by.
    """

    products: FloatArray
    blocks: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Lag:
    """A time constant and its standard uncertainty, s; the power of the filtered command that lift
    follows; `at_edge` where the best value lies at the end of the grid.
    """

    value_s: float
    u_s: float
    power: float
    at_edge: bool = False


def filtered(
    command: FloatArray, run: NDArray[np.int64], step_s: float, lag_s: float
) -> FloatArray:
    """A command (n,) behind a first-order lag, begun anew behind each hole of the log."""
    if lag_s <= 0:
        return command
    from scipy.signal import lfilter

    keep = float(np.exp(-step_s / lag_s))
    out: FloatArray = np.empty_like(command)
    edges = [0, *(np.flatnonzero(np.diff(run)) + 1).tolist(), len(command)]
    for a, b in itertools.pairwise(edges):
        known = np.nan_to_num(command[a:b])
        out[a:b] = lfilter([1 - keep], [1, -keep], known, zi=keep * known[:1])[0]
    return out


def moments(
    lift_N: FloatArray,
    commands: FloatArray,
    beside: Sequence[FloatArray],
    group: NDArray[np.int64],
    step_s: float,
) -> list[Moments]:
    """The sums of each stretch: samples of one `group` (from 1; 0 is left out).

    Parameters
    ----------
    lift_N : (n,) array
    commands : (T, n) array
        The mean command behind each lag.
    beside : sequence of (n,) arrays
        What else log lift is fitted by.
    """
    size = max(round(BLOCK_S / step_s), 1)
    found = []
    for number in range(1, int(group.max(initial=0)) + 1):
        mine = np.flatnonzero(group == number)
        blocks = len(mine) // size
        if blocks < 2 * (len(beside) + 2):
            continue
        mine = mine[: blocks * size]

        def means(values: FloatArray, mine: NDArray[np.intp] = mine) -> FloatArray:
            blocked = values[..., mine].reshape(*values.shape[:-1], -1, size)
            return np.asarray(blocked.mean(axis=-1), dtype=np.float64)

        y = np.log(np.maximum(means(lift_N), 1e-9))
        fixed = [y, *(means(x) for x in beside)]
        logs = np.log(np.maximum(means(commands), 1e-9))
        columns = np.stack(
            [
                np.broadcast_to(fixed[0], logs.shape),
                logs,
                *(np.broadcast_to(x, logs.shape) for x in fixed[1:]),
            ],
            axis=-1,
        )
        columns = columns - columns.mean(axis=1, keepdims=True)
        found.append(Moments(products=columns.swapaxes(1, 2) @ columns, blocks=len(y)))
    return found


def estimate(stretches: Sequence[Moments], given_s: float | None = None) -> Lag | None:
    """The lag that all stretches share, and the command's power there, or at the given lag; None
    where they cannot tell one.
    """
    if len(stretches) < 2:
        return None
    each = np.stack([s.products for s in stretches])
    whole = each.sum(axis=0)
    best, power, powers = _best(whole)
    if given_s is not None:
        return Lag(value_s=given_s, u_s=0.0, power=float(np.interp(given_s, GRID, powers)))
    without = np.array([_best(whole - one)[0] for one in each])
    n = len(without)
    # jackknife (Efron & Stein 1981, Ann. Stat. 9, 586)
    u = float(np.sqrt((n - 1) / n * np.sum((without - without.mean()) ** 2)))
    step = float(GRID[1] - GRID[0])
    return Lag(
        value_s=best,
        u_s=max(u, step / 2),
        power=power,
        at_edge=not GRID[0] + step / 2 < best < GRID[-1] - step / 2,
    )


def _best(products: FloatArray) -> tuple[float, float, FloatArray]:
    """The time constant at the least sum of squares, between nodes by a parabola; the power of the
    command there, and at each node.
    """
    left, power = np.empty(len(GRID)), np.empty(len(GRID))
    for k, own in enumerate(products):
        scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
        inner = own / np.outer(scale, scale)
        solved = np.linalg.lstsq(inner[1:, 1:], inner[1:, 0], rcond=1e-10)[0]
        left[k] = own[0, 0] * max(1.0 - float(inner[0, 1:] @ solved), 0.0)
        power[k] = solved[0] * scale[0] / scale[1]
    k = int(np.argmin(left))
    if not 0 < k < len(GRID) - 1:
        return float(GRID[k]), float(power[k]), power
    a, b, c = left[k - 1 : k + 2]
    away = 0.5 * (a - c) / (a - 2 * b + c) if a - 2 * b + c > 0 else 0.0
    value = GRID[k] + away * (GRID[1] - GRID[0])
    return float(value), float(np.interp(value, GRID, power)), power
