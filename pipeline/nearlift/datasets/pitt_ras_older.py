"""Pitt-RAS 2017: six older sweeps, typed into the script that fitted them, as a campaign of means.

Rows of the script are (force, pulse width in us, supply in V, distance in m). No throttle repeats
between sweeps, so L_inf is a curve of throttle and supply.
"""

from __future__ import annotations

import re
from pathlib import Path

from nearlift.datasets.pitt_ras import LEAST_THROTTLE
from nearlift.datasets.tables import write_campaign
from nearlift.errors import InputRefused

ROW = re.compile(r"^\s*\(\s*([\d.]+)\s*,\s*([\d.]+)\s*,\s*([\d.]+)\s*,\s*([\d.]+)\s*\)", re.M)
#: Where a sweep begins; a sweep that the authors commented out is left out.
SWEEP = re.compile(r"^\s*np\.array\(\(", re.M)
#: Pulse widths of zero and full throttle, us.
ZERO_US, FULL_US = 1000.0, 2100.0
#: Sweep, force, pulse width, supply, distance, as the script has them.
Point = tuple[int, str, str, str, str]


def convert(files: dict[str, Path], folder: Path, name: str) -> None:
    """Write the campaign; a sweep is a session. `InputRefused` where the script has no sweep."""
    (script,) = files.values()
    text = script.read_text(encoding="utf-8", errors="replace")
    parts = SWEEP.split(text)[1:]
    points = [(k, *row) for k, part in enumerate(parts, 1) for row in ROW.findall(part)]
    if not points:
        raise InputRefused(str(script), "has no sweeps np.array((...))", "it is another file")
    write(points, folder, name)


def write(points: list[Point], folder: Path, name: str) -> None:
    """Write these points as a campaign; low throttle is left out."""
    lines = ["trial,distance,throttle,lift,supply,session"]
    for i, (sweep, force, pulse, supply, distance) in enumerate(points):
        throttle = (float(pulse) - ZERO_US) / (FULL_US - ZERO_US)
        if throttle > LEAST_THROTTLE and float(force) > 0:
            lines.append(f"s{sweep}-{i:02d},{distance},{throttle:g},{force},{supply},{sweep}")
    write_campaign(folder, "pitt_ras_older", lines, name=name)
