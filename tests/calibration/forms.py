"""The simulator's physics: base curves, each named effect in two forms, and effects that no library
holds.

Written from the published formulas; shares no code with nearlift. The own form of an effect is the
printed one; the foreign form has the same cause and another shape. A form is scaled by one amplitude
and does nothing at 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from tests.calibration.bench import RADIUS, SPACING, Array, Bench

Place = Literal["height", "ratio", "gain", "force"]
D, B = SPACING / RADIUS, np.sqrt(2) * SPACING / RADIUS
COEFFICIENTS = {
    "ground": {"K_b": 2.0},
    "ceiling": {"alpha": 0.125},
    "sidewall": {"a": 0.05, "lambda_": 0.5},
}
HEADLINE = {"ground": "K_b", "ceiling": "alpha", "sidewall": "a"}
BOUNDARIES = ("ground", "ceiling", "sidewall")


def sanchez_cuevas(
    z: Array,
    K_b: float | Array,
    *,
    single: float = 1.0,
    neighbours: float = 1.0,
    spacing: float = D,
    body: float | None = None,
) -> Array:
    """Four rotors over a plane, original form: images of the rotor itself, of the two adjacent and
    of the opposite one, and the fountain under the body.
    """
    body = np.sqrt(2) * spacing if body is None else body
    below = 1 / (16 * z**2)
    beside = z / np.sqrt((spacing**2 + 4 * z**2) ** 3)
    beside = beside + 0.5 * z / np.sqrt((2 * spacing**2 + 4 * z**2) ** 3)
    fountain = 2 * K_b * z / np.sqrt((body**2 + 4 * z**2) ** 3)
    return 1 / (1 - single * below - neighbours * beside - fountain)


def ratio(boundary: str, z: Array, theta: dict[str, float], spacing: float = D) -> Array:
    """L / L_inf of the base model; `spacing` is that of adjacent rotors over the radius."""
    if boundary == "ground":
        return sanchez_cuevas(z, theta["K_b"], spacing=spacing)
    if boundary == "ceiling":
        return 0.5 + 0.5 * np.sqrt(1 + theta["alpha"] / z**2)
    return 1 - theta["a"] * np.exp(-z / theta["lambda_"])


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What a form depends on: the bench, the base curve's coefficients, and lift far away."""

    bench: Bench
    theta: dict[str, float]
    levels_N: Array

    @property
    def inf_N(self) -> Array:
        """Lift far away at each trial's throttle."""
        return self.levels_N[self.bench.level]

    def curve(self, z: Array) -> Array:
        """The base curve."""
        return ratio(self.bench.boundary, z, self.theta)

    @property
    def load(self) -> Array:
        """Lift far away over that of the highest throttle."""
        return self.inf_N / self.levels_N.max()


@dataclass(frozen=True, kw_only=True)
class Form:
    """One shape of one effect.

    `apply` takes (value, bench, setting, amplitude). The value is z_hat for `height`, L / L_inf for
    `ratio`, and lift in N for `force`; a `gain` takes None and returns the logarithm of a factor.
    `most` is the largest physically possible amplitude, per boundary.
    """

    place: Place
    apply: Callable[..., Array]
    most: dict[str, float]
    signed: bool = True


def _form(
    place: Place, apply: Callable[..., Array], most: float | dict[str, float], signed: bool = True
) -> Form:
    limits = dict.fromkeys(BOUNDARIES, most) if isinstance(most, float) else most
    return Form(place=place, apply=apply, most=limits, signed=signed)


def _pair(
    place: Place,
    own: Callable[..., Array],
    foreign: Callable[..., Array],
    most: float | dict[str, float],
    foreign_most: float | dict[str, float] | None = None,
    signed: bool = True,
) -> tuple[Form, Form]:
    return (
        _form(place, own, most, signed),
        _form(place, foreign, most if foreign_most is None else foreign_most, signed),
    )


def _at(ground: float, ceiling: float, sidewall: float) -> dict[str, float]:
    return {"ground": ground, "ceiling": ceiling, "sidewall": sidewall}


def _coned(z: Array, b: Bench, s: Setting, x: float) -> Array:
    """Blades cone in proportion to thrust, and the plane rises with them."""
    return z + x / b.radius_m * (0.4 + 0.6 * s.load / s.load.mean())


