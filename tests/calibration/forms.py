"""The referee's own physics: base curves, every named effect in two forms, and effects that no
library holds.

Written from the published formulas; shares no code with nearlift. The
`own` form of an effect is the printed one, the `foreign` form has the same cause and another shape.
A form is scaled by one amplitude and does nothing at 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from tests.calibration.bench import RADIUS, SPACING, Bench

Place = Literal["height", "ratio", "gain", "force"]
Array = np.ndarray
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
    K_b: float,
    *,
    single: float = 1.0,
    neighbours: float = 1.0,
    spacing: float = D,
    body: float | None = None,
) -> Array:
    """Four rotors over a plane, original form: one image below each, two beside, one across, and
    the fountain under the body.
    """
    body = np.sqrt(2) * spacing if body is None else body
    below = 1 / (16 * z**2)
    beside = z / np.sqrt((spacing**2 + 4 * z**2) ** 3) + 0.5 * z / np.sqrt(
        (2 * spacing**2 + 4 * z**2) ** 3
    )
    fountain = 2 * K_b * z / np.sqrt((body**2 + 4 * z**2) ** 3)
    return 1 / (1 - single * below - neighbours * beside - fountain)


def ratio(boundary: str, z: Array, theta: dict[str, float], spacing: float = D) -> Array:
    """Lift over lift far away of the base model; `spacing` is that of adjacent rotors over the
    radius.
    """
    if boundary == "ground":
        return sanchez_cuevas(z, theta["K_b"], spacing=spacing)
    if boundary == "ceiling":
        return 0.5 + 0.5 * np.sqrt(1 + theta["alpha"] / z**2)
    return 1 - theta["a"] * np.exp(-z / theta["lambda_"])


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What a form may look at: the bench, the base curve's coefficients, and forces far away."""

    bench: Bench
    theta: dict[str, float]
    levels_N: Array

    @property
    def inf_N(self) -> Array:
        """Lift far away of each trial's throttle."""
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

    `apply` takes (what it acts on, setting, amplitude): z_hat for `height`, L / L_inf for `ratio`,
    nothing (None) for `gain`, where it returns the logarithm of a factor, lift in N for `force`.
    `most` bounds the amplitude by what is physically possible, per boundary. `because` is what
    happens in the laboratory, where no catalogue says it.
    """

    place: Place
    apply: Callable[..., Array]
    most: dict[str, float]
    signed: bool = True
    because: str = ""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A named cause: the published shape, and one that differs."""

    name: str
    own: Form
    foreign: Form


def _all(x: float) -> dict[str, float]:
    return dict.fromkeys(BOUNDARIES, x)


def _form(
    place: Place, apply: Callable[..., Array], most: float | dict[str, float], signed: bool = True
) -> Form:
    return Form(
        place=place,
        apply=apply,
        most=_all(most) if isinstance(most, float) else most,
        signed=signed,
    )


def _coning(s: Setting) -> Array:
    """Blades cone in proportion to thrust, and the plane rises with them."""
    return 0.4 + 0.6 * s.load / s.load.mean()


def _saturate(f: Array, s: Setting, x: float) -> Array:
    """Gain capped like a step; `x` is the undisturbed gain at the nearest station over the cap."""
    gain = f - 1
    nearest = np.abs(s.curve(np.array([s.bench.z_hat.min()])) - 1)
    return 1 + gain / (1 + (x * np.abs(gain) / nearest) ** 6) ** (1 / 6)


def _tilted(f: Array, s: Setting, x: float) -> Array:
    """Rotors of an inclined vehicle stand at different heights, and thrust leans (E23); `x` = 1 is
    the image theory's size.
    """
    z = s.bench.z_hat
    angle = s.bench.tilt_rad + s.bench.unit["levelling"]
    if s.bench.boundary == "sidewall":
        lean = s.curve(np.maximum(z + 1.3 * np.tan(angle), 0.3 * z))
    else:
        half = 0.5 * D * np.tan(angle)
        lean = 0.5 * (
            s.curve(np.maximum(z + half, 0.3 * z)) + s.curve(np.maximum(z - half, 0.3 * z))
        )
    return f * (1 + x * (lean / s.curve(z) * np.cos(angle) - 1))


