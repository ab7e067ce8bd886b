"""The independent simulator: campaigns at record level, with a known truth.

`simulate(spec, seed)` plans a campaign (`bench`), computes its true lift from the simulator's own
physics (`forms`), makes a load-cell record for every trial (tare, running part, rotor tone, coloured
noise, counts) and reduces it with the library's `reduction.record`, the one piece shared with what
is judged. With `Spec.errors` there are no records, and trials have those errors.

An effect's strength rho is its rms per trial in units of trial noise after the base model's
coefficients and a free L_inf per throttle have absorbed their part: rho^2 = ||P W e||^2 / n with W
the true whitening, P the projection, e its log lift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.stats import norm
from tests.calibration import forms
from tests.calibration.bench import (
    RADIUS,
    Array,
    Bench,
    Errors,
    Shared,
    Spec,
    build,
    levels_N,
    stream,
    wander,
)

from nearlift.likelihood.budget import Component
from nearlift.reduction.quality import rejected
from nearlift.reduction.record import reduce_record
from nearlift.reduction.samples import Conditions
from nearlift.results import Observations

__all__ = ["Campaign", "Errors", "Shared", "Spec", "Unreachable", "simulate"]

RATE = 1000.0
COUNT_N = 9.8e-6
COLOUR = 0.8  # correlation of the coloured part from one sample to the next
Pieces = tuple[tuple[forms.Form, float], ...]


class Unreachable(Exception):
    """No physically possible size of this effect is as strong as that on this bench."""

    def __init__(self, kind: str, rho: float, most: float) -> None:
        super().__init__(f"{kind} reaches rho = {most:.3g} at most, not {rho:.3g}")
        self.most = most


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """True standard deviations: fraction of lift, N, m per visit, and of one record's mean, N."""

    relative: float
    force_N: float
    height_m: float
    record_N: float


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """One record: samples of its running part and its tare, noise per sample, rotor tone."""

    samples: int
    tare: int
    white_N: float
    coloured_N: float
    tone_N: float

    @property
    def mean_sd_N(self) -> float:
        """Standard deviation of mean minus tare from sample noise."""
        density = self.white_N**2 + self.coloured_N**2 * (1 + COLOUR) / (1 - COLOUR)
        return float(np.sqrt(density / self.samples + density / self.tare))


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What was put in; arrays are of the trials kept, in run order.

    `log_lift` is noiseless, at nominal distance, with every effect; `contributions` are the log lift
    that each effect alone adds, `rho` their strengths, `rho_beside` what is left of these once the
    other effects' directions are absorbed too. `variance` is that of log lift, height scatter
    included and `realism` left out.
    """

    theta: dict[str, float]
    levels_N: Array
    scatter: Scatter
    log_lift: Array
    contributions: dict[str, Array]
    amplitudes: dict[str, float]
    rho: dict[str, float]
    rho_beside: dict[str, float]
    variance: Array


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A simulated campaign: the library's input `data`, and the truth.

    `keep` marks the trials of the bench that are in `data`, `columns` (all trials of the bench) are
    those of L_inf per throttle and of theta; `scheduled` trials in all, where it was cut.
    """

    spec: Spec
    seed: int
    data: Observations
    truth: Truth
    setting: forms.Setting = field(repr=False)
    keep: Array = field(repr=False)
    whitener: Whitener = field(repr=False)
    sensor: Sensor = field(repr=False)
    columns: Array = field(repr=False)
    scheduled: int | None = None

    @property
    def parts(self) -> tuple[Component, ...]:
        """Stated uncertainties."""
        shared = self.spec.shared
        sizes = {
            "height": shared.datum_m,
            "rotor_radius": shared.rotor_radius,
            "rotor_spacing": shared.spacing_m / self.spec.spacing_m,
        }
        moves = {"rotor_spacing": ("spacing_hat", "diagonal_hat", "layout_hat")}
        fields = {"distribution": "normal", "scope": "boundary"}
        return tuple(
            Component(name=on, on=on, standard=size, moves=moves.get(on, ()), **fields)
            for on, size in sizes.items()
            if size and self.spec.declared
        )

    def until(self, n: int) -> Campaign:
        """The campaign after its first n trials."""
        rows, truth = np.arange(n), self.truth
        contributions = {kind: e[:n] for kind, e in truth.contributions.items()}
        arrays = {"log_lift": truth.log_lift[:n], "variance": truth.variance[:n]}
        return replace(
            self,
            data=self.data.take(rows),
            truth=replace(truth, contributions=contributions, **arrays),
            keep=self.keep & (np.cumsum(self.keep) <= n),
            whitener=self.whitener.of(rows),
            scheduled=self.data.n,
        )

    @property
    def jacobian(self) -> Array:
        """d log ratio / d theta of the base model at its true coefficients, (n, p)."""
        return self.columns[self.keep, len(self.truth.levels_N) :]

    @property
    def indicator(self) -> Array:
        """One column per throttle, (n, k)."""
        return self.columns[self.keep, : len(self.truth.levels_N)]

    def effect(self, piece: tuple[forms.Form, float]) -> Array:
        """Log lift that an effect of this form and size adds, (n,)."""
        return (log_lift(self.setting, (piece,)) - log_lift(self.setting, ()))[self.keep]

    @cached_property
    def absorbed(self) -> Array:
        """Orthonormal basis of what L_inf and theta absorb, whitened."""
        return np.linalg.qr(self.whitener(self.columns[self.keep]))[0]

    def left(self, effect: Array) -> Array:
        """Whitened log lift that L_inf and theta do not absorb."""
        white = self.whitener(effect)
        return white - self.absorbed @ (self.absorbed.T @ white)


