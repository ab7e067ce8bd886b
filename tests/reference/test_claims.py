"""Every number that the paper states, worked out again.

claims.toml lists them in the paper's order, each with the words, the number, a verdict and the name
of a function here that computes what the number should be. The test recomputes it and derives the
verdict from the two; a claim that cannot be computed says what would have to be known.
"""

import functools
import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from nearlift.models.images import (
    CHEESEMAN_BENNETT,
    CHEESEMAN_BENNETT_THEORY,
    SANCHEZ_CUEVAS,
    SANCHEZ_CUEVAS_AS_PRINTED,
    SANCHEZ_CUEVAS_FREE_EXPONENT,
)
from nearlift.models.momentum import HSIAO_CHIRARATTANANON, gamma

FILE = tomllib.loads(Path(__file__).with_name("claims.toml").read_text(encoding="utf-8"))
CLAIMS, FINDINGS = FILE["claim"], FILE["finding"]
FUNCTIONS: dict[str, Callable[..., float]] = {}


def computes(function: Callable[..., float]) -> Callable[..., float]:
    FUNCTIONS[function.__name__] = function
    return function


# --- what the paper states and what others measured

R = 0.023  # rotor radius, m
MASS, GRAVITY, DENSITY = 0.027, 9.8, 1.2
L_PAPER = 0.090  # "distance between centers of rotors", m
ADJACENT, DIAGONAL, ARM = (
    0.06505,
    0.092,
    0.0325,
)  # of a Crazyflie 2.0, from its maker's firmware; arm: half the adjacent spacing
CRAZYFLIE = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
PAPER = {"spacing_hat": L_PAPER / R, "diagonal_hat": math.sqrt(2) * L_PAPER / R}
KP, KD, KI, C_L, STEP, DISTURBANCE = 316.0, 316.0, 31.6, 1.6, 0.1, 0.015
LIFT_PER_F2 = 4 * C_L * DENSITY * R**4  # N s^2

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
RPM = np.array(
    [
        0,
        4485,
        7570,
        9374,
        10885,
        12277,
        13522,
        14691,
        15924,
        17174,
        18179,
        19397,
        20539,
        21692,
        22598,
        23882.0,
    ]
)
GF = np.array(
    [0, 1.6, 4.8, 7.9, 10.9, 13.9, 17.3, 21.0, 24.4, 28.6, 32.8, 37.3, 41.7, 46.0, 51.9, 57.9]
)


def induced_velocity() -> float:
    """Hovering Crazyflie, m/s: thrust of 66.2 mN per rotor."""
    return math.sqrt(MASS * GRAVITY / 4 / (2 * DENSITY * math.pi * R**2))


# --- constants


@computes
def standard_gravity() -> float:
    return 9.80665


@computes
def propeller_radius_mm() -> float:
    return 1.85 * 25.4 / 2


@computes
def density_of_humid_air(
    celsius: float = 20.0, pressure: float = 101325.0, humidity: float = 0.5
) -> float:
    vapour = humidity * 610.94 * math.exp(17.625 * celsius / (celsius + 243.04))
    kelvin = celsius + 273.15
    return (pressure - vapour) / (287.058 * kelvin) + vapour / (461.495 * kelvin)


@computes
def adjacent_spacing_mm() -> float:
    return 1e3 * ADJACENT


@computes
def spacing_over_radius() -> float:
    return L_PAPER / R


@computes
def rolling_inertia_of_the_cited_thesis() -> float:
    return 2.3951e-5


@computes
def length_exponent_of_a_moment_of_inertia() -> float:
    return 2.0  # kg m^2


# --- Table 1


@computes
def table_rows() -> float:
    return float(len(GROUND)) if len(GROUND) == len(CEILING) == len(SIDEWALL) else math.nan


@computes
def farthest_station_m(unit: str) -> float:
    return float(GROUND.max() * UNIT[unit])


@computes
def nearest_station_z_hat(boundary: str, unit: str) -> float:
    return float(
        {"ground": GROUND, "ceiling": CEILING, "sidewall": SIDEWALL}[boundary].min()
        * UNIT[unit]
        / R
    )