def _tilt_fade(f: Array, s: Setting, x: float) -> Array:
    angle = s.bench.tilt_rad + s.bench.unit["levelling"]
    return 1 + (f - 1) * np.maximum(1 - x * (angle / np.radians(5)) ** 2, 0)


def _density(kelvin: Array) -> Array:
    """Air at 1013.25 hPa and 50 % relative humidity (C5)."""
    celsius = kelvin - 273.15
    vapour = 0.5 * 610.94 * np.exp(17.625 * celsius / (celsius + 243.04))
    return (101325 - vapour) / (287.058 * kelvin) + vapour / (461.495 * kelvin)


def _drifting(_: None, s: Setting, x: float) -> Array:
    """Half of the campaigns relax exponentially, half walk at random."""
    t = s.bench.start_s / s.bench.start_s.max()
    return x * np.where(s.bench.unit["coin"] > 0.5, s.bench.unit["walk"], 1 - np.exp(-4 * t))


def _before(s: Setting, steps: int) -> Array:
    """Lift of an earlier trial, N; `previous` chains back and stops at the first."""
    at = s.bench.previous
    for _ in range(steps - 1):
        at = s.bench.previous[at]
    return (s.inf_N * s.curve(s.bench.z_hat))[at]


KINDS = (
    Kind(
        name="height_offset",
        own=_form(
            "height",
            lambda z, s, x: z + x / s.bench.radius_m,
            {"ground": 5e-3, "ceiling": 1e-3, "sidewall": 1.5e-3},
        ),
        foreign=_form(
            "height",
            lambda z, s, x: z + x / s.bench.radius_m * _coning(s),
            {"ground": 5e-3, "ceiling": 0.8e-3, "sidewall": 1e-3},
        ),
    ),
    Kind(
        name="height_scale",
        own=_form("height", lambda z, s, x: z * (1 + x), 0.05),
        foreign=_form("height", lambda z, s, x: z * (1 + x * (1 - np.exp(-z / 2))), 0.08),
    ),
    Kind(
        name="approach_backlash",
        own=_form(
            "height",
            lambda z, s, x: z - s.bench.approach * 0.5 * x / s.bench.radius_m,
            {"ground": 0.8e-3, "ceiling": 0.5e-3, "sidewall": 0.8e-3},
        ),
        foreign=_form(
            "height",
            lambda z, s, x: (
                z
                - s.bench.approach
                * 0.5
                * x
                / s.bench.radius_m
                * (1 - np.exp(-s.bench.move_m / 0.005))
            ),
            {"ground": 0.8e-3, "ceiling": 0.5e-3, "sidewall": 0.8e-3},
        ),
    ),
    Kind(
        name="near_wall_saturation",
        own=_form(
            "height",
            lambda z, s, x: np.sqrt(z**2 + x**2),
            {"ground": 0.5, "ceiling": 0.3, "sidewall": 0.3},
            signed=False,
        ),
        foreign=_form("ratio", _saturate, 1.5, signed=False),
    ),
    Kind(
        name="held_quantity",
        own=_form("ratio", lambda f, s, x: f ** (1 + x), 0.4),
        foreign=_form(
            "ratio",
            lambda f, s, x: (
                f ** (1 + 1.6 * x * (1 - np.exp(-2 * np.abs(np.log(f)) / np.abs(np.log(f)).max())))
            ),
            0.4,
        ),
    ),
    Kind(
        name="airframe_stagnation",
        own=_form("ratio", lambda f, s, x: f + x / s.bench.z_hat**2, {"ground": 0.05}),
        foreign=_form(
            "ratio", lambda f, s, x: f + x * np.exp(-((s.bench.z_hat / 1.3) ** 2)), {"ground": 0.06}
        ),
    ),
    Kind(
        name="fountain_shape",
        own=_form(
            "ratio",
            lambda f, s, x: (
                f
                * sanchez_cuevas(s.bench.z_hat, s.theta["K_b"], body=B * (1 + x))
                / s.curve(s.bench.z_hat)
            ),
            {"ground": 0.4},
        ),
        foreign=_form(
            "ratio",
            lambda f, s, x: f + x * np.exp(-(((s.bench.z_hat - 1.8) / 0.6) ** 2)),
            {"ground": 0.04},
        ),
    ),
    Kind(
        name="image_strength",
        own=_form(
            "ratio",
            lambda f, s, x: (
                f
                * sanchez_cuevas(s.bench.z_hat, s.theta["K_b"], single=1 + x, neighbours=1 + x)
                / s.curve(s.bench.z_hat)
            ),
            {"ground": 0.5},
        ),
        foreign=_form(
            "ratio",
            lambda f, s, x: (
                f
                * sanchez_cuevas(s.bench.z_hat, s.theta["K_b"], neighbours=1 + x)
                / s.curve(s.bench.z_hat)
            ),
            {"ground": 0.8},
        ),
    ),
    Kind(
        name="plate_edge",
        own=_form(
            "ratio",
            lambda f, s, x: 1 + (f - 1) * -np.expm1(-1 / np.maximum(x * s.bench.z_hat, 1e-6) ** 2),
            0.6,
            signed=False,
        ),
        foreign=_form(
            "ratio", lambda f, s, x: 1 + (f - 1) / (1 + (x * s.bench.z_hat) ** 3), 0.5, signed=False
        ),
    ),
    Kind(
        name="tilt",
        own=_form("ratio", _tilted, 4.0, signed=False),
        foreign=_form("ratio", _tilt_fade, 1.0, signed=False),
    ),
    Kind(
        name="reynolds",
        own=_form("ratio", lambda f, s, x: 1 + (f - 1) * (s.bench.speed_rpm / 17000) ** x, 0.6),
        foreign=_form(
            "ratio",
            lambda f, s, x: 1 + (f - 1) * (1 + x * np.exp(-(s.bench.speed_rpm - 10800) / 3000)),
            0.5,
        ),
    ),
    Kind(
        name="room_recirculation",
        own=_form(
            "gain",
            lambda _, s, x: -x * np.sqrt(s.load) * (1 - np.exp(-s.bench.z_hat / 4)),
            0.06,
            signed=False,
        ),
        foreign=_form(
            "gain",
            lambda _, s, x: -x * s.load * s.bench.z_hat**2 / (s.bench.z_hat**2 + 36),
            0.06,
            signed=False,
        ),
    ),
    Kind(
        name="session_gain",
        own=_form("gain", lambda _, s, x: x * s.bench.unit["session"], 0.05, signed=False),
        foreign=_form(
            "gain",
            lambda _, s, x: (
                x * s.bench.unit["session"] * (1 + 0.7 * np.exp(-s.bench.session_s / 900))
            ),
            0.05,
            signed=False,
        ),
    ),
    Kind(
        name="gain_drift",
        own=_form(
            "gain", lambda _, s, x: x * (s.bench.start_s / s.bench.start_s.max() - 0.5), 0.08
        ),
        foreign=_form("gain", _drifting, 0.06),
    ),
    Kind(
        name="warm_up",
        own=_form("gain", lambda _, s, x: x * np.exp(-s.bench.session_s / 480), 0.1),
        foreign=_form(
            "gain",
            lambda _, s, x: x * np.exp(-np.sqrt(s.bench.session_s / 500)) * (0.6 + 0.8 * s.load),
            0.1,
        ),
    ),
    Kind(
        name="supply_sag",
        own=_form("gain", lambda _, s, x: x * np.log(s.bench.supply_V / 3.8), 2.5, signed=False),
        foreign=_form(
            "gain",
            lambda _, s, x: (
                x
                * np.log(
                    (s.bench.supply_V - 0.04 * s.bench.current_A * (1 + 1.5 * s.bench.charge**2))
                    / 3.7
                )
            ),
            2.5,
            signed=False,
        ),
    ),
    Kind(
        name="air_density",
        own=_form(
            "gain",
            lambda _, s, x: x * np.log(_density(s.bench.temperature_K) / 1.19),
            1.5,
            signed=False,
        ),
        foreign=_form(
            "gain", lambda _, s, x: x * np.log(_density(s.bench.lagged_K) / 1.19), 1.5, signed=False
        ),
    ),
    Kind(
        name="zero_offset",
        own=_form("force", lambda lift, s, x: lift + x, 0.01),
        foreign=_form("force", lambda lift, s, x: lift + x * (0.3 + s.load), 0.01),
    ),
    Kind(
        name="zero_drift",
        own=_form("force", lambda lift, s, x: lift - x * np.expm1(-s.bench.session_s / 1500), 0.02),
        foreign=_form(
            "force",
            lambda lift, s, x: (
                lift + x * np.sqrt(s.bench.session_s / 4000) * (1 + 0.4 * s.bench.unit["session"])
            ),
            0.02,
        ),
    ),
    Kind(
        name="zero_temperature",
        own=_form("force", lambda lift, s, x: lift + x * (s.bench.temperature_K - 295), 3e-3),
        foreign=_form(
            "force",
            lambda lift, s, x: (
                lift + x * ((s.bench.lagged_K - 295) + 0.25 * (s.bench.lagged_K - 295) ** 2)
            ),
            3e-3,
        ),
    ),
    Kind(
        name="cell_nonlinearity",
        own=_form("force", lambda lift, s, x: lift * (1 + x * lift / s.levels_N.max()), 0.1),
        foreign=_form(
            "force", lambda lift, s, x: lift * (1 + x * (lift / s.levels_N.max()) ** 2), 0.08
        ),
    ),
    Kind(
        name="cell_creep",
        own=_form(
            "force", lambda lift, s, x: lift + x * _before(s, 1) * np.exp(-s.bench.gap_s / 20), 0.01
        ),
        foreign=_form(
            "force",
            lambda lift, s, x: (
                lift + x * (0.7 * _before(s, 1) + 0.3 * _before(s, 2)) / (1 + s.bench.gap_s / 12)
            ),
            0.01,
        ),
    ),
    Kind(
        name="tether_stiffness",
        own=_form("force", lambda lift, s, x: lift + x * s.bench.radius_m * s.bench.z_hat, 0.04),
        foreign=_form(
            "force",
            lambda lift, s, x: (
                lift
                + x
                * s.bench.radius_m
                * np.maximum(s.bench.z_hat - np.median(s.bench.z_hat), 0) ** 1.5
            ),
            0.04,
        ),
    ),
)

