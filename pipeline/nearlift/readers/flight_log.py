"""A vehicle's own log as series on one clock, that of its acceleration, in SI and up positive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.declare import BoolArray, FloatArray, IntArray
from nearlift.errors import InputRefused
from nearlift.manifest.campaign import Campaign
from nearlift.manifest.flight_log import Flight, LoggedColumn
from nearlift.readers.channel import Channel, Contents, pick
from nearlift.readers.files import source_of
from nearlift.readers.seam import Reader
from nearlift.reduction.stretch import median

#: What a clock's steps may be, s: no controller is as slow or as fast.
STEPS_S = (1e-4, 0.2)
#: A hole in a series, s, or in steps of its clock where those are longer.
HOLE_S, HOLE_STEPS = 0.03, 2.5
#: Share of a clock's steps that may be holes or run backwards; a log of fewer samples is none.
WORST_CLOCK, FEWEST = 0.2, 50


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightLog:
    """One log; arrays of shape (n,) unless stated, NaN where a sensor said nothing, None for a
    column that the manifest does not name.

    Time is from the first sample on; `run` counts the stretches between holes of the clock.
    Acceleration and velocity, (n,) or (n, 3), are as logged: along one axis, or x, y, z where the
    log has all three. `command` (n, rotors) is in shares of full throttle.
    """

    source: str
    time_s: FloatArray
    run: IntArray
    acceleration_m_s2: FloatArray
    velocity_m_s: FloatArray
    height_m: FloatArray
    command: FloatArray
    supply_V: FloatArray | None = None
    setpoint_m: FloatArray | None = None
    tilt_rad: FloatArray | None = None
    codes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def step_s(self) -> float:
        """The clock's usual step."""
        return median(np.diff(self.time_s))

    @property
    def climb_m_s(self) -> FloatArray:
        """The velocity upwards."""
        return upwards(self.velocity_m_s)


