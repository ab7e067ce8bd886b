"""The independent referee: simulated campaigns at record level, with a known truth.

`simulate(spec, seed)` plans a campaign (`bench`), computes its true lift from the referee's own
physics (`forms`), writes a load-cell record for every trial (tare head, running part, rotor tone,
coloured noise, counts) and reduces it with the library's own `reduction.record`: the one piece
shared with what is being judged, because it is what turns records into trials. With `Spec.errors`
it goes without records, and the errors of trials are what that says.

An effect's strength rho is its rms per trial in units of trial noise after the base model's
coefficients and a free L_inf per throttle have absorbed what they can: rho^2 = ||P W e||^2 / n with
W the true whitening, P the projection, e its log lift.
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
    SPACING,
    THROTTLES,
    Bench,
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

RATE = 1000.0
COUNT_N = 9.8e-6
COLOUR = 0.8  # correlation of the coloured part from one sample to the next
Array = np.ndarray


class Unreachable(Exception):
    """No physically possible size of this effect is as strong as that on this bench."""

    def __init__(self, kind: str, rho: float, most: float) -> None:
        super().__init__(f"{kind} reaches rho = {most:.3g} at most, not {rho:.3g}")
        self.kind, self.most = kind, most


@dataclass(frozen=True, kw_only=True)
class Shared:
    """Sizes of errors that many trials have in common, each drawn once per element of its scope; 0
    is none.

    Attributes
    ----------
    session_gain, throttle_gain : float
        Standard deviation of a gain error per session and per throttle.
    visit_gain : float
        The same per visit.
    datum_m : float
        Standard deviation of one offset of every distance.
    rotor_radius, spacing_m : float
        Standard deviation of the radius, as a fraction, and of the spacing that the campaign's
        owner believes in.
    cell_N : float
        Half-width of the load cell's uniform departure from its line at `range_N`; it bends with
        the square of the force.
    """

    session_gain: float = 0.0
    throttle_gain: float = 0.0
    visit_gain: float = 0.0
    datum_m: float = 0.0
    rotor_radius: float = 0.0
    spacing_m: float = 0.0
    cell_N: float = 0.0
    range_N: float = 9.8


@dataclass(frozen=True, kw_only=True)
class Errors:
    """How each trial errs beside its additive noise and its visit's height; by default normally,
    independently, all alike.

    Attributes
    ----------
    tails : float
        Degrees of freedom of a Student t of unit variance.
    far, near : float
        Standard deviation at the farthest, or the nearest, distance over that at the other end,
        linear in log distance between.
    sessions : float
        Standard deviation of the logarithm of a factor on each session's scatter.
    correlation : float
        Of a trial's error with that of the trial before.
    wander, trials : float
        Rms of a gain that wanders as an Ornstein-Uhlenbeck process over so many trials; as a random
        walk where `trials` is infinite.
    outliers : float
        Share of trials that are off by 5 to 10 standard deviations.
    bad_visit : float
        By how many standard deviations all trials of one visit are off together.
    lost, lost_sessions : float, int
        Share of trials, and number of sessions, that are missing.
    rail : float
        Share of trials with lift beyond what the amplifier can follow: the means of their records
        are cut short.
    table : float
        Scatter of a cell as published, a fraction of lift, in place of the bench's; such a table
        has no covariates and no order.
    """

    tails: float = np.inf
    far: float = 1.0
    near: float = 1.0
    sessions: float = 0.0
    correlation: float = 0.0
    wander: float = 0.0
    trials: float = np.inf
    outliers: float = 0.0
    bad_visit: float = 0.0
    lost: float = 0.0
    lost_sessions: int = 0
    rail: float = 0.0
    table: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Spec:
    """What to simulate.

    Attributes
    ----------
    effects : tuple of (kind, rho)
        Names of `forms.NAMED` or `forms.UNNAMED` with their strength; empty for a null.
    foreign : bool
        Whether named effects take their foreign form.
    design : str
        "from_one" (stations from z_hat = 1, ceiling and sidewall from 0.1), "percent_diameter" or
        "mm" (readings of Table 1).
    realism : bool
        t6 tails and 0.3 % outliers of trials, and an undeclared wander of the gain of 0.03 %.
    spread : float
        Coefficients are drawn within +- this fraction of the published ones, so that no prior
        centred there is helped.
    sink : float
        Motor heating: fraction by which lift sinks within a record at the highest throttle, in
        proportion to load. Alike in every trial of a throttle, so that L_inf absorbs it and only
        the records show it; rho does not apply.
    samples : int or None
        Running samples per record; 260 to 500 if None.
    every : int
        Takes every so-manieth station of the design.
    distances : int or None
        Takes that many stations instead.
    shared : Shared
        Errors that many trials share, on top of `Scatter`.
    declared : bool
        Whether the campaign's owner declares `shared.datum_m`, `rotor_radius` and `spacing_m`.
    errors : Errors or None
        Simulate trials, not records, with errors of this kind; `realism`, `sink` and the rest of
        `shared` then do not apply.
    order, radius_m : str, float
        As `bench.build` has them. A larger rotor is the same vehicle, larger; lift goes with its
        area.
    height_m : float or None
        Standard deviation of a visit's height, in place of 0.02 to 0.1 mm.
    experiments : bool
        As `bench.build` has it: then `forms.EXPERIMENTS` can be told.
    """

    boundary: str
    effects: tuple[tuple[str, float], ...] = ()
    foreign: bool = False
    design: str = "from_one"
    realism: bool = True
    visits: int = 15
    sessions: int = 6
    throttles: tuple[float, ...] = THROTTLES
    spread: float = 0.2
    sink: float = 0.0
    samples: int | None = None
    every: int = 1
    distances: int | None = None
    shared: Shared = Shared()
    declared: bool = False
    errors: Errors | None = None
    order: str = "random"
    radius_m: float = RADIUS
    height_m: float | None = None
    experiments: bool = False


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
    """What was put in. Arrays are of the trials kept, in run order.

    Attributes
    ----------
    log_lift : array
        Noiseless log lift at nominal distance, every effect included.
    base_log_lift : array
        The same without effects.
    contributions : dict
        What each effect alone adds to log lift.
    amplitudes, rho, rho_beside : dict
        Amplitude found; strength reached; strength left once the other effects' directions are
        absorbed too.
    variance : array
        Marginal variance of log lift, height jitter included, realism's excess left out.
    """

    theta: dict[str, float]
    levels_N: Array
    scatter: Scatter
    log_lift: Array
    base_log_lift: Array
    contributions: dict[str, Array]
    amplitudes: dict[str, float]
    rho: dict[str, float]
    rho_beside: dict[str, float]
    variance: Array = field(repr=False)

    @property
    def noise_floor(self) -> float:
        """Rms relative scatter of a trial that no model can foresee."""
        return float(np.sqrt(np.mean(self.variance)))


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A simulated campaign: what the library is given (`data`), and the truth; `scheduled` trials
    in all, where it was cut.
    """

    spec: Spec
    seed: int
    data: Observations
    truth: Truth
    setting: forms.Setting = field(repr=False)
    keep: Array = field(repr=False)
    whitener: Whitener = field(repr=False)
    sensor: Sensor = field(repr=False)
    records: Array | None = field(default=None, repr=False)
    scheduled: int | None = None

    @property
    def parts(self) -> tuple[Component, ...]:
        """What the campaign's owner declares."""
        shared, spacing = self.spec.shared, self.spec.radius_m * SPACING / RADIUS
        sizes = {
            "height": shared.datum_m,
            "rotor_radius": shared.rotor_radius,
            "rotor_spacing": shared.spacing_m / spacing,
        }
        moves = {"rotor_spacing": ("spacing_hat", "diagonal_hat", "layout_hat")}
        return tuple(
            Component(
                name=on,
                on=on,
                standard=size,
                distribution="normal",
                scope="boundary",
                moves=moves.get(on, ()),
            )
            for on, size in sizes.items()
            if size and self.spec.declared
        )

    def until(self, n: int) -> Campaign:
        """As it stood after its first trials."""
        keep = np.flatnonzero(self.keep)[n:]
        rows, truth = np.arange(n), self.truth
        cut = {name: getattr(truth, name)[:n] for name in ("log_lift", "base_log_lift", "variance")}
        known = replace(
            truth, **cut, contributions={k: v[:n] for k, v in truth.contributions.items()}
        )
        left = self.keep & ~np.isin(np.arange(len(self.keep)), keep)
        return replace(
            self,
            data=self.data.take(rows),
            truth=known,
            keep=left,
            whitener=self.whitener.of(rows),
            scheduled=self.data.n,
        )

    @cached_property
    def jacobian(self) -> Array:
        """d log ratio / d theta of the base model at its true coefficients, (n, p)."""
        return base_jacobian(self.setting)[self.keep]

    @cached_property
    def indicator(self) -> Array:
        """One column per throttle, (n, k)."""
        return np.eye(len(self.truth.levels_N))[self.setting.bench.level[self.keep]]


