"""C_L of the Crazyflie's rotors from public thrust-stand tables: neither the 1.6 of Carter et al.
2021 nor constant.
"""

import csv
import itertools
from pathlib import Path

import numpy as np
import pytest

from nearlift.fit import rotor

PLACE = Path(__file__).resolve().parents[3] / "shared" / "data" / "crazyflie-thrust-stand"
pytestmark = pytest.mark.skipif(not PLACE.is_dir(), reason=f"{PLACE} is not here")
AIR = {"air_density": 1.2, "radius_m": 0.023, "rotors": 4}
GRAVITY = 9.80665
#: Below this speed a gram of thrust is a few steps of the scale.
SLOWEST_HZ = 100.0


def rows(name):
    with (PLACE / name).open(newline="") as file:
        return list(csv.DictReader(file))


def points(name):
    """Speed (root mean square over rotors) in Hz, thrust in N and its standard uncertainty, per
    setting of the throttle.
    """
    table = rows(name)
    if name == "bitcraze_2015_table.csv":
        speed = np.array([float(r["rpm_avg"]) / 60 for r in table])
        gram = np.array([float(r["thrust_g"]) for r in table])
        u = np.full(len(gram), 0.1)
    elif "thrust[g]" in table[0]:
        speed = np.sqrt(
            np.mean([[(float(r[f"rpm{i}"]) / 60) ** 2 for i in range(1, 5)] for r in table], axis=1)
        )
        gram = np.array([float(r["thrust[g]"]) for r in table])
        u = np.full(len(gram), 0.5)
    else:
        speed, gram, u = steps(table)
    fast = speed > SLOWEST_HZ
    return speed[fast], 1e-3 * GRAVITY * gram[fast], 1e-3 * GRAVITY * u[fast]


def steps(table):
    """Means over the second half of each step of the throttle, tare removed; the tare is that of
    the rotors at rest at both ends.
    """
    found = []
    at_rest = [
        float(r["weight[g]"])
        for r in table
        if int(r["pwm"]) == 0 and all(float(r[f"rpm{i}"]) == 0 for i in range(1, 5))
    ]
    for _, group in itertools.groupby(table, key=lambda r: r["pwm"]):
        step = list(group)
        late = step[len(step) // 2 :]
        if len(step) < 10:
            continue
        speeds = np.array([[float(r[f"rpm{i}"]) / 60 for i in range(1, 5)] for r in late])
        weight = np.array([float(r["weight[g]"]) for r in late])
        found.append(
            (
                np.sqrt(np.mean(speeds**2)),
                weight.mean() - np.median(at_rest),
                max(weight.std() / np.sqrt(5), 0.1),
            )
        )
    return np.array(found).T


def measured(name):
    """C_L at each point, the weighted mean, and the trend with speed."""
    speed, lift, u = points(name)
    C_L = rotor.coefficient(lift, speed, **AIR)
    return C_L, rotor.trend(np.log(C_L), np.diag((u / lift) ** 2), np.log(speed))


def test_bitcraze_2015_rises_from_2_2_to_2_7():
    C_L, law = measured("bitcraze_2015_table.csv")
    assert len(C_L) == 14
    assert (C_L[0], C_L[-1]) == pytest.approx((2.20, 2.67), abs=0.01)
    assert law.p_constant < 1e-12
    assert law.exponent - 5 * law.u_exponent > 0
    assert law.mean > 1.5 * rotor.PAPER


# speeds of the fourth are a quarter higher at the same thrust than on the other stands; the fifth
# has larger propellers
OTHERS = {
    "cf2.1-stock-prop.csv": (2.46, 0.06),
    "cf21_stock2.csv": (2.24, 0.20),
    "imrc_cf21plus_350mah_2026.csv": (1.68, 0.11),
    "imrc_cf21bl_guards_2026.csv": (4.60, 0.115),
}


@pytest.mark.parametrize("name", OTHERS)
def test_on_every_stand_it_rises_with_speed(name):
    mean, exponent = OTHERS[name]
    _, law = measured(name)
    assert law.mean == pytest.approx(mean, abs=0.01)
    assert law.exponent == pytest.approx(exponent, abs=0.01)
    assert law.exponent - 3 * law.u_exponent > 0
    assert law.p_trend < 1e-3
    assert law.mean - 5 * law.u_mean * law.excess > rotor.PAPER