class Whitener:
    """W with W C W' = 1 for C = diag(variance) + a rank-one block per visit (+ `beside`); visits
    are contiguous in run order.
    """

    def __init__(
        self, variance: Array, shared: Array, visit: Array, beside: Array | None = None
    ) -> None:
        self.given = variance, shared, visit, beside
        if beside is not None:
            visits = (visit[:, None] == visit) * np.outer(shared, shared)
            self.factor = cholesky(np.diag(variance) + visits + beside, lower=True)
            return
        self.sd = np.sqrt(variance)
        change = np.diff(visit, prepend=visit[0] - 1) != 0
        self.first, self.block = np.flatnonzero(change), np.cumsum(change) - 1
        self.q = shared / self.sd
        length = np.add.reduceat(self.q**2, self.first)
        self.shrink = np.where(
            length > 1e-14, (1 - 1 / np.sqrt(1 + length)) / np.maximum(length, 1e-14), 0.5
        )

    def of(self, rows: Array) -> Whitener:
        """Whitener of some of the trials, in their order."""
        variance, shared, visit, beside = self.given
        block = None if beside is None else beside[np.ix_(rows, rows)]
        return Whitener(variance[rows], shared[rows], visit[rows], block)

    def __call__(self, x: Array) -> Array:
        """Apply along the first axis."""
        if self.given[3] is not None:
            return solve_triangular(self.factor, x, lower=True)
        x = (x.T / self.sd).T
        along = np.add.reduceat((x.T * self.q).T, self.first, axis=0)
        return x - ((self.shrink * along.T)[..., self.block] * self.q).T

    def strength(self, e: Array, absorbed: Array) -> float:
        """Rms per trial of what the columns `absorbed` leave of `e`, whitened."""
        q, r = np.linalg.qr(self(absorbed))
        diagonal = np.abs(np.diag(r))
        if diagonal.min() <= 1e-9 * diagonal.max():
            u, s, _ = np.linalg.svd(self(absorbed), full_matrices=False)
            q = u[:, s > 1e-10 * s[0]]
        white = self(e)
        return float(np.sqrt(np.mean((white - q @ (q.T @ white)) ** 2)))


def log_lift(setting: forms.Setting, effects: Pieces, z_hat: Array | None = None) -> Array:
    """Noiseless log lift: height effects, base curve, ratio effects, gains, forces, in that order."""
    bench = setting.bench

    def acted(value: Array, place: forms.Place) -> Array:
        for form, x in effects:
            if form.place == place:
                value = form.apply(value, bench, setting, x)
                if place == "height":
                    value = np.maximum(value, 0.2 * bench.z_hat)
        return value

    z = acted(bench.z_hat if z_hat is None else z_hat, "height")
    lift = setting.inf_N * acted(setting.curve(z), "ratio")
    for form, x in effects:
        if form.place == "gain":
            lift = lift * np.exp(form.apply(None, bench, setting, x))
    return np.log(np.maximum(acted(lift, "force"), 1e-6))


def base_jacobian(setting: forms.Setting) -> Array:
    """Central differences of the log base curve, (n, p)."""
    bench, columns = setting.bench, []
    for name, value in setting.theta.items():
        step = 1e-4 * abs(value)
        up, down = (
            np.log(forms.ratio(bench.boundary, bench.z_hat, {**setting.theta, name: value + s}))
            for s in (step, -step)
        )
        columns.append((up - down) / (2 * step))
    return np.stack(columns, axis=1)