#: Causes that show only where a bench ran trials in two ways on purpose (`Spec.experiments`).
EXPERIMENTS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            name="mount_blockage",
            own=_form("gain", lambda _, s, x: np.log1p(-x * s.bench.unit["inverted"]), 0.08),
            foreign=_form(
                "gain",
                lambda _, s, x: np.log1p(
                    -x * s.bench.unit["inverted"] * (0.6 + 0.4 * np.tanh(s.bench.z_hat / 2))
                ),
                0.08,
            ),
        ),
        Kind(
            name="cell_crosstalk",
            own=_form(
                "gain", lambda _, s, x: np.log1p(x * np.cos(s.bench.unit["turn"] - 0.6)), 0.05
            ),
            foreign=_form(
                "gain",
                lambda _, s, x: np.log1p(
                    x * np.cos(s.bench.unit["turn"] - 0.6) * (1 + 0.5 * np.exp(-s.bench.z_hat))
                ),
                0.05,
            ),
        ),
        Kind(
            name="propeller_step",
            own=_form("gain", lambda _, s, x: np.log1p(x * s.bench.unit["propeller"]), 0.05),
            foreign=_form(
                "gain",
                lambda _, s, x: np.log1p(x * s.bench.unit["propeller"] * (0.7 + 0.6 * s.load)),
                0.05,
            ),
        ),
        Kind(
            name="fountain_state",
            own=_form(
                "ratio",
                lambda f, s, x: (
                    f
                    * sanchez_cuevas(s.bench.z_hat, s.theta["K_b"] + x * s.bench.unit["state"])
                    / s.curve(s.bench.z_hat)
                ),
                {"ground": 1.5},
            ),
            foreign=_form(
                "ratio",
                lambda f, s, x: (
                    f + x * s.bench.unit["state"] * np.exp(-(((s.bench.z_hat - 1.8) / 0.6) ** 2))
                ),
                {"ground": 0.03},
            ),
        ),
    )
}


