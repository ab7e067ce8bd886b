"""A Crazyflie 2.1 on a thrust stand: dwells of constant pulse width as trials in free air, and the
throttle map that they give.

Files of ``weight[g],pwm,vbat[V],rpm1,...,rpm4,...``, a row some 10 ms after the other; the cell is
read ten times a second. A dwell is a run of rows with one pulse width; its first half is left for
rotors and cell to settle. Weights are tared by the rows before the rotors turn.
"""

from __future__ import annotations

import csv
import itertools
import statistics
from pathlib import Path

from nearlift.errors import InputRefused

COLUMNS = ("weight[g]", "pwm", "vbat[V]", "rpm1", "rpm2", "rpm3", "rpm4")
FULL_PWM = 65535
#: Rows of the shortest dwell that is a trial: half of it must hold more than a few readings of the
#: cell.
LEAST_ROWS = 90
MANIFEST = """\
# Measured. A whole Crazyflie 2.1 upside down on a thrust stand, far from every boundary. See SOURCE.txt.
# No boundary, so `nearlift ingest` is as far as this goes alone; [vehicle.throttle_map] is for the manifest of a campaign with the same craft.
schema = "nearlift.campaign/1"
name   = "{name}"

[vehicle]
name          = "Crazyflie 2.1"
rotors        = 4
rotor_radius  = "23 mm"
rotor_spacing = "65 mm"
mass          = "27 g"
throttle_map  = {{ points = [{points}] }}

[rig]
held            = "throttle"
distance_datum  = "rotor plane"      # no distance was measured
distance_offset = "0 mm"
gravity         = "9.80665 m/s^2"    # of the stand's calibration, not recorded

[records]
reader = "means"

[trials]
file = "trials.csv"
[trials.units]
distance = "mm"
throttle = "fraction"
lift     = "gf"
lift_sd  = "gf"
supply   = "V"
rpm      = "rpm"
"""


def convert(files: dict[str, Path], folder: Path, name: str) -> None:
    """Write the campaign; a file is a session.

    Raises
    ------
    InputRefused
        A file lacks a column, or begins with turning rotors.
    """
    lines = ["trial,boundary,distance,throttle,lift,lift_sd,n,supply,rpm,session"]
    speeds: dict[float, list[float]] = {}
    for session, path in enumerate(files.values(), 1):
        rows = _read(path)
        dwells = [
            (pwm, list(group)) for pwm, group in itertools.groupby(rows, key=lambda row: row[1])
        ]
        if not dwells or dwells[0][0] != 0:
            raise InputRefused(
                str(path), "does not begin with rotors at rest", "its weights cannot be tared"
            )
        zero = statistics.fmean(row[0] for row in dwells[0][1])
        for place, (pwm, dwell) in enumerate(dwells):
            if pwm == 0 or len(dwell) < LEAST_ROWS:
                continue
            settled = dwell[len(dwell) // 2 :]
            weights = [reading for reading, _ in itertools.groupby(row[0] for row in settled)]
            rpm, supply = (statistics.fmean(row[i] for row in settled) for i in (3, 2))
            throttle = round(pwm / FULL_PWM, 6)
            speeds.setdefault(throttle, []).append(rpm)
            spread = statistics.stdev(weights) if len(weights) > 1 else 0.0
            cells = (
                f"{throttle:g}",
                f"{statistics.fmean(weights) - zero:.5g}",
                f"{spread:.3g}",
                str(len(weights)),
                f"{supply:.4g}",
                f"{rpm:.6g}",
            )
            lines.append(",".join((f"s{session}-{place:03d},none,", *cells, str(session))))
    points = ", ".join(
        f'["{100 * t:.4g} percent", "{statistics.fmean(rpm):.0f} rpm"]'
        for t, rpm in sorted(speeds.items())
    )
    (folder / "campaign.toml").write_text(
        MANIFEST.format(name=name, points=points), encoding="utf-8"
    )
    (folder / "trials.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _read(path: Path) -> list[tuple[float, int, float, float]]:
    """Weight in g, pulse width, supply in V, mean speed of the rotors that report one in rpm."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        lacking = [c for c in COLUMNS if c not in (reader.fieldnames or ())]
        if lacking:
            raise InputRefused(
                str(path),
                f"lacks the columns {', '.join(lacking)}",
                f"it has to have {', '.join(COLUMNS)}",
            )
        rows = []
        for number, row in enumerate(reader, 2):
            try:
                turning = [rpm for rpm in (float(row[f"rpm{i}"]) for i in range(1, 5)) if rpm > 0]
                rows.append(
                    (
                        float(row["weight[g]"]),
                        int(row["pwm"]),
                        float(row["vbat[V]"]),
                        statistics.fmean(turning) if turning else 0.0,
                    )
                )
            except (TypeError, ValueError):
                raise InputRefused(
                    f"{path}, line {number}",
                    "is not a row of numbers",
                    "the file was changed or cut",
                ) from None
    return rows
