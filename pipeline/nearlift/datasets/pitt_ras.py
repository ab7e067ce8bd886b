"""Pitt-RAS 2017: sweeps of 50 throttles, a file each, as a campaign of means.

Columns, without a header: throttle (fraction), thrust (kgf), supply (V), distance of the rotor to
the ground (m). The name of a file holds the start of its sweep. At low throttle the stand reads
little more than its own friction, so trials begin above 0.15.
"""

from __future__ import annotations

import datetime
import re
from pathlib import Path

from nearlift.errors import InputRefused

LEAST_THROTTLE = 0.15
NAME = re.compile(r"thrust_data_(\d{4}-\d\d-\d\d)_(\d\d-\d\d-\d\d\.\d+)")
MANIFEST = """\
# Measured. Pitt-RAS IARC-7 thrust stand, 2017: one 12x6 rotor on a load cell. See SOURCE.txt.
schema = "nearlift.campaign/1"
name   = "{name}"
note   = "Distance was made smaller while the battery fell: the two are confounded by the order of the sweeps."

[vehicle]
name         = "12x6 rotor, isolated"
rotors       = 1
rotor_radius = "152.4 mm"
mass         = "1 kg"                # not recorded; nothing here depends on it

[rig]
held            = "throttle"
distance_datum  = "rotor plane"
distance_offset = "0 mm"
arena           = "5 m"              # not recorded
gravity         = "9.80665 m/s^2"

[load_cell]
range    = "5 kgf"
accuracy = "2 gf"                    # of cells of this kind; the stand's own is not recorded

[records]
reader = "means"

[trials]
file = "trials.csv"
[trials.units]
distance = "m"
throttle = "fraction"
lift     = "kgf"
supply   = "V"
start    = "s"                       # of the sweep; its steps follow each other about a second apart
"""


def convert(files: dict[str, Path], folder: Path, name: str) -> None:
    """Write the campaign; a sweep is a session.

    Raises
    ------
    InputRefused
        A file's name does not say when it was begun, or a line has other than four numbers.
    """
    starts = {path: _start(path) for path in files.values()}
    first = min(starts.values())
    lines = ["trial,boundary,distance,throttle,lift,supply,session,start"]
    for session, path in enumerate(sorted(starts, key=lambda path: starts[path]), 1):
        seconds = (starts[path] - first).total_seconds()
        for step, line in enumerate(path.read_text(encoding="ascii").splitlines()):
            try:
                throttle, lift, supply, distance = (float(cell) for cell in line.split(","))
            except ValueError:
                raise InputRefused(
                    f"{path}, line {step + 1}",
                    "is not four numbers",
                    "throttle, thrust, supply, distance",
                ) from None
            if throttle > LEAST_THROTTLE:
                lines.append(
                    f"r{session:02d}-{step:02d},ground,{distance:g},{throttle:.6g},{lift:.6g},{supply:.4g},{session},{seconds:.6f}"
                )
    (folder / "campaign.toml").write_text(MANIFEST.format(name=name), encoding="utf-8")
    (folder / "trials.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _start(path: Path) -> datetime.datetime:
    match = NAME.match(path.name)
    if match is None:
        raise InputRefused(
            str(path),
            "does not say in its name when it was begun",
            "thrust_data_YYYY-MM-DD_HH-MM-SS.ssssss.csv",
        )
    return datetime.datetime.strptime(f"{match[1]} {match[2]}", "%Y-%m-%d %H-%M-%S.%f").replace(
        tzinfo=datetime.UTC
    )