@computes
def ground_stations_between(low: float, high: float, unit: str) -> float:
    z = GROUND * UNIT[unit] / R
    return float(((z > low) & (z < high)).sum())


@computes
def nearest_ground_station_with_feet_z_hat() -> float:
    """The third reading: millimetres of a command that carries 52.3 mm of datum, plus 24 mm from
    feet to rotor plane.
    """
    return float((GROUND.min() - 52.3 + 24) * 1e-3 / R)


@computes
def height_where_gamma_is(value: float) -> float:
    return float(brentq(lambda z: float(gamma(z, 0.125)) - value, 1e-3, 10))


# --- thrust stand


@computes
def hover_throttle_percent() -> float:
    return float(np.interp(1e3 * MASS, GF, PWM))


@computes
def lift_at_throttle_gf(percent: float) -> float:
    return float(np.interp(percent, PWM, GF))


@computes
def accuracy_over_lift_percent(throttle: float) -> float:
    return 100 * 1.5 / lift_at_throttle_gf(throttle)


@computes
def hover_rpm_measured() -> float:
    """The maker's polynomial (whole vehicle, gf against rpm), solved for 27 gf."""
    return float(
        brentq(lambda n: 1.0942e-07 * n**2 - 2.1059e-04 * n + 0.15417 - 1e3 * MASS, 1e4, 3e4)
    )


@computes
def lift_coefficient_at_hover() -> float:
    return MASS * GRAVITY / (4 * DENSITY * (hover_rpm_measured() / 60) ** 2 * R**4)


@computes
def change_of_lift_coefficient_percent(low: float, high: float) -> float:
    """Between two rows of the thrust stand's table, by throttle."""
    c = [np.interp(p, PWM, GF) / np.interp(p, PWM, RPM) ** 2 for p in (low, high)]
    return float(100 * (c[1] / c[0] - 1))


@computes
def trials() -> float:
    return 3.0 * 20 * 4 * 15


@computes
def batteries(minutes_each: float) -> float:
    return trials() * 10 / 60 / minutes_each


# --- models


@computes
def cheeseman_bennett_gain_percent(z_hat: float) -> float:
    return 100 * (float(CHEESEMAN_BENNETT_THEORY(z_hat)) - 1)


@computes
def cheeseman_bennett_downwash_percent(z_hat: float) -> float:
    return 100 * (1 - float(CHEESEMAN_BENNETT.downwash(z_hat, k=1.0)))


@computes
def equation_1_with_z_in_metres(z_hat: float) -> float:
    return 1 / (1 - 1 / (16 * (z_hat * R) ** 2))


@computes
def printed_gain_percent(z_hat: float) -> float:
    return 100 * (
        float(SANCHEZ_CUEVAS_AS_PRINTED(z_hat, spacing_hat=PAPER["spacing_hat"], inverse_K_b=0.5))
        - 1
    )


@computes
def original_gain_percent(z_hat: float) -> float:
    """With the Crazyflie's own geometry."""
    return 100 * (float(SANCHEZ_CUEVAS(z_hat, **CRAZYFLIE, K_b=2.0)) - 1)


@computes
def original_over_printed_fountain(z_hat: float) -> float:
    original = [SANCHEZ_CUEVAS.downwash(z_hat, **PAPER, K_b=k) for k in (0.0, 2.0)]
    printed = [
        SANCHEZ_CUEVAS_AS_PRINTED.downwash(
            z_hat, spacing_hat=PAPER["spacing_hat"], inverse_K_b=inverse
        )
        for inverse in (0.0, 0.5)
    ]
    return float((original[0] - original[1]) / (printed[0] - printed[1]))


@computes
def printed_K_b_equal_to_an_original_2(z_hat: float) -> float:
    return 2.0 / original_over_printed_fountain(z_hat)


@computes
def measured_over_classic(z_hat: float) -> float:
    return 20.0 / cheeseman_bennett_gain_percent(z_hat)


