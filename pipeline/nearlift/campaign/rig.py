"""Facts of the manifest: vehicle, rig, load cell, records, their cuts, schedule, uncertainties."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from nearlift import units
from nearlift.campaign import quantities as si
from nearlift.campaign.quantities import Section, as_fault
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import ManifestError

#: Largest ratio of rotor spacing to radius.
WIDEST = 20.0
#: Placeholder of a record's id in ``[records] files`` if records are cut into trials.
RECORD_MARK = "{record}"
#: Fewest samples of a trial: aborted runs leave two to four rows.
FEWEST_SAMPLES = 5
#: Dimension of what an `[[uncertainty]]` can be on.
UNCERTAIN = {
    "height": "length",
    "force": "force",
    "gain": "fraction",
    "exponent": "fraction",
    "rotor_radius": "length",
    "rotor_spacing": "length",
    "mass": "mass",
    "air_density": "density",
}
#: Reference plane of a distance.
Datum = Literal["rotor plane", "airframe", "blade tip", "rotor axis"]


class ThrottleMap(Section):
    """Pairs of throttle and rotor speed, Hz, far from every boundary, with the relative standard
    uncertainty of each speed.
    """

    points: Annotated[
        list[Annotated[tuple[si.Fraction, si.Rotation], Field(strict=False)]],
        Field(min_length=1),
        si.Ascending,
    ]
    uncertainty: si.Fraction = 0.0

    def speed_Hz(self, throttle: FloatArray) -> FloatArray:
        """Speed at each throttle, linear between points, nan outside of them."""
        known, speed = np.array(self.points).T
        return np.asarray(np.interp(throttle, known, speed, left=np.nan, right=np.nan))


class Vehicle(Section):
    """The vehicle under the load cell. Lengths in m, mass in kg.

    `contact` is the distance from datum to boundary at first touch. `thrust_limit` (N, all
    rotors, far from every boundary; default: the largest measured lift) applies to simulated
    flights.
    """

    name: str
    rotors: int = Field(ge=1, le=100)
    rotor_radius: si.PositiveLength
    rotor_spacing: si.PositiveLength | None = None
    rotor_diagonal: si.PositiveLength | None = None
    mass: si.Mass
    contact: dict[Boundary, si.Length] = {}
    thrust_limit: si.Force | None = None
    throttle_map: ThrottleMap | None = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        spacing, diagonal, r = self.rotor_spacing, self.rotor_diagonal, self.rotor_radius
        if spacing is not None and not 2 * r <= spacing <= WIDEST * r:
            raise ValueError(
                f"rotor_spacing {spacing:g} m is {spacing / r:.3g} radii of {r:g} m; neighbouring"
                f" rotors are 2 to {WIDEST:g} radii apart: correct one of them, or its unit"
            )
        if diagonal is not None and spacing is not None and diagonal < spacing:
            raise ValueError(
                f"rotor_diagonal {diagonal:g} m is less than rotor_spacing {spacing:g} m; the"
                " spacing is that of ADJACENT rotors"
            )
        return self


class DistanceReference(NamedTuple):
    """Reference plane of the distances to a boundary, and rotor plane behind it, m: the offset that
    is added to every recorded distance.
    """

    datum: Datum
    offset_m: float


class Rig(Section):
    """Distance datum, held quantity and surroundings of the vehicle.

    `gap` is the distance from ground to ceiling if both are near (model `corridor`). `edge` is the
    x of the ground's straight edge from the middle of the rotors (model `images_edge`).
    """

    held: Literal["throttle", "voltage", "rpm", "power"]
    distance_datum: Datum | dict[Boundary, Datum]
    distance_offset: si.Length | dict[Boundary, si.Length]
    arena: si.PositiveLength | None = None
    gap: si.PositiveLength | None = None
    edge: si.Length | None = None
    air_density: si.Density | None = None
    gravity: si.Gravity

    @model_validator(mode="after")
    def _gap_fits(self) -> Self:
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

    sample_rate: si.Rate | None = None
    tare: si.Duration | Literal["none", "level 0"] | None = None
    settle: si.Duration = 0.0
    record: si.Duration | None = None
    range: si.Force | None = None
    accuracy: si.Force | None = None


class Calibration(Section):
    """Counts to force: force = gain (count - offset), N per count and counts."""

    gain: si.ForcePerCount
    offset: si.Counts


class ForceChannel(Section):
    """The force column of a record, and its conversion to newtons of lift."""

    column: str
    unit: str
    sign: Literal[1, -1]
    calibration: Calibration | None = None

    @model_validator(mode="after")
    def _convertible(self) -> Self:
        if (self.unit == "count") != (self.calibration is not None):
            raise ValueError(
                f"unit = {self.unit!r} with{'' if self.calibration else 'out'} a calibration; one"
                ' goes with unit = "count":'
                ' calibration = { gain = "... mN/count", offset = "... count" }'
            )
        with as_fault():
            self.linear()
        return self

    def linear(self) -> tuple[float, float]:
        """Factor and zero of lift in N = factor * (number - zero), the sign included."""
        if self.calibration is not None:
            return self.sign * self.calibration.gain, self.calibration.offset
        return self.sign * units.to_si(self.unit, "force", "records.force.unit")[0], 0.0


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


class ColumnOfRecord(Section):
    """A column of the records in `unit`, or a command with readings `zero` at rest and `full` at
    full throttle.
    """

    column: str
    unit: str | None = None
    zero: float = 0.0
    full: float | None = None

    def linear(self, dimension: str, key: str) -> tuple[float, float]:
        """Factor and offset to SI; `ManifestError` if the unit is missing or of another dimension.
        An empty `dimension` needs no unit.
        """
        if self.full is not None:
            if dimension != "throttle" or self.full == self.zero:
                remedy = "full (and zero) go with a throttle, and differ"
                raise ManifestError(f"{key}.full", "is no command's full throttle", remedy)
            return 1 / (self.full - self.zero), -self.zero / (self.full - self.zero)
        if not dimension:
            return 1.0, 0.0
        if self.unit is None:
            hint = ', or full = ..., "the number at full throttle"'
            remedy = f"give the unit of {self.column!r}{hint if dimension == 'throttle' else ''}"
            raise ManifestError(f"{key}.unit", "is missing", remedy)
        return units.to_si(self.unit, dimension, f"{key}.unit")


class Segments(Section):
    """Cutting of a record into pieces, each of which becomes a trial.

    Either the steps of `column` divide the pieces, or `cut` is "plateaus" or "windows". Plateaus
    are levels of the force, separated by changes of at least `step`, N. Windows have the length
    `length`, which divides each piece further with the other ways.

    `settle` is dropped after each cut; a piece with less than `shortest` left is no trial. `unit`,
    `zero` and `full` belong to `column`, which `becomes` a column of the schedule. Samples within
    `tolerance` are one level; only pieces at the level `keep_where` are kept. `columns` are those
    of the schedule's columns that the records hold, such as `supply`. Times are in s.
    """

    column: str | None = None
    cut: Literal["plateaus", "windows"] | None = None
    settle: si.Duration
    shortest: si.PositiveDuration
    unit: str | None = None
    zero: float = 0.0
    full: float | None = None
    becomes: str = "throttle"
    tolerance: float = Field(default=0.0, ge=0, allow_inf_nan=False)
    keep_where: str | float | int | None = None
    step: si.Force | None = None
    length: si.PositiveDuration | None = None
    columns: dict[str, ColumnOfRecord] = {}

    @property
    def level(self) -> ColumnOfRecord | None:
        """The column whose level is in the schedule, if one is."""
        if self.keep_where is not None or self.column is None:
            return None
        return ColumnOfRecord(column=self.column, unit=self.unit, zero=self.zero, full=self.full)

    @model_validator(mode="after")
    def _keys_of_one_way(self) -> Self:
        if (self.column is None) == (self.cut is None):
            raise ValueError('give either column or cut = "plateaus" or "windows"')
        needed = {"plateaus": "step", "windows": "length", None: "column"}[self.cut]
        if getattr(self, needed) is None:
            raise ValueError(f'cut = "{self.cut}" needs {needed}')
        if self.step is not None and self.cut != "plateaus":
            raise ValueError('step needs cut = "plateaus"')
        if self.column is None and (self.tolerance or self.keep_where is not None):
            raise ValueError("tolerance and keep_where need column, a column of the record")
        dropped = self.settle if self.cut == "windows" else 0.0
        if self.length is not None and (self.length < self.shortest or self.length <= dropped):
            raise ValueError("length is below shortest, or settle: no window would be a trial")
        return self


class Trials(Section):
    """The schedule: its file, order, units of its columns, and columns with one value for all.

    With ``order = "unknown"``, as in a published table, the order of rows has no meaning.
    """

    file: str = "trials.csv"
    order: Literal["run", "unknown"] = "run"
    units: dict[str, str] = {}
    constants: dict[str, object] = {}


class Uncertainty(Section):
    """A component of the budget: one shared unknown per element of its scope."""

    name: str
    on: Literal[
        "height",
        "force",
        "gain",
        "rotor_radius",
        "rotor_spacing",
        "exponent",
        "mass",
        "air_density",
    ]
    value: str
    distribution: Literal["normal", "uniform"] = "normal"
    scope: Literal["sample", "trial", "distance", "throttle", "session", "boundary", "campaign"]

    @model_validator(mode="after")
    def _value_has_the_dimension(self) -> Self:
        with as_fault():
            value = self.standard()
        if value < 0:
            raise ValueError(f"{self.value!r} is negative; an uncertainty is a size")
        if value >= 1 and (self.relative or UNCERTAIN[self.on] == "fraction"):
            raise ValueError(
                f'{self.value!r} is as large as what it is of; percent? one per cent is "1 percent"'
            )
        return self

    @property
    def relative(self) -> bool:
        """Whether the value is a fraction of an input with a unit, as of `rotor_radius`."""
        return self.on in ("rotor_radius", "rotor_spacing", "mass", "air_density") and (
            self.value.strip().endswith(("percent", "%", "fraction"))
        )

    def standard(self) -> float:
        """Standard uncertainty in SI: m on height and lengths, N on force, a fraction on gain and
        exponent; a fraction if `relative`.
        """
        dimension = "fraction" if self.relative else UNCERTAIN[self.on]
        value = units.quantity(self.value, dimension, f"uncertainty {self.name!r}: value")
        return value / math.sqrt(3) if self.distribution == "uniform" else value


def check_records(records: Records, cell: LoadCell, cut: Segments | None) -> None:
    """Raise ValueError if [records], [load_cell] and [segments] do not agree."""
    rate_Hz, marked = cell.sample_rate, RECORD_MARK in (records.files or "")
    level_0 = cell.tare == "level 0"
    if records.reader == "means":
        if cut is not None:
            raise ValueError('[segments] cuts records, and reader = "means" has none')
        return
    if records.files is None or records.force is None:
        raise ValueError('[records] needs `files` and `force` (only reader = "means" has neither)')
    if rate_Hz is None:
        raise ValueError('[load_cell] needs sample_rate, such as "1000 Hz"')
    if cell.tare is None:
        raise ValueError(
            '[load_cell] needs tare: "2 s" for a rotors-stopped head, "0 s" if the records are'
            ' already tared, "none" if unknown (an offset then enters the budget)'
        )
    if cut is None and (marked or level_0):
        what = 'load_cell.tare = "level 0"' if level_0 else f"{RECORD_MARK} in files"
        raise ValueError(f"{what} goes with [segments]; without it a record is a trial")
    if cut is None:
        return
    if not marked:
        raise ValueError(
            f"with [segments] a file is a record: write {RECORD_MARK} in [records] files, as in"
            f' "sweeps/{RECORD_MARK}.csv"'
        )
    if cell.settle or cell.record is not None:
        raise ValueError(
            "[load_cell] settle and record apply to records of one trial each; [segments] has"
            " settle and shortest for its pieces"
        )
    if level_0 and cut.column is None:
        raise ValueError(
            'tare = "level 0" is the lowest level of a column: name it by [segments] column'
        )
    if round(cut.shortest * rate_Hz) < FEWEST_SAMPLES:
        raise ValueError(
            f"[segments] shortest = {cut.shortest:g} s is {cut.shortest * rate_Hz:.3g} samples at"
            f" {rate_Hz:g} Hz; a trial needs {FEWEST_SAMPLES}: {FEWEST_SAMPLES / rate_Hz:.3g} s"
        )