def whitener(
    setting: forms.Setting, scatter: Scatter, spec: Spec, drawn: Drawn | None
) -> tuple[Whitener, Array]:
    """The true whitening of log lift at the base curve, with the stated uncertainties, and the
    marginal variance.
    """
    bench, step = setting.bench, 1e-4

    def per(moved: Callable[[float], Array]) -> Array:
        return (np.log(moved(1 + step)) - np.log(moved(1 - step))) / (2 * step)

    def curve(radius: float, spacing: float) -> Array:
        z = bench.z_hat / radius
        return forms.ratio(bench.boundary, z, setting.theta, forms.D / radius * spacing)

    slope = per(lambda f: setting.curve(bench.z_hat * f)) / bench.z_hat / bench.radius_m
    lift = setting.inf_N * setting.curve(bench.z_hat)
    own = (scatter.force_N**2 + scatter.record_N**2) / lift**2
    own = own + (scatter.relative**2 if drawn is None else drawn.variance)
    shared, beside = scatter.height_m * slope, None if drawn is None else drawn.covariance
    if drawn is not None and spec.declared:
        given = spec.shared
        columns = np.column_stack(
            [
                given.datum_m * slope,
                given.rotor_radius * per(lambda f: curve(f, 1.0)),
                given.spacing_m / spec.spacing_m * per(lambda f: curve(1.0, f)),
            ]
        )
        beside = columns @ columns.T + (0.0 if beside is None else beside)
    marginal = own + shared**2 + (0.0 if beside is None else np.diag(beside))
    return Whitener(own, shared, bench.visit, beside), marginal


def amplitude(
    setting: forms.Setting, white: Whitener, kind: str, foreign: bool, rho: float, sign: float
) -> float:
    """The size at which an effect is as strong as `rho`; `Unreachable` where its largest physical
    size is weaker.
    """
    form = forms.form(kind, foreign)
    base, absorbed = log_lift(setting, ()), absorbed_columns(setting)
    most = form.most[setting.bench.boundary] * (sign if form.signed else 1.0)

    def miss(share: float) -> float:
        return white.strength(log_lift(setting, ((form, share * most),)) - base, absorbed) - rho

    # strength need not grow with size: take the first crossing
    share = next((s for s in (0.01, 0.03, 0.1, 0.3, 1.0) if miss(s) > 0), None)
    if share is None:
        raise Unreachable(kind, rho, miss(1.0) + rho)
    return float(brentq(miss, 0.0, share, xtol=1e-7, rtol=1e-5)) * most


def absorbed_columns(setting: forms.Setting) -> Array:
    """Columns of L_inf per throttle and of theta, of all trials."""
    levels = np.eye(len(setting.levels_N))[setting.bench.level]
    return np.hstack([levels, base_jacobian(setting)])


