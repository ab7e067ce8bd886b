"""The paper's Table 1, whose unit cannot be what it says, in its three readings; each says which of
the paper's claims it meets.

Table 1 of Carter, Bouchard and Quinn 2021 prints distances to 577 "cm" for a traverse in a room of
1.5 m. Read literally it is refused (`AS_PRINTED` exists to show that). No reading meets every claim
of the text, and the text does not decide, so none is ever taken silently: a campaign says its unit
and its datum, and these presets say theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from nearlift.declare import Boundary, FloatArray

#: As printed, boundary to numbers. Ground less ceiling is 52 or 53 in every row, sidewall less
#: ceiling 10 or 11: one list of commands.
TABLE_1: Mapping[Boundary, tuple[int, ...]] = {
    "ceiling": (5, 6, 7, 8, 9, 10, 11, 12, 14, 15, 18, 22, 25, 29, 34, 38, 55, 68, 90, 525),
    "ground": (57, 58, 59, 60, 61, 62, 63, 64, 66, 68, 70, 74, 77, 82, 86, 90, 108, 121, 142, 577),
    "sidewall": (15, 16, 17, 18, 19, 21, 22, 23, 24, 26, 28, 32, 35, 40, 44, 48, 66, 79, 101, 535),
}
RADIUS_M = 0.023
ROOM_M = 1.5

ZHat = Mapping[Boundary, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableClaim:
    """Something that the paper says and that a reading of Table 1 can contradict; `holds` takes
    z_hat per boundary.
    """

    name: str
    text: str
    holds: Callable[[ZHat], bool]


CLAIMS = (
    TableClaim(
        name="room",
        text="the arena is 1.5 m wide (section II)",
        holds=lambda z: bool(max(v.max() for v in z.values()) * RADIUS_M <= ROOM_M),
    ),
    TableClaim(
        name="near_ground",
        text="R^2 = 0.956 is quoted for 1 < z_hat < 3 (section V.A)",
        holds=lambda z: bool(z["ground"].min() < 1.5),
    ),
    # with the vehicle's true spacings the original model passes half of the 20 % at z_hat 1.5
    TableClaim(
        name="ground_gain",
        text="the ground adds up to 20 % of lift (section V.A)",
        holds=lambda z: bool(z["ground"].min() <= 1.5),
    ),
    TableClaim(
        name="ground_reach",
        text="the ground matters for z_hat < 4 (section V.A)",
        holds=lambda z: bool(np.any((z["ground"] > 3) & (z["ground"] < 6))),
    ),
    # the model gives the measured 1.60 at z_hat = 0.180
    TableClaim(
        name="ceiling_excess",
        text="closest to the ceiling Eq. 3 gives more than the measured 60 %",
        holds=lambda z: bool(z["ceiling"].min() < 0.180),
    ),
    TableClaim(
        name="near_sidewall",
        text="the sidewall matters for z_hat < 0.3 only",
        holds=lambda z: bool(z["sidewall"].min() <= 0.3 + 1e-9),
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TableReading:
    """One reading of Table 1.

    Attributes
    ----------
    name, title : str
    unit_m : float
        What one of the printed numbers is worth, m.
    unit : str
        The unit in which a schedule records them (``"mm"``, or ``"cm"`` as printed).
    offset_m : mapping of boundary to float
        From the datum of the printed numbers to rotor plane (sidewall: blade tip), m; added.
    """

    name: str
    title: str
    unit_m: float
    unit: str = "mm"
    offset_m: Mapping[Boundary, float]

    def recorded_m(self, boundary: Boundary) -> FloatArray:
        """Reading of the traverse at each station, m, nearest first; the datum's offset still wants
        adding.
        """
        return np.array(TABLE_1[boundary], dtype=float) * self.unit_m

    def z_m(self, boundary: Boundary) -> FloatArray:
        """Rotor plane (sidewall: nearest blade tip) to boundary at each station, m,
        nearest first.
        """
        return self.recorded_m(boundary) + self.offset_m[boundary]

    @property
    def contradicts(self) -> tuple[str, ...]:
        """Names of the `CLAIMS` that do not hold under this reading."""
        z_hat = {side: self.z_m(side) / RADIUS_M for side in TABLE_1}
        return tuple(c.name for c in CLAIMS if not c.holds(z_hat))


_NO_OFFSET: Mapping[Boundary, float] = {"ground": 0.0, "ceiling": 0.0, "sidewall": 0.0}

MM = TableReading(
    name="mm",
    title="the numbers are millimetres to the rotor plane",
    unit_m=1e-3,
    offset_m=_NO_OFFSET,
    # z_hat: ground 2.48 to 25, ceiling 0.217 to 22.8, sidewall 0.65 to 23.3
)
PERCENT_DIAMETER = TableReading(
    name="percent_diameter",
    title="the numbers are hundredths of a rotor diameter (0.46 mm) to the rotor plane",
    unit_m=0.46e-3,
    offset_m=_NO_OFFSET,
    # z_hat: ground 1.14 to 11.5 with nothing between 2.84 and 11.5, ceiling 0.10 to 10.5, sidewall
    # 0.30 to 10.7; the ground column's excess of 52.3 is then 24.1 mm, rotor plane to feet of a
    # Crazyflie
)
FEET_DATUM = TableReading(
    name="feet_datum",
    title=(
        "the numbers are millimetres commanded, each column with a datum of its own: the ground's"
        " is 28.3 mm too large, the sidewall's 10.4 mm"
    ),
    unit_m=1e-3,
    # one list of clearances (the ceiling's): ground entries less 52.3 plus 24 mm from the feet to
    # the rotor plane, sidewall entries less 10.4
    offset_m={"ground": -28.3e-3, "ceiling": 0.0, "sidewall": -10.4e-3},
    # z_hat: ground 1.25 to 23.9, ceiling 0.217 to 22.8, sidewall 0.20 to 22.8
)
PRESETS = (MM, PERCENT_DIAMETER, FEET_DATUM)

#: The unit that the paper prints. No preset: a campaign that says so is refused ("525 cm is outside
#: the 1.5 m arena; mm?").
AS_PRINTED = TableReading(
    name="cm_as_printed",
    title="the unit that is printed; impossible",
    unit_m=1e-2,
    unit="cm",
    offset_m=_NO_OFFSET,
)
