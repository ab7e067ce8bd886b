"""A flight log cut into windows, each of which is a trial: what the vehicle lifted, what its motors
were told, how high it was and how it moved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from nearlift.declare import BoolArray, FloatArray, IntArray
from nearlift.errors import InputRefused
from nearlift.manifest.campaign import Campaign
from nearlift.manifest.segments import FEWEST_SAMPLES
from nearlift.readers import flight_log
from nearlift.readers.channel import Contents
from nearlift.readers.flight_log import FlightLog
from nearlift.readers.seam import Reader
from nearlift.readers.segments import Pieces
from nearlift.reduction import motor_lag
from nearlift.reduction.airborne import CLEAN, Phases, Window, phases, windows_of
from nearlift.reduction.motor_lag import GRID, LagMoments
from nearlift.reduction.specific_force import along_axis, apart, faults, leaning, silent

#: Columns of the schedule that a log brings.
BROUGHT = ("distance", "supply", "tilt")
#: How long before a window's middle the set-point's history is kept, s.
HISTORY_S = (0.0, 0.1, 0.2, 0.4, 0.8)
#: Nothing is averaged nearer than so many rotor radii, where one over a distance is all noise.
LEAST_HEIGHT = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighed:
    """One log cut into windows, its pieces: the `first` sample of each, up to that of the next, and
    the code of each, "" of a clean one. `lift_N` (n,) is that of the samples, `command` (windows,
    T) the mean of the rotors behind each lag of the grid, and `stretches` are what its lag is
    estimated from.
    """

    source: str
    step_s: float
    codes: tuple[str, ...]
    notes: tuple[str, ...]
    pieces: Pieces
    first: IntArray
    codes_of: tuple[str, ...]
    lift_N: FloatArray
    command: FloatArray
    stretches: tuple[LagMoments, ...]
    counts: Counter[str]

    @property
    def clean(self) -> BoolArray:
        """Which windows have no code."""
        return np.array([not code for code in self.codes_of], dtype=bool)


def read(
    campaign: Campaign, root: Path, reader: Reader, path: Path, offset_m: float | None
) -> Weighed | Contents:
    """The windows of one log, or the contents of a file that holds no sample; `offset_m` is from
    the logged height to the rotor plane, None in free air. Raises as `flight_log.read` does.
    """
    log = flight_log.read(campaign, root, reader, path)
    if isinstance(log, Contents):
        return log
    return _Cut(campaign, log, str(path), offset_m).weighed()


class _Cut:
    """A log that is being cut."""

    def __init__(
        self, campaign: Campaign, log: FlightLog, where: str, offset_m: float | None
    ) -> None:
        assert campaign.flight is not None
        self.campaign, self.flight, self.log, self.where = campaign, campaign.flight, log, where
        self.offset_m = offset_m
        self.step_s = log.step_s
        said = self.flight.acceleration
        # gravity that was taken out is put in again
        self.gravity = None if said.gravity == "included" else campaign.rig.gravity
        self.axes: Literal["body", "world"] = said.axes
        if said.axes == "world" and log.acceleration_m_s2.ndim == 1:
            raise InputRefused(
                where,
                f"has no columns like {said.column!r} along x and y",
                'along the world\'s axes all three are wanted; are they "body" axes?',
            )
        self.tilt = log.tilt_rad
        if self.tilt is None and said.axes == "world":
            self.tilt = leaning(log.acceleration_m_s2, self.gravity)
        felt = along_axis(log.acceleration_m_s2, self.gravity, said.axes, self.tilt)
        self.lift_N = campaign.vehicle.mass * felt

    def weighed(self) -> Weighed:
        log, flight = self.log, self.flight
        phases = self._phases()
        self._as_declared(phases)
        length = max(round(flight.window / self.step_s), 1)
        if length < FEWEST_SAMPLES:
            raise InputRefused(
                self.where,
                f"has {length} samples in a window of {flight.window:g} s",
                f'a trial takes {FEWEST_SAMPLES}: [flight] window ='
                f' "{FEWEST_SAMPLES * self.step_s:.2g} s"',
            )  # fmt: skip
        cut = windows_of(phases, log.run, length)
        command = log.command.mean(axis=1)
        means = motor_lag.filtered(command, log.run, self.step_s, GRID)
        # windows follow each other without a gap
        first = np.array([w.first for w in cut])
        length_of = np.diff([*first, len(command)])
        of_window = {
            name: np.add.reduceat(values, first, axis=-1) / length_of
            for name, values in self._series(phases).items()
        }
        if self.offset_m is not None:
            of_window["distance"] = 1 / of_window["distance"] - self.offset_m
        counts = Counter({w.code: 0 for w in cut})
        for w in cut:
            counts[w.code] += w.end - w.first
        return Weighed(
            source=log.source,
            step_s=self.step_s,
            codes=log.codes,
            notes=log.notes,
            pieces=self._pieces(cut, {**of_window, **self._placed(cut)}),
            first=first,
            codes_of=tuple(w.code for w in cut),
            lift_N=self.lift_N,
            command=(np.add.reduceat(means, first, axis=-1) / length_of).T,
            stretches=tuple(self._stretches(phases, means)),
            counts=counts,
        )

    def _phases(self) -> Phases:
        log, flight = self.log, self.flight
        series = {
            "climb_m_s": log.climb_m_s,
            "height_m": log.height_m,
            "lift_N": self.lift_N,
            "supply_V": log.supply_V,
            "tilt_rad": self.tilt,
        }
        return phases(
            {name: values for name, values in series.items() if values is not None},
            log.command,
            log.run,
            1 / self.step_s,
            flight.airborne,
            (flight.tilt, flight.height.range),
            flight.height.zero == "each start",
        )

    def _as_declared(self, phases: Phases) -> None:
        """Refuse a log that contradicts what the manifest says of it."""
        said, log = self.flight.acceleration, self.log
        # what changes in any flight
        series = {
            "command": log.command.mean(axis=1),
            "height": log.height_m,
            "velocity": log.climb_m_s,
            "acceleration": flight_log.upwards(log.acceleration_m_s2),
        }
        if log.setpoint_m is not None:
            series["setpoint"] = log.setpoint_m
        contradictions = [
            *silent(series, phases.aloft),
            *faults(
                log.acceleration_m_s2,
                log.velocity_m_s,
                log.height_m,
                phases.aloft,
                self.step_s,
                (said.gravity, said.axes, self.campaign.rig.gravity),
            ),
            *apart(log.supply_V, log.setpoint_m, log.height_m, phases.aloft),
        ]
        for fault in contradictions[:1]:
            named = getattr(self.flight, fault.key)
            columns = getattr(named, "columns", None) or [named.column]
            raise InputRefused(
                self.where,
                f"contradicts [flight] {fault.key} ({columns[0]!r}): {fault.what}",
                f"flight.{fault.key}: {fault.remedy}",
            )
        least, most = np.nanmin(log.command), np.nanmax(log.command)
        if least < -0.01 or most > 1.01:
            raise InputRefused(
                self.where,
                f"has commands from {100 * least:.3g} to {100 * most:.3g} % of full throttle",
                "mend full and zero under [flight] command",
            )

    def _series(self, phases: Phases) -> dict[str, FloatArray]:
        """What windows are told by their means of, (n,): the schedule's columns, how the vehicle
        moved, and what each rotor was told beside the others. Near a boundary its distance stands
        as one over that of the rotor plane, which a gain follows more nearly: lift goes with the
        mean of the curve, and while a vehicle climbs that is not the curve at the mean distance.
        """
        log = self.log
        series = {"distance": log.height_m - phases.floor_m}
        if self.offset_m is not None:
            least = LEAST_HEIGHT * self.campaign.vehicle.rotor_radius
            series["distance"] = 1 / np.maximum(series["distance"] + self.offset_m, least)
        if log.supply_V is not None:
            series["supply"] = log.supply_V
        if self.flight.tells_tilt and self.tilt is not None:
            series["tilt"] = self.tilt
        series["climb_m_s"] = log.climb_m_s
        if log.velocity_m_s.ndim > 1:
            series["level_speed_m_s"] = np.hypot(log.velocity_m_s[:, 0], log.velocity_m_s[:, 1])
        rotors = log.command.shape[1]
        together = np.maximum(log.command.mean(axis=1), 1e-9)
        for k in range(rotors if rotors > 1 else 0):
            series[f"command_share_{k + 1}"] = log.command[:, k] / together
        return series

    def _pieces(self, cut: Sequence[Window], of_window: Mapping[str, FloatArray]) -> Pieces:
        """The windows with the means that they are known by, (windows,) each."""
        # what is left out may stand at any height, and behind any command
        lost = np.array([bool(w.code) for w in cut])
        means = {name: np.where(lost, np.nan, values) for name, values in of_window.items()}
        # what moves within a window is no scatter of what it was
        return Pieces(
            number=np.arange(1, len(cut) + 1),
            since_s=self.log.time_s[[w.first for w in cut]],
            brought={name: values for name, values in means.items() if name in BROUGHT},
            covariates={name: values for name, values in means.items() if name not in BROUGHT},
        )

    def _placed(self, cut: Sequence[Window]) -> dict[str, FloatArray]:
        """The start that each window follows, and where the set-point stood before its middle."""
        placed = {"flight": np.array([float(w.start) for w in cut])}
        if self.log.setpoint_m is not None:
            middle = np.array([(w.first + w.end) // 2 for w in cut])
            for k, ago in enumerate(HISTORY_S):
                at = np.maximum(middle - round(ago / self.step_s), 0)
                placed[f"setpoint_m_{k}"] = self.log.setpoint_m[at]
        return placed

    def _stretches(self, phases: Phases, means: FloatArray) -> list[LagMoments]:
        log = self.log
        clean = phases.code == CLEAN
        z_hat = (log.height_m - phases.floor_m) / self.campaign.vehicle.rotor_radius
        aside = []
        if log.velocity_m_s.ndim > 1:
            aside.append(log.velocity_m_s[:, 0] ** 2 + log.velocity_m_s[:, 1] ** 2)
        beside = [log.climb_m_s, *aside, *(np.exp(-z_hat / decay) for decay in motor_lag.DECAYS)]
        if log.supply_V is not None:
            beside.append(np.log(np.maximum(log.supply_V, 1e-3)))
        # a stretch begins anew at every start, hole, and so many seconds
        groups = _stretches_of(clean, phases.start, log.run, log.time_s)
        sent = None
        if log.setpoint_m is not None:
            asked = [
                log.setpoint_m[np.maximum(np.arange(len(z_hat)) - round(ago / self.step_s), 0)]
                for ago in motor_lag.SENT_S
            ]
            asked_hat = np.maximum(np.nan_to_num(asked), 0.0) / self.campaign.vehicle.rotor_radius
            shapes = (np.exp(-asked_hat / decay) for decay in motor_lag.DECAYS)
            sent = np.vstack([asked_hat, *shapes, *aside])
        return motor_lag.moments(self.lift_N, means, beside, groups, self.step_s, sent)


def _stretches_of(clean: BoolArray, start: IntArray, run: IntArray, time_s: FloatArray) -> IntArray:
    """Stretches of flight, counted from 1: of one start without a hole, long ones parted."""
    first = np.flatnonzero(np.concatenate([[True], (np.diff(start) != 0) | (np.diff(run) != 0)]))
    begun = np.repeat(time_s[first], np.diff([*first, len(time_s)]))
    part = ((time_s - begun) // motor_lag.STRETCH_S).astype(np.int64)
    number = np.zeros(len(time_s), dtype=np.int64)
    flown = np.flatnonzero(clean)
    changes = np.ones(len(flown), dtype=bool)
    for series in (start[flown], run[flown], part[flown]):
        changes[1:] &= series[1:] == series[:-1]
    number[flown] = np.cumsum(~changes) + 1
    return number
