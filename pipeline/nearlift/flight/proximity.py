"""Distance at which each boundary shows in lift, and its place by a reading of lift."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from nearlift.campaign.forecasts import Detect, LiftReading
from nearlift.declare import Boundary
from nearlift.errors import InputRefused, UsageError
from nearlift.flight.detection import (
    Located,
    Sensor,
    change_needed,
    locate,
    ratio_of_hover,
    reach,
    reaches,
    refuse_folds,
)
from nearlift.flight.quoted_lift import QuotedLift, QuotedLifts
from nearlift.reduction.quality import rejected
from nearlift.results.document import IfAny, Real
from nearlift.results.quotation import Results

#: Draws of each model.
DRAWS = 100
#: Probabilities below this are stated as a bound: the likelihood's far tails are not known.
MIN_BEYOND = 1e-4
#: Exponent of lift over supply voltage where the loop found none: a motor at fixed duty.
SAG_EXPONENT = 2.0
#: Number of heights that are inferred, and averaging time of their readings, s.
N_HEIGHTS, AVERAGING_S = 25, 1.0
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightInterval:
    """Median and 90 % interval of a height."""

    median: float
    lo90: float
    hi90: float


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
    alike: Mapping[Boundary, float]

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


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightTrial(Located):
    """Posterior of the height for a reading of exactly the best estimate at `z_hat`."""

    z_hat: float
    ratio: float


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


def proximity(
    quoted: QuotedLifts, say: Callable[[str], None]
) -> tuple[list[dict[str, object]], ProximityResult, tuple[str, ...]]:
    """Ranges over averaging times, payloads and supplies (rows of detection.parquet); the distance
    inferred from a reading at each height; the manifest's readings; and notes.
    """
    chosen = quoted.campaign.detect or Detect()
    rows: list[dict[str, object]] = []
    notes = []
    boundaries: dict[Boundary, BoundaryProximity] = {}
    for boundary in quoted.boundaries:
        say(f"detect {boundary}")
        lift, device = quoted.lift(boundary, DRAWS), sensor(quoted, boundary)
        rows += _ranges(lift, device, chosen, quoted.campaign.vehicle.rotor_radius)
        entry = boundaries[boundary] = _boundary(lift, device, chosen)
        if entry.refused:
            notes.append(f"{boundary}: distance cannot be inferred from lift:  {entry.refused}")
    readings: list[HeightReading | RefusedReading] = []
    for i, reading in enumerate(chosen.reading):
        try:
            readings.append(read(quoted, reading))
        except (InputRefused, UsageError) as refusal:
            why = f"{refusal.what}; {refusal.remedy}"
            readings.append(RefusedReading(boundary=reading.boundary, refused=why))
            notes.append(f"detect.reading[{i}]: {why}")
    result = ProximityResult(
        false_alarm_rate=chosen.false_alarm_rate,
        miss_rate=chosen.miss_rate,
        averaging_s=AVERAGING_S,
        boundaries=boundaries,
        readings=tuple(readings),
    )
    return rows, result, tuple(notes)


def sensor(quoted: QuotedLifts, boundary: Boundary) -> Sensor:
    """The manifest's sensor; else the bench's load cell, whose records show what averaging does.

    Averaging leaves the scatter of the bench's trials and the uncertainty of L_inf.
    """
    chosen, trials = quoted.campaign.detect or Detect(), quoted.trials
    levels, scatter = quoted.levels(boundary)
    floor = float(np.hypot(scatter, np.median([u / value for value, u in levels.values()])))
    weight = quoted.campaign.vehicle.mass * quoted.campaign.rig.gravity
    noise, rate = 0.0, quoted.campaign.load_cell.sample_rate
    mine = (
        (trials["boundary"] == boundary) & ~rejected(trials["quality"]) & (trials["u_lift_N"] > 0)
    )
    if chosen.force_noise is not None and chosen.force_bandwidth is not None:
        # white up to the bandwidth: the average over a second has sd / sqrt(2 bandwidth)
        noise = chosen.force_noise / weight / math.sqrt(2 * chosen.force_bandwidth)
    elif mine.any() and rate is not None:
        length_s = trials["n"][mine] / rate
        noise = float(np.median(trials["u_lift_N"][mine] * np.sqrt(length_s) / weight))
    return Sensor(short_per_sqrt_Hz=noise, floor=floor)


def _sag_exponent(lift: QuotedLift) -> float:
    """|d ln lift / d ln supply voltage|."""
    return abs(lift.best.get("sag_exponent", SAG_EXPONENT))


def _refuse_ambiguous(lift: QuotedLift) -> None:
    """Refuse a lift whose best estimate or any draw has the same ratio at two heights.

    A draw may be constant, where the interval of a coefficient reaches 0.
    """
    for i, ratio in enumerate(lift.ratios):
        where = f"{lift.boundary} {lift.model.name}"
        refuse_folds(ratio, *lift.measured_z_hat, where, constant=i > 0)


def _boundary(lift: QuotedLift, device: Sensor, chosen: Detect) -> BoundaryProximity:
    """Significant range and inferred heights (none where the model folds)."""
    exponent, (best, *draws) = _sag_exponent(lift), lift.ratios
    low, high = lift.measured_z_hat
    sigma = device.sigma(AVERAGING_S, chosen.payload[0], exponent * chosen.supply[0])
    located, refused = None, None
    try:
        _refuse_ambiguous(lift)
        heights = np.geomspace(low, high, N_HEIGHTS)
        located = tuple(
            HeightTrial(z_hat=z, ratio=ratio, **asdict(locate(ratio, sigma, draws, low, high)))
            for z, ratio in zip(heights.tolist(), best(heights).tolist(), strict=True)
        )
    except InputRefused as refusal:
        refused = f"{refusal.what}; {refusal.remedy}"
    z_hat, lo90, hi90 = reaches(lift.ratios, chosen.significant, low, high)
    return BoundaryProximity(
        model=lift.model.name,
        title=lift.title,
        draws_from=Results.file,
        effects=lift.effects,
        measured_z_hat=lift.measured_z_hat,
        largest_change=lift.largest_change,
        significant=SignificantHeight(change=chosen.significant, z_hat=z_hat, lo90=lo90, hi90=hi90),
        short_per_sqrt_Hz=device.short_per_sqrt_Hz,
        floor=device.floor,
        lift_per_voltage=exponent,
        located=located,
        refused=refused,
    )


def _ranges(
    lift: QuotedLift, device: Sensor, chosen: Detect, radius_m: float
) -> list[dict[str, object]]:
    """Rows of detection.parquet: detection ranges over supplies, payloads and averaging times."""
    rows = []
    for voltage, payload, averaging_s in itertools.product(
        chosen.supply, chosen.payload, chosen.averaging
    ):
        supply = _sag_exponent(lift) * voltage
        sigma = device.sigma(averaging_s, payload, supply)
        change = change_needed(sigma, chosen.false_alarm_rate, chosen.miss_rate)
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


def read(quoted: QuotedLifts, reading: LiftReading) -> HeightReading:
    """Posterior of z_hat from one reading.

    Raises
    ------
    UsageError
        Nothing was fitted at that boundary.
    InputRefused
        The model folds, the throttle is outside those measured, or as `locate`.
    """
    if reading.boundary not in quoted.fits.boundaries:
        raise UsageError(
            "boundary",
            f"nothing was fitted at the {reading.boundary}",
            f"fitted: {', '.join(quoted.fits.boundaries)}",
        )
    lift = quoted.lift(reading.boundary, DRAWS)
    _refuse_ambiguous(lift)
    ratio, u = _measured(quoted, reading, _sag_exponent(lift))
    height = locate(ratio, u, lift.ratios[1:], *lift.measured_z_hat)
    z_hat, z_m = (
        HeightInterval(median=r * height.median, lo90=r * height.lo90, hi90=r * height.hi90)
        for r in (1.0, quoted.campaign.vehicle.rotor_radius)
    )
    others = [quoted.lift(b, 2) for b in quoted.fits.boundaries if b != reading.boundary]
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


def _measured(quoted: QuotedLifts, reading: LiftReading, exponent: float) -> tuple[float, float]:
    """L / L_inf of a reading and its standard uncertainty."""
    if reading.ratio is not None:
        # a ratio's `u` includes weight and supply unless they are given; a throttle's never does
        further = math.hypot(reading.weight or 0.0, exponent * (reading.supply or 0.0))
        return reading.ratio, math.hypot(reading.u, reading.ratio * further)
    assert reading.throttle is not None
    chosen = quoted.campaign.detect or Detect()
    lift_inf_N = quoted.levels(reading.boundary)[0]
    levels = sorted(lift_inf_N)
    far, u_far = np.array([lift_inf_N[t] for t in levels]).T
    supply = exponent * (chosen.supply[0] if reading.supply is None else reading.supply)
    mass = quoted.campaign.vehicle.mass if reading.mass is None else reading.mass
    return ratio_of_hover(
        reading.throttle,
        mass * quoted.campaign.rig.gravity,
        chosen.payload[0] if reading.weight is None else reading.weight,
        levels,
        far.tolist(),
        math.hypot(float(np.interp(reading.throttle, levels, u_far / far)), supply),
        reading.u,
    )
