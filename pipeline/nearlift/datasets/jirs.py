"""J Intell Robot Syst 110.3 (2024): tables of a quadrotor bed near ground and ceiling as campaigns
of means.

The published rows hold a mean thrust for five distances by four pulse widths. The data set's name
says which table: its boundary and its propeller's diameter in inches.
"""

from __future__ import annotations

import re
from pathlib import Path

from nearlift.datasets.tables import read_rows, write_campaign
from nearlift.errors import InputRefused

NAME = re.compile(r"(?P<boundary>ground|ceiling)-(?P<inches>\d+)-inch$")
#: Speeds of two rotors are published; this table's second is blank nearest the ceiling.
ONE_SPEED = ("ceiling", "10")
COLUMNS = ("row_type", "effect", "prop_diameter_in", "distance_cm", "pwm", "fz_n")


def convert(files: dict[str, Path], folder: Path, name: str) -> None:
    """Write the table that `name` ends with, such as ``ceiling-12-inch``.

    Raises
    ------
    InputRefused
        The name ends with no table, or the file lacks its columns or rows.
    """
    (path,) = files.values()
    wanted = NAME.search(name)
    if wanted is None:
        raise InputRefused(name, "names no table", "end it with ground-10-inch, for example")
    boundary, inches = wanted["boundary"], wanted["inches"]
    rpm = "rpm_1" if (boundary, inches) == ONE_SPEED else "rpm_mean"
    rows = [
        row
        for row in read_rows(path, (*COLUMNS, rpm))
        if "measurement" in row["row_type"]
        and (row["effect"], row["prop_diameter_in"]) == (boundary, inches)
    ]
    if not rows:
        raise InputRefused(str(path), f"has no rows of {boundary}, {inches} inches", "see its list")
    lines = ["trial,distance,throttle,rpm,lift"]
    lines += [
        f"t{i:02d},{row['distance_cm']},{(float(row['pwm']) - 1000) / 10:g},{row[rpm]},{row['fz_n']}"
        for i, row in enumerate(rows)
    ]
    facts = {"boundary": boundary, "inches": inches, "radius": 12.7 * int(inches)}
    write_campaign(folder, "jirs", lines, name=name, **facts)