def _play(z: Array, b: Bench, s: Setting, x: float) -> Array:
    return z - b.approach * 0.5 * x / b.radius_m * (1 - np.exp(-b.move_m / 0.005))


def _saturate(f: Array, b: Bench, s: Setting, x: float) -> Array:
    """Gain capped like a step; `x` is the undisturbed gain at the nearest station over the cap."""
    gain = f - 1
    nearest = np.abs(s.curve(np.array([b.z_hat.min()])) - 1)
    return 1 + gain / (1 + (x * np.abs(gain) / nearest) ** 6) ** (1 / 6)


def _held(f: Array, b: Bench, s: Setting, x: float) -> Array:
    strength = np.abs(np.log(f))
    return f ** (1 + 1.6 * x * (1 - np.exp(-2 * strength / strength.max())))


def _images(change: Callable[[float], dict[str, float]]) -> Callable[..., Array]:
    """The base curve of the ground with other strengths of images or another body."""

    def apply(f: Array, b: Bench, s: Setting, x: float) -> Array:
        return f * sanchez_cuevas(b.z_hat, s.theta["K_b"], **change(x)) / s.curve(b.z_hat)

    return apply


def _tilted(f: Array, b: Bench, s: Setting, x: float) -> Array:
    """Rotors of an inclined vehicle at different heights, thrust inclined (E23); `x` = 1 is the
    image theory's size.
    """
    z, angle = b.z_hat, b.tilt_rad + b.unit["levelling"]
    if b.boundary == "sidewall":
        lean = s.curve(np.maximum(z + 1.3 * np.tan(angle), 0.3 * z))
    else:
        half = 0.5 * D * np.tan(angle)
        up, down = (s.curve(np.maximum(z + h, 0.3 * z)) for h in (half, -half))
        lean = 0.5 * (up + down)
    return f * (1 + x * (lean / s.curve(z) * np.cos(angle) - 1))


def _tilt_fade(f: Array, b: Bench, s: Setting, x: float) -> Array:
    angle = b.tilt_rad + b.unit["levelling"]
    return 1 + (f - 1) * np.maximum(1 - x * (angle / np.radians(5)) ** 2, 0)


def _density(kelvin: Array) -> Array:
    """Air at 1013.25 hPa and 50 % relative humidity (C5)."""
    celsius = kelvin - 273.15
    vapour = 0.5 * 610.94 * np.exp(17.625 * celsius / (celsius + 243.04))
    return (101325 - vapour) / (287.058 * kelvin) + vapour / (461.495 * kelvin)


def _drifting(_: None, b: Bench, s: Setting, x: float) -> Array:
    """Half of the campaigns relax exponentially, half walk at random."""
    t = b.start_s / b.start_s.max()
    return x * np.where(b.unit["coin"] > 0.5, b.unit["walk"], 1 - np.exp(-4 * t))


def _starved(_: None, b: Bench, s: Setting, x: float) -> Array:
    drop = 0.04 * b.current_A * (1 + 1.5 * b.charge**2)
    return x * np.log((b.supply_V - drop) / 3.7)


def _reaction(b: Bench, s: Setting) -> Array:
    """Force on the cell at each trial."""
    return s.inf_N * s.curve(b.z_hat)


def _crept(lift: Array, b: Bench, s: Setting, x: float) -> Array:
    before = _reaction(b, s)[b.previous]
    return lift + x * (0.7 * before + 0.3 * before[b.previous]) / (1 + b.gap_s / 12)


def _tethered(lift: Array, b: Bench, s: Setting, x: float) -> Array:
    return lift + x * b.radius_m * np.maximum(b.z_hat - np.median(b.z_hat), 0) ** 1.5


def _bump(z: Array) -> Array:
    return np.exp(-(((z - 1.8) / 0.6) ** 2))


def _warmed(_: None, b: Bench, s: Setting, x: float) -> Array:
    return x * np.exp(-np.sqrt(b.session_s / 500)) * (0.6 + 0.8 * s.load)


