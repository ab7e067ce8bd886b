"""Quantity and unit that a heading means, of a channel of a record or a column of a table."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from nearlift import units
from nearlift.declare import FloatArray
from nearlift.errors import ManifestError
from nearlift.readers.base import (
    AS_FORCE,
    FORCE_UNITS,
    SECONDS,
    Channel,
    fold,
    rate_of,
    split_unit,
    unit_word,
)
from nearlift.schedule import BY_NAME, KNOWN, RADII


def _pairs(text: str) -> dict[str, str]:
    """A mapping from ``key:value`` pairs."""
    return {key: value for key, _, value in (pair.partition(":") for pair in text.split())}


#: Words in names of force channels, the most certain first.
FORCE_WORDS = (
    *("thrust", "force fz", "lift", "load cell", "loadcell", "weight", "force", "kraft"),
    *("schub", "auftrieb", "poussée", "portance", "empuje", "cell", "fz"),
)
#: Names of a lift without a unit.
LIFT_WORDS = {"thrust", "lift", "force", "fz", "f", *FORCE_WORDS[7:12]}
#: Words of a command or of a motor: no measured force, whatever the unit.
COMMAND_WORDS = {
    *("cmd", "command", "commanded", "setpoint", "target", "desired", "ref", "reference"),
    "throttle",
}
MOTOR_WORDS = {"u", "m", "motor", "pwm", "esc", "servo", "acc", "vibration", "efficiency"}
#: Words of a statistic that is no mean.
SCATTER_WORDS = {
    *("sd", "std", "stdev", "stddev", "sigma", "dev", "deviation", "scatter", "rms", "noise"),
    *("std.", "σ", "±", "s", "standardabweichung", "streuung", "stdabw", "écart", "desviación"),
}
OTHER_STATISTICS = {
    *("min", "max", "peak", "minimum", "maximum", "median", "u", "se", "sem", "err", "error"),
    *("uncertainty", "efficiency", "tare", "zero", "offset", "mass", "raw", "theory", "model"),
}
MEAN_WORDS = {"mean", "avg", "average", "mittel", "mittelwert"}
CLOCKS = (
    *("t", "time", "timestamp", "time stamp", "stamp", "ts", "x_value", "zeit", "uhrzeit"),
    *("date", "datetime"),
)
#: Headings of clocks that are a unit.
TIMES = _pairs("millis:ms micros:us ms:ms us:us ns:ns sec:s seconds:s")
#: Sample rates of load cells, Hz. A lower one is of means of steps, a higher one of another unit.
USUAL_RATES_HZ = (1.0, 2e6)
#: Headings of distances in rotor radii.
AS_RADII = {
    *("h/r", "z/r", "z_hat", "zhat", "d/r", "y/r"),
    *("gap/r", "height/r", "distance/r", "dist/r", "clearance/r"),
}
#: Headings of distances in rotor diameters, which the manifest does not read.
AS_DIAMETERS = {"h/d", "z/d"}
#: Units behind the last underscore of a name.
_SUFFIXES = {
    unit: unit
    for unit in (
        *(
            "s",
            "ms",
            "us",
            "ns",
            "V",
            "mV",
            "A",
            "mA",
            "W",
            "N",
            "mN",
            "kN",
            "g",
            "gf",
            "kg",
            "kgf",
        ),
        *("lbf", "m", "mm", "cm", "um", "Hz", "kHz", "Pa", "hPa", "kPa", "degC", "deg", "rad"),
        *("percent", "fraction", "rpm"),
    )
} | _pairs(
    "v:V a:A w:W hz:Hz sec:s pct:percent pc:percent C:degC lbs:lbf lb:lbf oz:ozf volts:V amps:A"
)
#: Units that instruments write and `readers.base` does not know, folded.
_WRITTEN = _pairs(
    "lbs:lb pounds:lb ounces:oz grams-force:gf gram-force:gf g-f:gf p:gf kp:kgf 1/min:rpm volts:V"
    " pct:percent"
)
#: Other names of a schedule's columns: folded, without units, blanks for `_`.
SYNONYMS = {
    "trial": ("id", "run", "file", "record", "test", "name", "nr", "no", "filename", "file name"),
    "boundary": ("surface", "effect", "wall"),
    "distance": (
        *("dist", "height", "h", "z", "gap", "clearance", "altitude"),
        *("abstand", "höhe", "hauteur", "altura", "distancia"),
    ),
    "throttle": (
        *("thr", "duty", "pwm", "esc", "esc signal", "signal", "command", "cmd", "gas"),
        *("drossel", "gaz", "commande", "acelerador"),
    ),
    "start": ("started", "start time", "date", "time of day", "timestamp"),
    "session": ("battery number", "series", "block", "day", "battery no", "pack"),
    "supply": ("voltage", "vbat", "battery", "v bat", "supply voltage", "battery voltage", "v"),
    "current": ("i", "amps", "strom"),
    "rpm": ("speed", "rpm mean", "rpm avg", "rotor speed"),
    "power": ("p", "electrical power"),
    "temperature": ("temp", "air temperature", "t air"),
    "pressure": ("p", "air pressure"),
    "humidity": ("relative humidity", "rh"),
    "lift": ("thrust", "force", "fz", "weight", "mean lift", "mean thrust", "mean force"),
    "lift_sd": ("sd", "std", "lift std", "thrust sd", "thrust std", "fz sd", "fz std", "force sd"),
    "n": ("samples", "count"),
}
#: Words of which one is enough, as in ``Height above floor``.
ONE_WORD = {
    "distance": {"distance", "height", "gap", "clearance", "altitude"},
    "throttle": {"throttle", "duty", "pwm", "esc", "signal"},
    "supply": {"voltage", "vbat", "battery"},
}


def named(heading: str) -> tuple[str, str]:
    """Name and unit (empty: none) of ``Thrust (gf)``, ``weight[g]`` or ``h_mm``."""
    bare, unit = split_unit(heading)
    if unit:
        return bare, _WRITTEN.get(fold(unit), unit)
    if heading.rstrip().endswith("%"):
        return heading.rstrip(" %"), "percent"
    # a unit before the last words, as in "Thrust (lbf) mean"
    within = re.fullmatch(r"([^()\[\]]+)[(\[]([^()\[\]]+)[)\]]\s*(\w[\w ]*)", heading.strip())
    if within and (inner := unit_word(within[2])):
        return f"{within[1].rstrip()} {within[3]}", inner
    head, _, suffix = heading.strip().rpartition("_")
    suffix = suffix.lower() if heading.isupper() and suffix.lower() in _SUFFIXES else suffix
    if head and suffix in _SUFFIXES:
        return head, _SUFFIXES[suffix]
    # a lower-case n is newtons in the name of a force, else a count
    if suffix == "n" and any(word in fold(head) for word in FORCE_WORDS):
        return head, "N"
    return heading, TIMES.get(fold(heading), "")


def words(heading: str) -> set[str]:
    """The words of a name, folded, its unit left out."""
    return set(re.findall(r"[^\W\d_]+|±", fold(named(heading)[0])))


def force_unit(heading: str) -> str:
    """The unit of a heading; one of mass as that of a weight."""
    unit = named(heading)[1]
    return AS_FORCE.get(unit, unit)


# ---- channels of a record


def likely_force(columns: Sequence[tuple[str, str]]) -> int | None:
    """Place of the one column that may be the load cell's, by names and units; else None.

    It is called a force, or is in a unit of force. Of several, it is the most certain one.
    """
    ranks = [_rank(*column) for column in columns]
    best = max(ranks, default=0)
    return ranks.index(best) if best and ranks.count(best) == 1 else None


def _rank(heading: str, unit: str) -> int:
    said, plain = words(heading), fold(named(heading)[0])
    force = next((len(FORCE_WORDS) - i for i, w in enumerate(FORCE_WORDS) if w in plain), 0)
    force = force or len(said & LIFT_WORDS)
    if said & COMMAND_WORDS or (said & MOTOR_WORDS and not force):
        return 0
    if unit in FORCE_UNITS:
        return 100 + force + 100 * bool(said & MEAN_WORDS)
    # a gram is a force only in a channel that is called one
    if force and unit in AS_FORCE:
        return 50 + force
    return force + 100 * bool(force and said & MEAN_WORDS) if unit in ("", "count") else 0


def force_channel(channels: Sequence[Channel]) -> Channel | None:
    """Channel that may be the load cell: `likely_force`, else the only one that is no clock."""
    place = likely_force([(c.name, c.unit) for c in channels])
    if place is not None:
        return channels[place]
    only = [c for c in channels if not is_clock(c.name) and c.unit not in SECONDS]
    alone = len(only) == 1 and not words(only[0].name) & (COMMAND_WORDS | MOTOR_WORDS)
    return only[0] if alone else None


def is_clock(heading: str) -> bool:
    """Whether a column of that name is a clock."""
    bare, unit = named(heading)
    called = fold(bare.rsplit(".", 1)[-1])
    return (called in CLOCKS and unit in ("", *SECONDS)) or called in TIMES


def stamp_unit(clock: Channel) -> str:
    """The unit of a clock's stamps since 1970, or of a spreadsheet's days; empty for others."""
    first = float(clock.values[0]) if len(clock.values) else 0.0
    for unit in ("s", "ms", "us", "ns"):
        if 8e8 < first * SECONDS[unit] < 4e9:
            return unit
    in_days = 2e4 < first < 8e4 and 0 < float(clock.values[-1]) - first < 1
    return "day" if in_days else ""


def likely_clock(channels: Sequence[Channel], force: Channel | None) -> Channel | None:
    """The channel that may be the clock of the force."""
    group = force.name.rpartition(".")[0] if force is not None and "." in force.name else ""
    clocks = [c for c in channels if c.unit in ("", *SECONDS) and is_clock(c.name)]
    in_group = [c for c in clocks if c.name.rpartition(".")[0] == group]
    # times of day under another name
    grows = [c for c in channels if c.unit == "s" and len(c.values) > 2 and _only_grows(c.values)]
    return next(iter(in_group or clocks or grows), None)


def _only_grows(values: FloatArray) -> bool:
    return bool(np.all(np.diff(values) >= 0) and values[-1] > values[0])


def clock_rate(clock: Channel | None) -> float | None:
    """The rate of a clock with a unit, Hz."""
    if clock is None or clock.unit not in SECONDS or len(clock.values) < 3:
        return None
    return rate_of(SECONDS[clock.unit] * clock.values)


def doubtful_rate(rate_Hz: float, clock: Channel | None) -> str:
    """The reason why a rate cannot be that of a load cell's samples; empty where it can."""
    low, high = USUAL_RATES_HZ
    if low <= rate_Hz <= high:
        return ""
    ways = ["these are means of steps"] if rate_Hz < low else []
    if clock is not None and clock.unit in SECONDS:
        rates = {u: rate_Hz * SECONDS[clock.unit] / s for u, s in SECONDS.items()}
        fitting = (f"its clock is in {u} ({r:.6g} Hz)" for u, r in rates.items() if 10 <= r <= 1e5)
        ways += [*fitting][:1]
    said = f"the file says {rate_Hz:.6g} Hz, which no load cell has"
    return f"{said}: {' or '.join(ways)}" if ways else said


