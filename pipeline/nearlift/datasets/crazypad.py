"""CrazyPAD: flights of a Crazyflie 2.1 with and without defects, uSD logs; the name of a file is
its condition and its name there.
"""

from __future__ import annotations

import shutil
from pathlib import Path

MANIFEST = """\
# Measured. Flights of a Crazyflie 2.1, normal ones and such with a known defect. See SOURCE.txt.
# No set-point was logged, so no effect near the ground is diagnosed; hover is compared with that of normal flights.
schema = "nearlift.campaign/1"
name   = "{name}"

[vehicle]
name          = "Crazyflie 2.1"
rotors        = 4
rotor_radius  = "23.1 mm"
rotor_spacing = "65 mm"
mass          = "31 g"               # with the deck that logs; not stated

[rig]
held            = "command"
distance_datum  = "airframe"
distance_offset = "30 mm"            # feet to rotor plane; not stated
gravity         = "9.81 m/s^2"

[records]
reader = "crazyflie-usd"
files  = "logs/{{record}}"

[flight]
acceleration = {{ column = "stateEstimate.az", unit = "g", gravity = "removed", axes = "world" }}
command  = {{ columns = ["pwm.m1_pwm", "pwm.m2_pwm", "pwm.m3_pwm", "pwm.m4_pwm"], full = 65535 }}
supply   = {{ column = "pm.vbatMV", unit = "mV" }}
height   = {{ column = "stateEstimate.z", unit = "m", zero = "each start" }}
velocity = {{ column = "stateEstimate.vz", unit = "m/s" }}
sound    = "normal_flight"
"""


def convert(files: dict[str, Path], folder: Path, name: str) -> None:
    """Write the campaign; a log is a session."""
    (folder / "logs").mkdir()
    lines = ["record,boundary,condition"]
    for log, path in files.items():
        shutil.copyfile(path, folder / "logs" / log)
        lines.append(f"{log},ground,{log.rsplit('-', 1)[0]}")
    (folder / "campaign.toml").write_text(MANIFEST.format(name=name), encoding="utf-8")
    (folder / "trials.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