#: Each named effect: own form, foreign form.
NAMED: dict[str, tuple[Form, Form]] = {
    "height_offset": _pair(
        "height",
        lambda z, b, s, x: z + x / b.radius_m,
        _coned,
        _at(5e-3, 1e-3, 1.5e-3),
        _at(5e-3, 0.8e-3, 1e-3),
    ),
    "height_scale": _pair(
        "height",
        lambda z, b, s, x: z * (1 + x),
        lambda z, b, s, x: z * (1 + x * (1 - np.exp(-z / 2))),
        0.05,
        0.08,
    ),
    "approach_backlash": _pair(
        "height",
        lambda z, b, s, x: z - b.approach * 0.5 * x / b.radius_m,
        _play,
        _at(0.8e-3, 0.5e-3, 0.8e-3),
    ),
    "near_wall_saturation": (
        _form("height", lambda z, b, s, x: np.sqrt(z**2 + x**2), _at(0.5, 0.3, 0.3), signed=False),
        _form("ratio", _saturate, 1.5, signed=False),
    ),
    "held_quantity": _pair("ratio", lambda f, b, s, x: f ** (1 + x), _held, 0.4),
    "airframe_stagnation": _pair(
        "ratio",
        lambda f, b, s, x: f + x / b.z_hat**2,
        lambda f, b, s, x: f + x * np.exp(-((b.z_hat / 1.3) ** 2)),
        {"ground": 0.05},
        {"ground": 0.06},
    ),
    "fountain_shape": _pair(
        "ratio",
        _images(lambda x: {"body": B * (1 + x)}),
        lambda f, b, s, x: f + x * _bump(b.z_hat),
        {"ground": 0.4},
        {"ground": 0.04},
    ),
    "image_strength": _pair(
        "ratio",
        _images(lambda x: {"single": 1 + x, "neighbours": 1 + x}),
        _images(lambda x: {"neighbours": 1 + x}),
        {"ground": 0.5},
        {"ground": 0.8},
    ),
    "plate_edge": _pair(
        "ratio",
        lambda f, b, s, x: 1 + (f - 1) * -np.expm1(-1 / np.maximum(x * b.z_hat, 1e-6) ** 2),
        lambda f, b, s, x: 1 + (f - 1) / (1 + (x * b.z_hat) ** 3),
        0.6,
        0.5,
        signed=False,
    ),
    "tilt": _pair("ratio", _tilted, _tilt_fade, 4.0, 1.0, signed=False),
    "reynolds": _pair(
        "ratio",
        lambda f, b, s, x: 1 + (f - 1) * (b.speed_rpm / 17000) ** x,
        lambda f, b, s, x: 1 + (f - 1) * (1 + x * np.exp(-(b.speed_rpm - 10800) / 3000)),
        0.6,
        0.5,
    ),
    "room_recirculation": _pair(
        "gain",
        lambda _, b, s, x: -x * np.sqrt(s.load) * (1 - np.exp(-b.z_hat / 4)),
        lambda _, b, s, x: -x * s.load * b.z_hat**2 / (b.z_hat**2 + 36),
        0.06,
        signed=False,
    ),
    "session_gain": _pair(
        "gain",
        lambda _, b, s, x: x * b.unit["session"],
        lambda _, b, s, x: x * b.unit["session"] * (1 + 0.7 * np.exp(-b.session_s / 900)),
        0.05,
        signed=False,
    ),
    "gain_drift": _pair(
        "gain",
        lambda _, b, s, x: x * (b.start_s / b.start_s.max() - 0.5),
        _drifting,
        0.08,
        0.06,
    ),
    "warm_up": _pair("gain", lambda _, b, s, x: x * np.exp(-b.session_s / 480), _warmed, 0.1),
    "supply_sag": _pair(
        "gain", lambda _, b, s, x: x * np.log(b.supply_V / 3.8), _starved, 2.5, signed=False
    ),
    "air_density": _pair(
        "gain",
        lambda _, b, s, x: x * np.log(_density(b.temperature_K) / 1.19),
        lambda _, b, s, x: x * np.log(_density(b.lagged_K) / 1.19),
        1.5,
        signed=False,
    ),
    "zero_offset": _pair(
        "force",
        lambda lift, b, s, x: lift + x,
        lambda lift, b, s, x: lift + x * (0.3 + s.load),
        0.01,
    ),
    "zero_drift": _pair(
        "force",
        lambda lift, b, s, x: lift - x * np.expm1(-b.session_s / 1500),
        lambda lift, b, s, x: (
            lift + x * np.sqrt(b.session_s / 4000) * (1 + 0.4 * b.unit["session"])
        ),
        0.02,
    ),
    "zero_temperature": _pair(
        "force",
        lambda lift, b, s, x: lift + x * (b.temperature_K - 295),
        lambda lift, b, s, x: lift + x * ((k := b.lagged_K - 295) + 0.25 * k**2),
        3e-3,
    ),
    "cell_nonlinearity": _pair(
        "force",
        lambda lift, b, s, x: lift * (1 + x * lift / s.levels_N.max()),
        lambda lift, b, s, x: lift * (1 + x * (lift / s.levels_N.max()) ** 2),
        0.1,
        0.08,
    ),
    "cell_creep": _pair(
        "force",
        lambda lift, b, s, x: lift + x * _reaction(b, s)[b.previous] * np.exp(-b.gap_s / 20),
        _crept,
        0.01,
    ),
    "tether_stiffness": _pair(
        "force", lambda lift, b, s, x: lift + x * b.radius_m * b.z_hat, _tethered, 0.04
    ),
}


