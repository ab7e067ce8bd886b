"""Types of a manifest's values: quantities in SI, and tables without unknown keys."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo

from nearlift import units
from nearlift.errors import ManifestError, brief


class Section(BaseModel):
    """A table of the manifest: immutable, without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)


@contextlib.contextmanager
def as_fault() -> Iterator[None]:
    """Turn a refusal into the ValueError that pydantic collects."""
    try:
        yield
    except ManifestError as refusal:
        raise ValueError(f"{refusal.what}\n{refusal.remedy}") from None


def _quantity(dimension: str) -> BeforeValidator:
    def parse(value: object, info: ValidationInfo) -> float:
        with as_fault():
            return units.quantity(value, dimension, info.field_name or "")

    return BeforeValidator(parse)


def _per(names: tuple[str, ...], dimension: str, example: str) -> BeforeValidator:
    """Validator of a quantity per pixel or per count, a text such as `example`."""

    def parse(value: object) -> float:
        text, _, per = value.rpartition("/") if isinstance(value, str) else ("", "", "")
        if per.strip() not in names or units.measure(text)[0] in (None, 0.0):
            raise ValueError(
                f'{brief(repr(value))} is no {dimension} per {names[0]}, as "{example}" is'
            )
        with as_fault():
            return units.quantity(text, dimension, "")

    return BeforeValidator(parse)


def _count(value: object) -> float:
    number, unit = units.measure(value) if isinstance(value, str) else (None, "")
    if number is None or unit != "count":
        raise ValueError(f'{brief(repr(value))} is not a number of counts; write "120 count"')
    return number


def _ascending(values: list[Any]) -> list[Any]:
    first = [v[0] if isinstance(v, tuple) else v for v in values]
    if any(b <= a for a, b in itertools.pairwise(first)):
        raise ValueError("must ascend")
    return values


def _distinct(values: list[Any]) -> list[Any]:
    if len(set(values)) != len(values):
        raise ValueError("names one of its values twice")
    return values


Ascending = AfterValidator(_ascending)
Distinct = AfterValidator(_distinct)
Length = Annotated[float, _quantity("length")]
PositiveLength = Annotated[Length, Field(gt=0)]
Angle = Annotated[float, _quantity("angle")]
Fraction = Annotated[float, _quantity("fraction"), Field(ge=0)]
Share = Annotated[float, _quantity("fraction"), Field(gt=0)]
Mass = Annotated[float, _quantity("mass"), Field(gt=0)]
Duration = Annotated[float, _quantity("time"), Field(ge=0)]
PositiveDuration = Annotated[Duration, Field(gt=0)]
Rotation = Annotated[float, _quantity("rotation"), Field(gt=0)]
Rate = Annotated[float, _quantity("frequency"), Field(gt=0)]
Force = Annotated[float, _quantity("force"), Field(gt=0)]
Scatter = Annotated[float, _quantity("force"), Field(ge=0)]
Voltage = Annotated[float, _quantity("voltage"), Field(gt=0)]
Temperature = Annotated[float, _quantity("temperature"), Field(gt=0)]
Density = Annotated[float, _quantity("density"), Field(gt=0)]
Inertia = Annotated[float, _quantity("inertia"), Field(gt=0)]
ProportionalGain = Annotated[float, _quantity("proportional gain")]
DerivativeGain = Annotated[float, _quantity("derivative gain")]
IntegralGain = Annotated[float, _quantity("integral gain")]
#: Acceleration of free fall: 9.76 to 9.84 m/s^2 on this Earth, with room for rounding.
Gravity = Annotated[float, _quantity("acceleration"), Field(ge=9.7, le=9.9)]
PixelSize = Annotated[float, _per(("px", "pix", "pixel"), "length", "20 um/px"), Field(gt=0)]
ForcePerCount = Annotated[float, _per(("count",), "force", "0.0098 mN/count")]
Counts = Annotated[float, BeforeValidator(_count)]
# TOML has arrays and no tuples, which strict models would refuse
Position = Annotated[tuple[Length, Length], Field(strict=False)]
