"""The paper's Fig. 6: crash rates and levels of its models, as printed and with a converged time
step, and sample time histories.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray
from nearlift.flight.crash_rate import (
    CrashLevel,
    Rows,
    StepTest,
    levels,
    resamples,
    spread90,
    sweep,
)
from nearlift.flight.simulation import Curves, Simulation, Spread, tabulate
from nearlift.flight.vehicle import Craft, Disturbance, Gains, Groups
from nearlift.randomness import generator

#: The vehicle of the paper's simulation.
CRAZYFLIE_AS_PRINTED = Craft(
    radius_m=0.023, mass_kg=0.027, gravity_m_s2=9.8, density_kg_m3=1.2, C_L=1.6
)
#: Magnitudes as printed (10^2.5 and 10^1.5), with the sign that each boundary needs.
GAINS: dict[Boundary, Gains] = {
    "ground": Gains(kP=-316.0, kD=-316.0, kI=-31.6),
    "ceiling": Gains(kP=316.0, kD=316.0, kI=31.6),
}
#: The paper's white noise, held for its step of 0.1 s.
DISTURBANCE = Disturbance(sd_N=0.015, hold_s=0.1)
#: Duration of each flight.
DURATION_S = 120.0
MODELS: dict[Boundary, str] = {"ground": "sanchez_cuevas", "ceiling": "hsiao_chirarattananon"}
#: Powers to which the paper's models are raised; 0 is no model.
EXPONENTS = (0.0, 0.6, 0.8, 1.0, 1.2, 1.4)
#: Set-points in rotor radii: the paper's (0.5 to 2 above ground, 1 to 2.5 below the ceiling), and
#: somewhat beyond, where its curves end.
TARGETS: dict[Boundary, FloatArray] = {
    "ground": np.round(np.arange(4, 21) * 0.1, 10),
    "ceiling": np.round(np.arange(8, 29) * 0.1, 10),
}
#: 90 mm between adjacent rotors, as in the paper (65 mm on a Crazyflie), over a radius of 23 mm.
GEOMETRY = {"spacing_hat": 90 / 23, "diagonal_hat": math.sqrt(2) * 90 / 23}
#: z_hat below which the paper holds L / L_inf constant.
BOUND_Z_HAT = 0.5
#: Set-points of Fig. 6a and b, z_hat, near the middle of the model's effect.
SHOWN: dict[Boundary, float] = {"ground": 1.0, "ceiling": 1.75}
#: The presets that a manifest may name.
MEANINGS = {
    "paper": "as printed: explicit Euler, a step of 0.1 s, one gust a step; a point without feet"
    " that crashes at z_hat = 0",
    "converged": "the same gusts, each held 0.1 s. Runge-Kutta of order 4, a step of 0.05 s; a"
    " point without feet that crashes at z_hat = 0",
}
#: Number of flights searched for time histories, and largest number shown.
SEARCHED, PICKED = 60, 2


def groups(boundary: Boundary) -> Groups:
    """Dimensionless groups with the paper's gains, signed for the boundary."""
    return Groups.scaled(CRAZYFLIE_AS_PRINTED, GAINS[boundary], DISTURBANCE, DURATION_S)


def simulation(
    preset: str, boundary: Boundary, flights: int, key: int, spread: Spread = map
) -> Simulation:
    """Flights of the paper's vehicle at a boundary, integrated as a preset of `MEANINGS` is."""
    as_printed = preset == "paper"
    return Simulation(
        boundary=boundary,
        groups=groups(boundary),
        runge_kutta=not as_printed,
        hold_s=DISTURBANCE.hold_s,
        steps_per_hold=1 if as_printed else 2,
        flights=flights,
        key=key,
        spread=spread,
    )


def scaled_curves(boundary: Boundary, exponents: Sequence[float]) -> Curves:
    """L / L_inf of the paper's model for the paper's vehicle, raised to each of `exponents`."""
    model = catalogue.model(MODELS[boundary])
    geometry = {n: GEOMETRY[n] for n in model.needs}
    return tabulate(
        [lambda z, k=k: model(z, **geometry) ** k for k in exponents],  # type: ignore[misc]
        BOUND_Z_HAT,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedFlights:
    """The paper's models at one boundary under one preset."""

    convergence: StepTest
    groups: Groups
    flights: int
    levels: tuple[CrashLevel, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PresetFlights:
    """The paper's models under one preset."""

    meaning: str
    boundaries: Mapping[Boundary, PublishedFlights]


def published_flights(
    preset: str, how: Simulation, risks: Sequence[float]
) -> tuple[PublishedFlights, Rows]:
    """Crash rates and levels of all powers over all set-points, with the rows of
    crash_rates.parquet.
    """
    boundary = how.boundary
    # one bootstrap for all curves: they met the same gusts
    rng = generator(how.key % 2**32, "levels", preset, boundary)
    weights = resamples(how.flights, rng)
    rows, reached, tests = Rows(), [], []
    for k in EXPONENTS:
        flown, step_test = sweep(how, scaled_curves(boundary, (k,)), TARGETS[boundary], risks)
        tests.append(step_test)
        labels = {"preset": preset, "boundary": boundary, "exponent": k, "member": -1}
        labels |= {"below_nearest": "", "contact_z_hat": how.groups.contact}
        rows += flown.rows(0, "thrust", model=MODELS[boundary] if k else "none", **labels)
        lowest = float(flown.target_z_hat[0])
        for risk in risks:
            values = levels(flown.target_z_hat, flown.crashed[0], risk, weights)
            lo90, hi90 = spread90(values)
            at: dict[str, float] = {"value": float(values[0]), "lo90": lo90, "hi90": hi90}
            reached.append(CrashLevel(exponent=k, risk=risk, **at, lowest_flown=lowest))
    worst = max(tests, key=lambda test: test.worst)
    flights = PublishedFlights(
        convergence=replace(worst, converged=all(test.converged for test in tests)),
        groups=how.groups,
        flights=how.flights,
        levels=tuple(reached),
    )
    return flights, rows


def histories(preset: str, boundary: Boundary, key: int) -> Rows:
    """Rows of flights.parquet: the first flights that end differently with and without the model.

    Above a ground they crash only without the model, below a ceiling only with it, as in the
    paper's own illustration. The crash rates count all flights.
    """
    how, target = simulation(preset, boundary, SEARCHED, key), SHOWN[boundary]
    curves, both = scaled_curves(boundary, (0.0, 1.0)), np.arange(2)
    crashed = how.ended(curves, target, both) >= 0
    bad, good = (0, 1) if boundary == "ground" else (1, 0)
    rows = Rows()
    for flight in np.flatnonzero(crashed[bad] & ~crashed[good])[:PICKED].tolist():
        labels = {"preset": preset, "boundary": boundary, "flight": flight, "target_z_hat": target}
        tracks = how.trace(curves, target, both, flight)
        for model, z_hat in zip(("none", MODELS[boundary]), tracks, strict=True):
            rows += [
                labels | {"model": model, "t_s": k * DISTURBANCE.hold_s, "z_hat": float(z_hat[k])}
                for k in np.flatnonzero(np.isfinite(z_hat)).tolist()
            ]
    return rows
