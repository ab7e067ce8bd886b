"""Whether a file is a vehicle's own log of a flight, told from the names of its channels, and the
[flight] table that cuts it into trials.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.manifest.flight_log import STANDARD_G
from nearlift.readers.channel import Channel, Contents
from nearlift.readers.flight_log import siblings
from nearlift.reduction.airborne import starts_and_contacts
from nearlift.reduction.specific_force import faults

#: What each quantity is called by flight controllers, the surest name first; of the whole name,
#: groups included.
NAMES = {
    "acceleration": (
        re.compile(r"stateestimate\.az$"),
        re.compile(r"(accelerometer_m_s2|xyz)\[2\]$"),
        re.compile(r"linear_acceleration\.z$"),
        re.compile(r"(^|[._/])a(cc(el(eration)?)?)?[._ ]?z\b"),
    ),
    "velocity": (
        re.compile(r"stateestimate\.vz$"),
        re.compile(r"local_position\.vz$"),
        re.compile(r"twist\.linear\.z$"),
        re.compile(r"(^|[._/])v(el(ocity)?)?[._ ]?z\b"),
    ),
    "setpoint": (
        re.compile(r"(ctrltarget|set_?point|target|desired|ref\w*)\b.*z$"),
        re.compile(r"(^|[._/])(set_?point|target)([._]z)?$"),
    ),
    "height": (
        re.compile(r"stateestimate\.z$"),
        re.compile(r"local_position\.z$"),
        re.compile(r"position\.z$"),
        re.compile(r"(^|[._/])(height|altitude|alt|z|zrange)\b"),
    ),
    "supply": (
        re.compile(r"vbatmv$"),
        re.compile(r"vbat"),
        re.compile(r"battery.*voltage"),
        re.compile(r"(^|[._/])(supply|voltage|battery)\b"),
    ),
}
MOTORS = (
    re.compile(r"pwm"),
    re.compile(r"motor"),
    re.compile(r"actuator|output|esc"),
    re.compile(r"(^|[._/])m\d"),
)
#: What a flight holds.
RIG = '# a flight log: no load cell, the vehicle weighs itself\n[rig]\nheld = "command"\n'
UNITS = {"height": "m", "velocity": "m/s", "setpoint": "m"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Channels:
    """The channels of a flight log by what they are."""

    known: dict[str, Channel]
    commands: tuple[Channel, ...]


def channels_of(contents: Contents) -> Channels | None:
    """The channels of a flight log; None where one that is needed is missing."""
    known: dict[str, Channel] = {}
    for what, patterns in NAMES.items():
        left = [c for c in contents.channels if c not in known.values() and len(c.values)]
        channel = next((c for p in patterns for c in left if p.search(c.name.lower())), None)
        if channel is not None:
            known[what] = channel
        elif what not in ("setpoint", "supply"):
            return None
    commands = _commands(contents.channels)
    return Channels(known=known, commands=commands) if commands else None


def _commands(channels: Sequence[Channel]) -> tuple[Channel, ...]:
    """The channels that differ in a rotor's number alone, of the surest name that there is."""
    for pattern in MOTORS:
        groups: dict[str, list[Channel]] = {}
        for c in channels:
            if pattern.search(c.name.lower()) and re.search(r"\d", c.name) and len(c.values):
                groups.setdefault(re.sub(r"\d+", "#", c.name), []).append(c)
        full = [g for g in groups.values() if len(g) > 1]
        # a controller has more outputs than rotors, which then stand still
        moving = [tuple(c for c in g if np.ptp(c.values) > 0) for g in full]
        if best := max(moving, key=len, default=()):
            return best
    return ()


def flight_block(channels: Channels, contents: Contents) -> str:
    """[flight], with what the log does not say marked FILL IN."""
    acceleration, command = channels.known["acceleration"], channels.commands
    unit, gravity, axes = conventions(channels, contents)
    said = (
        "   # as its samples have it"
        if unit
        else '   # "g" or "m/s^2"; "included" or "removed"; "body" or "world" axes'
    )
    words = [unit or "FILL IN", gravity or "FILL IN", axes or "FILL IN"]
    lines = [
        "[flight]",
        (
            f"acceleration = {{ column = {_text(acceleration)}, unit = {json.dumps(words[0])},"
            f" gravity = {json.dumps(words[1])}, axes = {json.dumps(words[2])} }}{said}"
        ),
    ]
    columns = ", ".join(_text(c) for c in command)
    full, zero = _full(max(float(np.nanmax(c.values)) for c in command))
    at_rest = f", zero = {zero}" if zero else ""
    lines.append(f"command  = {{ columns = [{columns}], full = {full}{at_rest} }}")
    if (supply := channels.known.get("supply")) is not None:
        unit = "mV" if float(np.nanmedian(supply.values)) > 500 else "V"
        lines.append(f'supply   = {{ column = {_text(supply)}, unit = "{unit}" }}')
    for what in ("height", "velocity", "setpoint"):
        if what in channels.known:
            zero_at = ', zero = "each start"' if what == "height" else ""
            lines.append(
                f"{what:8} = {{ column = {_text(channels.known[what])}, unit ="
                f' "{channels.known[what].unit or UNITS[what]}"{zero_at} }}'
            )
    return "\n".join(lines) + "\n"


def conventions(channels: Channels, contents: Contents) -> tuple[str, str, str]:
    """Unit, gravity and axes of the acceleration that its samples do not contradict; empty where
    they leave a choice, or where series have clocks of their own.
    """
    z, velocity = channels.known["height"].values, channels.known["velocity"]
    up = channels.known["acceleration"]
    lengths = {len(c.values) for c in (up, velocity, channels.known["height"], *channels.commands)}
    rate = up.rate_Hz
    if len(lengths) > 1 or rate is None:
        return "", "", ""
    a, v = _three(up, contents), _three(velocity, contents)
    command = np.stack([c.values for c in channels.commands], axis=1)
    with np.errstate(all="ignore"):
        climb = v if v.ndim == 1 else v[:, 2]
        full, zero = _full(float(np.nanmax(command)))
        aloft, _, _ = starts_and_contacts(climb, z, (command - zero) / (full - zero), 0.15)
        fitting = [
            (unit, gravity, axes)
            for unit, factor in (("g", STANDARD_G), ("m/s^2", 1.0))
            for gravity in ("included", "removed")
            for axes in ("body", "world")
            if aloft.any()
            and (axes == "body" or a.ndim > 1)
            and not faults(factor * a, v, z, aloft, 1 / rate, (gravity, axes, STANDARD_G))
        ]
    if len({f[:2] for f in fitting}) != 1:
        return "", "", ""
    return (*fitting[0][:2], fitting[0][2] if len(fitting) == 1 or a.ndim == 1 else "")


def _three(channel: Channel, contents: Contents) -> FloatArray:
    """A channel with its siblings along x and y before it, where there are such."""
    others = [c.values for c in siblings(channel, contents.channels)]
    return np.stack([*others, channel.values], axis=1) if len(others) == 2 else channel.values


def _full(highest: float) -> tuple[float, float]:
    """What a command reads at full throttle and at rest, of the ranges that there are."""
    for most, full, zero in ((1.001, 1, 0), (100.1, 100, 0), (1000.5, 1000, 0), (2200, 2000, 1000)):
        if highest <= most:
            return full, zero
    return 65535, 0


def _text(channel: Channel) -> str:
    return json.dumps(channel.name, ensure_ascii=False)