class Whitener:
    """W with W C W' = 1 for C = diag(variance) + a rank-one block per visit (+ `beside`); visits
    are contiguous in run order.
    """

    def __init__(
        self, variance: Array, shared: Array, visit: Array, beside: Array | None = None
    ) -> None:
        self.given = variance, shared, visit, beside
        if beside is not None:
            covariance = (
                np.diag(variance) + (visit[:, None] == visit) * np.outer(shared, shared) + beside
            )
            self.factor = cholesky(covariance, lower=True)
            return
        self.sd = np.sqrt(variance)
        self.first = np.flatnonzero(np.diff(visit, prepend=visit[0] - 1))
        self.block = np.cumsum(np.diff(visit, prepend=visit[0] - 1) != 0) - 1
        self.q = shared / self.sd
        length = np.add.reduceat(self.q**2, self.first)
        self.shrink = np.where(
            length > 1e-14, (1 - 1 / np.sqrt(1 + length)) / np.maximum(length, 1e-14), 0.5
        )

    def of(self, rows: Array) -> Whitener:
        """That of some of the trials alone, in their order."""
        variance, shared, visit, beside = self.given
        return Whitener(
            variance[rows],
            shared[rows],
            visit[rows],
            None if beside is None else beside[np.ix_(rows, rows)],
        )

    def __call__(self, x: Array) -> Array:
        """Apply along the first axis."""
        if self.given[3] is not None:
            return solve_triangular(self.factor, x, lower=True)
        x = (x.T / self.sd).T
        along = np.add.reduceat((x.T * self.q).T, self.first, axis=0)
        return x - ((self.shrink * along.T)[..., self.block] * self.q).T

    def strength(self, e: Array, absorbed: Array) -> float:
        """Rms per trial of what is left of `e`, whitened, once the columns `absorbed` have taken
        what they can.
        """
        q, r = np.linalg.qr(self(absorbed))
        keep = np.abs(np.diag(r)) > 1e-9 * np.abs(np.diag(r)).max()
        if not keep.all():
            u, s, _ = np.linalg.svd(self(absorbed), full_matrices=False)
            q = u[:, s > 1e-10 * s[0]]
        white = self(e)
        return float(np.sqrt(np.mean((white - q @ (q.T @ white)) ** 2)))


