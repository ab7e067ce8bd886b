"""Every number that the paper states, worked out again.

claims.toml lists them in the paper's order, each with the words, the number, a verdict and an
expression, of the names here, for what the number should be. The test recomputes it and derives the
verdict from the two; a claim that cannot be computed says what would have to be known.
"""

import functools
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from nearlift import catalogue
from nearlift.models.images import (
    SANCHEZ_CUEVAS,
    SANCHEZ_CUEVAS_AS_PRINTED,
    SANCHEZ_CUEVAS_FREE_EXPONENT,
)
from nearlift.models.momentum import gamma

FILE = tomllib.loads(Path(__file__).with_name("claims.toml").read_text(encoding="utf-8"))
CLAIMS, FINDINGS = FILE["claim"], FILE["finding"]

# --- what the paper states and what others measured

R = 0.023  # rotor radius, m
MASS, GRAVITY, DENSITY = 0.027, 9.8, 1.2
L_PAPER = 0.090  # "distance between centers of rotors", m
ADJACENT = 0.06505  # of a Crazyflie 2.0, from its maker's firmware, m
CRAZYFLIE = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
PAPER = {"spacing_hat": L_PAPER / R, "diagonal_hat": math.sqrt(2) * L_PAPER / R}
KP, KD, KI, C_L, STEP, DISTURBANCE = 316.0, 316.0, 31.6, 1.6, 0.1, 0.015
LIFT_PER_F2 = 4 * C_L * DENSITY * R**4  # N s^2
HOVER_HZ = math.sqrt(MASS * GRAVITY / LIFT_PER_F2)
#: Induced velocity of a hovering Crazyflie, m/s.
INDUCED = math.sqrt(MASS * GRAVITY / 4 / (2 * DENSITY * math.pi * R**2))

#: Table 1 as printed, without its unit.
CEILING = np.array([5, 6, 7, 8, 9, 10, 11, 12, 14, 15, 18, 22, 25, 29, 34, 38, 55, 68, 90, 525.0])
GROUND = np.array(
    [57, 58, 59, 60, 61, 62, 63, 64, 66, 68, 70, 74, 77, 82, 86, 90, 108, 121, 142, 577.0]
)
SIDEWALL = np.array(
    [15, 16, 17, 18, 19, 21, 22, 23, 24, 26, 28, 32, 35, 40, 44, 48, 66, 79, 101, 535.0]
)
#: Metres per entry: as printed; as millimetres; as percent of a rotor diameter.
UNIT = {"cm": 1e-2, "mm": 1e-3, "percent of diameter": 0.01 * 2 * R}

#: The maker's thrust stand: PWM %, rpm, gram-force of the whole vehicle.
PWM = np.array(
    [0, 6.25, 12.5, 18.75, 25, 31.25, 37.5, 43.25, 50, 56.25, 62.5, 68.75, 75, 81.25, 87.5, 93.75]
)
# fmt: off
RPM = np.array([0, 4485, 7570, 9374, 10885, 12277, 13522, 14691, 15924, 17174, 18179, 19397, 20539,
                21692, 22598, 23882.0])
# fmt: on
GF = np.array(
    [0, 1.6, 4.8, 7.9, 10.9, 13.9, 17.3, 21.0, 24.4, 28.6, 32.8, 37.3, 41.7, 46.0, 51.9, 57.9]
)


def density_of_humid_air(celsius: float, pressure: float, humidity: float) -> float:
    vapour = humidity * 610.94 * math.exp(17.625 * celsius / (celsius + 243.04))
    kelvin = celsius + 273.15
    return (pressure - vapour) / (287.058 * kelvin) + vapour / (461.495 * kelvin)


def height_where_gamma_is(value: float) -> float:
    return float(brentq(lambda z: float(gamma(z, 0.125)) - value, 1e-3, 10))


def hover_rpm() -> float:
    """The maker's polynomial (whole vehicle, gf against rpm), solved for 27 gf."""
    return float(
        brentq(lambda n: 1.0942e-07 * n**2 - 2.1059e-04 * n + 0.15417 - 1e3 * MASS, 1e4, 3e4)
    )