def simulate(spec: Spec, seed: int) -> Campaign:
    """One campaign with its truth.

    Raises
    ------
    Unreachable
        An effect cannot be as strong as asked on this bench.
    """
    rng = stream(seed, "truth", spec.boundary)
    bench = build(spec, seed)
    theta = {
        name: value * (1 + spec.spread * rng.uniform(-1, 1))
        for name, value in forms.COEFFICIENTS[spec.boundary].items()
    }
    levels = levels_N(rng, spec.throttles) * (spec.radius_m / RADIUS) ** 2
    setting = forms.Setting(bench=bench, theta=theta, levels_N=levels)
    relative, force_N = rng.uniform(0.003, 0.006), rng.uniform(0.1e-3, 0.5e-3)
    height_m = rng.uniform(0.02e-3, 0.1e-3)
    sensor = Sensor(
        samples=spec.samples or int(rng.integers(260, 501)),
        tare=int(rng.integers(100, 161)),
        white_N=rng.uniform(0.8e-3, 2.5e-3),
        coloured_N=rng.uniform(0.2e-3, 0.6e-3),
        tone_N=rng.uniform(2e-3, 8e-3),
    )
    height_m = height_m if spec.height_m is None else spec.height_m
    record_N = sensor.mean_sd_N
    if spec.errors is not None and spec.errors.table:
        relative, force_N, record_N = spec.errors.table, 0.0, 0.0
    scatter = Scatter(relative=relative, force_N=force_N, height_m=height_m, record_N=record_N)
    drawn = None if spec.errors is None else draw_errors(spec.errors, relative, bench, seed)
    white, variance = whitener(setting, scatter, spec, drawn)

    sizes = {
        kind: amplitude(
            setting,
            white,
            kind,
            spec.foreign,
            rho,
            stream(seed, "sign", kind).choice([-1.0, 1.0]),
        )
        for kind, rho in spec.effects
    }
    pieces = {kind: (forms.form(kind, spec.foreign), x) for kind, x in sizes.items()}
    base, full = log_lift(setting, ()), log_lift(setting, tuple(pieces.values()))
    heat = sinking(np.linspace(0, 1, sensor.samples), spec.foreign).mean()
    full = full + np.log1p(-spec.sink * setting.load * heat)
    parts = {kind: log_lift(setting, (piece,)) - base for kind, piece in pieces.items()}
    absorbed = absorbed_columns(setting)

    def others(kind: str) -> Array:
        return np.column_stack([absorbed, *(e for k, e in parts.items() if k != kind)])

    made = setting, scatter, sensor, tuple(pieces.values())
    if drawn is None:
        data, keep = _reduced(records(spec, seed, *made), bench, sensor)
    else:
        data, keep = _trials(spec, seed, *made, drawn), drawn.keep
    truth = Truth(
        theta=theta,
        levels_N=levels,
        scatter=scatter,
        log_lift=full[keep],
        contributions={kind: e[keep] for kind, e in parts.items()},
        amplitudes=sizes,
        rho={kind: white.strength(e, absorbed) for kind, e in parts.items()},
        rho_beside={kind: white.strength(e, others(kind)) for kind, e in parts.items()},
        variance=variance[keep],
    )
    return Campaign(
        spec=spec,
        seed=seed,
        data=data,
        truth=truth,
        setting=setting,
        keep=keep,
        whitener=white if keep.all() else white.of(np.flatnonzero(keep)),
        sensor=sensor,
        columns=absorbed,
    )


def candidate_columns(campaign: Campaign) -> dict[str, Array]:
    """Every named effect's own form as a column of log lift, linear in its size: the truth's own
    shapes, without form error. An effect that theta and L_inf absorb altogether is left out.
    """
    boundary, columns = campaign.spec.boundary, {}
    for name in forms.names(boundary):
        form = forms.form(name, foreign=False)
        share = 0.5 if form.place in ("height", "ratio") and not form.signed else 0.05
        e = campaign.effect((form, share * form.most[boundary]))
        noticeable = 1e-3 * np.sqrt(np.mean(campaign.whitener(e) ** 2))
        if campaign.whitener.strength(e, campaign.columns[campaign.keep]) > noticeable:
            columns[name] = e / share
    return columns


def sinking(u: Array, foreign: bool) -> Array:
    """Heat's share in a record, from 0 at the first to 1 at the last running sample: linear, or
    saturating where foreign.
    """
    return np.expm1(-4 * u) / np.expm1(-4.0) if foreign else u


