"""Crash rates over set-points for several lift curves at once, with the test of the time step that
every run makes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.flight.simulation import safety
from nearlift.flight.simulation.curve import Curves
from nearlift.flight.simulation.flight import Map, Plan, Scheme, Setting, fly
from nearlift.flight.simulation.groups import Groups

#: Share of the flights, and least number of them, that are flown again with half the step.
CHECKED, LEAST_CHECKED = 0.25, 50


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """What was flown.

    Attributes
    ----------
    target_z_hat : array (t,)
    crashed : bool array (curves, t, flights)
    ratio : array (curves, t)
        L / L_inf at the set-points.
    convergence : Convergence
    """

    target_z_hat: FloatArray
    crashed: NDArray[np.bool_]
    ratio: FloatArray
    convergence: safety.Convergence

    @property
    def flights(self) -> int:
        """Flights per setting."""
        return int(self.crashed.shape[2])

    @property
    def rate(self) -> FloatArray:
        """Crash rates (curves, t)."""
        result: FloatArray = self.crashed.mean(axis=2)
        return result


def sweep(
    boundary: Boundary,
    curves: Curves,
    target_z_hat: FloatArray,
    groups: Groups,
    *,
    scheme: Scheme,
    steps_per_hold: int,
    step_s: float,
    flights: int,
    key: int,
    spread: Map = map,
    droops: Sequence[float] = (),
    checked: Sequence[int] | None = None,
) -> Sweep:
    """Fly every curve at every set-point, and some of it again with half the step.

    `droops` gives each curve's loss of lift over the flight (none by default), `checked` the curves
    whose step is tested (all). Step and `step_s` say the same; the latter is only for the record.
    """
    n, t = len(curves.values), len(target_z_hat)
    settings = [
        Setting(
            target_z_hat=float(z),
            groups=groups,
            curve=c,
            droop=float(droops[c]) if len(droops) else 0.0,
        )
        for c in range(n)
        for z in target_z_hat
    ]
    plan = Plan(
        boundary=boundary,
        settings=settings,
        curves=curves,
        scheme=scheme,
        steps_per_hold=steps_per_hold,
    )
    crashed = fly(plan, flights, key, spread) >= 0
    again = [c * t + i for c in (range(n) if checked is None else checked) for i in range(t)]
    return Sweep(
        target_z_hat=np.asarray(target_z_hat, dtype=float),
        crashed=crashed.reshape(n, t, flights),
        ratio=curves.at(np.asarray(target_z_hat, dtype=float)),
        convergence=halved(plan, crashed, again, key, step_s, spread),
    )


def halved(
    plan: Plan,
    crashed: NDArray[np.bool_],
    again: Sequence[int],
    key: int,
    step_s: float,
    spread: Map = map,
) -> safety.Convergence:
    """What half the step changes: settings `again` of a plan that `crashed` (settings, flights), a
    share of their flights flown once more.
    """
    flights = crashed.shape[1]
    few = min(flights, max(round(CHECKED * flights), LEAST_CHECKED))
    finer = (
        fly(replace(plan.halved(), settings=[plan.settings[i] for i in again]), few, key, spread)
        >= 0
    )
    return safety.convergence(
        np.array([plan.settings[i].target_z_hat for i in again]),
        crashed[list(again)][:, :few],
        finer,
        step_s,
    )
