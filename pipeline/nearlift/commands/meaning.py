"""What a channel of a record or a column of a table may be, told from its name and its unit."""

from __future__ import annotations

import re
from collections.abc import Sequence

from nearlift import units
from nearlift.errors import ManifestError
from nearlift.readers.channel import AS_FORCE, FORCE_UNITS, Channel, fold, rate_of, split_unit
from nearlift.schedule import KNOWN

#: Words that a force channel is called by, the surest first.
FORCE_WORDS = (
    "thrust",
    "force fz",
    "lift",
    "load cell",
    "loadcell",
    "weight",
    "force",
    "kraft",
    "schub",
    "cell",
    "fz",
)
#: What is asked of a rotor is no measured force, in whatever unit; nor is what is called like a
#: motor, unless it is called a force as well.
ASKED = {
    "cmd",
    "command",
    "commanded",
    "setpoint",
    "target",
    "desired",
    "ref",
    "reference",
    "throttle",
}
OF_A_MOTOR = {"u", "m", "motor", "pwm", "esc", "servo", "acc", "vibration", "efficiency"}
CLOCKS = ("t", "time", "timestamp", "x_value", "zeit", "millis", "micros")
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
#: Rates that a load cell's samples may have, Hz: below are means of steps, or another unit of time.
BELIEVED_HZ = (1.0, 2e6)
#: Units as they stand behind the last underscore of a name.
_BEHIND = {
    unit: unit
    for unit in (
        *("s", "ms", "us", "V", "mV", "A", "mA", "W", "N", "mN", "kN", "g", "gf", "kg", "kgf"),
        *("lbf", "m", "mm", "cm", "um", "Hz", "kHz", "Pa", "hPa", "kPa", "degC", "deg", "rad"),
        *("percent", "rpm"),
    )
} | {"v": "V", "a": "A", "w": "W", "hz": "Hz", "sec": "s", "pct": "percent", "C": "degC"}
#: Other names of a schedule's columns, folded, without their units, `_` as a blank.
SYNONYMS = {
    "trial": ("id", "run", "file", "record", "test", "name", "nr", "no"),
    "boundary": ("surface", "effect", "wall"),
    "distance": ("dist", "height", "h", "z", "gap", "clearance", "altitude"),
    "throttle": ("thr", "duty", "pwm", "esc", "esc signal"),
    "start": ("started", "start time", "date", "time of day"),
    "session": ("battery number", "series", "block"),
    "supply": ("voltage", "vbat", "battery", "v bat", "supply voltage"),
    "current": ("i", "amps"),
    "rpm": ("speed", "rpm mean", "rpm avg", "rotor speed"),
    "power": ("p", "electrical power"),
    "temperature": ("temp", "air temperature"),
    "pressure": ("p", "air pressure"),
    "humidity": ("relative humidity", "rh"),
    "lift": ("thrust", "force", "fz", "weight", "mean lift", "mean thrust", "mean force"),
    "lift_sd": ("sd", "std", "lift std", "thrust sd", "thrust std", "fz sd", "fz std", "force sd"),
    "n": ("samples", "count"),
}


def named(name: str) -> tuple[str, str]:
    """Name and unit (empty: none) of ``Thrust (gf)``, ``weight[g]`` or ``h_mm``."""
    bare, unit = split_unit(name)
    if unit:
        return bare, unit
    head, _, behind = name.strip().rpartition("_")
    if head and behind in _BEHIND:
        return head, _BEHIND[behind]
    # a small n counts, unless the name is a force's
    if behind == "n" and any(word in fold(head) for word in FORCE_WORDS):
        return head, "N"
    return name, {"millis": "ms", "micros": "us"}.get(fold(name), "")


def likely_force(channels: Sequence[Channel]) -> Channel | None:
    """The one channel that may be the load cell: called a force, or in a unit of force; None where
    there is none, or no telling which.
    """
    ranks = [_rank(channel) for channel in channels]
    best = max(ranks, default=0)
    if best and ranks.count(best) == 1:
        return channels[ranks.index(best)]
    return channels[0] if len(channels) == 1 else None


def _rank(channel: Channel) -> int:
    plain = fold(named(channel.name)[0])
    said = next((len(FORCE_WORDS) - i for i, w in enumerate(FORCE_WORDS) if w in plain), 0)
    words = set(re.findall(r"[^\W\d_]+", plain))
    if words & ASKED or (words & OF_A_MOTOR and not said):
        return 0
    if channel.unit in FORCE_UNITS:
        return 100 + said
    # a gram is a force only to what is called one
    return said if channel.unit in ("", "count", *AS_FORCE) else 0


def likely_clock(channels: Sequence[Channel], force: Channel | None) -> Channel | None:
    """The channel that may be the clock of the force."""
    group = force.name.rpartition(".")[0] if force is not None and "." in force.name else ""
    clocks = [c for c in channels if c.unit in ("", *SECONDS) and is_clock(c.name)]
    in_group = [c for c in clocks if c.name.rpartition(".")[0] == group]
    return next(iter(in_group or clocks), None)


def is_clock(name: str) -> bool:
    """Whether a column of that name is a clock."""
    return fold(named(name)[0].rsplit(".", 1)[-1]) in CLOCKS


def clock_rate(clock: Channel | None) -> float | None:
    """The rate of a clock with a unit, Hz."""
    if clock is None or clock.unit not in SECONDS or len(clock.values) < 3:
        return None
    return rate_of(SECONDS[clock.unit] * clock.values)


def doubtful_rate(rate_Hz: float, clock: Channel | None) -> str:
    """Why a rate cannot be that of a load cell's samples; empty where it can."""
    low, high = BELIEVED_HZ
    if low <= rate_Hz <= high:
        return ""
    said = f"the file says {rate_Hz:.6g} Hz, which no load cell has"
    step = None if clock is None or clock.unit not in SECONDS else rate_Hz * SECONDS[clock.unit]
    other = [] if step is None else [u for u, s in SECONDS.items() if 10 <= step / s <= 1e5]
    ways = ["these are means of steps"] if rate_Hz < low else []
    if step is not None and other:
        ways.append(f"its clock is in {other[0]} ({step / SECONDS[other[0]]:.6g} Hz)")
    return f"{said}: {' or '.join(ways)}" if ways else said


def schedule_column(name: str) -> tuple[str, str]:
    """What a schedule calls a column of that name, and its unit, each empty where nobody knows."""
    bare, unit = named(name)
    plain = fold(bare).replace("_", " ")
    may = [
        known
        for known in KNOWN
        if plain == known.name.replace("_", " ") or plain in SYNONYMS.get(known.name, ())
    ]
    for known in may:
        if known.kind != "quantity":
            return known.name, ""
        written = AS_FORCE.get(unit, unit) if known.dimension == "force" else unit
        try:
            units.to_si(written or known.own_unit, known.dimension, "")
        except ManifestError:
            continue
        return known.name, written or known.own_unit
    # in a unit of something else it is something else
    return (may[0].name, "") if may and not unit else ("", "")
