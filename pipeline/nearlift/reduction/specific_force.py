"""Specific force along the rotor axis from a logged acceleration, and whether the log bears out the
unit, sign, gravity and axes that the manifest says it has.

A vehicle in flight weighs itself: lift is its mass times the acceleration that it feels along its
rotors' axis. What a log calls acceleration may be that, or how its velocity changes; along its own
axes, or along the world's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from nearlift.declare import BoolArray, FloatArray
from nearlift.reduction.airborne import FULL

#: Time over which a velocity is differentiated, s.
SPAN_S = 0.1
#: Correlation from which on a slope says something, what it may be, and how little a series moves
#: to say nothing, m/s^2.
TELLING, SLOPES, STILL = 0.6, (0.5, 2.0), 0.1
#: Batteries of vehicles, V, and a set-point that hardly moves, m.
SUPPLY_V, RESTS_M = (1.0, 1000.0), 0.02
#: Samples that a slope rests on.
FEWEST = 50
#: What the mean of an acceleration in flight may be off by, in units of g.
OFF = 0.35


class Fault(NamedTuple):
    """What is wrong with a declaration: its key under [flight], what is seen, and what to write."""

    key: str
    what: str
    remedy: str


def along_axis(
    acceleration: FloatArray,
    gravity: float | None,
    axes: Literal["body", "world"],
    tilt_rad: FloatArray | None,
) -> FloatArray:
    """Specific force along the rotor axis, m/s^2, (n,), from an acceleration (n,) or (n, 3), the
    last axis up, and the gravity that is to be added, None where it is in it already.

    Along the world's axes the norm is taken: a rotor pulls along its axis alone.
    """
    if axes == "world":
        felt = acceleration.copy()
        felt[:, 2] += gravity or 0.0
        return np.asarray(np.sqrt(np.sum(felt**2, axis=1)), dtype=np.float64)
    up = acceleration if acceleration.ndim == 1 else acceleration[:, 2]
    if gravity is None:
        return up
    return np.asarray(up + gravity * (1.0 if tilt_rad is None else np.cos(tilt_rad)))


def leaning(acceleration: FloatArray, gravity: float | None) -> FloatArray:
    """The angle between the specific force along the world's axes (n, 3) and the vertical, rad."""
    across = np.hypot(acceleration[:, 0], acceleration[:, 1])
    return np.asarray(np.arctan2(across, acceleration[:, 2] + (gravity or 0.0)))


def faults(
    acceleration: FloatArray,
    velocity: FloatArray,
    height: FloatArray,
    flying: BoolArray,
    step_s: float,
    said: tuple[Literal["included", "removed"], Literal["body", "world"], float],
) -> list[Fault]:
    """What the samples that are `flying` (n,) contradict, the surest first.

    Acceleration and velocity (n,) or (n, 3), the last axis up, and height (n,) are as declared, in
    SI, at steps of `step_s`; `said` is gravity and axes as declared, and g in m/s^2.
    """
    gravity, axes, g = said
    (up, sideways), (climb, drift) = _split(acceleration), _split(velocity)
    span = max(round(SPAN_S / step_s), 1)
    contradictions = []
    rate = _slope(_change(height, span, step_s), _level(climb, span), flying, STILL)
    if rate is not None and not SLOPES[0] <= rate <= SLOPES[1]:
        remedy = _scaled("velocity", rate) if rate > 0 else "velocity.sign = -1, or height.sign?"
        what = f"the height changes by {rate:.3g} of what the velocity says"
        contradictions.append(Fault("velocity", what, remedy))
        return contradictions
    if not np.isfinite(up[flying]).any():
        return contradictions
    mean = float(np.nanmean(up[flying])) / g
    expected = 1.0 if gravity == "included" else 0.0
    pull = _slope(_level(up, span), _change(climb, span, step_s), flying, STILL)
    if pull is not None and not SLOPES[0] <= pull <= SLOPES[1]:
        remedy = {True: 'unit = "g"?', False: 'unit = "m/s^2"?'}[pull < SLOPES[0]]
        if pull < 0:
            remedy = "sign = -1?"
        what = f"it changes by {pull:.3g} of what the velocity's change says"
        contradictions.append(Fault("acceleration", what, remedy))
    elif not abs(mean - expected) <= OFF:
        what = f"its mean in flight is {mean:.3g} g, and with gravity {gravity} it is {expected:g}"
        if abs(mean - (1 - expected)) <= OFF:
            other = "removed" if gravity == "included" else "included"
            remedy = f'gravity = "{other}"?'
        elif abs(mean + expected) <= OFF:
            remedy = "sign = -1?"
        else:
            unit, ratio = ("g", abs(mean) * g) if abs(mean) < 0.5 else ("m/s^2", abs(mean) / g)
            remedy = f'unit = "{unit}"?' if abs(ratio - 1) <= OFF else "name another column"
        contradictions.append(Fault("acceleration", what, remedy))
    if not contradictions and sideways is not None and drift is not None:
        sides = zip(sideways, drift, strict=True)
        pairs = [(_level(a, span), _change(v, span, step_s)) for a, v in sides]
        both = [_slope(a, v, flying, 2 * STILL, 0.0) for a, v in pairs]
        slopes = [slope for slope in both if slope is not None]
        follows = max(slopes, key=lambda s: -abs(s - 1), default=math.nan)
        if axes == "body" and abs(follows - 1) < 0.35:
            what = f"sideways it is {follows:.3g} of the velocity's change: along the world's axes"
            contradictions.append(Fault("acceleration", what, 'axes = "world"'))
        elif axes == "world" and slopes and max(slopes) < 0.5:
            what = f"sideways it is {follows:.3g} of the velocity's change: along the vehicle's own"
            contradictions.append(Fault("acceleration", what, 'axes = "body"'))
    return contradictions


