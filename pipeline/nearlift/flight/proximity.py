"""Proximity from lift: the distance at which each boundary shows, and its place by one reading.

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
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nearlift.campaign.choices import Detect, LiftReading
from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused, UsageError
from nearlift.flight.quoted_lift import QuotedLifts
from nearlift.results.quotation import Results

#: Row of a product, or an object of a JSON file.
Row = dict[str, object]
#: Draws of each model.
MODEL_DRAWS = 100
#: Number of heights of the grid, geometrically spaced, and the lowest z_hat.
N_HEIGHTS, LOWEST_Z_HAT = 1200, 1e-3
#: Largest change of L / L_inf between nodes that counts as rounding.
NO_CHANGE = 1e-9
#: Prior probability that there is no boundary within the range.
PRIOR_BEYOND = 0.5
#: Distance of a refused reading from all that it could mean, in its standard uncertainties.
MAX_DISTANCE_U = 10.0
#: Probabilities below this are stated as a bound: the likelihood's far tails are not known.
MIN_BEYOND = 1e-4
#: Exponent of lift over supply voltage where the loop found none: a motor at fixed duty.
SAG_EXPONENT = 2.0
HOUR_S = 3600.0


# ---- ratios (draws, n) on a grid of heights (n,)


def grid(low: float, high: float) -> FloatArray:
    """Geometrically spaced heights from `low` to `high`: shape (N_HEIGHTS,)."""
    return np.geomspace(max(low, LOWEST_Z_HAT), high, N_HEIGHTS)


def refuse_folds(z_hat: FloatArray, ratios: FloatArray, where: str) -> None:
    """Refuse ratios of which any is not monotonic over the heights, or the first is constant.

    A draw may be constant, where the interval of a coefficient reaches 0.

    Raises
    ------
    InputRefused
        One folds (says above which height it does not), or has no value somewhere.
    """
    unknown = ~np.isfinite(ratios).all(axis=0)
    if unknown.any():
        bad = z_hat[unknown].max()
        what = f"the model has no value at z_hat = {bad:.3g}"
        raise InputRefused(where, what, f"ask above {bad:.3g}")
    change = np.diff(ratios)
    change[np.abs(change) <= NO_CHANGE] = 0.0
    if not change[0].any():
        what = "the model does not change with distance"
        raise InputRefused(where, what, "lift does not depend on this boundary")
    for row in change:
        steep = row[row != 0]
        against = np.flatnonzero(row * steep[-1:].sum() < 0)
        if len(against):
            turn = z_hat[against[-1] + 1]
            raise InputRefused(
                where,
                f"the model folds at z_hat = {turn:.3g}: one lift ratio has two heights",
                f"only heights above {turn:.3g} can be distinguished",
            )


def ranges(z_hat: FloatArray, ratios: FloatArray, change: float) -> tuple[float, float, float]:
    """Largest height at which |L / L_inf - 1| is at least `change`, interpolated, with its 90 %
    interval.

    The first row is the best estimate; the interval is over the others. The height is nan where
    there is none (zero in the interval), and a lower bound at the end of the grid.
    """
    effect, n = np.abs(ratios - 1.0), len(z_hat)
    enough = effect >= change
    last = n - 1 - enough[:, ::-1].argmax(axis=1)
    i, row = np.minimum(last, n - 2), np.arange(len(effect))
    a, b = effect[row, i], effect[row, i + 1]
    between = z_hat[i] + (z_hat[i + 1] - z_hat[i]) * ((a - change) / np.where(a == b, 1.0, a - b))
    farthest = np.where(last == n - 1, z_hat[-1], between)
    best, *others = np.where(enough.any(axis=1), farthest, np.nan).tolist()
    lo90, hi90 = np.percentile(np.nan_to_num(others or [best], nan=0.0), [5, 95]).tolist()
    return best, lo90, hi90


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightInterval:
    """Median and 90 % interval of a height."""

    median: float
    lo90: float
    hi90: float


def locate(
    measured: float, u: float, z_hat: FloatArray, ratios: FloatArray
) -> tuple[HeightInterval, float]:
    """Posterior of z_hat, given a boundary within the range, and the probability of none.

    The reading is `measured`, an L / L_inf with its standard uncertainty `u`.

    `ratios` (draws, n) are draws of the model, each monotonic (see `refuse_folds`). The prior is
    uniform in ln z_hat over the grid; that there is no boundary within has the probability
    `PRIOR_BEYOND`.

    Raises
    ------
    InputRefused
        `u` is not positive, or `measured` is over ten `u` both from 1 and from the model's range.
    """
    where, low, high = "measured ratio", ratios.min(), ratios.max()
    if not u > 0:
        what = f"has the uncertainty {u:g}"
        raise InputRefused(where, what, "give a positive standard uncertainty")
    outside = max(low - measured, measured - high) / u
    if min(outside, abs(measured - 1.0) / u) > MAX_DISTANCE_U:
        raise InputRefused(
            where,
            f"{measured:.4g} is {outside:.0f} standard uncertainties from everything between"
            f" {low:.4g} and {high:.4g}",
            "lift has another cause, or its uncertainty is larger than stated",
        )
    # both evidences are relative to the larger of the likelihoods at the best height and without a
    # boundary, so that they cannot both underflow
    chi2 = ((measured - ratios) / u) ** 2
    nearest, alone = float(chi2.min()), ((measured - 1.0) / u) ** 2
    least = min(nearest, alone)
    log_z = np.log(z_hat)
    mass = np.exp(-0.5 * (chi2 - nearest)).mean(axis=0) * np.gradient(log_z)
    within = float(mass.sum() / (log_z[-1] - log_z[0]) * np.exp(-0.5 * (nearest - least)))
    beyond = PRIOR_BEYOND * math.exp(-0.5 * (alone - least))
    lo90, median, hi90 = np.interp((0.05, 0.5, 0.95), np.cumsum(mass) / mass.sum(), z_hat).tolist()
    height = HeightInterval(median=median, lo90=lo90, hi90=hi90)
    return height, beyond / ((1 - PRIOR_BEYOND) * within + beyond)


# ---- results


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightReading:
    """A reading and its posterior; `beyond` is the probability of no boundary in `within_z_hat`."""

    boundary: Boundary
    model: str
    throttle: float | None
    ratio: float
    u: float
    z_hat: HeightInterval
    z_m: HeightInterval
    beyond: float
    within_z_hat: tuple[float, float]

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
        )


# ---- one boundary of a campaign


class BoundarySensor:
    """Lift of one boundary as a sensor of distance: its model on a grid, and its noise.

    The noise is the manifest's, else that of the bench's load cell, whose records show what
    averaging does. Averaging leaves `floor`: the scatter of the bench's trials and the uncertainty
    of L_inf.
    """

    def __init__(self, quoted: QuotedLifts, boundary: Boundary) -> None:
        self.quoted, self.boundary = quoted, boundary
        self.chosen = quoted.campaign.detect or Detect()
        self.lift = quoted.lift(boundary, MODEL_DRAWS)
        self.z_hat = grid(*self.lift.measured_z_hat)
        # the best estimate, then every draw
        self.ratios = np.stack([ratio(self.z_hat) for ratio in self.lift.ratios])
        self.sag_exponent = abs(self.lift.best.get("sag_exponent", SAG_EXPONENT))
        self.L_inf_N, scatter = quoted.levels(boundary)
        self.floor = float(np.hypot(scatter, np.median([u / x for x, u in self.L_inf_N.values()])))
        self.short = self._short()

    def _short(self) -> float:
        """Standard deviation of a one-second average over weight."""
        campaign, trials, chosen = self.quoted.campaign, self.quoted.trials, self.chosen
        weight, rate = campaign.vehicle.mass * campaign.rig.gravity, campaign.load_cell.sample_rate
        if chosen.force_noise is not None and chosen.force_bandwidth is not None:
            # white up to the bandwidth: the average over a second has sd / sqrt(2 bandwidth)
            return chosen.force_noise / weight / math.sqrt(2 * chosen.force_bandwidth)
        mine = self.quoted.accepted_at(self.boundary) & (trials["u_lift_N"] > 0)
        if not mine.any() or rate is None:
            return 0.0
        length_s = trials["n"][mine] / rate
        return float(np.median(trials["u_lift_N"][mine] * np.sqrt(length_s) / weight))

    def sigma(self, averaging_s: float, payload: float, voltage: float) -> float:
        """Standard deviation of the estimated L / L_inf; `payload` and `voltage` are relative
        standard uncertainties of weight and supply voltage.
        """
        short = self.short / math.sqrt(averaging_s)
        return math.hypot(short, self.floor, payload, self.sag_exponent * voltage)

    def refuse_ambiguous(self) -> None:
        """Refuse a lift of which the best estimate or any draw has one ratio at two heights."""
        refuse_folds(self.z_hat, self.ratios, f"{self.boundary} {self.lift.model.name}")

    def summary(self) -> Row:
        """Entry in proximity.json: the sensor, the range of significant change, and why lift cannot
        be inverted, where it cannot (`refused`). `lift_per_voltage` is |d ln L / d ln V|.
        """
        lift, change, refused = self.lift, self.chosen.significant, Row()
        try:
            self.refuse_ambiguous()
        except InputRefused as refusal:
            refused["refused"] = f"{refusal.what}; {refusal.remedy}"
        z_hat, lo90, hi90 = ranges(self.z_hat, self.ratios, change)
        return {
            "model": lift.model.name,
            "title": lift.title,
            "draws_from": Results.file,
            "effects": lift.effects,
            "measured_z_hat": lift.measured_z_hat,
            "largest_change": lift.largest_change,
            "significant": {"change": change, "z_hat": z_hat, "lo90": lo90, "hi90": hi90},
            "short_per_sqrt_Hz": self.short,
            "floor": self.floor,
            "lift_per_voltage": self.sag_exponent,
            **refused,
        }

    def rows(self) -> list[Row]:
        """Rows of detection.parquet: detection ranges over supplies, payloads, averaging times."""
        from scipy.special import ndtri

        chosen, rows = self.chosen, list[Row]()
        quantiles = -float(ndtri(chosen.false_alarm_rate) + ndtri(chosen.miss_rate))
        for voltage, payload, averaging_s in itertools.product(
            chosen.supply, chosen.payload, chosen.averaging
        ):
            sigma = self.sigma(averaging_s, payload, voltage)
            z_hat, lo90, hi90 = ranges(self.z_hat, self.ratios, quantiles * sigma)
            rows.append(
                {
                    "boundary": self.boundary,
                    "model": self.lift.model.name,
                    "averaging_s": averaging_s,
                    "payload": payload,
                    "voltage": voltage,
                    "supply": self.sag_exponent * voltage,
                    "sigma": sigma,
                    "false_alarms_per_hour": chosen.false_alarm_rate * HOUR_S / averaging_s,
                    "needed": quantiles * sigma,
                    "range_z_hat": z_hat,
                    "lo90": lo90,
                    "hi90": hi90,
                    "range_m": z_hat * self.quoted.campaign.vehicle.rotor_radius,
                }
            )
        return rows

    def measured(self, reading: LiftReading) -> tuple[float, float]:
        """L / L_inf of a reading and its standard uncertainty.

        That of a throttle is weight, payload included, over lift far away at that throttle. A power
        law of throttle holds between those measured.

        Raises
        ------
        InputRefused
            The throttle is outside those measured.
        """
        campaign, given, levels = self.quoted.campaign, reading, sorted(self.L_inf_N)
        if given.ratio is not None:
            # a ratio's `u` includes weight and supply unless they are given; a throttle's never
            further = math.hypot(given.weight or 0.0, self.sag_exponent * (given.supply or 0.0))
            return given.ratio, math.hypot(given.u, given.ratio * further)
        throttle = given.throttle or 0.0
        if not levels[0] <= throttle <= levels[-1]:
            raise InputRefused(
                "throttle",
                f"{throttle:.3g} is outside {levels[0]:.3g} to {levels[-1]:.3g}, where lift was"
                " measured",
                "measure lift at that throttle too",
            )
        far, u_far = np.array([self.L_inf_N[t] for t in levels]).T
        x, y = np.log(levels), np.log(far)
        mass = campaign.vehicle.mass if given.mass is None else given.mass
        ratio = mass * campaign.rig.gravity / math.exp(np.interp(math.log(throttle), x, y))
        above = max(int(np.searchsorted(levels, throttle)), 1)
        exponents = np.append(np.diff(y) / np.diff(x), 0.0)  # none from a single throttle
        supply = self.chosen.supply[0] if given.supply is None else given.supply
        return ratio, ratio * math.hypot(
            self.chosen.payload[0] if given.weight is None else given.weight,
            np.interp(throttle, levels, u_far / far),
            self.sag_exponent * supply,
            exponents[above - 1] * given.u / throttle,
        )


def read(quoted: QuotedLifts, reading: LiftReading) -> HeightReading:
    """Posterior of z_hat from one reading.

    Raises
    ------
    UsageError
        Nothing was fitted at that boundary.
    InputRefused
        The model folds, the throttle is outside those measured, or as `locate`.
    """
    fitted = quoted.fits.boundaries
    if reading.boundary not in fitted:
        what = f"nothing was fitted at the {reading.boundary}"
        raise UsageError("boundary", what, f"fitted: {', '.join(fitted)}")
    sensor = BoundarySensor(quoted, reading.boundary)
    sensor.refuse_ambiguous()
    ratio, u = sensor.measured(reading)
    z_hat, beyond = locate(ratio, u, sensor.z_hat, sensor.ratios[1:])
    r = quoted.campaign.vehicle.rotor_radius
    return HeightReading(
        boundary=reading.boundary,
        model=sensor.lift.model.name,
        throttle=reading.throttle,
        ratio=ratio,
        u=u,
        z_hat=z_hat,
        z_m=HeightInterval(median=r * z_hat.median, lo90=r * z_hat.lo90, hi90=r * z_hat.hi90),
        beyond=beyond,
        within_z_hat=sensor.lift.measured_z_hat,
    )


def proximity(
    quoted: QuotedLifts, say: Callable[[str], None]
) -> tuple[list[Row], Row, tuple[str, ...]]:
    """Rows of detection.parquet, content of proximity.json, and notes."""
    chosen = quoted.campaign.detect or Detect()
    rows, boundaries = list[Row](), dict[Boundary, Row]()
    for boundary in quoted.boundaries:
        say(f"detect {boundary}")
        sensor = BoundarySensor(quoted, boundary)
        rows += sensor.rows()
        boundaries[boundary] = sensor.summary()
    content = {
        "false_alarm_rate": chosen.false_alarm_rate,
        "miss_rate": chosen.miss_rate,
        "boundaries": boundaries,
    }
    notes = (
        f"{boundary}: distance cannot be inferred from lift: {entry['refused']}"
        for boundary, entry in boundaries.items()
        if "refused" in entry
    )
    return rows, content, tuple(notes)
