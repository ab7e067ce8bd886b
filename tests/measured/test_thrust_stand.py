"""C_L of the Crazyflie's rotors from public thrust-stand tables: neither the 1.6 of Carter et al.
2021 nor constant.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from nearlift.fit import rotor

PLACE = Path(__file__).resolve().parents[3] / "shared" / "data" / "crazyflie-thrust-stand"
pytestmark = pytest.mark.skipif(not PLACE.is_dir(), reason=f"{PLACE} is not here")
AIR = {"air_density": 1.2, "radius_m": 0.023, "rotors": 4}
NEWTON = 9.80665e-3
#: Below this speed a gram of thrust is a few steps of the scale.
SLOWEST_HZ = 100.0
RPM = ["rpm1", "rpm2", "rpm3", "rpm4"]


def points(name):
    """Speed (root mean square over rotors) in Hz, thrust in gf and its standard uncertainty, per
    setting of the throttle.
    """
    table = pd.read_csv(PLACE / name)
    if "rpm_avg" in table:
        return np.array([table["rpm_avg"] / 60, table["thrust_g"], np.full(len(table), 0.1)])
    hertz = table[RPM] / 60
    if "thrust[g]" in table:
        speed = np.sqrt((hertz**2).mean(axis=1))
        return np.array([speed, table["thrust[g]"], np.full(len(table), 0.5)])
    # second half of each step of the throttle, less the tare of the rotors at rest at both ends
    at_rest = (table["pwm"] == 0) & (table[RPM] == 0).all(axis=1)
    tare = table["weight[g]"][at_rest].median()
    found = []
    for _, step in table.groupby((table["pwm"].diff() != 0).cumsum()):
        late = step.iloc[len(step) // 2 :]
        if len(step) >= 10:
            speed = np.sqrt((hertz.loc[late.index].to_numpy() ** 2).mean())
            weight = late["weight[g]"]
            u = max(weight.std(ddof=0) / np.sqrt(5), 0.1)
            found.append((speed, weight.mean() - tare, u))
    return np.array(found).T


# speeds of the fourth are a quarter higher at the same thrust than on the other stands; the last
# has larger propellers
STANDS = {
    "bitcraze_2015_table.csv": (2.61, 0.121),
    "cf2.1-stock-prop.csv": (2.46, 0.06),
    "cf21_stock2.csv": (2.24, 0.20),
    "imrc_cf21plus_350mah_2026.csv": (1.68, 0.11),
    "imrc_cf21bl_guards_2026.csv": (4.60, 0.115),
}


@pytest.mark.parametrize("name", STANDS)
def test_on_every_stand_it_rises_with_speed(name):
    mean, exponent = STANDS[name]
    speed, gram, u = points(name)
    fast = speed > SLOWEST_HZ
    speed, lift, u = speed[fast], NEWTON * gram[fast], NEWTON * u[fast]
    C_L = rotor.coefficient(lift, speed, **AIR)
    law = rotor.trend(np.log(C_L), np.diag((u / lift) ** 2), np.log(speed))
    assert law.mean.value == pytest.approx(mean, abs=0.01)
    assert law.exponent.value == pytest.approx(exponent, abs=0.01)
    assert law.exponent.value - 3 * law.exponent.u > 0
    assert law.p_trend < 1e-3
    assert law.mean.value - 5 * law.mean.u * law.excess > rotor.PAPER_C_L