def _blocked(_: None, b: Bench, s: Setting, x: float) -> Array:
    return np.log1p(-x * b.unit["inverted"] * (0.6 + 0.4 * np.tanh(b.z_hat / 2)))


def _crossed(_: None, b: Bench, s: Setting, x: float) -> Array:
    return np.log1p(x * np.cos(b.unit["turn"] - 0.6) * (1 + 0.5 * np.exp(-b.z_hat)))


def _two_states(f: Array, b: Bench, s: Setting, x: float) -> Array:
    jets = sanchez_cuevas(b.z_hat, s.theta["K_b"] + x * b.unit["state"])
    return f * jets / s.curve(b.z_hat)


#: Effects that can be identified only where a bench ran trials in two ways (`Spec.experiments`).
EXPERIMENTS: dict[str, tuple[Form, Form]] = {
    "mount_blockage": _pair(
        "gain", lambda _, b, s, x: np.log1p(-x * b.unit["inverted"]), _blocked, 0.08
    ),
    "cell_crosstalk": _pair(
        "gain", lambda _, b, s, x: np.log1p(x * np.cos(b.unit["turn"] - 0.6)), _crossed, 0.05
    ),
    "propeller_step": _pair(
        "gain",
        lambda _, b, s, x: np.log1p(x * b.unit["propeller"]),
        lambda _, b, s, x: np.log1p(x * b.unit["propeller"] * (0.7 + 0.6 * s.load)),
        0.05,
    ),
    "fountain_state": _pair(
        "ratio",
        _two_states,
        lambda f, b, s, x: f + x * b.unit["state"] * _bump(b.z_hat),
        {"ground": 1.5},
        {"ground": 0.03},
    ),
}


def _one_throttle(_: None, b: Bench, s: Setting, x: float) -> Array:
    log_z = np.log(b.z_hat)
    low, high = np.log(b.z_hat.min()), np.log(b.z_hat.max())
    place = low + b.unit["bump_at"] * (high - low)
    bump = np.exp(-(((log_z - place) / (0.12 * (high - low))) ** 2))
    return x * (b.level == b.unit["bump_level"]) * bump


def _resonance(_: None, b: Bench, s: Setting, x: float) -> Array:
    wave = np.sin(2 * np.pi * b.z_hat * b.speed_rpm / 17000 / 0.9 + b.unit["phase"])
    return x * wave / (1 + b.z_hat / 3)


def _wave(turns: Callable[[Bench, Setting], Array]) -> Callable[..., Array]:
    return lambda _, b, s, x: x * np.sin(2 * np.pi * turns(b, s) + b.unit["phase"])


