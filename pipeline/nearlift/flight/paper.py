"""The paper's Fig. 6: crash rates and levels of its models, as printed and with a converged time
step, and sample time histories.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError
from nearlift.flight import crash_rate
from nearlift.flight.crash_rate import CrashLevel
from nearlift.flight.monte_carlo import (
    Curves,
    MonteCarlo,
    Scheme,
    Spread,
    StepTest,
    combined,
    settings_of,
    steps_per_hold,
    sweep,
    tabulate,
)
from nearlift.flight.vehicle import (
    CRAZYFLIE_AS_PRINTED,
    PAPER_DISTURBANCE,
    PAPER_GAINS,
    Groups,
    dimensionless,
)
from nearlift.randomness import generator

Rows = list[dict[str, object]]
#: Powers to which the paper's models are raised; 0 is no model.
EXPONENTS = (0.0, 0.6, 0.8, 1.0, 1.2, 1.4)
#: Set-points in rotor radii: the paper's (0.5 to 2 above ground, 1 to 2.5 below the ceiling), and
#: somewhat beyond, where its curves end.
TARGETS: dict[Boundary, FloatArray] = {
    "ground": np.round(np.arange(4, 21) * 0.1, 10),
    "ceiling": np.round(np.arange(8, 29) * 0.1, 10),
}
#: Lowest and highest default set-point above the height of contact, in rotor radii.
ABOVE_CONTACT: dict[Boundary, tuple[float, float]] = {"ground": (0.1, 2.0), "ceiling": (0.5, 2.8)}
MODELS: dict[Boundary, str] = {"ground": "sanchez_cuevas", "ceiling": "hsiao_chirarattananon"}
#: 90 mm between adjacent rotors, as in the paper (65 mm on a Crazyflie), over a radius of 23 mm.
GEOMETRY = {"spacing_hat": 90 / 23, "diagonal_hat": math.sqrt(2) * 90 / 23}
#: Height below which the paper holds L / L_inf constant, in rotor radii.
BOUND_Z_HAT = 0.5
#: Of each flight.
DURATION_S = 120.0
#: Set-points of Fig. 6a and b, near the middle of the model's effect.
SHOWN: dict[Boundary, float] = {"ground": 1.0, "ceiling": 1.75}
#: Number of flights searched for time histories, and largest number shown.
LOOKED_AT, PICKED = 60, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPreset:
    """The paper's vehicle, controller and disturbance, and how they are integrated."""

    name: str
    meaning: str
    scheme: Scheme
    step_s: float

    def groups(self, boundary: Boundary) -> Groups:
        """Dimensionless groups with the paper's gains, signed for the boundary."""
        gains = PAPER_GAINS[boundary]
        return dimensionless(CRAZYFLIE_AS_PRINTED, gains, PAPER_DISTURBANCE, DURATION_S)

    @property
    def steps_per_hold(self) -> int:
        """Number of time steps for which a gust is held."""
        return steps_per_hold(PAPER_DISTURBANCE.hold_s, self.step_s)

    def monte_carlo(
        self, boundary: Boundary, flights: int, key: int, spread: Spread = map
    ) -> MonteCarlo:
        """Flights of the paper's vehicle at a boundary, with this preset's scheme and step."""
        return MonteCarlo(
            boundary=boundary,
            groups=self.groups(boundary),
            scheme=self.scheme,
            step_s=self.step_s,
            steps_per_hold=self.steps_per_hold,
            flights=flights,
            key=key,
            spread=spread,
        )


#: Crash criterion of the paper's vehicle.
POINT = "; a point without feet that crashes at z_hat = 0"

PRESETS = (
    FlightPreset(
        name="paper",
        meaning="as printed: explicit Euler, a step of 0.1 s, one gust a step" + POINT,
        scheme="euler",
        step_s=0.1,
    ),
    FlightPreset(
        name="converged",
        meaning="the same gusts, each held 0.1 s; Runge-Kutta of order 4, a step of 0.05 s" + POINT,
        scheme="rk4",
        step_s=0.05,
    ),
)


