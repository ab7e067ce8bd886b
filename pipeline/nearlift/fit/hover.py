"""Hover voltages of flights in one condition compared with those of sound flights.

Averaged over a start, motors in hover balance the vehicle's weight and moments, whatever gusts the
controller countered; no set-point is needed. Log voltages are compared: of all rotors together, and
of each against the others. The scatter from one sound log to another is the noise, known as well as
there are sound logs (Student's t), and every contrast shares the stated false-alarm rate
(Bonferroni).
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood import student
from nearlift.results.hover import HoverShift

#: Fewest sound logs from which their scatter is estimated.
FEWEST_SOUND = 3


def shifts(of: FloatArray, sound: FloatArray, false_alarm_rate: float) -> tuple[HoverShift, ...]:
    """Shifts of logs `of` one condition (m, S, R) from `sound` ones (n, S, R): mean log voltages of
    each start, nan where a log has fewer. Starts are compared by number, since a battery is warm in
    the second. A single rotor is not compared with others.
    """
    usual = np.nanmean(sound, axis=0)
    contrast = _contrasts(of.shape[2])
    value, scatter = (contrast @ np.nanmean(logs - usual, axis=1).T for logs in (of, sound))
    m, n = len(of), len(sound)
    reach = student.quantile(1 - false_alarm_rate / 2 / len(contrast), n - 1)
    limits = reach * np.std(scatter, axis=1, ddof=1) * np.sqrt(1 / m + 1 / n)
    return tuple(
        HoverShift(rotor=rotor, value=float(shift), limit=float(limit))
        for rotor, (shift, limit) in enumerate(zip(value.mean(axis=1), limits, strict=True))
    )


def _contrasts(rotors: int) -> FloatArray:
    mean = np.full((1, rotors), 1 / rotors)
    if rotors == 1:
        return mean
    apart = (rotors * np.eye(rotors) - 1) / (rotors - 1)
    return np.vstack([mean, apart])