# ---- columns of a schedule


def schedule_column(heading: str) -> tuple[str, str]:
    """Column of the schedule that a heading means, and its unit; each may be empty."""
    bare, unit = named(heading)
    ratios = {fold(heading).replace("_over_", "/").replace(" ", ""), fold(unit)}
    if ratios & AS_RADII or unit == RADII:
        return "distance", RADII
    if ratios & AS_DIAMETERS:
        return "", ""
    plain, said = fold(bare).replace("_", " "), words(heading)
    may = [k for k in KNOWN if plain in (k.name.replace("_", " "), *SYNONYMS.get(k.name, ()))]
    for known in may:
        if known.kind == "quantity" and (written := unit_of(known.name, unit)):
            return known.name, written
        if known.kind != "quantity" and not unit:
            return known.name, ""
    # a unit of another dimension makes it another quantity
    if may and not unit:
        return may[0].name, ""
    if said & (OTHER_STATISTICS | SCATTER_WORDS):
        return "", ""
    for column in (column for column, of_it in ONE_WORD.items() if said & of_it):
        if (written := unit_of(column, unit) if unit else "") or (not unit and column != "supply"):
            return column, written
    return "", ""


def unit_of(column: str, unit: str) -> str:
    """Unit of a schedule's column as the manifest has it; empty if missing, or of another kind."""
    known = BY_NAME[column]
    written = AS_FORCE.get(unit, unit) if known.dimension == "force" else unit
    try:
        units.to_si(written or known.own_unit, known.dimension, "")
    except ManifestError:
        return ""
    return written or known.own_unit
