"""Crash rate over pairs of dimensionless groups, all others as flown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.flight.simulation import safety
from nearlift.flight.simulation.curve import tabulate
from nearlift.flight.simulation.flight import Map, Plan, Scheme, Setting, fly
from nearlift.flight.simulation.groups import Groups
from nearlift.flight.simulation.sweep import halved

#: Cells along either axis; the flown value is the middle one.
SIDE = 9
#: Most flights a cell.
FLIGHTS = 150
#: The step is tested in every second cell whose crash rate is so near one half.
UNDECIDED = 0.4
#: Set-points, above what the vehicle touches.
TARGETS: dict[Boundary, float] = {"ground": 1.0, "ceiling": 2.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One group of a map: its name among the groups, and the range of its values over the flown one
    (correlation: over the hold).
    """

    name: str
    low: float
    high: float

    @property
    def factors(self) -> FloatArray:
        """Equally spaced on a logarithmic axis."""
        return np.round(np.geomspace(self.low, self.high, SIDE), 6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """One map: two groups, what changes in proportion to the first, and into how many the step is
    divided (a larger gain is a faster loop).
    """

    name: str
    x: Axis
    y: Axis
    along: tuple[str, ...] = ()
    finer: int = 1


BETA, NOISE = Axis(name="beta", low=1 / 3, high=3.0), Axis(name="noise", low=1 / 3, high=3.0)
SPACING = "spacing_hat"
PAIRS = (
    Pair(name="gains", x=BETA, y=Axis(name="alpha", low=0.1, high=10.0), finer=2),
    Pair(name="noise and gains", x=BETA, y=NOISE, along=("alpha", "gamma"), finer=2),
    # gusts that forget at once, as flown elsewhere, are to the left of it
    Pair(name="noise and its memory", x=Axis(name="correlation", low=0.3, high=30.0), y=NOISE),
    Pair(name="noise and spacing", x=Axis(name=SPACING, low=0.75, high=2.0), y=NOISE),
)


def scan(
    boundary: Boundary,
    ratio: Callable[[float], Callable[[FloatArray], FloatArray]],
    model: str,
    bound: float,
    spacing_hat: float | None,
    *,
    groups: Groups,
    scheme: Scheme,
    steps_per_hold: int,
    step_s: float,
    flights: int,
    key: int,
    spread: Map = map,
) -> tuple[list[dict[str, Any]], safety.Convergence]:
    """Rows of crash_map.parquet, every pair of groups whose groups this boundary's model has; and
    what half the step changes.

    Parameters
    ----------
    ratio : callable
        L / L_inf with the rotors' spacing so many times the vehicle's.
    spacing_hat : float or None
        The vehicle's; None where the model does not depend on it.
    """
    target = max(groups.contact + TARGETS[boundary], bound)
    few = min(flights, FLIGHTS)
    rows, tested = [], []
    for pair in PAIRS:
        if pair.x.name == SPACING and spacing_hat is None:
            continue
        ratios = (
            [ratio(float(f)) for f in pair.x.factors] if pair.x.name == SPACING else [ratio(1.0)]
        )
        curves = tabulate(ratios, bound)
        cells = list(_cells(pair, groups, spacing_hat))
        # gusts of one plan share their memory
        for memory in dict.fromkeys(g.correlation for _, _, g, _, _ in cells):
            mine = [c for c in cells if c[2].correlation == memory]
            settings = [
                Setting(target_z_hat=target, groups=g, curve=i if len(ratios) > 1 else 0)
                for _, _, g, i, _ in mine
            ]
            plan = Plan(
                boundary=boundary,
                settings=settings,
                curves=curves,
                scheme=scheme,
                steps_per_hold=pair.finer * steps_per_hold,
            )
            crashed = fly(plan, few, key, spread) >= 0
            # the step is tested in the corners, where the loop is fastest and slowest, and where
            # crashing is undecided: elsewhere no step shows
            corners = [
                n
                for n, (_, _, _, i, j) in enumerate(mine)
                if i % (SIDE - 1) == 0 and j % (SIDE - 1) == 0
            ]
            undecided = np.flatnonzero(np.abs(crashed.mean(axis=1) - 0.5) < UNDECIDED)[::2]
            again = sorted({*corners, *undecided.tolist()})
            tested += (
                [halved(plan, crashed, again, key, step_s / pair.finer, spread)] if again else []
            )
            crashes = crashed.sum(axis=1)
            low, high = safety.binomial90(crashes, few)
            rows += [
                {
                    "boundary": boundary,
                    "model": model,
                    "map": pair.name,
                    "x_group": pair.x.name,
                    "y_group": pair.y.name,
                    "x": x,
                    "y": y,
                    "target_z_hat": target,
                    "flights": few,
                    "crashes": int(crashes[i]),
                    "rate": float(crashes[i] / few),
                    "lo90": float(low[i]),
                    "hi90": float(high[i]),
                }
                for i, (x, y, _, _, _) in enumerate(mine)
            ]
    return rows, safety.together(tested)


def _cells(
    pair: Pair, groups: Groups, spacing_hat: float | None
) -> Iterator[tuple[float, float, Groups, int, int]]:
    """Values on both axes (sizes, without the gains' sign), the groups there, and which place on
    either axis it is.
    """
    for i, fx in enumerate(pair.x.factors.tolist()):
        for j, fy in enumerate(pair.y.factors.tolist()):
            changes = {name: fx * getattr(groups, name) for name in pair.along} | {
                pair.y.name: fy * getattr(groups, pair.y.name)
            }
            if pair.x.name == SPACING:
                x = fx * (spacing_hat or 0.0)
            elif pair.x.name == "correlation":
                x = changes["correlation"] = fx * groups.hold
            else:
                changes[pair.x.name] = fx * getattr(groups, pair.x.name)
                x = abs(changes[pair.x.name])
            yield x, abs(changes[pair.y.name]), groups.with_groups(**changes), i, j
