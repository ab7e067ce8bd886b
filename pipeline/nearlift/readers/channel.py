"""A file as channels: named series with the unit and rate that it states, as readers give them."""

from __future__ import annotations

import difflib
import functools
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused

#: ``[records] dialect`` of a manifest: keys and types are those of the format's options.
RecordsDialect = Mapping[str, object]
#: The names of the channels wanted; None for all.
Names = tuple[str, ...] | None
#: What nearlift calls a unit, and so do instruments in letters of any size; what else they write,
#: folded.
_UNITS = (
    *("N", "mN", "kN", "gf", "kgf", "lbf", "ozf", "g", "kg", "lb", "oz", "count", "percent"),
    *("s", "ms", "us", "Hz", "kHz", "rpm", "m", "mm", "cm", "m/s", "m/s^2", "deg", "rad"),
    *("V", "mV", "A", "mA", "W", "degC", "K", "Pa", "hPa", "kPa", "N m"),
)
_WRITTEN = {
    "N": ("newton", "newtons"),
    "g": ("gram", "grams"),
    "count": ("counts",),
    "s": ("sec", "second", "seconds"),
    "us": ("μs", "microseconds"),
    "V": ("volt", "volts"),
    "A": ("amps",),
    "percent": ("%",),
    "degC": ("°c", "c"),
    "m/s^2": ("m/s2",),
    "N m": ("nm", "n·m"),
    "": ("-", "1"),
}
UNITS = {unit.casefold(): unit for unit in _UNITS} | {
    word: unit for unit, words in _WRITTEN.items() for word in words
}
#: What a load cell means by a unit of mass.
AS_FORCE = {"g": "gf", "kg": "kgf", "lb": "lbf", "oz": "ozf"}
FORCE_UNITS = ("N", "mN", "kN", "gf", "kgf", "lbf", "ozf")
_PRODUCT = str.maketrans({"·": "·", "⋅": "·", "∙": "·", "*": "·", "•": "·"})


class Malformed(Exception):
    """A file that contradicts itself: its trial is rejected, the campaign goes on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One series: its name, the unit that the file states (empty: none), samples, stated rate."""

    name: str
    unit: str = ""
    values: FloatArray
    rate_Hz: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """The channels of a file, the name of its format, quality codes, and remarks for the user."""

    channels: tuple[Channel, ...]
    kind: str = ""
    codes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@functools.lru_cache(maxsize=1024)
def fold(text: str) -> str:
    """The form in which names are compared: compatible letters folded (both micro signs, all
    product signs), lower case, single blanks.
    """
    plain = unicodedata.normalize("NFKC", text).translate(_PRODUCT).casefold()
    return " ".join(plain.split())


@functools.lru_cache(maxsize=1024)
def split_unit(name: str) -> tuple[str, str]:
    """Name and unit of ``Thrust (gf)`` or ``weight[g]``; the unit is empty where there is none."""
    plain = name.rstrip()
    start = max(plain.rfind("("), plain.rfind("["))
    bare, unit = plain[:start].rstrip(), plain[start + 1 : -1]
    if start < 0 or not bare or not plain.endswith((")", "]")) or ")" in unit or "]" in unit:
        return name, ""
    return bare, unit_word(unit) or unit.strip()


def unit_word(cell: str) -> str | None:
    """What nearlift calls the unit in a cell, brackets aside; None where it is no unit, ""
    where it is blank.
    """
    plain = fold(cell.strip().strip("()[]"))
    return UNITS.get(plain) if plain else ""


def pick(channels: Sequence[Channel], column: str, key: str, where: str) -> Channel:
    """The channel of that name: as written, else folded, else folded without its unit or its group;
    `InputRefused` where there is none, or the name fits several.
    """
    names = tuple(c.name for c in channels)
    places = _fitting(names, column)
    if len(places) == 1:
        return channels[places[0]]
    if places:
        raise InputRefused(
            where,
            f"has more than one column {column!r}: {', '.join(repr(names[i]) for i in places)}",
            f"{key} names one of them",
        )
    close = difflib.get_close_matches(column, names, n=1, cutoff=0.5)
    more = f" and {len(names) - 12} more" if len(names) > 12 else ""
    listed = ", ".join(repr(n) for n in names[:12]) + more
    raise InputRefused(
        where,
        f"has no column {column!r}",
        f'{key} = "{close[0]}"?' if close else f"it has {listed or 'none'}; {key} names it",
    )


# the records of a campaign have the same names
@functools.lru_cache(maxsize=256)
def _fitting(names: tuple[str, ...], column: str) -> tuple[int, ...]:
    """Indices of the names that match, by the first kind of match that any name has."""
    folded = fold(column)
    for same in (
        lambda name: name == column,
        lambda name: fold(name) == folded,
        lambda name: fold(split_unit(name)[0]) == folded,
        lambda name: _in_a_group(name, folded),
    ):
        if places := tuple(i for i, name in enumerate(names) if same(name)):
            return places
    return ()


def wanted(name: str, names: Names) -> bool:
    """Whether `pick` may choose this channel for one of these names, so that a reader need not read
    others; without names every channel is wanted.
    """
    if names is None:
        return True
    spellings = {fold(name), fold(split_unit(name)[0])}
    return any(fold(n) in spellings or _in_a_group(name, fold(n)) for n in names)


def _in_a_group(name: str, folded: str) -> bool:
    """Whether a channel has that name within a group, or a group of groups."""
    return fold(name).endswith((f".{folded}", f"/{folded}"))


def rate_of(clock: FloatArray) -> float | None:
    """The steady rate of a clock in s, Hz: the inverse of its median step; None if it has none."""
    steps = np.diff(clock[np.isfinite(clock)])
    usual = float(np.median(steps)) if len(steps) else 0.0
    return 1 / usual if usual > 0 else None