def _bump(_: None, s: Setting, x: float) -> Array:
    log_z = np.log(s.bench.z_hat)
    low, high = np.log(s.bench.z_hat.min()), np.log(s.bench.z_hat.max())
    place = low + s.bench.unit["bump_at"] * (high - low)
    return (
        x
        * (s.bench.level == s.bench.unit["bump_level"])
        * np.exp(-(((log_z - place) / (0.12 * (high - low))) ** 2))
    )


def _phase(s: Setting) -> Array:
    return s.bench.unit["phase"]


#: Effects without a place in any library. Nothing may take the credit for them.
OUTSIDE = (
    (
        "distance_ripple",
        lambda _, s, x: x * np.sin(2 * np.pi * np.log(s.bench.z_hat) / np.log(1.7) + _phase(s)),
    ),
    ("clock_ripple", lambda _, s, x: x * np.sin(2 * np.pi * s.bench.start_s / 2800 + _phase(s))),
    ("damage_step", lambda _, s, x: -x * s.bench.unit["step"]),
    (
        "resonance_ripple",
        lambda _, s, x: (
            x
            * np.sin(2 * np.pi * s.bench.z_hat * s.bench.speed_rpm / 17000 / 0.9 + _phase(s))
            / (1 + s.bench.z_hat / 3)
        ),
    ),
    ("parity", lambda _, s, x: x * (1 - 2.0 * (np.cumsum(np.ones(s.bench.n)) % 2))),
    ("hidden_humidity", lambda _, s, x: x * s.bench.unit["hidden"]),
    ("throttle_bump", _bump),
    ("bistability", lambda _, s, x: x * s.bench.unit["state"]),
    (
        "converter_wave",
        lambda _, s, x: x * np.sin(2 * np.pi * s.inf_N * s.curve(s.bench.z_hat) / 0.03 + _phase(s)),
    ),
    ("first_in_visit", lambda _, s, x: -x * (s.bench.order == 0)),
)
NAMED: dict[str, Kind] = {k.name: k for k in KINDS}
UNNAMED: dict[str, Form] = {
    name: _form("gain", apply, 0.05, signed=False) for name, apply in OUTSIDE
}