@computes
def pole_of_cheeseman_bennett() -> float:
    return float(brentq(lambda z: float(CHEESEMAN_BENNETT.downwash(z, k=1.0)), 0.1, 1.0))


@computes
def pole_of_sanchez_cuevas() -> float:
    return float(brentq(lambda z: float(SANCHEZ_CUEVAS.downwash(z, **PAPER, K_b=2.0)), 0.1, 1.0))


@computes
def u_of_K_b(unit: str, free_lift_inf: bool) -> float:
    """Standard uncertainty of K_b from one mean per station of Table 1, each good to 1 %, geometry
    of a Crazyflie.
    """
    z, step = GROUND * UNIT[unit] / R, 1e-5
    ratio = [np.asarray(SANCHEZ_CUEVAS(z, **CRAZYFLIE, K_b=2.0 + d)) for d in (step, 0.0, -step)]
    slope = (ratio[0] - ratio[2]) / (2 * step)
    columns = np.stack([slope, ratio[1]], axis=1) if free_lift_inf else slope[:, None]
    return float(0.01 * math.sqrt(np.linalg.inv(columns.T @ columns)[0, 0]))


@computes
def coefficient_in_gamma() -> float:
    """alpha of Eq. 3 from the momentum balance v_e^2 - 2 v_i v_e - v_i^2 / (8 z_hat^2) = 0 at z_hat
    = 1/2, v_i = 1.
    """
    v_e = brentq(lambda v: v**2 - 2 * v - 1 / (8 * 0.25), 1.0, 10.0)
    return float(((v_e - 1) ** 2 - 1) * 0.25)


@computes
def gamma_gain_percent(z_hat: float) -> float:
    return 100 * (float(gamma(z_hat, 0.125)) - 1)


@computes
def ceiling_downwash_percent(z_hat: float) -> float:
    return 100 * (1 - float(HSIAO_CHIRARATTANANON.downwash(z_hat, alpha=0.125)))


@computes
def power_of_hovering_below_the_ceiling(z_hat: float) -> float:
    """P / P_inf at the same thrust, which is what gamma was derived as."""
    return 1 / float(gamma(z_hat, 0.125))


@computes
def ground_over_ceiling_distance_for_gain(percent: float) -> float:
    ground = brentq(lambda z: original_gain_percent(z) - percent, 1.0, 20)
    return float(ground / height_where_gamma_is(1 + percent / 100))


@computes
def lowest_plane_above_floor_in_radii(z_hat: float) -> float:
    """Height above the ground of a section one rotor diameter below the rotor."""
    return z_hat - 2.0


@computes
def sidewall_ratio_scaled(ratio: float, power: float) -> float:
    return ratio**power


@computes
def gap_at_the_tip_mm(z_hat: float, measured_from: str) -> float:
    return 1e3 * (z_hat * R - (R if measured_from == "axis" else 0.0))


@computes
def year_of_rossow() -> float:
    return 1985.0  # NASA TM-86754


# --- rolling moment


@computes
def rolling_torque_N_mm(arm_mm: float) -> float:
    """Differential lift of 3 % of two rotors' share of the weight."""
    return 0.03 * MASS * GRAVITY / 2 * arm_mm


@computes
def rolling_acceleration_deg_s2(torque_N_mm: float, inertia: float) -> float:
    return math.degrees(torque_N_mm * 1e-3 / inertia)


# --- flow measurement


@computes
def recording_time_s() -> float:
    return 150 / 15.0


@computes
def settling_speed_mm_s() -> float:
    """Stokes, a droplet of water and glycol (1050 kg/m^3) of 14 um in air."""
    return 1e3 * 1050 * 9.81 * (14e-6) ** 2 / (18 * 1.81e-5)


@computes
def height_of_equal_pressures_mm(times: float) -> float:
    """Height h at which the far wake's dynamic pressure is so many times rho g h."""
    return 1e3 * (2 * induced_velocity()) ** 2 / 2 / GRAVITY / times


# --- the reduced-order simulation


