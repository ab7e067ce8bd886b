"""A Crazyflie 2.1 on a thrust stand: dwells of constant pulse width as trials in free air, and the
throttle map that they give.

Files of ``weight[g],pwm,vbat[V],rpm1,...,rpm4,...``, a row some 10 ms after the other; the cell is
read ten times a second. A dwell is a run of rows with one pulse width; its first half is left for
rotors and cell to settle. Weights are tared by the rows before the rotors turn.
"""

from __future__ import annotations

import itertools
import statistics
from pathlib import Path

from nearlift.datasets.tables import read_rows, write_campaign
from nearlift.errors import InputRefused

COLUMNS = ("weight[g]", "pwm", "vbat[V]", "rpm1", "rpm2", "rpm3", "rpm4")
FULL_PWM = 65535
#: Rows of the shortest dwell that is a trial: half of it must hold more than a few readings of the
#: cell.
LEAST_ROWS = 90


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
    write_campaign(folder, "crazyflie_stand", lines, name=name, points=points)


def _read(path: Path) -> list[tuple[float, int, float, float]]:
    """Weight in g, pulse width, supply in V, mean speed of the rotors that report one in rpm."""
    rows = []
    for number, row in enumerate(read_rows(path, COLUMNS), 2):
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
                f"{path}, line {number}", "is not a row of numbers", "the file was changed or cut"
            ) from None
    return rows
