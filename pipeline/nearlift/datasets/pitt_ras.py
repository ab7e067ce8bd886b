"""Pitt-RAS 2017: sweeps of 50 throttles, a file each, as a campaign of means.

Columns, without a header: throttle (fraction), thrust (kgf), supply (V), distance of the rotor to
the ground (m). The name of a file holds the start of its sweep. At low throttle the stand reads
little more than its own friction, so trials begin above 0.15.
"""

from __future__ import annotations

import datetime
import re
from pathlib import Path

from nearlift.datasets.tables import write_campaign
from nearlift.errors import InputRefused

LEAST_THROTTLE = 0.15
NAME = re.compile(r"thrust_data_(\d{4}-\d\d-\d\d)_(\d\d-\d\d-\d\d\.\d+)")


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
    write_campaign(folder, "pitt_ras", lines, name=name)


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
