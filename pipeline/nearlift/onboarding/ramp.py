"""Lines of a manifest that cut a record of many throttles into trials, tried on the record."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from nearlift.campaign.rig import FEWEST_SAMPLES
from nearlift.declare import FloatArray
from nearlift.onboarding import headings
from nearlift.readers.base import AS_FORCE, Channel, fold, split_unit
from nearlift.readers.sweep import AT_REST, is_sweep, levels_of
from nearlift.reduction import cuts

#: Least rank correlation of a command with the force, and that of one whose name is in `COMMANDS`,
#: since lift may fall before it ends.
FOLLOWS = {False: 0.95, True: 0.7}
#: A staircase has at least this duration of a level, s, or samples where the rate is unknown;
#: number of levels; and share of them left once cut. Otherwise it is a ramp.
LASTS_S, LASTS, FEWEST_LEVELS, LEFT = 0.4, 40, 3, 0.5
#: Words in the names of commands, and of the force's own readings, which follow it as well.
COMMANDS = {"esc", "throttle", "thr", "pwm", "command", "cmd", "signal", "duty"}
READINGS = {"raw", "adc", "count", "counts", "thrust", "force", "load", "cell", "weight", "lift"}
#: Range of pulses, us, and full scales of counts and per cent, where the file has no fraction.
PULSE_US, COUNTS, PERCENT = (700.0, 2600.0), (1023, 4095, 65535), 100.0
#: Settling, pieces and windows that are proposed, s: rotors and cells follow within a few tenths.
SETTLE_S, SHORTEST_S = 0.5, 0.5
#: Largest relative change of lift within a window of a ramp.
CHANGE = 0.03


class Ramp(NamedTuple):
    """A record of many throttles in `words`, and the text of [segments] that cuts it."""

    words: str
    segments: str


def ramp_of(force: Channel, channels: Sequence[Channel]) -> Ramp | None:
    """The ramp in a record that is a sweep, or None; the rate need not be known.

    One of the file's channels that follows the force, and is no clock, may be the command.
    """
    if not is_sweep(force.values):
        return None
    rate_Hz, said, along = force.rate_Hz, "", _command(force, channels)
    if along is None:
        segments = _by_force(force)
    else:
        said = f", along {along.name!r}"
        name, meaning = json.dumps(along.name, ensure_ascii=False), _meaning(along)
        levels = [(a, b) for a, b in cuts.by_level(along.values) if b - a >= FEWEST_SAMPLES]
        if times := _times(levels, len(force.values), rate_Hz):
            said += f", which has {len(levels)} levels that hold"
            segments = "\n".join(["[segments]", f"column = {name}", *meaning, *times, ""])
        else:
            throttle = f"{{ column = {name}, {', '.join(meaning)} }}"
            segments = _in_windows(force.values, rate_Hz, throttle)
    words = f"takes many lifts{said}: it is a sweep of the throttle, not one trial"
    return Ramp(words, segments)


def _command(force: Channel, channels: Sequence[Channel]) -> Channel | None:
    """The column that the force follows: one that is called a command before others."""
    from scipy.stats import rankdata

    ranked, commands = rankdata(np.abs(levels_of(force.values))), []
    for c in channels:
        words = set(re.findall(r"[^\W\d_]+", fold(c.name)))
        said, is_reading = bool(words & COMMANDS), bool(words & READINGS)
        if c.name == force.name or headings.is_clock(c.name) or (is_reading and not said):
            continue
        means = levels_of(c.values)
        if len(c.values) != len(force.values) or not np.isfinite(means).all() or not np.ptp(means):
            continue
        together = float(np.corrcoef(ranked, rankdata(means))[0, 1])
        # a setting, and no measurement, if most samples repeat the one before
        holds = bool(np.mean(c.values[1:] == c.values[:-1]) > 0.5)
        if together > FOLLOWS[said] and (said or holds):
            commands.append((said, together, c))
    return max(commands, key=lambda f: f[:2])[2] if commands else None


def _meaning(command: Channel) -> list[str]:
    """The keys that say what the command's numbers mean."""
    low, high = float(np.nanmin(command.values)), float(np.nanmax(command.values))
    if PULSE_US[0] <= low and PULSE_US[0] < high <= PULSE_US[1]:
        return ["zero = 1000", "full = 2000"]
    if split_unit(command.name)[1] == "percent" or (1.5 < high <= PERCENT and low >= 0):
        return ['unit = "percent"']
    if low >= 0 and high <= 1:
        return ['unit = "fraction"']
    full = next((full for full in COUNTS if PERCENT < high <= full and low >= 0), '"FILL IN"')
    return [f"full = {full}"]


