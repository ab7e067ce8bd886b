"""[piv] of the manifest: velocity grids, their boundary and distance, and their orientation.

Vehicle axes: origin midway between the rotors in the rotor plane, x along the light sheet, y along
thrust. The wake is at negative y for upright and inverted vehicles alike.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from nearlift.campaign import quantities as si
from nearlift.campaign.quantities import Section

Rectangle = Annotated[tuple[si.Length, si.Length, si.Length, si.Length], Field(strict=False)]
Direction = Literal["+x", "-x", "+y", "-y"]


class PivConventions(Section):
    """Reading and orientation of velocity files, under [piv] or for one case.

    `format` names a dialect; without it the file itself must show which. Files that do not state
    their units need `length_unit` and `velocity_unit`. Files in pixels need `scale` (m per pixel);
    files of displacements need `frame_time` (s between the two images).

    `thrust` and `across` are the file's directions of thrust and of the vehicle's +x. `v_sign` is
    -1 if the software counts the second component against its own axis. `origin` is the midpoint
    between the rotors in the file's coordinates, m. `rotors` are the x of rotor axes in the light
    sheet. `mask` are excluded rectangles (x from, x to, y from, y to). Both are in vehicle axes, m.
    `mirror` is the measured half; the other half becomes its marked reflection. `rate` is fields
    per second.
    """

    format: str | None = None
    length_unit: str | None = None
    velocity_unit: str | None = None
    scale: si.PixelSize | None = None
    frame_time: si.PositiveDuration | None = None
    v_sign: Literal[1, -1] | None = None
    thrust: Direction | None = None
    across: Direction | None = None
    origin: si.Position | None = None
    rotors: list[si.Length] | None = None
    mask: list[Rectangle] | None = None
    mirror: Literal["left", "right"] | None = None
    rate: si.Rate | None = None


class PivCase(PivConventions):
    """The fields of one boundary, distance and tilt (positive: +x side farther from it)."""

    name: str = Field(pattern=r"^[a-zA-Z0-9][a-zA-Z0-9._+-]*$")
    boundary: Literal["ground", "ceiling", "none"]
    z_hat: float | None = Field(default=None, gt=0)
    tilt: si.Angle = 0.0
    files: str

    @model_validator(mode="after")
    def _distance_known(self) -> Self:
        if (self.z_hat is None) != (self.boundary == "none"):
            need = "needs z_hat, rotor plane to boundary over rotor radius"
            if self.z_hat is not None:
                need = "has no distance: leave z_hat out"
            raise ValueError(f'case {self.name!r}: boundary = "{self.boundary}" {need}')
        return self


class Piv(PivConventions):
    """All cases, and their evaluation.

    `control` names the case far from every boundary. The cut beneath each rotor is `below` its
    plane, m (default: one rotor diameter). It extends `half_span`, m, to both sides (default: one
    radius). `u_position` is the standard uncertainty of the cut's place, m (default: a grid spacing
    over sqrt(12)). `u_scale` is a relative one of every velocity, common to all cases. `outliers`
    is the threshold of the median test; 0 keeps all vectors. `figure3` names the three cases of
    Figure 3.
    """

    control: str
    below: si.PositiveLength | None = None
    half_span: si.PositiveLength | None = None
    u_position: si.PositiveLength | None = None
    u_scale: si.Fraction = 0.0
    outliers: float = Field(default=3.0, ge=0)
    figure3: list[str] | None = None
    case: list[PivCase] = Field(min_length=1)

    @model_validator(mode="after")
    def _cases_known(self) -> Self:
        cases = {c.name: c for c in self.case}
        if len(cases) != len(self.case):
            names = [c.name for c in self.case]
            twice = sorted(n for n in cases if names.count(n) > 1)
            raise ValueError(f"two cases have the same name: {', '.join(twice)}")
        for wanted in (self.control, *(self.figure3 or ())):
            if wanted not in cases:
                raise ValueError(f"there is no case {wanted!r}; cases are {', '.join(cases)}")
        if cases[self.control].boundary != "none":
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
        """The setting of one case, else of [piv], else `default`."""
        for section in (case, self):
            if (value := getattr(section, key)) is not None:
                return value
        return default

    def named(self, name: str) -> PivCase:
        """The case of that name."""
        return next(c for c in self.case if c.name == name)