def _travelled(s: Setting) -> Array:
    """Way up that the traverse has gone since it was homed in the morning, m."""
    bench = s.bench
    way = np.cumsum(
        np.where(
            (bench.order == 0) & (np.diff(bench.z_hat, prepend=bench.z_hat[0]) > 0),
            bench.move_m,
            0.0,
        )
    )
    return (
        way
        - np.array([way[bench.session == k].min() for k in range(bench.session.max() + 1)])[
            bench.session
        ]
    )


def _dragged(s: Setting) -> Array:
    """A loop of cable that follows the traverse up to its Coulomb limit, -1 to 1: play of 4 mm."""
    pull, last, z = np.zeros(s.bench.n), 0.0, s.bench.z_hat * s.bench.radius_m / 0.004
    for i, step in enumerate(np.diff(z, prepend=z[0]).tolist()):
        pull[i] = last = min(max(last + step, -1.0), 1.0)
    return pull


def _autorange(lift: Array, s: Setting, x: float) -> Array:
    """The threshold lies within what the throttle nearest to the middle goes through."""
    level = s.bench.level == np.unique(s.bench.level)[len(s.levels_N) // 2]
    here = (s.inf_N * s.curve(s.bench.z_hat))[level]
    return lift * (1 + x * (lift > np.quantile(here, s.bench.unit["range_at"][0])))


def _strange(
    place: Place, apply: Callable[..., Array], most: float | dict[str, float], because: str
) -> Form:
    return replace(_form(place, apply, most, signed=place != "gain"), because=because)


#: Outside every library too, as laboratories go: none is a step in time, a ripple, or periodic.
STRANGE: dict[str, Form] = {
    "lost_steps": _strange(
        "height",
        lambda z, s, x: z - x * _travelled(s) / s.bench.radius_m,
        {"ground": 4e-3, "ceiling": 1e-3},
        "The stepper loses a few steps on each way up, always in the same direction, until it is"
        " homed the next morning.",
    ),
    "parallax": _strange(
        "height",
        lambda z, s, x: z + x * s.bench.unit["reader"] / s.bench.radius_m,
        {"ground": 5e-3, "ceiling": 0.8e-3, "sidewall": 2e-3},
        "Two people take turns at setting the distance by eye, and each reads the scale with a"
        " parallax of his own.",
    ),
    "cable_drag": _strange(
        "force",
        lambda lift, s, x: lift + x * _dragged(s),
        0.02,
        "A loop of the cable sticks to the guide: it pulls one way or the other up to a limit, by"
        " where the traverse came from.",
    ),
    "contact_resistance": _strange(
        "gain",
        lambda _, s, x: -x * s.bench.unit["seating"] * s.bench.current_A / s.bench.current_A.max(),
        0.1,
        "Each battery's plug seats anew, and its contact robs the motors of voltage in proportion"
        " to current, behind the voltmeter.",
    ),
    "spool_up": _strange(
        "gain",
        lambda _, s, x: -x * np.maximum(s.bench.throttle - s.bench.throttle[s.bench.previous], 0.0),
        0.3,
        "The record begins a fixed moment after the command, so that a trial after a slower one"
        " still spools up.",
    ),
    "multiplexer": _strange(
        "force",
        lambda lift, s, x: lift + x * s.bench.tilt_rad,
        0.5,
        "The converter settles incompletely between channels, and force carries a little of the"
        " inclinometer's voltage.",
    ),
    "autorange": _strange(
        "force",
        _autorange,
        0.05,
        "The amplifier changes its range at a certain force, and the two ranges differ in gain.",
    ),
    "draught": _strange(
        "gain",
        lambda _, s, x: -x * s.bench.unit["draught"] * s.bench.z_hat / (s.bench.z_hat + 2.0),
        0.06,
        "A ventilation comes and goes as it likes, and its draught blows into the wake of rotors"
        " that no boundary shelters.",
    ),
}


def form(kind: str, foreign: bool) -> Form:
    """The form of a named or an unnamed effect."""
    if kind in STRANGE:
        return STRANGE[kind]
    if kind in UNNAMED:
        return UNNAMED[kind]
    known = (NAMED | EXPERIMENTS)[kind]
    return known.foreign if foreign else known.own


def names(boundary: str) -> tuple[str, ...]:
    """Named effects that make sense at a boundary."""
    return tuple(k.name for k in KINDS if boundary in k.own.most)