def poles(sign: float = -1.0, ratio: float = 1.0) -> np.ndarray:
    """Poles of the linearised loop, 1/s; `sign` is that of the gains above the ground, `ratio` a
    frozen L / L_inf.
    """
    f0 = math.sqrt(MASS * GRAVITY / LIFT_PER_F2 / ratio)
    per_Hz = 2 * GRAVITY / f0
    return np.roots([1.0, -sign * per_Hz * KD, -sign * per_Hz * KP, -sign * per_Hz * KI])


@computes
def hover_frequency_Hz() -> float:
    return math.sqrt(MASS * GRAVITY / LIFT_PER_F2)


@computes
def slowest_time_constant_s() -> float:
    return float(-1 / poles().real.max())


@computes
def largest_imaginary_part() -> float:
    return float(abs(poles().imag).max())


@computes
def growth_rate_with_printed_signs() -> float:
    return float(poles(sign=+1.0).real.max())


@computes
def largest_stable_step_s() -> float:
    return float(2 / abs(poles().real).max())


@computes
def ratio_at_which_the_step_is_unstable() -> float:
    return float(brentq(lambda g: abs(poles(ratio=g).real).max() - 2 / STEP, 1.0, 3.0))


@computes
def power_of_ten(value: float) -> float:
    return math.log10(value)


@computes
def step_in_rotor_times() -> float:
    return STEP / math.sqrt(R / GRAVITY)


@computes
def dimensionless_group(name: str) -> float:
    power = {
        "alpha": (KP, 6, 1),
        "beta": (KD, 5, 0),
        "gamma": (KI, 7, 2),
        "delta": (hover_frequency_Hz(), 4, 1),
    }
    gain, r, g = power[name]
    return gain * math.sqrt(4 * C_L * DENSITY * R**r / (MASS * GRAVITY**g))


@computes
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


@computes
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


@computes
def gain_in_safe_height(rate: float) -> float:
    return crash_level("ground", 0.0, rate) - crash_level("ground", 1.0, rate)


@computes
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


@pytest.mark.parametrize("claim", [c for c in CLAIMS if "computed" in c], ids=lambda c: c["id"])
def test_number_is_recomputed_and_bears_out_the_verdict(claim):
    value = FUNCTIONS[claim["computed"]](**claim.get("with", {}))
    assert value == pytest.approx(claim["gives"], abs=claim.get("within", 0.0), rel=1e-9), claim[
        "text"
    ]
    if claim["verdict"] != "untestable":
        assert holds(claim, value) == (claim["verdict"] == "reproduced"), (
            f"{claim['id']}: {value} against {claim['number']}"
        )


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: c["id"])
def test_claim_is_complete(claim):
    assert claim["text"]
    assert claim["verdict"] in ("reproduced", "contradicted", "untestable")
    assert claim["verdict"] == "untestable" or "computed" in claim
    assert claim["verdict"] == "reproduced" or claim["why"], (
        "a number that is not borne out needs a reason"
    )
    known = {
        "id",
        "text",
        "number",
        "unit",
        "relation",
        "margin",
        "verdict",
        "computed",
        "with",
        "gives",
        "gives_unit",
        "within",
        "why",
        "findings",
    }
    assert set(claim) <= known
    if "computed" in claim:
        assert "gives" in claim
    assert "number" in claim or claim["verdict"] == "untestable"


def test_claims_are_distinct():
    ids = [c["id"] for c in CLAIMS]
    assert len(set(ids)) == len(ids)


def test_every_function_serves_a_claim():
    assert set(FUNCTIONS) == {c["computed"] for c in CLAIMS if "computed" in c}


def test_every_numeric_finding_has_a_claim():
    assert [f["id"] for f in FINDINGS] == [f"D{i}" for i in range(1, 31)]
    cited = {d for c in CLAIMS for d in c.get("findings", [])}
    assert cited == {f["id"] for f in FINDINGS if f["numeric"]}


def test_table_1_is_one_command_list_with_a_datum_per_boundary():
    assert set(GROUND - CEILING) == {52, 53}
    assert set(SIDEWALL - CEILING) == {10, 11}
