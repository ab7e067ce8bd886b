"""Distance to a boundary from one reading: a lift ratio, or the throttle at hover."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from nearlift.campaign.forecasts import Detect, LiftReading
from nearlift.declare import Boundary
from nearlift.flight import inverse
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.inverse import reach

#: Exponent of lift over supply voltage where the loop found none: a motor at fixed duty.
SAG_EXPONENT = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightReading:
    """A reading and its posterior.

    `beyond` is the probability of no boundary within `within_z_hat`. `alike` are the heights of
    other boundaries with the same ratio, which one reading cannot exclude.
    """

    boundary: Boundary
    model: str
    throttle: float | None
    ratio: float
    u: float
    z_hat: inverse.HeightInterval
    z_m: inverse.HeightInterval
    beyond: float
    within_z_hat: tuple[float, float]
    alike: Mapping[Boundary, float] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """Summary for the terminal."""
        low, high = self.within_z_hat
        z, m = self.z_hat, self.z_m
        share = "below 0.01" if self.beyond < inverse.NONE else f"{100 * self.beyond:.2g}"
        hover = "" if self.throttle is None else f" (hover at {100 * self.throttle:.4g} % throttle)"
        return (
            f"{self.boundary}, {self.model}: L/L_inf = {self.ratio:.4g} +- {self.u:.2g}{hover}\n"
            f"z_hat = {z.median:.3g} (90 %: {z.lo90:.3g} to {z.hi90:.3g}), {1e3 * m.median:.3g} mm"
            f" ({1e3 * m.lo90:.3g} to {1e3 * m.hi90:.3g}), if there is a boundary\n"
            f"none between z_hat {low:.3g} and {high:.3g}: {share} % (50 % before the reading)"
            + "".join(
                f"\na {side} at z_hat {at:.3g} reads the same: one reading does not tell them"
                " apart; lift that rises in descent does (ground), or in climb (ceiling)"
                for side, at in self.alike.items()
            )
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RefusedReading:
    """A reading without a posterior, and why."""

    boundary: Boundary
    refused: str


def supply_sensitivity(lift: FittedLift) -> float:
    """Magnitude of d ln lift / d ln supply voltage."""
    return abs(lift.best.get("sag_exponent", SAG_EXPONENT))


def refuse_folds(lift: FittedLift) -> None:
    """Refuse a fitted lift whose best estimate or any draw has the same ratio at two heights."""
    low, high = lift.measured_z_hat
    for ratio in lift.ratios:
        inverse.refuse_folds(ratio, low, high, f"{lift.boundary} {lift.model.name}")


def read_height(
    reading: LiftReading,
    lift: FittedLift,
    lift_inf_N: Mapping[float, tuple[float, float]],
    chosen: Detect,
    radius_m: float,
    weight_N: float,
    others: Sequence[FittedLift] = (),
) -> HeightReading:
    """Posterior of z_hat from one reading.

    `lift_inf_N` gives lift far away and its standard uncertainty by throttle, `weight_N` includes
    the reading's payload, `others` are the lifts near the other boundaries.

    Raises
    ------
    InputRefused
        The model folds, the throttle is outside those measured, or as `inverse.locate`.
    """
    refuse_folds(lift)
    exponent = supply_sensitivity(lift)
    if reading.ratio is not None:
        # a ratio's `u` includes weight and supply unless they are given; a throttle's never does
        further = np.hypot(reading.weight or 0.0, exponent * (reading.supply or 0.0))
        ratio, u = reading.ratio, float(np.hypot(reading.u, reading.ratio * further))
    else:
        assert reading.throttle is not None
        supply = exponent * (chosen.supply[0] if reading.supply is None else reading.supply)
        levels = sorted(lift_inf_N)
        far, u_far = np.array([lift_inf_N[t] for t in levels]).T
        relative = float(np.interp(reading.throttle, levels, u_far / far))
        ratio, u = inverse.ratio_of_hover(
            reading.throttle,
            weight_N,
            chosen.payload[0] if reading.weight is None else reading.weight,
            levels,
            far.tolist(),
            float(np.hypot(relative, supply)),
            reading.u,
        )
    height = inverse.locate(ratio, u, lift.ratios[1:], *lift.measured_z_hat)
    z_hat, z_m = (
        inverse.HeightInterval(
            median=factor * height.median, lo90=factor * height.lo90, hi90=factor * height.hi90
        )
        for factor in (1.0, radius_m)
    )
    return HeightReading(
        boundary=reading.boundary,
        model=lift.model.name,
        throttle=reading.throttle,
        ratio=ratio,
        u=u,
        z_hat=z_hat,
        z_m=z_m,
        beyond=height.beyond,
        within_z_hat=lift.measured_z_hat,
        alike={
            other.boundary: at
            for other in others
            if (other.largest_change > 0) == (ratio > 1)
            and np.isfinite(at := reach(other.ratio(), abs(ratio - 1.0), *other.measured_z_hat))
            and at < other.measured_z_hat[1]
        },
    )