def silent(series: Mapping[str, FloatArray], flying: BoolArray) -> list[Fault]:
    """Series (n,) by key that hold no number, or say one thing throughout, in flight or, where
    nothing flies, at all; a set-point may stay where it is.
    """
    contradictions = []
    where = flying if flying.any() else np.ones_like(flying)
    for key, values in series.items():
        known = values[where & np.isfinite(values)]
        if key == "setpoint":
            if not len(known):
                contradictions.append(Fault(key, "it holds no number in flight", "take it away"))
        elif not np.isfinite(values).any():
            contradictions.append(Fault(key, "it holds no number", "name another column"))
        elif len(known) and not np.ptp(known) and not (key == "command" and known[0] >= FULL):
            # motors at their full command have a code of their own
            what = f"it is {known[0]:.4g} throughout"
            contradictions.append(Fault(key, what, "name the column that changes with the flight"))
    return contradictions


def apart(
    supply_V: FloatArray | None,
    setpoint_m: FloatArray | None,
    height_m: FloatArray,
    flying: BoolArray,
) -> list[Fault]:
    """A supply that no battery has, and a set-point that the height follows in another unit."""
    contradictions = []
    if supply_V is not None and np.isfinite(supply_V[flying]).any():
        volts = float(np.nanmedian(supply_V[flying]))
        if not SUPPLY_V[0] <= volts <= SUPPLY_V[1]:
            unit = 'unit = "mV"?' if volts > 0 else "name another column"
            remedy = 'unit = "V"?' if 0 < volts < SUPPLY_V[0] else unit
            contradictions.append(Fault("supply", f"its median in flight is {volts:.4g} V", remedy))
    if setpoint_m is not None:
        followed = _slope(height_m, setpoint_m, flying, RESTS_M)
        if followed is not None and not SLOPES[0] <= followed <= SLOPES[1]:
            what = f"the height changes by {followed:.3g} of what it asks for"
            contradictions.append(Fault("setpoint", what, "mend its unit or sign"))
    return contradictions


def _split(values: FloatArray) -> tuple[FloatArray, list[FloatArray] | None]:
    """What points up, and what points sideways, where that was logged."""
    if values.ndim == 1:
        return values, None
    return values[:, 2], [values[:, 0], values[:, 1]]


def _level(values: FloatArray, span: int) -> FloatArray:
    """The mean over as long as `_change` takes."""
    kernel = np.ones(2 * span + 1) / (2 * span + 1)
    return np.asarray(np.convolve(values, kernel, mode="same"))


def _change(values: FloatArray, span: int, step_s: float) -> FloatArray:
    """The change per second over `span` samples to either side, NaN at the ends."""
    out = np.full(len(values), np.nan)
    out[span:-span] = (values[2 * span :] - values[: -2 * span]) / (2 * span * step_s)
    return out


def _slope(
    y: FloatArray, x: FloatArray, where: BoolArray, still: float, apart: float | None = None
) -> float | None:
    """The slope of y on x, and `apart` where y does not go with it; without that the slope between
    that of y on x and of x on y, since noise in x makes the one too small (in quiet hover by half),
    and None where y does not go with x. None, too, where x hardly moves.
    """
    good = where & np.isfinite(x) & np.isfinite(y)
    if good.sum() < FEWEST:
        return None
    x, y = x[good] - x[good].mean(), y[good] - y[good].mean()
    if float(np.sqrt(np.mean(x**2))) < still:
        return None
    both, across = float(np.mean(x * y)), float(np.sqrt(np.mean(x**2) * np.mean(y**2)))
    if abs(both) <= TELLING * across:
        return apart
    slope = both / float(np.mean(x**2))
    return slope if apart is not None else slope * across / abs(both)


def _scaled(key: str, ratio: float) -> str:
    """What a factor between two series makes of the unit of one."""
    names = {1e-3: "thousandth", 1e-2: "hundredth", 1e2: "hundred times", 1e3: "thousand times"}
    near = [word for factor, word in names.items() if 0.7 < ratio / factor < 1.4]
    return f"{key}.unit, height.unit or the clock's is off: a {near[0]}" if near else f"{key}.unit?"