def log_lift(
    setting: forms.Setting,
    effects: tuple[tuple[forms.Form, float], ...],
    z_hat: Array | None = None,
) -> Array:
    """Noiseless log lift: height effects, the base curve, ratio effects, gains, forces, in that
    order.
    """
    bench = setting.bench
    z = bench.z_hat if z_hat is None else z_hat
    at = lambda place: [(f, x) for f, x in effects if f.place == place]  # noqa: E731
    for f, x in at("height"):
        z = np.maximum(f.apply(z, setting, x), 0.2 * bench.z_hat)
    value = setting.curve(z)
    for f, x in at("ratio"):
        value = f.apply(value, setting, x)
    lift = setting.inf_N * value
    for f, x in at("gain"):
        lift = lift * np.exp(f.apply(None, setting, x))
    for f, x in at("force"):
        lift = f.apply(lift, setting, x)
    return np.log(np.maximum(lift, 1e-6))


def base_jacobian(setting: forms.Setting) -> Array:
    """Central differences of the log base curve, (n, p)."""
    columns = []
    for name, value in setting.theta.items():
        step = 1e-4 * abs(value)
        up, down = (
            forms.ratio(
                setting.bench.boundary, setting.bench.z_hat, {**setting.theta, name: value + s}
            )
            for s in (step, -step)
        )
        columns.append((np.log(up) - np.log(down)) / (2 * step))
    return np.stack(columns, axis=1)


