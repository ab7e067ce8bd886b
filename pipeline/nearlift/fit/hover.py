"""What hover asks of the motors: by how much flights of one condition differ from sound ones.

Averaged over a start, motors in hover carry the vehicle's weight and balance its moments, whatever
gusts the controller answered on the way; no set-point is needed to read that. Voltages are compared
by their logarithms: of all rotors together, and of each one against the others. What sound flights
differ by among themselves, from log to log, is the noise; its size is known as well as there are
sound logs (Student's t), and every contrast shares the stated false-alarm rate (Bonferroni).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood import student

#: Sound logs that tell what sound flights differ by.
FEWEST_SOUND = 3


class Shifts(NamedTuple):
    """Relative differences of voltage, of all rotors and then of each against the others
    (R + 1,), and how large the difference has to be to be one; a single rotor has no others.
    """

    value: FloatArray
    limit: FloatArray


def shifts(of: FloatArray, sound: FloatArray, false_alarm_rate: float) -> Shifts:
    """Logs `of` one condition (m, S, R) against `sound` ones (n, S, R): log voltages, means of each
    start; nan where a log has fewer starts. Starts are compared with those of the same number,
    since a battery is warm in the second.
    """
    usual = np.nanmean(sound, axis=0)
    contrast = _contrasts(of.shape[2])
    value, scatter = (contrast @ np.nanmean(logs - usual, axis=1).T for logs in (of, sound))
    m, n = len(of), len(sound)
    reach = student.quantile(1 - false_alarm_rate / 2 / len(contrast), n - 1)
    limit = reach * np.std(scatter, axis=1, ddof=1) * np.sqrt(1 / m + 1 / n)
    return Shifts(value=value.mean(axis=1), limit=limit)


def _contrasts(rotors: int) -> FloatArray:
    mean = np.full((1, rotors), 1 / rotors)
    if rotors == 1:
        return mean
    apart = (rotors * np.eye(rotors) - 1) / (rotors - 1)
    return np.vstack([mean, apart])