def change_of_lift_coefficient_percent(low: float, high: float) -> float:
    """Between two rows of the thrust stand's table, by throttle."""
    c = [np.interp(p, PWM, GF) / np.interp(p, PWM, RPM) ** 2 for p in (low, high)]
    return float(100 * (c[1] / c[0] - 1))


def original_gain_percent(z_hat: float) -> float:
    """With the Crazyflie's own geometry."""
    return 100 * (float(SANCHEZ_CUEVAS(z_hat, **CRAZYFLIE, K_b=2.0)) - 1)


def original_over_printed_fountain(z_hat: float) -> float:
    original = [SANCHEZ_CUEVAS.downwash(z_hat, **PAPER, K_b=k) for k in (0.0, 2.0)]
    printed = [
        SANCHEZ_CUEVAS_AS_PRINTED.downwash(
            z_hat, spacing_hat=PAPER["spacing_hat"], inverse_K_b=inverse
        )
        for inverse in (0.0, 0.5)
    ]
    return float((original[0] - original[1]) / (printed[0] - printed[1]))


def u_of_K_b(unit: str, free_lift_inf: bool) -> float:
    """Standard uncertainty of K_b from one mean per station of Table 1, each good to 1 %, geometry
    of a Crazyflie.
    """
    z, step = GROUND * UNIT[unit] / R, 1e-5
    ratio = [np.asarray(SANCHEZ_CUEVAS(z, **CRAZYFLIE, K_b=2.0 + d)) for d in (step, 0.0, -step)]
    slope = (ratio[0] - ratio[2]) / (2 * step)
    columns = np.stack([slope, ratio[1]], axis=1) if free_lift_inf else slope[:, None]
    return float(0.01 * math.sqrt(np.linalg.inv(columns.T @ columns)[0, 0]))


def coefficient_in_gamma() -> float:
    """alpha of Eq. 3 from the momentum balance v_e^2 - 2 v_i v_e - v_i^2 / (8 z_hat^2) = 0 at z_hat
    = 1/2, v_i = 1.
    """
    v_e = brentq(lambda v: v**2 - 2 * v - 1 / (8 * 0.25), 1.0, 10.0)
    return float(((v_e - 1) ** 2 - 1) * 0.25)


def poles(sign: float = -1.0, ratio: float = 1.0) -> np.ndarray:
    """Poles of the linearised loop, 1/s; `sign` is that of the gains above the ground, `ratio` a
    frozen L / L_inf.
    """
    f0 = math.sqrt(MASS * GRAVITY / LIFT_PER_F2 / ratio)
    per_Hz = 2 * GRAVITY / f0
    return np.roots([1.0, -sign * per_Hz * KD, -sign * per_Hz * KP, -sign * per_Hz * KI])


def dimension_left_in_the_groups() -> float:
    """Largest exponent of m, kg or s left in the four groups; gain units m^-1 s^-1, m^-1, m^-1
    s^-2, s^-1.
    """
    gains = {
        "alpha": (-1, -1, 6, 1),
        "beta": (-1, 0, 5, 0),
        "gamma": (-1, -2, 7, 2),
        "delta": (0, -1, 4, 1),
    }
    left = []
    for metre, second, r, g in gains.values():
        # sqrt(rho r^r / (m g^g)): rho is kg m^-3, g is m s^-2
        left += [metre + (-3 + r - g) / 2, second + 2 * g / 2, (1 - 1) / 2]
    return float(np.abs(left).max())


def crash_rates(boundary: str, power: float, targets: np.ndarray, flights: int) -> np.ndarray:
    """Share of flights that touch the boundary, per target height; `power` 0 is no boundary model.

    As the paper describes it: explicit Euler, 0.1 s, 120 s, disturbance held for a step, L / L_inf
    bounded to its value at z_hat = 0.5, f0 adjusted for the boundary; gains with the sign that is
    stable at each boundary.
    """
    heights = np.linspace(0.5, 12, 4000)
    near = (
        SANCHEZ_CUEVAS_FREE_EXPONENT(heights, **PAPER, K_b=2.0, n=1.0)
        if boundary == "ground"
        else gamma(heights, 0.125)
    )

    def ratio(z_hat: np.ndarray) -> np.ndarray:
        return np.interp(z_hat, heights, near) ** power

    sign = -1.0 if boundary == "ground" else 1.0
    target = np.repeat(targets, flights) * R
    f0 = np.sqrt(MASS * GRAVITY / LIFT_PER_F2 / ratio(target / R))
    z, v, total, crashed = (
        target.copy(),
        np.zeros_like(target),
        np.zeros_like(target),
        np.zeros(target.shape, dtype=bool),
    )
    rng = np.random.default_rng(20210401)
    for _ in range(1200):
        f = np.maximum(f0 + sign * (KP * (z - target) + KD * v + KI * total), 0)
        lift = LIFT_PER_F2 * f**2 * ratio(z / R)
        net = (lift + DISTURBANCE * rng.standard_normal(z.shape) - MASS * GRAVITY) / MASS
        total += STEP * (z - target)
        z = z + STEP * v
        v = v - sign * STEP * net
        crashed |= z <= 0
        z[crashed], v[crashed], total[crashed] = (
            target[crashed],
            0.0,
            0.0,
        )  # out of the count; kept finite
    return crashed.reshape(len(targets), flights).mean(axis=1)