def whitener(
    setting: forms.Setting, scatter: Scatter, spec: Spec | None = None, drawn: Drawn | None = None
) -> tuple[Whitener, Array]:
    """The true whitening of log lift at the base curve, and the marginal variance; what is declared
    (`spec`) is part of it.
    """
    bench = setting.bench
    step = 1e-4

    def per(moved: Callable[[float], Array]) -> Array:
        return (np.log(moved(1 + step)) - np.log(moved(1 - step))) / (2 * step)

    slope = per(lambda f: setting.curve(bench.z_hat * f)) / bench.z_hat / bench.radius_m
    lift = setting.inf_N * setting.curve(bench.z_hat)
    own = (scatter.force_N**2 + scatter.record_N**2) / lift**2
    shared = scatter.height_m * slope
    if drawn is None:
        own = own + scatter.relative**2
        return Whitener(own, shared, bench.visit), own + shared**2
    own, beside = own + drawn.variance, drawn.covariance
    if spec is not None and spec.declared:
        given, spacing = spec.shared, spec.radius_m * SPACING / RADIUS
        curve = lambda f, g: forms.ratio(  # noqa: E731
            bench.boundary, bench.z_hat / f, setting.theta, forms.D / f * g
        )
        columns = np.column_stack(
            [
                given.datum_m * slope,
                given.rotor_radius * per(lambda f: curve(f, 1.0)),
                given.spacing_m / spacing * per(lambda f: curve(1.0, f)),
            ]
        )
        beside = columns @ columns.T + (0.0 if beside is None else beside)
    return Whitener(own, shared, bench.visit, beside), own + shared**2 + (
        0.0 if beside is None else np.diag(beside)
    )


def amplitude(
    setting: forms.Setting, white: Whitener, kind: str, foreign: bool, rho: float, sign: float
) -> float:
    """The size at which an effect is as strong as `rho`.

    Raises
    ------
    Unreachable
        Its largest physical size is weaker.
    """
    form = forms.form(kind, foreign)
    base = log_lift(setting, ())
    absorbed = np.hstack(
        [np.eye(len(setting.levels_N))[setting.bench.level], base_jacobian(setting)]
    )
    most = form.most[setting.bench.boundary] * (sign if form.signed else 1.0)

    def miss(share: float) -> float:
        return white.strength(log_lift(setting, ((form, share * most),)) - base, absorbed) - rho

    # what pays no heed to sign or size may turn round on the way: take the first crossing
    share = next((s for s in (0.01, 0.03, 0.1, 0.3, 1.0) if miss(s) > 0), None)
    if share is None:
        raise Unreachable(kind, rho, miss(1.0) + rho)
    return float(brentq(miss, 0.0, share, xtol=1e-7, rtol=1e-5)) * most