#: Effects outside every library.
UNNAMED: dict[str, Form] = {
    name: _form("gain", apply, 0.05, signed=False)
    for name, apply in {
        "distance_ripple": _wave(lambda b, s: np.log(b.z_hat) / np.log(1.7)),
        "clock_ripple": _wave(lambda b, s: b.start_s / 2800),
        "damage_step": lambda _, b, s, x: -x * b.unit["step"],
        "resonance_ripple": _resonance,
        "parity": lambda _, b, s, x: x * (1 - 2.0 * (np.cumsum(np.ones(b.n)) % 2)),
        "hidden_humidity": lambda _, b, s, x: x * b.unit["hidden"],
        "throttle_bump": _one_throttle,
        "bistability": lambda _, b, s, x: x * b.unit["state"],
        "converter_wave": _wave(lambda b, s: _reaction(b, s) / 0.03),
        "first_in_visit": lambda _, b, s, x: -x * (b.order == 0),
    }.items()
}


def _travelled(b: Bench) -> Array:
    """Way up of the traverse since it was homed in the morning, m."""
    up = (b.order == 0) & (np.diff(b.z_hat, prepend=b.z_hat[0]) > 0)
    way = np.cumsum(np.where(up, b.move_m, 0.0))
    homed = [way[b.session == k].min() for k in range(b.session.max() + 1)]
    return way - np.array(homed)[b.session]


def _dragged(b: Bench) -> Array:
    """Pull of a cable that follows the traverse up to its Coulomb limit, -1 to 1: play of 4 mm."""
    pull, last, z = np.zeros(b.n), 0.0, b.z_hat * b.radius_m / 0.004
    for i, step in enumerate(np.diff(z, prepend=z[0]).tolist()):
        pull[i] = last = min(max(last + step, -1.0), 1.0)
    return pull


def _autorange(lift: Array, b: Bench, s: Setting, x: float) -> Array:
    """The threshold lies within the forces of the middle throttle."""
    level = b.level == np.unique(b.level)[len(s.levels_N) // 2]
    here = _reaction(b, s)[level]
    return lift * (1 + x * (lift > np.quantile(here, b.unit["range_at"][0])))


def _seated(_: None, b: Bench, s: Setting, x: float) -> Array:
    return -x * b.unit["seating"] * b.current_A / b.current_A.max()


def _spooling(_: None, b: Bench, s: Setting, x: float) -> Array:
    return -x * np.maximum(b.throttle - b.throttle[b.previous], 0.0)


#: Outside every library too, from laboratories: none is a step in time, a ripple, or periodic.
STRANGE: dict[str, Form] = {
    # the stepper loses steps on each way up, always in the same direction, until it is homed
    "lost_steps": _form(
        "height",
        lambda z, b, s, x: z - x * _travelled(b) / b.radius_m,
        {"ground": 4e-3, "ceiling": 1e-3},
    ),
    # two people take turns at setting the distance by eye, each with a parallax
    "parallax": _form(
        "height", lambda z, b, s, x: z + x * b.unit["reader"] / b.radius_m, _at(5e-3, 0.8e-3, 2e-3)
    ),
    # a loop of the cable sticks to the guide and pulls towards where the traverse came from
    "cable_drag": _form("force", lambda lift, b, s, x: lift + x * _dragged(b), 0.02),
    # a battery's plug costs voltage in proportion to current, behind the voltmeter
    "contact_resistance": _form("gain", _seated, 0.1, signed=False),
    # the record begins a fixed moment after the command, so a trial after a slower one spools up
    "spool_up": _form("gain", _spooling, 0.3, signed=False),
    # the converter settles incompletely: force carries a little of the inclinometer's voltage
    "multiplexer": _form("force", lambda lift, b, s, x: lift + x * b.tilt_rad, 0.5),
    # the amplifier's two ranges differ in gain
    "autorange": _form("force", _autorange, 0.05),
    # a ventilation comes and goes, and blows into wakes that no boundary shelters
    "draught": _form(
        "gain",
        lambda _, b, s, x: -x * b.unit["draught"] * b.z_hat / (b.z_hat + 2.0),
        0.06,
        signed=False,
    ),
}


def form(kind: str, foreign: bool) -> Form:
    """The form of any effect."""
    outside = STRANGE | UNNAMED
    return outside[kind] if kind in outside else (NAMED | EXPERIMENTS)[kind][foreign]


def names(boundary: str) -> tuple[str, ...]:
    """Named effects that exist at a boundary."""
    return tuple(name for name, (own, _) in NAMED.items() if boundary in own.most)
