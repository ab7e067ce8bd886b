"""The manifest: facts about the rig and choices, as written in campaign.toml, in SI once parsed.

Strict: an unknown key, a quantity without a unit, a unit of the wrong dimension are refused with
the key, the value and the nearest thing that would have been right. No unit and no geometry has a
default.
"""

from __future__ import annotations

import difflib
import itertools
import math
import re
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel, Field, ValidationError, field_validator, model_validator

from nearlift import units
from nearlift.declare import BOUNDARIES, Boundary, FloatArray
from nearlift.errors import ManifestError, brief
from nearlift.manifest import toml
from nearlift.manifest.design import Planned
from nearlift.manifest.flight import Detect, Simulate
from nearlift.manifest.piv import Piv
from nearlift.manifest.quantities import (
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
)

SCHEMA = "nearlift.campaign/1"


class ThrottleMap(Section):
    """Rotor speed at some throttles far from every boundary: pairs of throttle and speed, Hz, and
    the standard uncertainty of each speed.
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
        """Speed at each throttle, linear between points; nan outside of them, since a map says
        nothing there.
        """
        known = np.array(self.points)
        return np.asarray(
            np.interp(throttle, known[:, 0], known[:, 1], left=np.nan, right=np.nan),
            dtype=np.float64,
        )


#: Spacing over radius beyond which one of the two is wrong; acceleration of free fall in m/s^2,
#: with room for rounding.
WIDEST, GRAVITY = 20.0, (9.7, 9.9)


class Vehicle(Section):
    """What hangs from the load cell. Lengths in m, mass in kg."""

    name: str
    rotors: int = Field(ge=1, le=100)
    rotor_radius: PositiveLength
    rotor_spacing: PositiveLength | None = None
    rotor_diagonal: PositiveLength | None = None
    rotor_positions: list[Position] | None = None
    mass: Mass
    throttle_map: ThrottleMap | None = None

    @model_validator(mode="after")
    def _rotors_do_not_overlap(self) -> Self:
        if self.rotor_spacing is not None and self.rotor_spacing < 2 * self.rotor_radius:
            raise ValueError(
                f"rotor_spacing {self.rotor_spacing:g} m is less than two radii: neighbouring"
                " rotors would overlap"
            )
        if self.rotor_spacing is not None and self.rotor_spacing > WIDEST * self.rotor_radius:
            raise ValueError(
                f"rotor_spacing {self.rotor_spacing:g} m is"
                f" {self.rotor_spacing / self.rotor_radius:.3g} radii of {self.rotor_radius:g} m;"
                " no vehicle is so wide: mend one of them, or its unit"
            )
        if (
            self.rotor_diagonal is not None
            and self.rotor_spacing is not None
            and self.rotor_diagonal < self.rotor_spacing
        ):
            raise ValueError(
                f"rotor_diagonal {self.rotor_diagonal:g} m is less than rotor_spacing"
                f" {self.rotor_spacing:g} m; the spacing is that of ADJACENT rotors"
            )
        if self.rotor_positions is not None and len(self.rotor_positions) != self.rotors:
            raise ValueError(
                f"rotor_positions lists {len(self.rotor_positions)} rotors, not {self.rotors}"
            )
        return self

    @property
    def diagonal(self) -> float | None:
        """Distance between opposite rotor axes, m: as given, else that of a regular polygon,
        sqrt(2) times the spacing for four rotors.
        """
        if self.rotor_diagonal is not None or self.rotor_spacing is None or self.rotors == 1:
            return self.rotor_diagonal
        return self.rotor_spacing / math.sin(math.pi / self.rotors)

    def geometry(self) -> dict[str, Any]:
        """What lift models may need, scaled by rotor radius: `spacing_hat`, `diagonal_hat`,
        `layout_hat` (rotors, 2).
        """
        known: dict[str, Any] = {}
        r = self.rotor_radius
        if self.rotor_spacing is not None and self.rotors > 1:
            known["spacing_hat"] = self.rotor_spacing / r
        if self.diagonal is not None and self.rotors > 1:
            known["diagonal_hat"] = self.diagonal / r
        if self.rotor_positions is not None:
            known["layout_hat"] = np.asarray(self.rotor_positions) / r
        elif self.rotors == 1:
            known["layout_hat"] = np.zeros((1, 2))
        elif self.rotor_spacing is not None:
            # a regular polygon whose side is the adjacent spacing
            angles = 2 * math.pi * (np.arange(self.rotors) + 0.5) / self.rotors
            circumradius = known["spacing_hat"] / (2 * math.sin(math.pi / self.rotors))
            known["layout_hat"] = circumradius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return known


class Rig(Section):
    """How distance is measured and what a trial holds constant."""

    held: Literal["throttle", "voltage", "rpm", "power"]
    distance_datum: str | dict[Boundary, str]
    distance_offset: Length | dict[Boundary, Length]
    arena: PositiveLength | None = None
    air_density: Density | None = None
    gravity: Acceleration

    @model_validator(mode="after")
    def _known_datums(self) -> Self:
        allowed = ("rotor plane", "airframe", "blade tip", "rotor axis")
        for datum in (
            self.distance_datum.values()
            if isinstance(self.distance_datum, dict)
            else (self.distance_datum,)
        ):
            if datum not in allowed:
                raise ValueError(f"distance_datum {datum!r} is none of {', '.join(allowed)}")
        if not GRAVITY[0] <= self.gravity <= GRAVITY[1]:
            raise ValueError(
                f"gravity {self.gravity:g} m/s^2 is nowhere on Earth: it is 9.76 to 9.84 there;"
                ' write "9.80665 m/s^2", or your own value'
            )
        return self

    def offset(self, boundary: Boundary) -> float:
        """Datum to rotor plane, m, added to every recorded distance."""
        return float(_by_boundary(self.distance_offset, boundary, "rig.distance_offset"))

    def datum(self, boundary: Boundary) -> str:
        """What the distance to that boundary is measured from."""
        return str(_by_boundary(self.distance_datum, boundary, "rig.distance_datum"))


def _by_boundary(value: Any, boundary: Boundary, key: str) -> Any:
    if not isinstance(value, dict):
        return value
    if boundary not in value:
        raise ManifestError(
            key, f"says nothing about the {boundary}", f"add {boundary} = ... to the table"
        )
    return value[boundary]


class LoadCell(Section):
    """The force channel. `tare` is the rotors-stopped head of each record in s, or "none"; `record`
    its planned length in s, tare included.
    """

    sample_rate: Rate | None = None
    tare: Duration | Literal["none"] | None = None
    settle: Duration = 0.0
    record: Duration | None = None
    range: Force | None = None
    accuracy: Force | None = None


class Calibration(Section):
    """Counts to force: force = gain (count - offset). `gain` is a text such as "0.0098
    mN/count".
    """

    gain: str
    offset: str

    def linear(self) -> tuple[float, float]:
        """N per count, and the count at zero force."""
        force, _, per = self.gain.rpartition("/")
        gain, unit = units.measure(force)
        zero, counted = units.measure(self.offset)
        if not gain or len(unit.split()) != 1 or per.strip() != "count":
            raise ManifestError(
                "records.force.calibration.gain",
                f"{self.gain!r} is not a force per count",
                'write it as "0.0098 mN/count"',
            )
        if zero is None or counted != "count":
            raise ManifestError(
                "records.force.calibration.offset",
                f"{self.offset!r} is not a number of counts",
                'write it as "120 count"',
            )
        factor, _ = units.to_si(unit, "force", "records.force.calibration.gain")
        return gain * factor, zero


class ForceChannel(Section):
    """Where the force stands in a record, and how it becomes newtons of lift."""

    column: str
    unit: str
    sign: Literal[1, -1]
    calibration: Calibration | None = None

    @model_validator(mode="after")
    def _convertible(self) -> Self:
        try:
            self.linear()
        except ManifestError as refusal:
            raise ValueError(f"{refusal.what}\n{refusal.remedy}") from None
        return self

    def linear(self) -> tuple[float, float]:
        """Lift in N is factor * (number - zero): returns (factor, zero), the sign included."""
        if self.unit == "count":
            if self.calibration is None:
                raise ManifestError(
                    "records.force",
                    'unit = "count" without a calibration',
                    'add calibration = { gain = "... mN/count", offset = "... count" }',
                )
            gain, zero = self.calibration.linear()
            return self.sign * gain, zero
        if self.calibration is not None:
            raise ManifestError(
                "records.force",
                f"a calibration beside unit = {self.unit!r}",
                'a calibration goes with unit = "count"',
            )
        factor, _ = units.to_si(self.unit, "force", "records.force.unit")
        return self.sign * factor, 0.0


class TimeChannel(Section):
    """An optional clock column, checked against the sample rate."""

    column: str
    unit: str


class Records(Section):
    """Which reader reads which files."""

    reader: str
    files: str | None = None
    force: ForceChannel | None = None
    time: TimeChannel | None = None
    dialect: dict[str, Any] = {}


class Trials(Section):
    """The schedule: its file, the units of its columns, columns that are the same for every trial,
    and whether its rows are in run order.

    ``order = "unknown"``, as in a published table: nothing is then read into which trial came
    before which.
    """

    file: str = "trials.csv"
    order: Literal["run", "unknown"] = "run"
    units: dict[str, str] = {}
    constants: dict[str, Any] = {}


#: Inputs of a lift model that have a unit, and what each kind of component is a size of.
INPUTS_WITH_UNIT = {
    "rotor_radius": "length",
    "rotor_spacing": "length",
    "mass": "mass",
    "air_density": "density",
}
DIMENSIONS = {
    "height": "length",
    "force": "force",
    "gain": "fraction",
    "exponent": "fraction",
    **INPUTS_WITH_UNIT,
}


class Uncertainty(Section):
    """One component of the budget: a shared unknown per element of its scope."""

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
        try:
            self.standard()
        except ManifestError as refusal:
            raise ValueError(f"{refusal.what}\n{refusal.remedy}") from None
        return self

    @property
    def relative(self) -> bool:
        """Whether the value is a part of the input, such as ``"1 percent"`` of the rotor radius."""
        return self.on in INPUTS_WITH_UNIT and self.value.strip().endswith(
            ("percent", "%", "fraction")
        )

    def standard(self) -> float:
        """Standard uncertainty in SI: m on height and lengths, N on force, a fraction on gain and
        exponent; a fraction if `relative`.
        """
        dimension = "fraction" if self.relative else DIMENSIONS[self.on]
        value = units.quantity(self.value, dimension, f"uncertainty {self.name!r}: value")
        if value < 0:
            raise ManifestError(
                f"uncertainty {self.name!r}: value",
                f"{self.value!r} is negative",
                "an uncertainty is a size, not a correction",
            )
        if value >= 1 and (self.relative or self.on in ("gain", "exponent")):
            raise ManifestError(
                f"uncertainty {self.name!r}: value",
                f"{self.value!r} is as large as what it is of",
                'percent? one per cent is "1 percent"',
            )
        return value / math.sqrt(3) if self.distribution == "uniform" else value


class FitChoice(Section):
    """The base model of one boundary (`downwash`: fitted to lift and downwash together, too) and
    the models that it is compared with.
    """

    base: str | None = None
    rivals: list[str] | None = None
    downwash: bool = False


class Fit(Section):
    """How models are fitted: the choice of models by boundary, and how their posteriors are
    sampled.

    `sampler` is "auto" (importance sampling where its check passes, else emcee), "emcee" or
    "importance"; `ess` the effective draws wanted; `steps` the most that emcee may take; `netcdf`
    asks for posterior.nc as well.
    """

    ground: FitChoice | None = None
    ceiling: FitChoice | None = None
    sidewall: FitChoice | None = None
    sampler: Literal["auto", "emcee", "importance"] = "auto"
    ess: int = Field(default=4000, ge=100, le=1_000_000)
    steps: int = Field(default=20_000, ge=400, le=10_000_000)
    netcdf: bool = False

    def of(self, boundary: Boundary) -> FitChoice | None:
        """The choice of models for one boundary, where there is one."""
        choice: FitChoice | None = getattr(self, boundary)
        return choice


class Overlay(Section):
    """Further data for Figure 2: a CSV with the columns z_hat, delta_L and u (fractions)."""

    file: str
    label: str
    boundary: Boundary


class Report(Section):
    """How figures look.

    `reference`: what Figure 2 takes Delta L from: the `fit` (its L_inf, with named effects taken
    out) or the `farthest` station, as the paper does.
    """

    style: str = "aiaa"
    reference: Literal["fit", "farthest"] = "fit"
    overlay: list[Overlay] = []


class Quality(Section):
    """Limits of the quality codes; fractions are of the trial's own lift, `height` of the rotor's
    radius.

    `near_reference`: a throttle without a station far from the boundary takes its L_inf from the
    farthest that it has, else it has no Delta L. `exclude`: trials to leave out, with the reason; a
    list of ids in the manifest has none.
    """

    drift: float = Field(default=0.05, gt=0)
    missing: float = Field(default=0.05, gt=0, lt=1)
    out_of_range: float = Field(default=0.01, ge=0, lt=1)
    height: float = Field(default=0.02, gt=0)
    near_reference: bool = False
    exclude: dict[str, str] = {}

    @field_validator("exclude", mode="before")
    @classmethod
    def _reasons(cls, value: Any) -> Any:
        return {str(trial): "" for trial in value} if isinstance(value, list) else value


class Diagnose(Section):
    """Choices of the closed loop.

    `not_feasible`: what this bench cannot do, so that it is not proposed: go closer than it did, go
    farther, arrive from both directions. `planned_trials`: how long the campaign will be, where the
    schedule does not say: it grows with the records, or the rest will not be measured.
    """

    false_alarm_rate: float = Field(default=0.05, gt=0, lt=1)
    planned_trials: int | None = Field(default=None, ge=1)
    not_feasible: list[Literal["closer", "farther", "both directions"]] = []


class Campaign(Section):
    """A whole manifest. `root` is the folder that holds it."""

    schema_: Literal["nearlift.campaign/1"] = Field(alias="schema")
    name: str
    simulated: bool = False
    note: str = ""
    vehicle: Vehicle
    rig: Rig
    load_cell: LoadCell = LoadCell()
    records: Records
    trials: Trials = Trials()
    uncertainty: list[Uncertainty] = []
    fit: Fit = Fit()
    report: Report = Report()
    quality: Quality = Quality()
    diagnose: Diagnose = Diagnose()
    piv: Piv | None = None
    design: Planned | None = None
    simulate: Simulate | None = None
    detect: Detect | None = None

    def nominal(self, on: str) -> float | None:
        """The value, SI, of a model's input with a unit that an `[[uncertainty]]` can be on; None
        where the manifest gives none.
        """
        place = self.rig if on == "air_density" else self.vehicle
        value: float | None = getattr(place, on)
        return value

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        if not re.fullmatch(r"[a-z0-9][a-z0-9._-]*", self.name):
            raise ValueError(
                f"name {self.name!r} is not a slug: lower-case letters, digits, '-', '_' and '.',"
                " since it names folders"
            )
        if len({u.name for u in self.uncertainty}) != len(self.uncertainty):
            raise ValueError("two [[uncertainty]] components have the same name")
        for u in self.uncertainty:
            if u.on in INPUTS_WITH_UNIT and not u.relative and self.nominal(u.on) is None:
                raise ValueError(
                    f"uncertainty {u.name!r} is on the {u.on}, which is not given: give it, or"
                    " state the uncertainty in percent"
                )
        if self.joint is not None and self.piv is None:
            raise ValueError(
                f"fit.{self.joint[0]}.downwash = true, but no velocity grids are listed under [piv]"
            )
        if self.records.reader == "means":
            return self
        cell = self.load_cell
        if self.records.files is None or self.records.force is None:
            raise ValueError(
                '[records] needs `files` and `force` (only reader = "means" does without)'
            )
        if cell.sample_rate is None:
            raise ValueError('[load_cell] needs sample_rate, such as "1000 Hz"')
        if cell.tare is None:
            raise ValueError(
                '[load_cell] needs tare: "2 s" for a rotors-stopped head, "0 s" if the records are'
                ' already tared, "none" if nobody knows (an offset then enters the budget)'
            )
        return self

    @property
    def joint(self) -> tuple[Boundary, ...] | None:
        """Boundaries whose base model is to be fitted to lift and downwash together; None if none
        is.
        """
        return (
            tuple(
                b for b in BOUNDARIES if (choice := self.fit.of(b)) is not None and choice.downwash
            )
            or None
        )

    @property
    def tare_s(self) -> float:
        """Length of the rotors-stopped head of each record, s (0 where there is none)."""
        return self.load_cell.tare if isinstance(self.load_cell.tare, float) else 0.0


def load(folder: Path) -> Campaign:
    """Read and check ``campaign.toml`` of a campaign folder.

    Raises
    ------
    ManifestError
        The folder or the file is missing, is not TOML, or breaks the contract; every fault is
        listed.
    """
    path = folder / "campaign.toml"
    if not path.is_file():
        raise ManifestError(
            str(folder), "holds no campaign.toml", "`nearlift new DIR` writes one to fill in"
        )
    with path.open("rb") as file:
        return parse(toml.loads(file.read(toml.MOST_BYTES + 1), str(path)), str(path))


Kind = TypeVar("Kind", bound=BaseModel)
#: What `nearlift new` writes where somebody must know.
BLANK = "FILL IN"
#: As many faults of one manifest are told.
MOST_FAULTS = 50


def parse(raw: dict[str, Any], where: str = "campaign.toml") -> Campaign:
    """A manifest from parsed TOML; raises `ManifestError` that lists every fault with its key, or
    what is still to be filled in.
    """
    values = list(_values(raw))
    blank = [
        f"{key}: {value!r} is still to be filled in"
        for key, value in values
        if isinstance(value, str) and BLANK in value
    ]
    if blank:
        raise ManifestError(where, "\n  ".join(_first(blank, len(blank))))
    huge = [key for key, value in values if isinstance(value, int) and abs(value) >= 1 << 63]
    if huge:
        raise ManifestError(
            where,
            f"{brief(huge[0])}: a whole number of TOML has at most 64 bits",
            "write a number that can be meant",
        )
    return validated(Campaign, raw, where)


def validated(kind: type[Kind], raw: dict[str, Any], where: str) -> Kind:
    """A table of the manifest from plain values; raises `ManifestError` that lists every fault with
    its key.
    """
    try:
        return kind.model_validate(raw)
    except ValidationError as fault:
        errors = fault.errors(include_url=False)
        lines = _first(
            dict.fromkeys(_explain(error, raw) for error in errors[:MOST_FAULTS]), len(errors)
        )
        if any(error["type"] == "missing" for error in errors):
            lines.append("`nearlift new DIR` writes a manifest that says what each key is")
        raise ManifestError(where, "\n  ".join(lines)) from None


def _first(faults: Iterable[str], count: int) -> list[str]:
    """The first of so many faults, each cut to a line that can be read."""
    shown = [brief(fault) for fault in itertools.islice(faults, MOST_FAULTS)]
    return [*shown, f"and {count - MOST_FAULTS} more"] if count > MOST_FAULTS else shown


def _values(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Every text and number of parsed TOML with its key."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _values(inner, f"{key}.{name}".lstrip("."))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _values(inner, f"{key}.{i}")
    else:
        yield key, value


def _explain(error: Any, raw: dict[str, Any]) -> str:
    """One fault in the user's terms: key, value, and the nearest thing that would have
    been right.
    """
    location = [
        part
        for part in error["loc"]
        if not (
            isinstance(part, str)
            and ("function" in part or "[" in part or part in ("float", "str"))
        )
    ]
    key = ".".join(str(part) for part in location) or "manifest"
    if error["type"] == "extra_forbidden":
        known = _keys_beside(location)
        near = difflib.get_close_matches(str(location[-1]), known, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(known)}"
        return f"{key}: unknown key; {hint}"
    if error["type"] == "missing":
        return f"{key}: is missing"
    if error["type"] == "literal_error" and key == "schema":
        return (
            f"schema: is {error['input']!r}, and this nearlift reads {error['ctx']['expected']}:"
            " mend it, or take the version that wrote it"
        )
    message = error["msg"].removeprefix("Value error, ").replace("\n", "; ")
    shown = (
        ""
        if isinstance(error["input"], dict | list) or str(error["input"]) in message
        else f" (found {error['input']!r})"
    )
    return f"{key}: {message}{shown}"


def _keys_beside(location: list[Any]) -> list[str]:
    """Keys allowed in the table that holds the last part of `location`."""
    model: Any = Campaign
    for part in location[:-1]:
        if isinstance(part, int):
            continue
        fields = (
            {f.alias or n: f for n, f in model.model_fields.items()}
            if isinstance(model, type) and issubclass(model, BaseModel)
            else {}
        )
        if part not in fields:
            continue
        model = _section_in(fields[part].annotation) or model
    return [f.alias or n for n, f in model.model_fields.items()]


def _section_in(annotation: Any) -> Any:
    """The Section class inside an annotation such as `list[Overlay] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        found = _section_in(inner)
        if found is not None:
            return found
    return None


def boundaries_of(values: Collection[str]) -> list[Boundary]:
    """The boundaries present, ground, ceiling, sidewall in that order (`none`, free air, is not
    one).
    """
    return [b for b in BOUNDARIES if b in values]