def simulate(spec: Spec, seed: int, *, keep_records: bool = False) -> Campaign:
    """One campaign with its truth.

    Raises
    ------
    Unreachable
        An effect cannot be as strong as asked on this bench.
    """
    rng = stream(seed, "truth", spec.boundary)
    bench = build(
        spec.boundary,
        spec.design,
        seed,
        visits=spec.visits,
        sessions=spec.sessions,
        throttles=spec.throttles,
        every=spec.every,
        distances=spec.distances,
        order=spec.order,
        radius_m=spec.radius_m,
        experiments=spec.experiments,
    )
    nominal = forms.COEFFICIENTS[spec.boundary]
    theta = {
        name: value * (1 + spec.spread * rng.uniform(-1, 1)) for name, value in nominal.items()
    }
    setting = forms.Setting(
        bench=bench,
        theta=theta,
        levels_N=levels_N(rng, spec.throttles) * (spec.radius_m / RADIUS) ** 2,
    )
    sizes = {
        "relative": rng.uniform(0.003, 0.006),
        "force_N": rng.uniform(0.1e-3, 0.5e-3),
        "height_m": rng.uniform(0.02e-3, 0.1e-3),
    }
    sensor = Sensor(
        samples=spec.samples or int(rng.integers(260, 501)),
        tare=int(rng.integers(100, 161)),
        white_N=rng.uniform(0.8e-3, 2.5e-3),
        coloured_N=rng.uniform(0.2e-3, 0.6e-3),
        tone_N=rng.uniform(2e-3, 8e-3),
    )
    if spec.height_m is not None:
        sizes["height_m"] = spec.height_m
    scatter = Scatter(**sizes, record_N=sensor.mean_sd_N)
    if spec.errors is not None and spec.errors.table:
        scatter = replace(scatter, relative=spec.errors.table, force_N=0.0, record_N=0.0)
    drawn = None if spec.errors is None else draw_errors(spec.errors, scatter.relative, bench, seed)
    white, variance = whitener(setting, scatter, spec, drawn)

    pieces: dict[str, tuple[forms.Form, float]] = {}
    for kind, rho in spec.effects:
        sign = stream(seed, "sign", kind).choice([-1.0, 1.0])
        pieces[kind] = (
            forms.form(kind, spec.foreign),
            amplitude(setting, white, kind, spec.foreign, rho, sign),
        )
    base, full = log_lift(setting, ()), log_lift(setting, tuple(pieces.values()))
    full = full + np.log1p(
        -spec.sink * setting.load * sinking(np.linspace(0, 1, sensor.samples), spec.foreign).mean()
    )
    parts = {kind: log_lift(setting, (piece,)) - base for kind, piece in pieces.items()}
    absorbed = np.hstack([np.eye(len(spec.throttles))[bench.level], base_jacobian(setting)])
    rho = {kind: white.strength(e, absorbed) for kind, e in parts.items()}
    beside = {
        kind: white.strength(
            e, np.column_stack([absorbed, *(o for k, o in parts.items() if k != kind)])
        )
        for kind, e in parts.items()
    }

    if drawn is None:
        records = _records(spec, seed, setting, scatter, sensor, tuple(pieces.values()))
        data, keep = _reduced(records, bench, sensor, spec.boundary)
    else:
        records, keep = None, drawn.keep
        data = _trials(spec, seed, setting, scatter, sensor, tuple(pieces.values()), drawn)
    truth = Truth(
        theta=theta,
        levels_N=setting.levels_N,
        scatter=scatter,
        log_lift=full[keep],
        base_log_lift=base[keep],
        contributions={kind: e[keep] for kind, e in parts.items()},
        amplitudes={kind: x for kind, (_, x) in pieces.items()},
        rho=rho,
        rho_beside=beside,
        variance=variance[keep],
    )
    if not keep.all():
        white = white.of(np.flatnonzero(keep))
    kept = records if keep_records else None
    return Campaign(
        spec=spec,
        seed=seed,
        data=data,
        truth=truth,
        setting=setting,
        keep=keep,
        whitener=white,
        sensor=sensor,
        records=kept,
    )


def candidate_columns(campaign: Campaign) -> dict[str, Array]:
    """Every named effect's own form as a column of log lift, linear in its size; what rival methods
    choose from.

    They are the truth's own shapes, so rival methods get the benefit of a library without form
    error. What theta and L_inf absorb altogether is left out.
    """
    base = log_lift(campaign.setting, ())
    absorbed = np.hstack([campaign.indicator, campaign.jacobian])
    columns = {}
    for name in forms.names(campaign.spec.boundary):
        form = forms.form(name, foreign=False)
        share = 0.5 if form.place in ("height", "ratio") and not form.signed else 0.05
        e = (
            log_lift(campaign.setting, ((form, share * form.most[campaign.spec.boundary]),)) - base
        )[campaign.keep]
        if campaign.whitener.strength(e, absorbed) > 1e-3 * np.sqrt(
            np.mean(campaign.whitener(e) ** 2)
        ):
            columns[name] = e / share
    return columns