def records(
    spec: Spec, seed: int, setting: forms.Setting, scatter: Scatter, sensor: Sensor, pieces: Pieces
) -> Array:
    """Load-cell series of every trial, N, shape (trials, tare + samples)."""
    rng, shared = stream(seed, "noise", spec.boundary), spec.shared
    bench, n = setting.bench, setting.bench.n
    jitter = rng.normal(0, scatter.height_m, bench.visit[-1] + 1)[bench.visit] / bench.radius_m

    def draw(name: str, size: int = 1) -> Array:
        # generators of their own, so that one error more leaves all other noise as it is
        return stream(seed, "shared", name, spec.boundary).standard_normal(size)

    datum = shared.datum_m * draw("datum")[0] / bench.radius_m
    z = np.maximum(bench.z_hat + datum + jitter, 0.3 * bench.z_hat)
    lift = np.exp(log_lift(setting, pieces, z))
    relative = rng.standard_t(6, n) * np.sqrt(4 / 6) if spec.realism else rng.standard_normal(n)
    gain = scatter.relative * relative
    if spec.realism:
        gain = gain + 3e-4 * wander(rng, bench.start_s, 3000.0)
        outlying = rng.random(n) < 0.003
        gain = gain + outlying * rng.choice([-1, 1], n) * rng.uniform(4, 10, n) * scatter.relative
    lift = lift * (1 + gain) + rng.normal(0, scatter.force_N, n)
    for name, size, index in (
        ("session", shared.session_gain, bench.session),
        ("throttle", shared.throttle_gain, bench.level),
        ("visit", shared.visit_gain, bench.visit),
    ):
        count = len(spec.throttles) if name == "throttle" else index.max() + 1
        lift = lift * (1 + size * draw(name, count)[index])

    length = sensor.tare + sensor.samples
    force = rng.standard_normal((n, length))
    force *= sensor.white_N
    kicks = rng.standard_normal((n, length))
    start = kicks[:, :1] / np.sqrt(1 - COLOUR**2)
    coloured, _ = lfilter([1.0], [1.0, -COLOUR], kicks[:, 1:], axis=1, zi=COLOUR * start)
    force[:, 1:] += sensor.coloured_N * np.sqrt(1 - COLOUR**2) * coloured
    force += rng.normal(0, 4e-3, n)[:, None]  # any zero; the tare removes it
    live = force[:, sensor.tare :]
    live += lift[:, None]
    if spec.sink:
        heat = sinking(np.linspace(0, 1, sensor.samples), spec.foreign)
        live -= (lift * spec.sink * setting.load)[:, None] * heat
    turn = 2 * np.pi * bench.speed_rpm / 60 * (1 + rng.normal(0, 0.004, n)) / RATE
    phase = rng.uniform(0, 2 * np.pi, n)
    live += _tone(turn, phase, sensor.samples) * (sensor.tone_N * setting.load)[:, None]
    if shared.cell_N:
        bend = stream(seed, "shared", "cell", spec.boundary).uniform(-1, 1)
        force += shared.cell_N * bend * (force / shared.range_N) ** 2
    return np.round(force / COUNT_N) * COUNT_N


def _tone(turn: Array, phase: Array, samples: int) -> Array:
    """sin(phase + turn k) for every trial and sample: two tables instead of a million sines."""
    block = 32
    fine = np.exp(1j * turn[:, None] * np.arange(block))
    coarse = np.exp(1j * (phase[:, None] + turn[:, None] * np.arange(0, samples, block)))
    full = coarse[:, :, None] * fine[:, None, :]
    return full.imag.reshape(len(turn), -1)[:, :samples]


def _reduced(records: Array, bench: Bench, sensor: Sensor) -> tuple[Observations, Array]:
    """Accepted trials, as ingest would make them of the records, and which these are."""
    conditions = Conditions(rate_Hz=RATE, tare_s=sensor.tare / RATE, range_N=9.8)
    rows = [reduce_record(r, conditions) for r in records]
    keep = ~rejected(np.array([" ".join(r.codes) for r in rows], dtype=object))
    good = [r for r, k in zip(rows, keep, strict=True) if k]

    def column(name: str) -> Array:
        return np.array([getattr(r, name) for r in good], dtype=float)

    data = _observed(bench, keep, column("lift_N"), column("u_lift_N"), column("n_eff"))
    within = {"drift_N_s": column("drift_N_s"), "record_s": column("n") / RATE}
    return replace(data, covariates={**data.covariates, **within}), keep


def _observed(
    bench: Bench, keep: Array, lift_N: Array, u_lift_N: Array, n_eff: Array
) -> Observations:
    """Trials as the library takes them; arrays are of those kept."""
    half = 0.5 * forms.D
    logged = {"start_s": bench.start_s, "approach": bench.approach, **bench.reading}
    return Observations(
        boundary=bench.boundary,
        trial=np.array([f"t{i:04d}" for i in np.flatnonzero(keep)], dtype=object),
        z_hat=bench.z_hat[keep],
        lift_N=lift_N,
        u_lift_N=u_lift_N,
        n_eff=n_eff,
        throttle=bench.throttle[keep],
        visit=bench.visit[keep].astype(np.int64),
        session=np.unique(bench.session[keep], return_inverse=True)[1].astype(np.int64),
        radius_m=bench.radius_m,
        geometry={
            "spacing_hat": forms.D,
            "diagonal_hat": forms.B,
            "layout_hat": np.array([[half, half], [-half, half], [-half, -half], [half, -half]]),
        },
        covariates={name: values[keep] for name, values in logged.items()},
    )


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """`Errors` as drawn: each trial's error as a fraction of lift, which trials are kept, and the
    true covariance, which knows the bad visit and each session's scatter but no outlier or tail.
    """

    error: Array
    keep: Array
    variance: Array
    covariance: Array | None


def _apart(n: int) -> Array:
    """How many trials lie between any two, (n, n)."""
    return np.abs(np.arange(n)[:, None] - np.arange(n))