def _times(levels: Sequence[cuts.Cut], samples: int, rate_Hz: float | None) -> list[str]:
    """`settle` and `shortest` that leave most of these levels, tried on them.

    Empty where the command is a ramp: its levels are few, cover too little, or are too short.
    """
    held = [b - a for a, b in levels]
    usual = float(np.median(held)) if held else 0.0
    enough = LASTS_S * rate_Hz if rate_Hz else LASTS
    if len(held) < FEWEST_LEVELS or sum(held) <= 0.5 * samples or usual < enough:
        return []
    if not rate_Hz:
        how = f'FILL IN s"   # levels last {usual:.0f} samples'
        return [f'settle = "{how}', f'shortest = "{how}']
    settle = min(SETTLE_S, usual / rate_Hz / 3)
    shortest = max((usual / rate_Hz - settle) / 2, FEWEST_SAMPLES / rate_Hz)
    printed = [f"{seconds:.2g}" for seconds in (settle, shortest)]
    settled, least = (round(float(text) * rate_Hz) for text in printed)
    kept = cuts.settled(levels, settled, max(least, FEWEST_SAMPLES)).pieces
    if len(kept) < LEFT * len(levels):
        return []
    return [f'settle = "{printed[0]} s"', f'shortest = "{printed[1]} s"']


def _by_force(force: Channel) -> str:
    """Cuts at changes of the force; or, where they leave fewer than two pieces, in windows."""
    throttle, rate_Hz = '{ column = "FILL IN", unit = "percent" }', force.rate_Hz
    step = float(f"{0.05 * float(np.abs(levels_of(force.values)).max()):.2g}")
    if rate_Hz:
        shortest = max(round(2 * SHORTEST_S * rate_Hz), FEWEST_SAMPLES)
        edges = cuts.by_change(force.values, step, shortest)
        if len(cuts.settled(edges, round(SETTLE_S * rate_Hz), shortest).pieces) < 2:
            return _in_windows(force.values, rate_Hz, throttle)
    unit = AS_FORCE.get(force.unit, force.unit) or "FILL IN"
    return f"""[segments]
cut = "plateaus"
step = "{step:g} {unit}"   # smallest change that is a step
settle = "{SETTLE_S:.2g} s"
shortest = "{2 * SHORTEST_S:.2g} s"
[segments.columns]
throttle = {throttle}
"""


def _in_windows(force: FloatArray, rate_Hz: float | None, throttle: str) -> str:
    """Cuts of a ramp into windows within which lift changes little, with a curve for its levels."""
    window = SHORTEST_S
    if rate_Hz:
        means = np.abs(levels_of(force))
        run = means > AT_REST * means.max()
        moved = np.abs(np.diff(means))[run[1:] & run[:-1]] / means[1:][run[1:] & run[:-1]]
        stretch = len(force) / len(means) / rate_Hz
        longest = CHANGE * stretch / max(float(np.median(moved)), 1e-6)
        window = max(min(SHORTEST_S, longest), 2 * FEWEST_SAMPLES / rate_Hz)
    return f"""[segments]
cut = "windows"
length = "{window:.2g} s"
settle = "0 s"
shortest = "{window / 2:.2g} s"
[segments.columns]
throttle = {throttle}

[levels]
by = "curve"   # no throttle repeats
of = ["throttle"]
"""