def repeat(campaign: Campaign, seed: int) -> Campaign:
    """The same bench, truth and schedule, run again with fresh noise."""
    spec, pieces = (
        campaign.spec,
        tuple(
            (forms.form(k, campaign.spec.foreign), x) for k, x in campaign.truth.amplitudes.items()
        ),
    )
    records = _records(
        spec, seed, campaign.setting, campaign.truth.scatter, campaign.sensor, pieces
    )
    data, keep = _reduced(records, campaign.setting.bench, campaign.sensor, spec.boundary)
    if not np.array_equal(keep, campaign.keep):
        raise RuntimeError("a repeat lost other trials than the campaign it repeats")
    return replace(campaign, seed=seed, data=data)


def sinking(u: Array, foreign: bool) -> Array:
    """Heat's share in a record, from 0 at the first to 1 at the last running sample: linear, or
    saturating where foreign.
    """
    return np.expm1(-4 * u) / np.expm1(-4.0) if foreign else u


def _records(
    spec: Spec,
    seed: int,
    setting: forms.Setting,
    scatter: Scatter,
    sensor: Sensor,
    pieces: tuple[tuple[forms.Form, float], ...],
) -> Array:
    """Load-cell series of every trial, N, shape (trials, tare + samples): a block per campaign,
    drawn at once.
    """
    rng = stream(seed, "noise", spec.boundary)
    bench, n = setting.bench, setting.bench.n
    jitter = rng.normal(0, scatter.height_m, bench.visit[-1] + 1)[bench.visit] / bench.radius_m
    # what many trials share has generators of its own, so that one error more leaves all other
    # noise as it was
    draw = lambda name, size: stream(seed, "shared", name, spec.boundary).standard_normal(size)  # noqa: E731
    datum = spec.shared.datum_m * draw("datum", 1)[0] / bench.radius_m
    z = np.maximum(bench.z_hat + datum + jitter, 0.3 * bench.z_hat)
    lift = np.exp(log_lift(setting, pieces, z))
    relative = rng.standard_t(6, n) * np.sqrt(4 / 6) if spec.realism else rng.standard_normal(n)
    gain = scatter.relative * relative
    if spec.realism:
        gain = gain + 3e-4 * wander(rng, bench.start_s, 3000.0)
        strayed = rng.random(n) < 0.003
        gain = gain + strayed * rng.choice([-1, 1], n) * rng.uniform(4, 10, n) * scatter.relative
    lift = lift * (1 + gain) + rng.normal(0, scatter.force_N, n)
    lift = lift * (
        1 + spec.shared.session_gain * draw("session", bench.session.max() + 1)[bench.session]
    )
    lift = lift * (
        1 + spec.shared.throttle_gain * draw("throttle", len(spec.throttles))[bench.level]
    )
    lift = lift * (1 + spec.shared.visit_gain * draw("visit", bench.visit[-1] + 1)[bench.visit])

    length = sensor.tare + sensor.samples
    force = rng.standard_normal((n, length))
    force *= sensor.white_N
    kicks = rng.standard_normal((n, length))
    start = kicks[:, :1] / np.sqrt(1 - COLOUR**2)
    coloured, _ = lfilter([1.0], [1.0, -COLOUR], kicks[:, 1:], axis=1, zi=COLOUR * start)
    force[:, 1:] += sensor.coloured_N * np.sqrt(1 - COLOUR**2) * coloured
    force += rng.normal(0, 4e-3, n)[
        :, None
    ]  # where the zero happens to stand; the tare takes it off
    live = force[:, sensor.tare :]
    live += lift[:, None]
    if spec.sink:
        live -= (lift * spec.sink * setting.load)[:, None] * sinking(
            np.linspace(0, 1, sensor.samples), spec.foreign
        )
    turn = 2 * np.pi * bench.speed_rpm / 60 * (1 + rng.normal(0, 0.004, n)) / RATE
    phase = rng.uniform(0, 2 * np.pi, n)
    # sin(a + kb) by the angle's sum: two tables instead of a million sines
    steps = np.arange(sensor.samples)
    live += _tone(turn, phase, steps) * (sensor.tone_N * setting.load)[:, None]
    if spec.shared.cell_N:
        force += (
            spec.shared.cell_N
            * stream(seed, "shared", "cell", spec.boundary).uniform(-1, 1)
            * (force / spec.shared.range_N) ** 2
        )
    return np.round(force / COUNT_N) * COUNT_N


