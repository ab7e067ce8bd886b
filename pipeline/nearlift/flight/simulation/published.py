"""The paper's Fig. 6 under a preset: crash rates and levels over set-points and powers of its
models, the same with other gains and noise ("the relative positioning of the curves would be
unaffected", it says), and sample time histories.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.flight.simulation import crash_rate, presets
from nearlift.flight.simulation.claims import CrashLevels
from nearlift.flight.simulation.craft import PAPER_DISTURBANCE
from nearlift.flight.simulation.crash_rate import CrashLevel
from nearlift.flight.simulation.flight import FlightPlan, FlightSetting, fly, trace
from nearlift.flight.simulation.groups import Groups
from nearlift.flight.simulation.monte_carlo import MonteCarlo, StepTest, combined, sweep
from nearlift.randomness import generator

Rows = list[dict[str, object]]
#: Name, factor of all three gains, factor of the noise. Larger gains are left out: the printed
#: scheme, explicit Euler at 0.1 s, diverges from a factor of 1.2 on.
VARIANTS = (
    ("gains x 0.5", 0.5, 1.0),
    ("gains x 0.8", 0.8, 1.0),
    ("noise x 0.7", 1.0, 0.7),
    ("noise x 1.4", 1.0, 1.4),
)
#: Powers that the claims on variants compare.
VARIED_EXPONENTS = (0.0, 0.6, 1.0, 1.4)
#: Set-points that hold every variant's 50 % level, close where converged ground curves are steep.
VARIED_TARGETS: dict[Boundary, FloatArray] = {
    "ground": np.round(np.concatenate([np.arange(6, 15) * 0.05, np.arange(4, 12) * 0.2]), 10),
    "ceiling": np.round(np.arange(3, 20) * 0.2, 10),
}
#: Share of the flights, and least number of them, flown for each variant.
VARIED_SHARE, LEAST_VARIED = 0.25, 50
#: Powers of the variants whose step is tested.
TESTED_EXPONENTS = (0.0, 1.0)
#: Set-points of Fig. 6a and b, near the middle of the model's effect.
SHOWN: dict[Boundary, float] = {"ground": 1.0, "ceiling": 1.75}
#: Number of flights searched for time histories, and largest number shown.
LOOKED_AT, PICKED = 60, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedFlights:
    """The paper's models at one boundary under one preset; `convergence` and `variants` are the
    step tests of the preset's own gains and noise, and of the variants.
    """

    convergence: StepTest
    groups: Groups
    flights: int
    levels: tuple[CrashLevel, ...]
    variants: StepTest


def published_flights(
    preset: presets.FlightPreset,
    boundary: Boundary,
    how: MonteCarlo,
    risks: Sequence[float],
    levels: CrashLevels,
) -> tuple[PublishedFlights, Rows]:
    """Crash rates and levels of all powers over all set-points, with the rows of
    crash_rates.parquet; the levels that the claims are judged by are added to `levels`.
    """
    groups = preset.groups(boundary)
    # one bootstrap for all curves: they met the same gusts
    rng = generator(how.key % 2**32, "levels", preset.name, boundary)
    weights = crash_rate.resamples(how.flights, rng)
    rows: Rows = []
    listed, tests = [], []
    for k in presets.EXPONENTS:
        curves = presets.scaled_curves(boundary, (k,))
        targets = presets.TARGETS[boundary]
        flown = sweep(boundary, curves, targets, groups, how, risks=risks)
        tests.append(flown.step_test)
        model = presets.MODELS[boundary] if k else "none"
        labels = {
            "preset": preset.name,
            "boundary": boundary,
            "model": model,
            "exponent": k,
            "member": -1,
            "below_nearest": "",
            "contact_z_hat": groups.contact,
        }
        rows += flown.rows(0, "thrust", labels)
        for risk in risks:
            values = crash_rate.levels(flown.target_z_hat, flown.crashed[0], risk, weights)
            levels.flown[boundary, k, risk] = crash_rate.levels_held(flown.target_z_hat, values)
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
    rng = generator(how.key % 2**32, "variants", preset.name, boundary)
    varied, tested = varied_levels(boundary, groups, how, rng)
    levels.varied.update(varied)
    flights = PublishedFlights(
        convergence=combined(tests),
        groups=groups,
        flights=how.flights,
        levels=tuple(listed),
        variants=tested,
    )
    return flights, rows


def varied_levels(
    boundary: Boundary, groups: Groups, how: MonteCarlo, rng: np.random.Generator
) -> tuple[dict[tuple[str, float, str], FloatArray], StepTest]:
    """50 % levels by (boundary, power, variant) under one bootstrap: arrays (m,), the first as
    flown, nan where the set-points do not hold the level; and the step test.

    A quarter of the flights are flown, but at least LEAST_VARIED.
    """
    few = how.at_most(max(round(VARIED_SHARE * how.flights), LEAST_VARIED))
    weights = crash_rate.resamples(few.flights, rng)
    levels: dict[tuple[str, float, str], FloatArray] = {}
    tests = []
    for name, gain, noise in VARIANTS:
        g = replace(
            groups,
            alpha=gain * groups.alpha,
            beta=gain * groups.beta,
            gamma=gain * groups.gamma,
            noise=noise * groups.noise,
        )
        for k in VARIED_EXPONENTS:
            curves = presets.scaled_curves(boundary, (k,))
            flown = sweep(boundary, curves, VARIED_TARGETS[boundary], g, few, risks=(0.5,))
            z_hat = flown.target_z_hat
            values = crash_rate.levels(z_hat, flown.crashed[0], 0.5, weights)
            levels[boundary, k, name] = crash_rate.levels_held(z_hat, values)
            tests += [flown.step_test] if k in TESTED_EXPONENTS else []
    return levels, combined(tests)


def histories(preset: presets.FlightPreset, boundary: Boundary, key: int) -> Rows:
    """Rows of flights.parquet: the first flights that end differently with and without the model.

    Above a ground those that crash only without the model, below a ceiling only with it, as in the
    paper's own illustration; the crash rates count all flights.
    """
    groups = preset.groups(boundary)
    plan = FlightPlan(
        boundary=boundary,
        settings=[
            FlightSetting(target_z_hat=SHOWN[boundary], groups=groups, curve=c) for c in (0, 1)
        ],
        curves=presets.scaled_curves(boundary, (0.0, 1.0)),
        scheme=preset.scheme,
        steps_per_hold=preset.steps_per_hold,
    )
    ended = fly(plan, LOOKED_AT, key)
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
            ("none", presets.MODELS[boundary]), trace(plan, flight, key), strict=True
        )
        for k in np.flatnonzero(np.isfinite(heights)).tolist()
    ]
