"""The published bench table of Garofano-Soldado et al. (non-planar rotor pairs above ground) as a
campaign of means.

The table (``thrust_vs_height.csv``) has a mean force and its standard deviation for 15 tilt
configurations at ten heights: ``case, config, alpha_deg, beta_deg, z_over_R, z_m, Fz_N, Fz_std_N``.
Neither the order of the runs, the number of samples, nor the spacing of the rotors is published:
order and spacing are left out of what the campaign claims, and the standard deviation is taken as
that of the mean, which is cautious.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

from nearlift.errors import InputRefused, UsageError

COLUMNS = ("case", "config", "alpha_deg", "beta_deg", "z_over_R", "z_m", "Fz_N", "Fz_std_N")
MANIFEST = """\
# Measured. Garofano-Soldado et al., "Aerodynamic interactions of non-planar rotor pairs and model derivation in ground approach":
# a rotor pair (13 in) on a force sensor, 6300 rpm, ten heights in each of 15 configurations of tilt. Written by nearlift from the
# published table; see docs/garofano-soldado.md. One configuration is one session: each was mounted by itself.
schema = "nearlift.campaign/1"
name   = "{name}"
note   = "{note}"

[vehicle]
name         = "rotor pair, 13 in"
rotors       = 2                     # their spacing is not published, so models of several rotors cannot be fitted
rotor_radius = "165.1 mm"
mass         = "2 kg"                # not published; nothing here depends on it

[rig]
held            = "rpm"
distance_datum  = "rotor plane"
distance_offset = "0 mm"
arena           = "10 m"             # not published
gravity         = "9.80665 m/s^2"

[records]
reader = "means"

[fit.ground]
base   = "cheeseman_bennett"
rivals = ["cheeseman_bennett_fixed", "cheeseman_bennett_constant_power", "hayden", "power_law", "exponential"]

[trials]
file  = "trials.csv"
order = "unknown"                    # the table is sorted by configuration and height
[trials.units]
distance = "m"
throttle = "fraction"                # one speed, 6300 rpm, so one level
tilt     = "deg"
lift     = "N"
lift_sd  = "N"
[trials.constants]
boundary = "ground"
throttle = 1
"""
NOTES = {
    False: "vertical force as measured",
    True: (
        "vertical force over cos(alpha) cos(beta): thrust along the rotors' axes if it does not"
        " care about tilt"
    ),
}


def convert(
    table: Path, folder: Path, *, along_axes: bool = False, name: str | None = None
) -> Path:
    """Write the table, ``thrust_vs_height.csv``, as a campaign into a new or empty folder, and
    return that; `InputRefused` where it lacks a column, or a cell is no number, `UsageError` where
    the folder holds something. With `along_axes` the force is divided by cos(alpha) cos(beta); the
    campaign has the `name`, or that of the folder.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            str(folder),
            "is not empty" if folder.is_dir() else "is a file",
            "name a new folder; nothing is ever overwritten",
        )
    lines = ["trial,distance,session,tilt,beta,lift,lift_sd"]
    for number, row in enumerate(read(table), 2):
        try:
            alpha, beta, z_m, force, spread = (
                float(row[c]) for c in ("alpha_deg", "beta_deg", "z_m", "Fz_N", "Fz_std_N")
            )
        except ValueError as fault:
            raise InputRefused(f"{table}, line {number}", str(fault), "correct that cell") from None
        share = math.cos(math.radians(alpha)) * math.cos(math.radians(beta)) if along_axes else 1.0
        # tilted towards each other counts positive
        facing = {"face_to_face": 1, "coplanar": 0, "back_to_back": -1}.get(row["config"])
        if facing is None:
            raise InputRefused(
                f"{table}, line {number}",
                f"{row['config']!r} is no known configuration",
                "coplanar, face_to_face or back_to_back",
            )
        trial = f"{row['case']}-{float(row['z_over_R']):g}"
        lines.append(
            f"{trial},{z_m:.6g},{row['case']},{facing * alpha:g},{beta:g},{force / share:.6g},{spread / share:.6g}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(
        MANIFEST.format(name=name or folder.name, note=NOTES[along_axes]), encoding="utf-8"
    )
    (folder / "trials.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def read(table: Path) -> list[dict[str, str]]:
    """Rows of the table, unchanged."""
    if not table.is_file():
        raise InputRefused(
            str(table), "is missing", "name the published table, thrust_vs_height.csv"
        )
    with table.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        lacking = [c for c in COLUMNS if c not in (reader.fieldnames or ())]
        if lacking:
            raise InputRefused(
                str(table),
                f"lacks the columns {', '.join(lacking)}",
                f"it has to have {', '.join(COLUMNS)}",
            )
        return list(reader)