def _tone(turn: Array, phase: Array, steps: Array) -> Array:
    """sin(phase + turn k) for every trial and sample, by repeated rotation in blocks of 32."""
    block = 32
    fine = np.exp(1j * turn[:, None] * np.arange(block))
    coarse = np.exp(1j * (phase[:, None] + turn[:, None] * np.arange(0, len(steps), block)))
    full = coarse[:, :, None] * fine[:, None, :]
    return full.imag.reshape(len(turn), -1)[:, : len(steps)]


def _reduced(
    records: Array, bench: Bench, sensor: Sensor, boundary: str
) -> tuple[Observations, Array]:
    """What ingest would make of the records: accepted trials of one boundary."""
    conditions = Conditions(rate_Hz=RATE, tare_s=sensor.tare / RATE, range_N=9.8)
    rows = [reduce_record(r, conditions) for r in records]
    keep = ~rejected(np.array([" ".join(r.codes) for r in rows], dtype=object))
    good = [r for r, k in zip(rows, keep, strict=True) if k]
    column = lambda name: np.array([getattr(r, name) for r in good], dtype=float)  # noqa: E731
    data = _observed(bench, keep, column("lift_N"), column("u_lift_N"), column("n_eff"))
    within = {"drift_N_s": column("drift_N_s"), "record_s": column("n") / RATE}
    return replace(data, covariates={**data.covariates, **within}), keep


def _observed(
    bench: Bench, keep: Array, lift_N: Array, u_lift_N: Array, n_eff: Array
) -> Observations:
    """Trials as the library takes them; arrays are of those kept."""
    half = 0.5 * SPACING / RADIUS
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
            "spacing_hat": SPACING / RADIUS,
            "diagonal_hat": np.sqrt(2) * SPACING / RADIUS,
            "layout_hat": np.array([[half, half], [-half, half], [-half, -half], [half, -half]]),
        },
        covariates={
            "start_s": bench.start_s[keep],
            "approach": bench.approach[keep],
            **{name: values[keep] for name, values in bench.reading.items()},
        },
    )


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """`Errors` as they came out: each trial's error as a fraction of lift, which trials there are,
    the covariance that a sage would use.

    The sage knows which visit was bad and how each session scattered; of tails and outliers he
    knows nothing.
    """

    error: Array
    keep: Array
    variance: Array
    covariance: Array | None