def upwards(values: FloatArray) -> FloatArray:
    """The last axis of a series that has three."""
    return values if values.ndim == 1 else values[:, 2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """When samples came: s, ascending; `kept` are those whose stamps ascend, and `hole_s` is the
    shortest time without one that is a hole.
    """

    time_s: FloatArray
    kept: BoolArray
    hole_s: float


def hole_of(step_s: float) -> float:
    """The shortest time without a sample that is a hole in a series of such a step, s."""
    return max(HOLE_S, HOLE_STEPS * step_s)


def read(campaign: Campaign, root: Path, reader: Reader, path: Path) -> FlightLog | Contents:
    """One log, or the contents of a file without any sample; `InputRefused` where a column or its
    clock is not there or contradicts the manifest, `Malformed` where the file is damaged.
    """
    from nearlift.readers import child
    from nearlift.readers.segments import format_of

    flight, form = campaign.flight, format_of(reader)
    assert flight is not None
    if path.stat().st_size == 0:
        return Contents(channels=(), codes=("EMPTY",))
    with child.source(form) as reading:
        contents = reading(path, campaign.records.dialect, None)
    if not any(len(c.values) for c in contents.channels):
        return Contents(channels=(), codes=contents.codes or ("NO_DATA",), notes=contents.notes)
    return _Aligned(campaign, flight, contents, str(path)).log(source_of(root, path))


class _Aligned:
    """The channels of one file, brought onto one clock."""

    def __init__(self, campaign: Campaign, flight: Flight, contents: Contents, where: str) -> None:
        self.campaign, self.flight, self.contents, self.where = campaign, flight, contents, where
        self.notes = list(contents.notes)
        self.clocks: dict[str, Clock] = {}
        self.main = self._clock_of(self._pick(flight.acceleration.column, "acceleration.column"))

    def log(self, source: str) -> FlightLog:
        flight, clock = self.flight, self.main
        full, zero = flight.command.full, flight.command.zero
        command = [
            self._on_clock(self._pick(name, "command.columns"), held=True)
            for name in flight.command.columns
        ]
        return FlightLog(
            source=source,
            time_s=clock.time_s - clock.time_s[0],
            run=np.cumsum(np.diff(clock.time_s, prepend=clock.time_s[0]) > clock.hole_s),
            acceleration_m_s2=self._three(flight.acceleration, "acceleration", "acceleration"),
            velocity_m_s=self._three(flight.velocity, "velocity", "velocity"),
            height_m=self._one(flight.height, "length", "height"),
            command=(np.stack(command, axis=1) - zero) / (full - zero),
            supply_V=self._if_named(flight.supply, "voltage", "supply"),
            setpoint_m=self._if_named(flight.setpoint, "length", "setpoint", held=True),
            tilt_rad=self._tilt(),
            codes=(*self.contents.codes, *(() if clock.kept.all() else ("clock",))),
            notes=tuple(self.notes),
        )

    def _pick(self, name: str, key: str) -> Channel:
        return pick(self.contents.channels, name, f"flight.{key}", self.where)

    def _one(
        self, column: LoggedColumn, dimension: str, key: str, held: bool = False
    ) -> FloatArray:
        channel = self._pick(column.column, f"{key}.column")
        return column.factor(dimension, key) * self._on_clock(channel, held=held)

    def _if_named(
        self, column: LoggedColumn | None, dimension: str, key: str, held: bool = False
    ) -> FloatArray | None:
        return None if column is None else self._one(column, dimension, key, held)

    def _three(self, column: LoggedColumn, dimension: str, key: str) -> FloatArray:
        """The column that points up, with its siblings x and y before it where the log has them."""
        up, channel = self._one(column, dimension, key), self._pick(column.column, f"{key}.column")
        others = siblings(channel, self.contents.channels)
        if len(others) < 2:
            return up
        factor = abs(column.factor(dimension, key))
        return np.stack([*(factor * self._on_clock(c) for c in others), up], axis=1)

    def _tilt(self) -> FloatArray | None:
        """The angle between rotor axis and vertical; roll or pitch alone tells a part of it."""
        if self.flight.attitude is None:
            return None
        factor, _ = units.to_si(self.flight.attitude.unit, "angle", "flight.attitude.unit")
        cosine = np.ones(len(self.main.time_s))
        for name in self.flight.attitude.columns:
            cosine *= np.cos(factor * self._on_clock(self._pick(name, "attitude.columns")))
        return np.arccos(np.clip(cosine, -1.0, 1.0))

    def _on_clock(self, channel: Channel, held: bool = False) -> FloatArray:
        """A channel at the times of the acceleration: `held` from sample to sample, as commands
        are, or in a straight line; NaN in its holes.
        """
        clock, at = self._clock_of(channel), self.main.time_s
        values = channel.values[clock.kept]
        if clock is self.main:
            return values
        after = np.searchsorted(clock.time_s, at, side="right")
        before = np.clip(after - 1, 0, len(values) - 1)
        behind = np.clip(after, 0, len(values) - 1)
        away = np.maximum(at - clock.time_s[before], 0.0)
        step = clock.time_s[behind] - clock.time_s[before]
        share = np.where(step > 0, away / np.where(step > 0, step, 1.0), 0.0)
        line = values[before] + share * (values[behind] - values[before])
        # what is not sent anew between two samples far apart may be anything
        lost = (after == 0) | (np.maximum(step, away) > clock.hole_s)
        return np.where(lost, np.nan, values[before] if held else line)

    def _clock_of(self, channel: Channel) -> Clock:
        """The clock of a channel: that of its topic, else the one that the manifest names."""
        said, where = self.campaign.records.time, self.where
        topics = [
            c
            for c in self.contents.channels
            if c.name.endswith(".time") and channel.name.startswith(c.name[: -len("time")])
        ]
        stamps, unit = max(topics, key=lambda c: len(c.name), default=None), "s"
        if stamps is None:
            if said is None:
                raise InputRefused(
                    where,
                    f"has no clock for {channel.name!r}",
                    'name it: [records] time = { column = "...", unit = "ms" }',
                )
            stamps = pick(self.contents.channels, said.column, "records.time.column", where)
            unit = said.unit
        if stamps.name not in self.clocks:
            self.clocks[stamps.name] = self._clock(stamps, unit)
        clock = self.clocks[stamps.name]
        if len(clock.kept) != len(channel.values):
            raise InputRefused(
                where,
                f"has {len(channel.values)} samples of {channel.name!r} and {len(clock.kept)} of"
                f" its clock {stamps.name!r}",
                "the log is damaged, or [records] time names the clock of another message",
            )
        return clock

    def _clock(self, channel: Channel, unit: str) -> Clock:
        """A clock in s. Its unit is judged by the median step, whatever the file's header says."""
        tick, _ = units.to_si(unit, "time", "records.time.unit")
        stamps, where = channel.values, self.where
        if len(stamps) < FEWEST:
            raise InputRefused(
                where,
                f"has {len(stamps)} samples of {channel.name!r}",
                f"a flight takes {FEWEST}: leave the log out of the schedule",
            )
        step = float(np.nanmedian(np.diff(stamps)))
        if not STEPS_S[0] <= tick * step <= STEPS_S[1]:
            likely = [
                u for u, s in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
                if STEPS_S[0] <= s * step <= STEPS_S[1]
            ]  # fmt: skip
            what = " or ".join(f'"{u}"' for u in likely)
            raise InputRefused(
                where,
                f"the clock {channel.name!r} steps by {step:.4g} {unit}, which no log of a flight"
                " does",
                f"[records] time: unit = {what}?" if what else "name another clock",
            )
        if channel.unit and channel.unit != unit and channel.unit in ("s", "ms", "us", "ns"):
            self.notes.append(
                f"the header says {channel.unit} of {channel.name!r}; its steps are those of a"
                f" clock in {unit}, as the manifest says"
            )
        return self._ascending(tick * stamps, channel.name)

    def _ascending(self, time_s: FloatArray, name: str) -> Clock:
        """The samples whose stamps ascend, those aside that jump ahead and come back."""
        n = len(time_s)
        known = np.isfinite(time_s)
        hole_s = hole_of(float(np.nanmedian(np.diff(time_s))))
        latest = np.maximum.accumulate(np.where(known, time_s, -np.inf))
        before = np.concatenate([[-np.inf], latest[:-1]])
        # a stamp that every later one lies below came from nowhere
        soonest = np.minimum.accumulate(np.where(known, time_s, np.inf)[::-1])[::-1]
        after = np.concatenate([soonest[1:], [np.inf]])
        kept = known & (time_s < after)
        # of a clock that was set back, the part before and the part behind both stand in order
        if kept.sum() < (1 - WORST_CLOCK) * n:
            kept = known & (time_s > before)
        ascending = time_s[kept]
        strides = np.diff(ascending)
        holes = np.count_nonzero(strides > hole_s)
        lost = n - int(kept.sum())
        if kept.sum() < FEWEST or lost + holes > WORST_CLOCK * n:
            raise InputRefused(
                self.where,
                f"the clock {name!r} jumps: {lost} of {n} stamps do not ascend, and {holes} lie"
                f" more than {1e3 * hole_s:.3g} ms behind the one before",
                "log at a steady rate, or name the clock that runs with it under [records] time",
            )
        return Clock(time_s=ascending, kept=kept, hole_s=hole_of(median(strides)))


def siblings(channel: Channel, channels: Sequence[Channel]) -> list[Channel]:
    """The channels, if any, along x and y beside one called ``az``, ``acc.z`` or ``a[2]``."""
    name = channel.name
    place, axes = (len(name) - 2, "01") if name.endswith("[2]") else (name.lower().rfind("z"), "xy")
    if place < 0:
        return []
    axes = axes.upper() if name[place] == "Z" else axes
    names = [name[:place] + axis + name[place + 1 :] for axis in axes]
    return [c for sibling in names for c in channels if c.name == sibling]
