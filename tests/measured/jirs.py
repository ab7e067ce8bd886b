"""The tables of J Intell Robot Syst 110.3 (2024) as campaigns: 20 cells each, ground and ceiling,
10- and 12-inch propellers.
"""

from __future__ import annotations

import csv
from pathlib import Path

FILE = (
    Path(__file__).parents[3]
    / "shared/data/jirs2024-unibz-surface/surface_jirs2024_effect_packet.csv"
)
#: As docs/published-tables.md gives it.
MANIFEST = """
schema = "nearlift.campaign/1"
name   = "{boundary}-{inches}-inch"
vehicle = {{ name = "quadrotor", rotors = 1, rotor_radius = "{radius} mm", mass = "1 kg" }}
rig = {{ held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }}
records = {{ reader = "means" }}
[trials]
order = "unknown"
[trials.units]
distance = "cm"
throttle = "percent"
rpm      = "rpm"
lift     = "N"
lift_sd  = "N"
[trials.constants]
boundary = "{boundary}"
lift_sd  = 0.085
"""


def written(folder: Path, boundary: str, inches: int) -> Path:
    """A campaign of one of the tables; under the ceiling the second of the 10-inch rotors is blank
    at the nearest distance.
    """
    root = folder / "raw"
    root.mkdir(parents=True)
    (root / "campaign.toml").write_text(
        MANIFEST.format(boundary=boundary, inches=inches, radius=12.7 * inches)
    )
    rpm = "rpm_1" if (boundary, inches) == ("ceiling", 10) else "rpm_mean"
    with FILE.open() as lines:
        rows = [r for r in csv.DictReader(lines) if "measurement" in r["row_type"]]
    rows = [r for r in rows if (r["effect"], r["prop_diameter_in"]) == (boundary, str(inches))]
    text = "".join(
        f"t{i:02d},{r['distance_cm']},{(float(r['pwm']) - 1000) / 10:g},{r[rpm]},{r['fz_n']}\n"
        for i, r in enumerate(rows)
    )
    (root / "trials.csv").write_text("trial,distance,throttle,rpm,lift\n" + text)
    return root