@functools.cache
def crash_level(boundary: str, power: float, rate: float) -> float:
    """Target z_hat at which the crash rate falls through `rate`."""
    targets = np.arange(0.65, 1.8, 0.1) if boundary == "ground" else np.arange(1.45, 2.5, 0.1)
    rates = np.maximum(
        crash_rates(boundary, power, targets, flights=2000 if rate < 0.1 else 500), 1e-5
    )
    last = np.flatnonzero(rates > rate).max()
    a, b = np.log(rates[last]), np.log(rates[last + 1])
    return float(targets[last] + 0.1 * (a - math.log(rate)) / (a - b))


def ceiling_over_ground_sensitivity() -> float:
    """Shift of the 50 % level over the paper's powers 0.6 to 1.4, ceiling over ground."""
    ceiling = crash_level("ceiling", 1.4, 0.5) - crash_level("ceiling", 0.6, 0.5)
    return ceiling / abs(crash_level("ground", 1.4, 0.5) - crash_level("ground", 0.6, 0.5))


# --- the tests


def holds(claim: dict, value: float) -> bool:
    """Whether the paper's statement is true of the computed value."""
    relation, number = claim.get("relation", "="), claim["number"]
    return {
        "=": abs(value - number) <= claim.get("margin", 0.0) * 1.000001,
        "<": value < number,
        ">": value > number,
    }[relation]


#: What expressions may use: all of this module, and every lift model by its name in capitals.
NAMES = globals() | {model.name.upper(): model for model in catalogue.models()}


@pytest.mark.parametrize("claim", [c for c in CLAIMS if "computed" in c], ids=lambda c: c["id"])
def test_number_is_recomputed_and_bears_out_the_verdict(claim):
    value = float(eval(claim["computed"], NAMES))
    assert value == pytest.approx(claim["gives"], abs=claim.get("within", 0.0), rel=1e-9), claim[
        "text"
    ]
    if claim["verdict"] != "untestable":
        assert holds(claim, value) == (claim["verdict"] == "reproduced"), (
            f"{claim['id']}: {value} against {claim['number']}"
        )


KEYS = {"id", "text", "number", "unit", "relation", "margin", "verdict", "computed", "gives"}
KEYS |= {"gives_unit", "within", "why", "findings"}


def test_claims_are_whole_and_distinct():
    """A number that is not borne out has a reason."""
    assert len({c["id"] for c in CLAIMS}) == len(CLAIMS)
    for c in CLAIMS:
        assert c["text"], c
        assert set(c) <= KEYS, c
        assert c["verdict"] in ("reproduced", "contradicted", "untestable"), c
        assert c["verdict"] == "untestable" or {"computed", "number"} <= set(c), c
        assert c["verdict"] == "reproduced" or c["why"], c
        assert ("computed" in c) == ("gives" in c), c


def test_every_numeric_finding_has_a_claim():
    assert [f["id"] for f in FINDINGS] == [f"D{i}" for i in range(1, 31)]
    cited = {d for c in CLAIMS for d in c.get("findings", [])}
    assert cited == {f["id"] for f in FINDINGS if f["numeric"]}


def test_table_1_is_one_command_list_with_a_datum_per_boundary():
    assert set(GROUND - CEILING) == {52, 53}
    assert set(SIDEWALL - CEILING) == {10, 11}