def draw_errors(errors: Errors, sd: float, bench: Bench, seed: int) -> Drawn:
    """Draw what `Errors` declares; `sd` is the scatter of a trial, a fraction of lift."""
    rng = stream(seed, "errors", bench.boundary)
    n = bench.n
    log_z = np.log(bench.z_hat)
    far = (log_z - log_z.min()) / np.ptp(log_z)
    size = sd * (1 + (errors.far - 1) * far) * (1 + (errors.near - 1) * (1 - far))
    size = (
        size * np.exp(errors.sessions * rng.standard_normal(bench.session.max() + 1))[bench.session]
    )
    own = (
        rng.standard_normal(n)
        if np.isinf(errors.tails)
        else rng.standard_t(errors.tails, n) * np.sqrt(1 - 2 / errors.tails)
    )
    variance, covariance = size**2, None
    trial = np.arange(n)
    if errors.correlation:
        kicks = np.r_[rng.standard_normal(400), own]
        own = lfilter([np.sqrt(1 - errors.correlation**2)], [1.0, -errors.correlation], kicks)[-n:]
        variance, covariance = (
            np.zeros(n),
            np.outer(size, size) * errors.correlation ** np.abs(trial[:, None] - trial),
        )
    error = size * own
    strayed = rng.random(n) < errors.outliers
    error = error + strayed * rng.choice([-1, 1], n) * rng.uniform(5, 10, n) * size
    if errors.wander:
        if np.isinf(errors.trials):
            # a walk of n steps strays from its own mean by sqrt(n / 6) steps rms
            step = errors.wander * np.sqrt(6 / n)
            path, path_covariance = (
                step * np.cumsum(rng.standard_normal(n)),
                step**2 * (1.0 + np.minimum(trial[:, None], trial)),
            )
        else:
            path = errors.wander * wander(rng, trial.astype(float), errors.trials)
            path_covariance = errors.wander**2 * np.exp(
                -np.abs(trial[:, None] - trial) / errors.trials
            )
        error = error + path
        covariance = path_covariance + (0.0 if covariance is None else covariance)
    if errors.bad_visit:
        bad = (bench.visit == rng.integers(bench.visit[-1] + 1)) * errors.bad_visit * sd
        error = error + bad * rng.choice([-1, 1])
        covariance = np.outer(bad, bad) + (0.0 if covariance is None else covariance)
    keep = rng.random(n) >= errors.lost
    keep &= ~np.isin(
        bench.session, rng.permutation(bench.session.max() + 1)[: errors.lost_sessions]
    )
    return Drawn(error=error, keep=keep, variance=variance, covariance=covariance)


def _trials(
    spec: Spec,
    seed: int,
    setting: forms.Setting,
    scatter: Scatter,
    sensor: Sensor,
    pieces: tuple[tuple[forms.Form, float], ...],
    drawn: Drawn,
) -> Observations:
    """Trials without records: the curve at the true height and geometry, errors as drawn, and the
    geometry that the owner believes in.
    """
    assert spec.errors is not None
    rng, bench, shared, errors = (
        stream(seed, "trials", spec.boundary),
        setting.bench,
        spec.shared,
        spec.errors,
    )
    height = (
        rng.normal(0, scatter.height_m, bench.visit[-1] + 1)[bench.visit]
        + shared.datum_m * rng.standard_normal()
    )
    lift = np.exp(
        log_lift(
            setting, pieces, np.maximum(bench.z_hat + height / bench.radius_m, 0.3 * bench.z_hat)
        )
    )
    sample_sd = sensor.tone_N / np.sqrt(2)
    if errors.rail:
        # the mean of min(x, rail) for normal x
        beyond = (np.quantile(lift, 1 - errors.rail) - lift) / sample_sd
        lift = lift - sample_sd * (norm.pdf(beyond) - beyond * norm.sf(beyond))
    lift = (
        lift * (1 + drawn.error)
        + rng.normal(0, scatter.force_N, bench.n)
        + rng.normal(0, scatter.record_N, bench.n)
    )
    keep = drawn.keep
    u = np.full(bench.n, scatter.record_N) if scatter.record_N else scatter.relative * lift
    data = _observed(
        bench,
        keep,
        lift[keep],
        u[keep],
        np.full(int(keep.sum()), sensor.samples / 5 if scatter.record_N else 1.0),
    )
    if errors.table:
        data = replace(data, covariates={}, session=np.zeros(data.n, dtype=np.int64), ordered=False)
    radius, spacing = (
        1 + size * rng.standard_normal()
        for size in (shared.rotor_radius, shared.spacing_m / (spec.radius_m * SPACING / RADIUS))
    )
    believed = {name: value / radius * spacing for name, value in data.geometry.items()}
    return replace(
        data, radius_m=data.radius_m * radius, z_hat=data.z_hat / radius, geometry=believed
    )
