"""J Intell Robot Syst 110.3 (2024): tables of a quadrotor bed near ground and ceiling as campaigns
of means.

The published rows hold a mean thrust for five distances by four pulse widths. The data set's name
says which table: its boundary and its propeller's diameter in inches.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

from nearlift.errors import InputRefused

NAME = re.compile(r"(?P<boundary>ground|ceiling)-(?P<inches>\d+)-inch$")
#: Speeds of two rotors are published; this table's second is blank nearest the ceiling.
ONE_SPEED = ("ceiling", "10")
COLUMNS = ("row_type", "effect", "prop_diameter_in", "distance_cm", "pwm", "fz_n")
MANIFEST = """\
# Measured. J Intell Robot Syst 110.3 (2024), doi 10.1007/s10846-024-02155-7. See SOURCE.txt.
schema = "nearlift.campaign/1"
name   = "{name}"

[vehicle]
name         = "quadrotor, {inches}-inch propellers"
rotors       = 1                     # the spacing is not published: no model of several rotors can be fitted
rotor_radius = "{radius:g} mm"
mass         = "1 kg"                # not published; nothing here depends on it

[rig]
held            = "throttle"
distance_datum  = "rotor plane"      # not stated by the authors
distance_offset = "0 mm"
gravity         = "9.8 m/s^2"

[records]
reader = "means"

[trials]
file  = "trials.csv"
order = "unknown"                    # the table is sorted by its columns, not by time
[trials.units]
distance = "cm"
throttle = "percent"                 # (pulse width - 1000 us) / 1000 us
rpm      = "rpm"
lift     = "N"
lift_sd  = "N"
[trials.constants]
boundary = "{boundary}"
lift_sd  = 0.085
"""


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
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        lacking = [c for c in (*COLUMNS, rpm) if c not in (reader.fieldnames or ())]
        if lacking:
            raise InputRefused(
                str(path), f"lacks the columns {', '.join(lacking)}", "it is another file"
            )
        rows = [
            row
            for row in reader
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
    (folder / "campaign.toml").write_text(
        MANIFEST.format(name=name, boundary=boundary, inches=inches, radius=12.7 * int(inches)),
        encoding="utf-8",
    )
    (folder / "trials.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