def draw_errors(errors: Errors, sd: float, bench: Bench, seed: int) -> Drawn:
    """Draw errors of trials; `sd` is the scatter of a trial, a fraction of lift."""
    rng, n = stream(seed, "errors", bench.boundary), bench.n
    log_z, trial = np.log(bench.z_hat), np.arange(n)
    far = (log_z - log_z.min()) / np.ptp(log_z)
    size = sd * (1 + (errors.far - 1) * far) * (1 + (errors.near - 1) * (1 - far))
    by_session = errors.sessions * rng.standard_normal(bench.session.max() + 1)
    size = size * np.exp(by_session)[bench.session]
    if np.isinf(errors.tails):
        own = rng.standard_normal(n)
    else:
        own = rng.standard_t(errors.tails, n) * np.sqrt(1 - 2 / errors.tails)
    variance, covariances = size**2, []
    if errors.correlation:
        kicks = np.r_[rng.standard_normal(400), own]
        own = lfilter([np.sqrt(1 - errors.correlation**2)], [1.0, -errors.correlation], kicks)[-n:]
        variance = np.zeros(n)
        covariances.append(np.outer(size, size) * errors.correlation ** _apart(n))
    error = size * own
    outlying = rng.random(n) < errors.outliers
    error = error + outlying * rng.choice([-1, 1], n) * rng.uniform(5, 10, n) * size
    if errors.wander and np.isinf(errors.trials):
        # a walk of n steps deviates from its own mean by sqrt(n / 6) steps rms
        step = errors.wander * np.sqrt(6 / n)
        error = error + step * np.cumsum(rng.standard_normal(n))
        covariances.append(step**2 * (1.0 + np.minimum(trial[:, None], trial)))
    elif errors.wander:
        error = error + errors.wander * wander(rng, trial.astype(float), errors.trials)
        covariances.append(errors.wander**2 * np.exp(-_apart(n) / errors.trials))
    if errors.bad_visit:
        bad = (bench.visit == rng.integers(bench.visit[-1] + 1)) * errors.bad_visit * sd
        error = error + bad * rng.choice([-1, 1])
        covariances.append(np.outer(bad, bad))
    keep = rng.random(n) >= errors.lost
    lost = rng.permutation(bench.session.max() + 1)[: errors.lost_sessions]
    return Drawn(
        error=error,
        keep=keep & ~np.isin(bench.session, lost),
        variance=variance,
        covariance=sum(covariances) if covariances else None,
    )


def _trials(
    spec: Spec,
    seed: int,
    setting: forms.Setting,
    scatter: Scatter,
    sensor: Sensor,
    pieces: Pieces,
    drawn: Drawn,
) -> Observations:
    """Trials without records: the curve at the true height and geometry, errors as drawn, and the
    geometry of the manifest.
    """
    rng, bench, shared = stream(seed, "trials", spec.boundary), setting.bench, spec.shared
    errors, keep = spec.errors or Errors(), drawn.keep
    height = rng.normal(0, scatter.height_m, bench.visit[-1] + 1)[bench.visit]
    height = height + shared.datum_m * rng.standard_normal()
    z = np.maximum(bench.z_hat + height / bench.radius_m, 0.3 * bench.z_hat)
    lift = np.exp(log_lift(setting, pieces, z))
    if errors.rail:
        # the mean of min(x, rail) for normal x
        sd = sensor.tone_N / np.sqrt(2)
        beyond = (np.quantile(lift, 1 - errors.rail) - lift) / sd
        lift = lift - sd * (norm.pdf(beyond) - beyond * norm.sf(beyond))
    lift = lift * (1 + drawn.error) + rng.normal(0, scatter.force_N, bench.n)
    lift = (lift + rng.normal(0, scatter.record_N, bench.n))[keep]
    u, n_eff = np.full(len(lift), scatter.record_N), sensor.samples / 5
    if errors.table:
        u, n_eff = scatter.relative * lift, 1.0
    data = _observed(bench, keep, lift, u, np.full(len(lift), n_eff))
    if errors.table:
        data = replace(data, covariates={}, session=np.zeros(data.n, dtype=np.int64), ordered=False)
    radius = 1 + shared.rotor_radius * rng.standard_normal()
    spacing = 1 + shared.spacing_m / spec.spacing_m * rng.standard_normal()
    believed = {name: value / radius * spacing for name, value in data.geometry.items()}
    return replace(
        data, radius_m=data.radius_m * radius, z_hat=data.z_hat / radius, geometry=believed
    )
