"""Detection of a boundary: range, distance of significance, and distance from one reading.

Without a boundary the estimate of L / L_inf scatters about 1 with standard deviation sigma(T). An
alarm is raised when it departs, in the boundary's direction, by more than k_fa sigma, with k_fa the
normal quantile of the false-alarm rate. A boundary that changes lift by D is missed at the given
rate when D = (k_fa + k_miss) sigma. The range is the largest z_hat at which |L / L_inf - 1| is D.

    sigma(T)^2 = short^2 / T + floor^2 + payload^2 + supply^2

Averaging over T reduces only `short`, the standard deviation of a one-second average.

Distance from a reading: on a grid, the prior is multiplied by the likelihood of the measured ratio,
averaged over draws of the model. The hypothesis "beyond" is that of no boundary within the range.
Where a model has the same ratio at two heights, lift cannot distinguish them, and the inversion is
refused.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from nearlift.campaign.forecasts import Detect, LiftReading
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused
from nearlift.flight import Ratio
from nearlift.flight.fitted_lift import FittedLift
from nearlift.results.document import IfAny, Real

#: Nodes of the grid, geometrically spaced.
GRID = 1200
#: Largest change of L / L_inf between nodes that counts as rounding.
FLAT = 1e-9
#: Prior probability that there is no boundary within the range.
PRIOR_BEYOND = 0.5
#: Probabilities below this are stated as a bound: the likelihood's far tails are not known.
MIN_BEYOND = 1e-4
#: Exponent of lift over supply voltage where the loop found none: a motor at fixed duty.
SAG_EXPONENT = 2.0
#: Number of heights that are inferred, and averaging time of a reading, s.
N_HEIGHTS = 25
INVERTED_S = 1.0
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightInterval:
    """Median and 90 % interval of a height."""

    median: float
    lo90: float
    hi90: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Located(HeightInterval):
    """Posterior of z_hat, given a boundary within the range; and the posterior probability `beyond`
    that there is none.
    """

    beyond: float


def grid(low: float, high: float) -> FloatArray:
    """Geometrically spaced heights from `low` (at least 0.001) to `high`: shape (GRID,)."""
    return np.geomspace(max(low, 1e-3), high, GRID)


def refuse_folds(ratio: Ratio, low: float, high: float, where: str, constant: bool = False) -> None:
    """Refuse a model whose L / L_inf is not monotonic from `low` to `high`; it may be `constant`.

    Raises
    ------
    InputRefused
        It folds (says above which height it does not), has no value somewhere, or is constant.
    """
    z_hat = grid(low, high)
    values = ratio(z_hat)
    if not np.isfinite(values).all():
        bad = float(z_hat[~np.isfinite(values)].max())
        raise InputRefused(
            where, f"the model has no value at z_hat = {bad:.3g}", f"ask above {bad:.3g}"
        )
    change = np.diff(values)
    steep = np.flatnonzero(np.abs(change) > FLAT)
    if not len(steep):
        if constant:
            return
        raise InputRefused(
            where, "the model does not change with distance", "lift says nothing of this boundary"
        )
    against = steep[change[steep] * change[steep[-1]] < 0]
    if len(against):
        turn = float(z_hat[against[-1] + 1])
        raise InputRefused(
            where,
            f"the model folds at z_hat = {turn:.3g}: one lift ratio has two heights",
            f"only heights above {turn:.3g} can be distinguished",
        )


def locate(measured: float, u: float, ratios: Sequence[Ratio], low: float, high: float) -> Located:
    """Posterior of z_hat from a measured L / L_inf with its standard uncertainty `u`, including
    sensor, payload and supply.

    `ratios` are draws of the model, each monotonic (see `refuse_folds`). The prior is uniform in ln
    z_hat from `low` to `high`; that there is no boundary within has the probability `PRIOR_BEYOND`.

    Raises
    ------
    InputRefused
        `u` is not positive, or `measured` is over ten `u` both from 1 and from the model's range.
    """
    if not u > 0:
        raise InputRefused(
            "measured ratio", f"has the uncertainty {u:g}", "give a positive standard uncertainty"
        )
    z_hat = grid(low, high)
    values = np.stack([ratio(z_hat) for ratio in ratios])
    deviation = (measured - values) / u
    outside = max(float(values.min()) - measured, measured - float(values.max())) / u
    if min(outside, abs(measured - 1.0) / u) > 10:
        raise InputRefused(
            "measured ratio",
            f"{measured:.4g} is {outside:.0f} standard uncertainties from everything between"
            f" {values.min():.4g} and {values.max():.4g}",
            "lift has another cause, or its uncertainty is larger than said",
        )
    # integrals over ln z, in which the prior is flat; both evidences are relative to the larger of
    # the likelihoods at the best height and without a boundary, so that they cannot both underflow
    nearest, alone = float((deviation**2).min()), ((measured - 1.0) / u) ** 2
    likelihood = np.exp(-0.5 * (deviation**2 - nearest)).mean(axis=0)
    log_z = np.log(z_hat)
    width = np.gradient(log_z)
    least = min(nearest, alone)
    evidence = float(
        np.sum(likelihood * width) / (log_z[-1] - log_z[0]) * np.exp(-0.5 * (nearest - least))
    )
    none = float(np.exp(-0.5 * (alone - least)))
    total = (1 - PRIOR_BEYOND) * evidence + PRIOR_BEYOND * none
    mass = likelihood * width
    cumulative = np.cumsum(mass) / mass.sum()
    lo90, median, hi90 = (float(np.interp(q, cumulative, z_hat)) for q in (0.05, 0.5, 0.95))
    return Located(median=median, lo90=lo90, hi90=hi90, beyond=PRIOR_BEYOND * none / total)


def ratio_of_hover(
    throttle: float,
    weight_N: float,
    u_weight: float,
    levels: Sequence[float],
    lift_inf_N: Sequence[float],
    u_lift: float,
    u_throttle: float = 0.0,
) -> tuple[float, float]:
    """L / L_inf at hover (weight, payload included, over lift far away at that throttle) and its
    standard uncertainty.

    `levels` are the throttles measured, fractions of full, ascending, and `lift_inf_N` lift far
    away at each; a power law holds between them. `u_weight` and `u_lift` (levels, supply) are
    relative; `u_throttle` is weighted by the exponent of the power law there.

    Raises
    ------
    InputRefused
        The throttle is outside those measured.
    """
    if not levels[0] <= throttle <= levels[-1]:
        raise InputRefused(
            "throttle",
            f"{throttle:.3g} is outside {levels[0]:.3g} to {levels[-1]:.3g}, where lift was"
            " measured",
            "measure lift at that throttle too",
        )
    log_levels, log_lift = np.log(levels), np.log(lift_inf_N)
    far = float(np.exp(np.interp(np.log(throttle), log_levels, log_lift)))
    ratio = weight_N / far
    i = int(np.clip(np.searchsorted(levels, throttle), 1, max(len(levels) - 1, 1)))
    power = 0.0
    if len(levels) > 1:
        power = float((log_lift[i] - log_lift[i - 1]) / (log_levels[i] - log_levels[i - 1]))
    return ratio, ratio * float(
        np.sqrt(u_weight**2 + u_lift**2 + (power * u_throttle / throttle) ** 2)
    )


def reach(ratio: Ratio, change: float, low: float, high: float) -> float:
    """Largest z_hat from `low` to `high` at which |L / L_inf - 1| is at least `change`,
    interpolated on the grid; nan where there is none. A result of `high` is a lower bound.
    """
    z_hat = grid(low, high)
    effect = np.abs(ratio(z_hat) - 1.0)
    enough = np.flatnonzero(effect >= change)
    if not len(enough):
        return float("nan")
    last = int(enough[-1])
    if last == len(z_hat) - 1:
        return float(z_hat[-1])
    a, b = effect[last], effect[last + 1]
    return float(z_hat[last] + (z_hat[last + 1] - z_hat[last]) * (a - change) / (a - b))


def reaches(
    ratios: Sequence[Ratio], change: float, low: float, high: float
) -> tuple[float, float, float]:
    """Detection range of the first ratio (the best estimate), and its 90 % interval over the
    others.

    Ratios without a range count as zero.
    """
    heights = [reach(f, change, low, high) for f in ratios]
    lo90, hi90 = (
        np.percentile(np.nan_to_num(heights[1:], nan=0.0), [5, 95])
        if len(heights) > 1
        else (heights[0], heights[0])
    )
    return heights[0], float(lo90), float(hi90)


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
    z_hat: HeightInterval
    z_m: HeightInterval
    beyond: float
    within_z_hat: tuple[float, float]
    alike: Mapping[Boundary, float] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """Summary for the terminal."""
        low, high = self.within_z_hat
        z, m = self.z_hat, self.z_m
        share = "below 0.01" if self.beyond < MIN_BEYOND else f"{100 * self.beyond:.2g}"
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


def refuse_ambiguous(lift: FittedLift) -> None:
    """Refuse a fitted lift whose best estimate or any draw has the same ratio at two heights.

    A draw may be constant, where the interval of a coefficient reaches 0.
    """
    low, high = lift.measured_z_hat
    for i, ratio in enumerate(lift.ratios):
        refuse_folds(ratio, low, high, f"{lift.boundary} {lift.model.name}", constant=i > 0)


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
        The model folds, the throttle is outside those measured, or as `locate`.
    """
    refuse_ambiguous(lift)
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
        ratio, u = ratio_of_hover(
            reading.throttle,
            weight_N,
            chosen.payload[0] if reading.weight is None else reading.weight,
            levels,
            far.tolist(),
            float(np.hypot(relative, supply)),
            reading.u,
        )
    height = locate(ratio, u, lift.ratios[1:], *lift.measured_z_hat)
    z_hat, z_m = (
        HeightInterval(
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Noise of a relative lift reading: the standard deviation of the average over one second, and
    that which averaging does not reduce.
    """

    short_per_sqrt_Hz: float
    floor: float

    def sigma(self, averaging_s: float, payload: float = 0.0, supply: float = 0.0) -> float:
        """Standard deviation of the estimated L / L_inf; `payload` and `supply` are relative
        standard uncertainties of weight and of lift by the supply.
        """
        short = self.short_per_sqrt_Hz**2 / averaging_s
        return float(np.sqrt(short + self.floor**2 + payload**2 + supply**2))


def needed(sigma: float, false_alarm_rate: float, miss_rate: float) -> float:
    """Relative change of lift that is detected at these rates."""
    from scipy.special import ndtri

    return float(sigma * (-ndtri(false_alarm_rate) - ndtri(miss_rate)))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightTrial:
    """Posterior of the height for a reading of exactly the best estimate at `z_hat`."""

    z_hat: Real
    ratio: Real
    median: Real
    lo90: Real
    hi90: Real
    beyond: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class SignificantHeight:
    """Largest z_hat with a change of lift of at least `change` (a fraction), and its 90 % interval.

    The interval is over draws of the model; nan where no measured height has such a change.
    """

    change: Real
    z_hat: Real
    lo90: Real
    hi90: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryProximity:
    """One boundary: model, sensor, range of significant change, and inferred heights or why none
    are; `lift_per_voltage` is |d ln L / d ln V|.
    """

    model: str
    title: str
    draws_from: str
    effects: tuple[str, ...]
    measured_z_hat: tuple[Real, Real]
    largest_change: Real
    significant: SignificantHeight
    short_per_sqrt_Hz: Real
    floor: Real
    lift_per_voltage: Real
    located: IfAny[tuple[HeightTrial, ...]] = None
    refused: IfAny[str] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximityResult:
    """Content of proximity.json; `averaging_s` is the averaging time of the inferred heights."""

    schema: str = "nearlift.proximity/1"
    false_alarm_rate: Real
    miss_rate: Real
    averaging_s: Real
    boundaries: Mapping[Boundary, BoundaryProximity]
    readings: tuple[HeightReading | RefusedReading, ...]


def boundary_proximity(lift: FittedLift, device: Sensor, chosen: Detect) -> BoundaryProximity:
    """Significant range and inferred heights (none where the model folds)."""
    sensitivity = supply_sensitivity(lift)
    sigma = device.sigma(INVERTED_S, chosen.payload[0], sensitivity * chosen.supply[0])
    located, refused = None, None
    try:
        refuse_ambiguous(lift)
        located = _located(lift, sigma)
    except InputRefused as refusal:
        refused = f"{refusal.what}; {refusal.remedy}"
    best, lo90, hi90 = reaches(lift.ratios, chosen.significant, *lift.measured_z_hat)
    return BoundaryProximity(
        model=lift.model.name,
        title=lift.title,
        draws_from=lift.source,
        effects=lift.effects,
        measured_z_hat=lift.measured_z_hat,
        largest_change=lift.largest_change,
        significant=SignificantHeight(change=chosen.significant, z_hat=best, lo90=lo90, hi90=hi90),
        short_per_sqrt_Hz=device.short_per_sqrt_Hz,
        floor=device.floor,
        lift_per_voltage=sensitivity,
        located=located,
        refused=refused,
    )


def _located(lift: FittedLift, sigma: float) -> tuple[HeightTrial, ...]:
    low, high = lift.measured_z_hat
    best, *draws = lift.ratios
    trials = []
    for z_hat in np.geomspace(low, high, N_HEIGHTS):
        ratio = float(best(np.array([z_hat]))[0])
        height = locate(ratio, sigma, draws, low, high)
        trials.append(HeightTrial(z_hat=float(z_hat), ratio=ratio, **asdict(height)))
    return tuple(trials)


def range_rows(
    lift: FittedLift, device: Sensor, chosen: Detect, radius_m: float
) -> list[dict[str, object]]:
    """Rows of detection.parquet: detection ranges over supplies, payloads and averaging times."""
    rows = []
    for voltage, payload, averaging_s in itertools.product(
        chosen.supply, chosen.payload, chosen.averaging
    ):
        supply = supply_sensitivity(lift) * voltage
        sigma = device.sigma(averaging_s, payload, supply)
        change = needed(sigma, chosen.false_alarm_rate, chosen.miss_rate)
        best, lo90, hi90 = reaches(lift.ratios, change, *lift.measured_z_hat)
        rows.append(
            {
                "boundary": lift.boundary,
                "model": lift.model.name,
                "averaging_s": averaging_s,
                "payload": payload,
                "voltage": voltage,
                "supply": supply,
                "sigma": sigma,
                "false_alarms_per_hour": chosen.false_alarm_rate * HOUR_S / averaging_s,
                "needed": change,
                "range_z_hat": best,
                "lo90": lo90,
                "hi90": hi90,
                "range_m": best * radius_m,
            }
        )
    return rows
