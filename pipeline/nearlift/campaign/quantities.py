"""Types of a manifest's values: quantities in SI, and tables without unknown keys."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo

from nearlift import units
from nearlift.errors import ManifestError


@contextlib.contextmanager
def as_fault(key: str = "") -> Iterator[None]:
    """Turn a refusal into the ValueError that pydantic collects."""
    try:
        yield
    except ManifestError as refusal:
        raise ValueError(f"{key}{refusal.what}\n{refusal.remedy}") from None


def _quantity(dimension: str) -> BeforeValidator:
    def parse(value: object, info: ValidationInfo) -> float:
        with as_fault():
            return units.quantity(value, dimension, info.field_name or "")

    return BeforeValidator(parse)


def positive(value: float) -> float:
    """The value; refuses one that is not above zero."""
    if not value > 0:
        raise ValueError("must be positive")
    return value


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError("must not be negative")
    return value


Length = Annotated[float, _quantity("length")]
PositiveLength = Annotated[Length, AfterValidator(positive)]
Angle = Annotated[float, _quantity("angle")]
Fraction = Annotated[float, _quantity("fraction"), AfterValidator(_not_negative)]
Share = Annotated[float, _quantity("fraction"), AfterValidator(positive)]
Mass = Annotated[float, _quantity("mass"), AfterValidator(positive)]
Duration = Annotated[float, _quantity("time"), AfterValidator(_not_negative)]
PositiveDuration = Annotated[Duration, AfterValidator(positive)]
Rotation = Annotated[float, _quantity("rotation"), AfterValidator(positive)]
Rate = Annotated[float, _quantity("frequency"), AfterValidator(positive)]
Force = Annotated[float, _quantity("force"), AfterValidator(positive)]
Scatter = Annotated[float, _quantity("force"), AfterValidator(_not_negative)]
Voltage = Annotated[float, _quantity("voltage"), AfterValidator(positive)]
Temperature = Annotated[float, _quantity("temperature"), AfterValidator(positive)]
Density = Annotated[float, _quantity("density"), AfterValidator(positive)]
Acceleration = Annotated[float, _quantity("acceleration"), AfterValidator(positive)]
Inertia = Annotated[float, _quantity("inertia"), AfterValidator(positive)]
ProportionalGain = Annotated[float, _quantity("proportional gain")]
DerivativeGain = Annotated[float, _quantity("derivative gain")]
IntegralGain = Annotated[float, _quantity("integral gain")]
# TOML has arrays and no tuples, which strict models would refuse
Position = Annotated[tuple[Length, Length], Field(strict=False)]


class Section(BaseModel):
    """A table of the manifest: immutable, without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)

    #: Keys that a table had once, with what to write instead.
    OLD_KEYS: ClassVar[Mapping[str, str]] = {}