def preset(name: str) -> FlightPreset:
    """Preset of that name; raises ManifestError if there is none."""
    by_name = {p.name: p for p in PRESETS}
    if name not in by_name:
        raise ManifestError(
            "simulate.presets", f"{name!r} is not a preset", f"presets are {', '.join(by_name)}"
        )
    return by_name[name]


def set_points(boundary: Boundary, contact_z_hat: float) -> list[float]:
    """Default set-points of a vehicle that touches at `contact_z_hat`: whole tenths of a radius."""
    tenths = np.arange(1000)
    low, high = (10 * (contact_z_hat + above) for above in ABOVE_CONTACT[boundary])
    targets: list[float] = np.round(
        0.1 * tenths[(tenths >= low) & (tenths < high + 1)], 10
    ).tolist()
    return targets


def scaled_curves(boundary: Boundary, exponents: Sequence[float] = EXPONENTS) -> Curves:
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


def published_flights(
    preset: str, how: MonteCarlo, risks: Sequence[float]
) -> tuple[PublishedFlights, Rows]:
    """Crash rates and levels of all powers over all set-points, with the rows of
    crash_rates.parquet.
    """
    boundary, groups = how.boundary, how.groups
    # one bootstrap for all curves: they met the same gusts
    rng = generator(how.key % 2**32, "levels", preset, boundary)
    weights = crash_rate.resamples(how.flights, rng)
    rows: Rows = []
    listed, tests = [], []
    for k in EXPONENTS:
        curves = scaled_curves(boundary, (k,))
        flown, step_test = sweep(how, curves, TARGETS[boundary], risks)
        tests.append(step_test)
        labels = {
            "preset": preset,
            "boundary": boundary,
            "model": MODELS[boundary] if k else "none",
            "exponent": k,
            "member": -1,
            "below_nearest": "",
            "contact_z_hat": groups.contact,
        }
        rows += flown.rows(0, "thrust", labels)
        for risk in risks:
            values = crash_rate.levels(flown.target_z_hat, flown.crashed[0], risk, weights)
            lo90, hi90 = crash_rate.spread90(values)
            listed.append(
                CrashLevel(
                    exponent=k,
                    risk=risk,
                    value=float(values[0]),
                    lo90=lo90,
                    hi90=hi90,
                    lowest_flown=float(flown.target_z_hat[0]),
                )
            )
    flights = PublishedFlights(
        convergence=combined(tests), groups=groups, flights=how.flights, levels=tuple(listed)
    )
    return flights, rows


def histories(preset: FlightPreset, boundary: Boundary, key: int) -> Rows:
    """Rows of flights.parquet: the first flights that end differently with and without the model.

    Above a ground they crash only without the model, below a ceiling only with it, as in the
    paper's own illustration. The crash rates count all flights.
    """
    how = preset.monte_carlo(boundary, LOOKED_AT, key)
    curves, settings = scaled_curves(boundary, (0.0, 1.0)), settings_of([SHOWN[boundary]], (0, 1))
    ended = how.ended(curves, settings)
    bad, good = (0, 1) if boundary == "ground" else (1, 0)
    picked = np.flatnonzero((ended[bad] >= 0) & (ended[good] < 0))[:PICKED]
    return [
        {
            "preset": preset.name,
            "boundary": boundary,
            "model": name,
            "target_z_hat": SHOWN[boundary],
            "flight": flight,
            "t_s": k * PAPER_DISTURBANCE.hold_s,
            "z_hat": float(heights[k]),
        }
        for flight in picked.tolist()
        for name, heights in zip(
            ("none", MODELS[boundary]), how.trace(curves, settings, flight), strict=True
        )
        for k in np.flatnonzero(np.isfinite(heights)).tolist()
    ]
