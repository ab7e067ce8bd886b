"""Facts of the manifest: vehicle, rig, load cell, records and schedule."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from nearlift import units
from nearlift.campaign.quantities import (
    Acceleration,
    Density,
    Duration,
    Force,
    Fraction,
    Length,
    Mass,
    Position,
    PositiveLength,
    Rate,
    Rotation,
    Section,
    as_fault,
)
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError

#: Largest ratio of rotor spacing to radius.
WIDEST = 20.0


class ThrottleMap(Section):
    """Pairs of throttle and rotor speed, Hz, far from every boundary, with the relative standard
    uncertainty of each speed.
    """

    points: list[Annotated[tuple[Fraction, Rotation], Field(strict=False)]] = Field(min_length=1)
    uncertainty: Fraction = 0.0

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        throttle = [t for t, _ in self.points]
        if any(b <= a for a, b in itertools.pairwise(throttle)):
            raise ValueError(
                "the throttles of points must ascend (found"
                f" {', '.join(f'{100 * t:g} %' for t in throttle)})"
            )
        return self

    def speed_Hz(self, throttle: FloatArray) -> FloatArray:
        """Speed at each throttle, linear between points, nan outside of them."""
        known = np.array(self.points)
        return np.asarray(
            np.interp(throttle, known[:, 0], known[:, 1], left=np.nan, right=np.nan),
            dtype=np.float64,
        )


class Vehicle(Section):
    """The vehicle under the load cell. Lengths in m, mass in kg.

    `contact` is the distance from datum to boundary at first touch. `thrust_limit` (N, all
    rotors, far from every boundary; default: the largest measured lift) applies to simulated
    flights.
    """

    name: str
    rotors: int = Field(ge=1, le=100)
    rotor_radius: PositiveLength
    rotor_spacing: PositiveLength | None = None
    rotor_diagonal: PositiveLength | None = None
    rotor_positions: list[Position] | None = None
    mass: Mass
    contact: dict[Boundary, Length] = Field(default={})
    thrust_limit: Force | None = None
    throttle_map: ThrottleMap | None = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        spacing, diagonal, r = self.rotor_spacing, self.rotor_diagonal, self.rotor_radius
        if spacing is not None and not 2 * r <= spacing <= WIDEST * r:
            why = "no vehicle is so wide: correct one of them, or its unit"
            if spacing < 2 * r:
                why = "less than two: neighbouring rotors would overlap"
            ratio = f"{spacing / r:.3g} radii of {r:g} m"
            raise ValueError(f"rotor_spacing {spacing:g} m is {ratio}; {why}")
        if diagonal is not None and spacing is not None and diagonal < spacing:
            raise ValueError(
                f"rotor_diagonal {diagonal:g} m is less than rotor_spacing {spacing:g} m; the"
                " spacing is that of ADJACENT rotors"
            )
        if self.rotor_positions is not None and len(self.rotor_positions) != self.rotors:
            raise ValueError(
                f"rotor_positions lists {len(self.rotor_positions)} rotors, not {self.rotors}"
            )
        return self

    @property
    def diagonal(self) -> float | None:
        """Distance between opposite rotor axes, m; if not given, that of a regular polygon."""
        if self.rotor_diagonal is not None or self.rotor_spacing is None or self.rotors == 1:
            return self.rotor_diagonal
        return self.rotor_spacing / math.sin(math.pi / self.rotors)

    def geometry(self) -> dict[str, object]:
        """Inputs of lift models over rotor radius: `spacing_hat`, `diagonal_hat`, `layout_hat`
        (rotors, 2).
        """
        known: dict[str, Any] = {}
        r, n = self.rotor_radius, self.rotors
        if self.rotor_spacing is not None and n > 1:
            known["spacing_hat"] = self.rotor_spacing / r
            # a regular polygon whose side is the adjacent spacing
            angles = 2 * math.pi * (np.arange(n) + 0.5) / n
            circumradius = known["spacing_hat"] / (2 * math.sin(math.pi / n))
            known["layout_hat"] = circumradius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        if self.diagonal is not None and n > 1:
            known["diagonal_hat"] = self.diagonal / r
        if n == 1:
            known["layout_hat"] = np.zeros((1, 2))
        if self.rotor_positions is not None:
            known["layout_hat"] = np.asarray(self.rotor_positions) / r
        return known


#: Placeholder of a record's id in ``[records] files`` if records are cut into trials.
RECORD_MARK = "{record}"
#: Reference plane of a distance.
Datum = Literal["rotor plane", "airframe", "blade tip", "rotor axis"]


class DistanceReference(NamedTuple):
    """Reference plane of the distances to a boundary, and rotor plane behind it, m: the offset that
    is added to every recorded distance.
    """

    datum: Datum
    offset_m: float


#: Acceleration of free fall, m/s^2, with room for rounding.
GRAVITY = (9.7, 9.9)


class Rig(Section):
    """Distance datum, held quantity and surroundings of the vehicle.

    `gap` is the distance from ground to ceiling if both are near (model `corridor`). `edge` is the
    x of the ground's straight edge from the middle of the rotors (model `images_edge`).
    """

    held: Literal["throttle", "voltage", "rpm", "power"]
    distance_datum: Datum | dict[Boundary, Datum]
    distance_offset: Length | dict[Boundary, Length]
    arena: PositiveLength | None = None
    gap: PositiveLength | None = None
    edge: Length | None = None
    air_density: Density | None = None
    gravity: Acceleration

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if not GRAVITY[0] <= self.gravity <= GRAVITY[1]:
            raise ValueError(
                f"gravity {self.gravity:g} m/s^2 is not of this Earth: it is 9.76 to 9.84 there;"
                ' write "9.80665 m/s^2", or your own value'
            )
        if self.gap is not None and self.arena is not None and self.gap > self.arena:
            raise ValueError(
                f"gap {self.gap:g} m is more than the arena of {self.arena:g} m: it is the distance"
                " from ground to ceiling"
            )
        return self


class LoadCell(Section):
    """The force channel.

    `tare` is the rotors-stopped head of each record, s; "none"; or, for records cut into pieces,
    "level 0", the lowest level. `record` is the planned length, s, tare included.
    """

    sample_rate: Rate | None = None
    tare: Duration | Literal["none", "level 0"] | None = None
    settle: Duration = 0.0
    record: Duration | None = None
    range: Force | None = None
    accuracy: Force | None = None


class Calibration(Section):
    """Counts to force: force = gain (count - offset), with a gain such as "0.0098 mN/count"."""

    gain: str
    offset: str

    def linear(self) -> tuple[float, float]:
        """N per count, and the count at zero force."""
        force, _, per = self.gain.rpartition("/")
        gain, unit = units.measure(force)
        zero, counted = units.measure(self.offset)
        key = "records.force.calibration"
        if not gain or len(unit.split()) != 1 or per.strip() != "count":
            what = f"{self.gain!r} is not a force per count"
            raise ManifestError(f"{key}.gain", what, 'write it as "0.0098 mN/count"')
        if zero is None or counted != "count":
            what = f"{self.offset!r} is not a number of counts"
            raise ManifestError(f"{key}.offset", what, 'write it as "120 count"')
        return gain * units.to_si(unit, "force", f"{key}.gain")[0], zero


class ForceChannel(Section):
    """The force column of a record, and its conversion to newtons of lift."""

    column: str
    unit: str
    sign: Literal[1, -1]
    calibration: Calibration | None = None

    @model_validator(mode="after")
    def _convertible(self) -> Self:
        with as_fault():
            self.linear()
        return self

    def linear(self) -> tuple[float, float]:
        """Factor and zero of lift in N = factor * (number - zero), the sign included."""
        if self.unit != "count" and self.calibration is None:
            return self.sign * units.to_si(self.unit, "force", "records.force.unit")[0], 0.0
        what, remedy = f"a calibration with unit = {self.unit!r}", "a calibration goes with counts"
        if self.calibration is None:
            what = 'unit = "count" without a calibration'
            remedy = 'add calibration = { gain = "... mN/count", offset = "... count" }'
        if self.calibration is None or self.unit != "count":
            raise ManifestError("records.force", what, remedy)
        gain, zero = self.calibration.linear()
        return self.sign * gain, zero


class TimeChannel(Section):
    """An optional clock column, checked against the sample rate."""

    column: str
    unit: str


class Records(Section):
    """Files of records and their reader."""

    reader: str
    files: str | None = None
    force: ForceChannel | None = None
    time: TimeChannel | None = None
    dialect: dict[str, object] = {}

    @property
    def pattern(self) -> str:
        """The files, with the mark of a trial in place of that of a record; empty without files."""
        return (self.files or "").replace(RECORD_MARK, "{trial}")


class Trials(Section):
    """The schedule: its file, order, units of its columns, and columns with one value for all.

    With ``order = "unknown"``, as in a published table, the order of rows has no meaning.
    """

    file: str = "trials.csv"
    order: Literal["run", "unknown"] = "run"
    units: dict[str, str] = {}
    constants: dict[str, object] = {}
