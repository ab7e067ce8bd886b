"""[piv] of the manifest: which velocity grids belong to which boundary and distance, and how their
pictures lie.

Vehicle axes: origin midway between the rotors in the rotor plane, x along the light sheet, y along
thrust. The wake is at negative y whichever way up the vehicle hung, so upright ground runs and
inverted ceiling runs agree.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from nearlift import units
from nearlift.campaign.quantities import (
    Angle,
    Fraction,
    Length,
    Position,
    PositiveDuration,
    PositiveLength,
    Rate,
    Section,
    positive,
)
from nearlift.errors import ManifestError, brief


def _pixel_size(value: object) -> float:
    length, _, per = value.rpartition("/") if isinstance(value, str) else ("", "", "")
    if per.strip() not in ("px", "pix", "pixel") or not length.strip():
        raise ValueError(f'{brief(repr(value))} is not a length per pixel; write it as "20 um/px"')
    try:
        return units.quantity(length, "length", "scale")
    except ManifestError as refusal:
        raise ValueError(f"{refusal.what}; {refusal.remedy}") from None


PixelSize = Annotated[float, BeforeValidator(_pixel_size), AfterValidator(positive)]
Rectangle = Annotated[tuple[Length, Length, Length, Length], Field(strict=False)]
Direction = Literal["+x", "-x", "+y", "-y"]
PivBoundary = Literal["ground", "ceiling", "none"]


class PivConventions(Section):
    """How files are read and how their pictures lie; said once under [piv], or for one case where
    it differs.

    Attributes
    ----------
    format : str or None
        Name of a dialect; None: told from the file itself, strictly.
    length_unit, velocity_unit : str or None
        Where the files do not say (old OpenPIV text): ``"mm"``, ``"px"``; ``"m/s"``,
        ``"px/frame"``.
    scale : float or None
        m per pixel, for files in pixels.
    frame_time : float or None
        s between the two images of a pair, for files that hold displacements.
    v_sign : int or None
        -1 where the software writes the second component positive against its own second axis.
    thrust, across : str or None
        The file's directions of thrust and of the vehicle's +x.
    origin : (float, float) or None
        File position of the midpoint between the rotors, in the rotor plane, m.
    rotors : list of float or None
        x of the rotor axes that the light sheet cuts, vehicle axes, m.
    mask : list of rectangles or None
        (x from, x to, y from, y to) in vehicle axes, m: what the picture cannot show there is left
        out.
    mirror : str or None
        Which half was measured, ``"left"`` or ``"right"``: the other is its reflection, and marked
        as such.
    rate : float or None
        Fields per second.
    """

    format: str | None = None
    length_unit: str | None = None
    velocity_unit: str | None = None
    scale: PixelSize | None = None
    frame_time: PositiveDuration | None = None
    v_sign: Literal[1, -1] | None = None
    thrust: Direction | None = None
    across: Direction | None = None
    origin: Position | None = None
    rotors: list[Length] | None = None
    mask: list[Rectangle] | None = None
    mirror: Literal["left", "right"] | None = None
    rate: Rate | None = None


class PivCase(PivConventions):
    """The fields of one boundary, distance and tilt. `tilt` is positive where the vehicle's +x side
    is farther from the boundary.
    """

    name: str
    boundary: PivBoundary
    z_hat: float | None = Field(default=None, gt=0)
    tilt: Angle = 0.0
    files: str

    @model_validator(mode="after")
    def _distance_known(self) -> Self:
        if not re.fullmatch(r"[a-zA-Z0-9][a-zA-Z0-9._+-]*", self.name):
            raise ValueError(
                f"name {self.name!r} is not made of letters, digits, '-', '+', '_' and '.'"
            )
        if (self.z_hat is None) != (self.boundary == "none"):
            raise ValueError(
                f'case {self.name!r}: boundary = "{self.boundary}" '
                + (
                    "has no distance: leave z_hat out"
                    if self.boundary == "none"
                    else "needs z_hat, rotor plane to boundary over rotor radius"
                )
            )
        return self


class Piv(PivConventions):
    """All cases, and what is asked of them.

    Attributes
    ----------
    control : str
        Name of the case far from every boundary.
    below, half_span : float or None
        Cut beneath each rotor: distance below the rotor plane (None: one rotor diameter) and half
        its length (None: one radius), m.
    u_position : float or None
        Standard uncertainty of the cut's place in the picture, m; None: a grid spacing over the
        root of 12.
    u_scale : float
        Relative standard uncertainty of every velocity, common to all cases (it leaves a reduction
        alone).
    outliers : float
        Threshold of the median test on each vector; 0 keeps them all.
    figure3 : list of str or None
        Cases of the three columns of Figure 3.
    """

    control: str
    below: PositiveLength | None = None
    half_span: PositiveLength | None = None
    u_position: PositiveLength | None = None
    u_scale: Fraction = 0.0
    outliers: float = Field(default=3.0, ge=0)
    figure3: list[str] | None = None
    case: list[PivCase] = Field(min_length=1)

    @model_validator(mode="after")
    def _cases_known(self) -> Self:
        names = [c.name for c in self.case]
        if len(set(names)) != len(names):
            raise ValueError(
                "two cases have the same name:"
                f" {', '.join(sorted(n for n, k in Counter(names).items() if k > 1))}"
            )
        for wanted in (self.control, *(self.figure3 or ())):
            if wanted not in names:
                raise ValueError(f"there is no case {wanted!r}; cases are {', '.join(names)}")
        if next(c for c in self.case if c.name == self.control).boundary != "none":
            raise ValueError(f'the control {self.control!r} must have boundary = "none"')
        for case in self.case:
            for key in ("thrust", "origin", "rotors"):
                if self.setting(case, key) is None:
                    raise ValueError(f"case {case.name!r}: {key} is missing, here or under [piv]")
            across = self.setting(case, "across")
            if across is not None and across[1] == self.setting(case, "thrust")[1]:
                raise ValueError(f"case {case.name!r}: across and thrust are the same axis")
        return self

    def setting(self, case: PivCase, key: str, default: Any = None) -> Any:
        """What one case says of `key`, else what [piv] says, else `default`."""
        for section in (case, self):
            if (value := getattr(section, key)) is not None:
                return value
        return default

    def named(self, name: str) -> PivCase:
        """The case of that name."""
        return next(c for c in self.case if c.name == name)
