"""[flight] of the manifest: by which columns of its log a vehicle is weighed, and when it flies."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from nearlift import units
from nearlift.errors import ManifestError
from nearlift.manifest.quantities import (
    Angle,
    Duration,
    Length,
    PositiveDuration,
    Section,
    Velocity,
    positive,
)
from nearlift.manifest.rig import RECORD_MARK

if TYPE_CHECKING:
    from nearlift.manifest.campaign import Campaign

#: Standard gravity, the unit of accelerometers, m/s^2.
STANDARD_G = 9.80665
#: The largest time constant of a motor, s.
LONGEST_LAG_S = 0.2


def _within_what_motors_do(lag: float) -> float:
    if lag > LONGEST_LAG_S:
        raise ValueError(f"no motor lags by more than {1e3 * LONGEST_LAG_S:g} ms")
    return lag


class LoggedColumn(Section):
    """A column of a log: its unit, and the sign with which it counts upwards."""

    column: str
    unit: str
    sign: Literal[1, -1] = 1

    def factor(self, dimension: str, key: str) -> float:
        """What its numbers are multiplied by for SI, up positive.

        Raises
        ------
        ManifestError
            The unit is of another dimension.
        """
        if dimension == "acceleration" and self.unit == "g":
            return self.sign * STANDARD_G
        factor, offset = units.to_si(self.unit, dimension, f"flight.{key}.unit")
        if offset:
            raise ManifestError(
                f"flight.{key}.unit", f"{self.unit!r} has a zero of its own", "take the SI unit"
            )
        return self.sign * factor


class Acceleration(LoggedColumn):
    """The acceleration along the rotor axis (`body`) or upwards (`world`), which has gravity in it
    (an accelerometer at rest reads 1 g) or not.
    """

    gravity: Literal["included", "removed"]
    axes: Literal["body", "world"]


class Command(Section):
    """What the motors were told: a column a rotor, its number at rest and at full throttle."""

    columns: list[str] = Field(min_length=1)
    full: float
    zero: float = 0.0

    @model_validator(mode="after")
    def _has_a_range(self) -> Self:
        if not (math.isfinite(self.full) and math.isfinite(self.zero) and self.full != self.zero):
            raise ValueError("full and zero are the numbers at full throttle and at rest")
        return self


class Height(LoggedColumn):
    """Height of the datum that [rig] names above the boundary; set to zero at each start, or as it
    is. `range` is that of its sensor.
    """

    zero: Literal["each start", "none"]
    range: Annotated[tuple[Length, Length], Field(strict=False)] | None = None


class Attitude(Section):
    """Roll and pitch, a column each."""

    columns: list[str] = Field(min_length=1, max_length=2)
    unit: str


class Flight(Section):
    """A log of the vehicle's own sensors in place of a load cell.

    Attributes
    ----------
    velocity
        Upwards.
    setpoint
        Of the height, where the log has it.
    airborne : float
        The climb that must have been exceeded since the last contact, m/s.
    tilt : float
        Beyond it a window is left out, rad.
    window : float
        Length of a trial, s.
    lag : float or "auto"
        Time constant of the motors, s, or to be estimated.
    sound : str or None
        Which `condition` (a column of the schedule) the flights have that hover is compared with.
    """

    acceleration: Acceleration
    command: Command
    supply: LoggedColumn | None = None
    height: Height
    velocity: LoggedColumn
    setpoint: LoggedColumn | None = None
    attitude: Attitude | None = None
    airborne: Velocity = 0.15
    tilt: Annotated[Angle, AfterValidator(positive)] = math.radians(15)
    window: PositiveDuration = 0.25
    lag: Annotated[Duration, AfterValidator(_within_what_motors_do)] | Literal["auto"] = "auto"
    sound: str | None = None

    @property
    def tells_tilt(self) -> bool:
        """Whether the log says how the vehicle leans: an acceleration along the world's axes does,
        since the rotors alone make it.
        """
        return self.attitude is not None or self.acceleration.axes == "world"


def flight_fits_the_rest(campaign: Campaign) -> None:
    """See that [flight] goes with the rest of the manifest, or that nothing asks for it.

    Raises
    ------
    ValueError
        It does not.
    """
    if campaign.flight is None:
        if campaign.rig.held == "command":
            raise ValueError('rig.held = "command" goes with [flight]: a log of commands')
        return
    if campaign.rig.held != "command":
        raise ValueError(
            f'a flight holds nothing but its command: rig.held = "command", not'
            f' "{campaign.rig.held}"'
        )
    if campaign.segments is not None:
        raise ValueError("[flight] and [segments] both cut records: take one of them away")
    if campaign.records.force is not None or campaign.load_cell.model_fields_set:
        raise ValueError(
            "with [flight] the vehicle weighs itself: take [load_cell] and records.force away"
        )
    if campaign.records.reader == "means" or RECORD_MARK not in (campaign.records.files or ""):
        raise ValueError(
            f"with [flight] a file is a log: write {RECORD_MARK} in [records] files, as"
            f' in "logs/{RECORD_MARK}.csv"'
        )
