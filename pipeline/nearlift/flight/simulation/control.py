"""PID of rotor frequency (Eq. 5): f = max(0, kP (z - z0) + kD z' + kI integral(z - z0) + f0).

z is the distance to the boundary. Above a ground a vehicle that is too low (z < z0) must turn its
rotors faster, so the gains are negative; below a ceiling it is then too high and must slow them, so
they are positive. The paper prints positive gains for both, with which the loop above a ground is
unstable; unstable gains are refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import Boundary
from nearlift.errors import ManifestError
from nearlift.flight.simulation.craft import Craft

#: Direction of lift along z: away from a ground, towards a ceiling.
AWAY: dict[Boundary, float] = {"ground": 1.0, "ceiling": -1.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Gains:
    """kP in 1/(m s), kD in 1/m, kI in 1/(m s^2), as they stand in Eq. 5."""

    kP: float
    kD: float
    kI: float

    def times(self, factor: float) -> Gains:
        """All three gains by `factor`; -1 is the same controller at the opposite boundary."""
        return Gains(kP=factor * self.kP, kD=factor * self.kD, kI=factor * self.kI)


#: Sign of gains that fly at a boundary, and why.
RIGHT_SIGN: dict[Boundary, tuple[str, str]] = {
    "ground": ("negative", "above a ground a vehicle that is too low must turn its rotors faster"),
    "ceiling": ("positive", "below a ceiling a vehicle that is too close must slow its rotors"),
}
#: Magnitudes as printed (10^2.5 and 10^1.5), with the sign that each boundary needs.
PAPER_CEILING = Gains(kP=316.0, kD=316.0, kI=31.6)
PAPER_GAINS: dict[Boundary, Gains] = {"ground": PAPER_CEILING.times(-1.0), "ceiling": PAPER_CEILING}


def poles(gains: Gains, craft: Craft, boundary: Boundary) -> np.ndarray:
    """Complex poles (3,), in 1/s, of the loop linearised about hover far from the boundary."""
    # s^3 = away * 2 g / f0 * (kD s^2 + kP s + kI)
    stiffness = AWAY[boundary] * 2.0 * craft.gravity_m_s2 / craft.hover_Hz
    return np.roots([1.0, -stiffness * gains.kD, -stiffness * gains.kP, -stiffness * gains.kI])


def stable(gains: Gains, craft: Craft, boundary: Boundary) -> Gains:
    """The gains, if their loop is stable without a boundary.

    Raises
    ------
    ManifestError
        A pole has a positive real part (says which signs would do), or kP or kD is zero.
    """
    # a pole at zero is that of an unused integrator
    worst = float(poles(gains, craft, boundary).real.max())
    if worst <= 1e-9 and gains.kP and gains.kD:
        return gains
    if gains.kP == 0.0 or gains.kD == 0.0:
        raise ManifestError(
            f"simulate.gains.{boundary}",
            f"kP = {gains.kP:g}, kD = {gains.kD:g}: without both nothing brings the vehicle back"
            " and calms it",
            "give both",
        )
    right, reason = RIGHT_SIGN[boundary]
    flipped = float(poles(gains.times(-1.0), craft, boundary).real.max()) <= 1e-9
    remedy = (
        f"change the sign of all three: {right} at this boundary"
        if flipped
        else "kP, kD and kI want one sign, and kD kP large enough for kI"
    )
    raise ManifestError(
        f"simulate.gains.{boundary}",
        f"kP = {gains.kP:g}, kD = {gains.kD:g}, kI = {gains.kI:g} make an unstable loop (a pole at"
        f" {worst:+.3g} 1/s): {reason}",
        remedy,
    )
