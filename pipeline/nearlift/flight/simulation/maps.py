"""Crash rates over pairs of dimensionless groups, all others as flown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.flight import Ratio
from nearlift.flight.simulation.crash_rate import binomial90
from nearlift.flight.simulation.curve import tabulate
from nearlift.flight.simulation.flight import FlightSetting
from nearlift.flight.simulation.groups import Groups
from nearlift.flight.simulation.monte_carlo import MonteCarlo, StepTest, combined

#: Cells along either axis.
SIDE = 9
#: Largest number of flights per cell.
FLIGHTS = 150
#: Distance of a crash rate from one half within which every second cell has its step tested.
UNDECIDED = 0.4
#: Set-point above the height of contact, in rotor radii.
TARGETS: dict[Boundary, float] = {"ground": 1.0, "ceiling": 2.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupAxis:
    """A group and its range relative to the flown value (of correlation: to the hold)."""

    name: str
    low: float
    high: float

    @property
    def factors(self) -> FloatArray:
        """Factors equally spaced on a logarithmic axis."""
        return np.round(np.geomspace(self.low, self.high, SIDE), 6)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupPair:
    """One map: two groups, those that scale with the first, and the divisor of the time step (a
    larger gain makes a faster loop).
    """

    name: str
    x: GroupAxis
    y: GroupAxis
    along: tuple[str, ...] = ()
    finer: int = 1


BETA, NOISE = (
    GroupAxis(name="beta", low=1 / 3, high=3.0),
    GroupAxis(name="noise", low=1 / 3, high=3.0),
)
SPACING = "spacing_hat"
PAIRS = (
    GroupPair(name="gains", x=BETA, y=GroupAxis(name="alpha", low=0.1, high=10.0), finer=2),
    GroupPair(name="noise and gains", x=BETA, y=NOISE, along=("alpha", "gamma"), finer=2),
    # gusts without memory, as flown elsewhere, lie to the left of this map
    GroupPair(
        name="noise and its memory", x=GroupAxis(name="correlation", low=0.3, high=30.0), y=NOISE
    ),
    GroupPair(name="noise and spacing", x=GroupAxis(name=SPACING, low=0.75, high=2.0), y=NOISE),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class MapCell:
    """One cell of a map: values (magnitudes) and indices on both axes, and the groups there."""

    x: float
    y: float
    groups: Groups
    i: int
    j: int

    @property
    def corner(self) -> bool:
        """Whether it is a corner of the map."""
        return self.i % (SIDE - 1) == 0 and self.j % (SIDE - 1) == 0


def scan(
    boundary: Boundary,
    ratio: Callable[[float], Ratio],
    model: str,
    bound: float,
    spacing_hat: float | None,
    groups: Groups,
    how: MonteCarlo,
) -> tuple[list[dict[str, object]], StepTest]:
    """Rows of crash_map.parquet for every pair of groups that the model has; step test.

    `ratio` gives L / L_inf with the rotor spacing multiplied by its argument; `spacing_hat` is the
    vehicle's, None where the model does not depend on it.
    """
    target = max(groups.contact + TARGETS[boundary], bound)
    rows, tested = [], []
    for pair in PAIRS:
        spaced = pair.x.name == SPACING
        if spaced and spacing_hat is None:
            continue
        curves = tabulate(
            [ratio(float(f)) for f in pair.x.factors] if spaced else [ratio(1.0)], bound
        )
        few = how.at_most(FLIGHTS).finer(pair.finer)
        cells = list(_cells(pair, groups, spacing_hat))
        # all settings of a plan share the gusts' correlation
        for memory in dict.fromkeys(c.groups.correlation for c in cells):
            alike = [c for c in cells if c.groups.correlation == memory]
            settings = [
                FlightSetting(target_z_hat=target, groups=c.groups, curve=c.i if spaced else 0)
                for c in alike
            ]
            crashed = few.crashed(boundary, settings, curves)
            # corners have the fastest and slowest loops; away from a rate of 1 / 2 no step shows
            undecided = np.flatnonzero(np.abs(crashed.mean(axis=1) - 0.5) < UNDECIDED)[::2]
            again = sorted({*(n for n, c in enumerate(alike) if c.corner), *undecided.tolist()})
            if again:
                picked = [settings[n] for n in again]
                tested.append(few.step_test(boundary, picked, curves, crashed[again]))
            crashes = crashed.sum(axis=1)
            low, high = binomial90(crashes, few.flights)
            rows += [
                {
                    "boundary": boundary,
                    "model": model,
                    "map": pair.name,
                    "x_group": pair.x.name,
                    "y_group": pair.y.name,
                    "x": c.x,
                    "y": c.y,
                    "target_z_hat": target,
                    "flights": few.flights,
                    "crashes": int(crashes[i]),
                    "rate": float(crashes[i] / few.flights),
                    "lo90": float(low[i]),
                    "hi90": float(high[i]),
                }
                for i, c in enumerate(alike)
            ]
    return rows, combined(tested)


def _cells(pair: GroupPair, groups: Groups, spacing_hat: float | None) -> Iterator[MapCell]:
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
            y = abs(changes[pair.y.name])
            yield MapCell(x=x, y=y, groups=replace(groups, **changes), i=i, j=j)
