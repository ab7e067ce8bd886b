"""Information of a fit: one joint matrix, and the uncertainty budget after the GUM from it.

Stated errors, log L_inf and coefficients are estimated together. Stated errors are unknowns of unit
variance, which adds 1 to their diagonal elements; the trials' own errors are the weights. The
inverse is the joint covariance. Its rows for log L_inf and coefficients, times the weighted design,
are the estimator ``theta = G y`` of the trials' log lift y.

The covariance of the trials is a sum of sources, ``C = sum C_i``, so a variance is the sum of ``G
C_i G'``. No source is left out or counted twice. An independent measurement adds to a diagonal
element. N repeats of the campaign multiply the trials' information and leave the stated part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.likelihood import semiseparable
from nearlift.likelihood.budget import GROUPED, INPUTS, Component, groups, independent_variance
from nearlift.likelihood.covariance import LEAST_VARIANCE, Covariance, group_sums
from nearlift.likelihood.noise import trial_variance
from nearlift.likelihood.problem import Likelihood
from nearlift.likelihood.variance_components import ages
from nearlift.nomenclature import letter
from nearlift.results import Noise, Observations
from nearlift.results.fit import Degeneracy, Halving, Remedy, Repeats
from nearlift.rounding import plain, signed

if TYPE_CHECKING:
    from nearlift.fit.least_squares import LeastSquaresFit

#: Least effective degrees of freedom. Ours: a 90 % interval then has 6.3 standard uncertainties to
#: either side.
LEAST_DOF = 1.0
#: What a component's standard uncertainty is on: its unit, and the factor and unit shown.
UNITS = {
    "height": ("m", 1e3, "mm"),
    "force": ("N", 1e3, "mN"),
    "linearity": ("N", 1e3, "mN"),
    "zero": ("N", 1e3, "mN"),
    "gain": ("1", 1e2, "%"),
    **dict.fromkeys(INPUTS, ("1", 1e2, "%")),
}
#: Line of the noise within each trial's own record, and lines of the components of `Noise`.
RECORD_NOISE = "noise within a record"
SCATTER_NAMES = {
    "relative": "proportional scatter",
    "force_N": "force scatter",
    "height_m": "height scatter",
    "common": "visit-to-visit scatter",
    "drift": "slow drift",
}
#: Absolute correlation above which a pair is degenerate. Ours: knowing one would reduce u of the
#: other to sqrt(1 - r^2) = 0.31 of it.
DEGENERATE = 0.95
#: Least relative reduction of an uncertainty for which a remedy is listed; u is printed to two
#: digits.
MIN_REDUCTION = 0.05
#: Information of exact knowledge, in the unknown's unit to the power -2: far above that of any
#: trials. Number of repeats at which scatter is taken as absent: 1e-4 of its u is left. Ours.
EXACT_INFORMATION, ENDLESS_REPEATS = 1e30, 1e8
#: Fraction of its length that a parameter's row must keep once L_inf is projected out; least
#: eigenvalue of the scaled information along a determined direction; and greatest share of a
#: determined parameter in an undetermined one. Ours: well above rounding, 2e-16 of a row or
#: an eigenvalue and the square root of that for a share.
MIN_KEPT_LENGTH, MIN_EIGENVALUE, MAX_BLIND_PART = 1e-6, 1e-13, 1e-6


def parameter_covariance(
    white: FloatArray, whole: FloatArray | None = None
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Covariance (p, p) of the parameters from their whitened Jacobian (p, n), and a mask of the
    determined ones.

    Undetermined directions are left out of the inverse; an undetermined parameter has infinite
    uncertainty. `whole` (p,) is the length of each row before L_inf was projected out. A parameter
    that keeps none of it, as where all trials are at one distance, is undetermined.
    """
    seen = np.linalg.norm(white, axis=1) > (0.0 if whole is None else MIN_KEPT_LENGTH * whole)
    white = np.where(seen[:, None], white, 0.0)
    information = white @ white.T
    size = np.sqrt(np.diag(information))
    unit = np.outer(*[np.where(size > 0, size, 1.0)] * 2)
    value, vector = np.linalg.eigh(information / unit)
    blind = value < MIN_EIGENVALUE
    inverse = (vector[:, ~blind] / value[~blind]) @ vector[:, ~blind].T
    determined = seen & np.all(np.abs(vector[:, blind]) < MAX_BLIND_PART, axis=1)
    return np.asarray(inverse / unit, dtype=np.float64), determined


@dataclass(frozen=True, slots=True, kw_only=True)
class JointInformation:
    """Inverse of the information on q unknowns, at the slices of their names.

    They are m shared errors of unit variance, k coefficients of the trials' `level_design`, and p
    parameters.

    Attributes
    ----------
    design : (n, q)
        Change of each trial's log lift per unit change of each unknown.
    covariance : (q, q)
        With undetermined parameters as if known.
    determined : (p,) bool
    gain : (p, n)
        Change of each parameter per unit change of each trial's log lift.
    level_gain : (k, n)
        The same of the coefficients of the levels.
    """

    design: FloatArray
    covariance: FloatArray
    determined: NDArray[np.bool_]
    gain: FloatArray
    level_gain: FloatArray
    shared: slice
    levels: slice
    parameters: slice

    @property
    def parameter_covariance(self) -> FloatArray:
        """Covariance of the parameters alone, (p, p)."""
        return self.covariance[self.parameters, self.parameters]

    @property
    def u(self) -> FloatArray:
        """Standard uncertainty of each parameter, (p,); inf for an undetermined one."""
        return np.where(self.determined, np.sqrt(np.diag(self.parameter_covariance)), np.inf)


def joint_information(
    problem: Likelihood, jacobian: FloatArray, prior_sd: FloatArray | None = None
) -> JointInformation:
    """Joint information of trials and statements, for parameters with the `jacobian` (n, p) of log
    lift. `prior_sd` (p,), where given, are the standard deviations of independent normal priors.
    """
    weights, (n, p), m = problem.covariance, jacobian.shape, problem.covariance.shared.shape[1]
    design = np.hstack([weights.shared, problem.data.level_design, jacobian])
    first, q = design.shape[1] - p, design.shape[1]
    stated = np.eye(m, q)
    if prior_sd is not None:
        stated = np.vstack([stated, np.eye(p, q, first) / prior_sd[:, None]])
    # the triangle's square is the information; its last block's, that of the parameters alone
    rotation, triangle = np.linalg.qr(np.vstack([weights.whiten_own(design.T).T, stated]))
    (inner, toll), outer = np.hsplit(triangle[:first], [first]), triangle[first:, first:]
    whole = np.linalg.norm(triangle[m:, first:], axis=0)
    covariance, determined = parameter_covariance(outer.T, whole)
    root = np.zeros((q, q))
    root[:first, :first] = np.linalg.inv(inner)
    root[first:, first:] = covariance @ outer.T
    root[:first, first:] = -root[:first, :first] @ toll @ root[first:, first:]
    gain = weights.whiten_own(root[m:] @ rotation[:n].T, transposed=True)
    return JointInformation(
        design=design,
        covariance=root @ root.T,
        determined=determined,
        gain=gain[first - m :],
        level_gain=gain[: first - m],
        shared=slice(0, m),
        levels=slice(m, first),
        parameters=slice(first, q),
    )


@dataclass(frozen=True, slots=True)
class Line:
    """One source of error, for all m coefficients (or other linear estimators) at once.

    Attributes
    ----------
    variance : (m,)
        Contribution to the variance.
    standard : float
        Standard uncertainty of the input in `unit`; the root mean square where trials or records
        differ.
    kind : str
        ``"A"`` from repeats, ``"B"`` stated.
    without : Covariance or None
        Covariance of the trials if the source were known exactly; None where nothing else scatters.
    moved : (m,) or None
        Signed contribution, where the input is one number.
    dof : (m,) or float
        Effective degrees of freedom of the contribution; inf for a stated one.
    sizes : dict of (m,)
        Variance by each component of `Noise`, for lines of the scatter of trials.
    """

    component: str
    variance: FloatArray
    without: Covariance | None = None
    standard: float = 1.0
    unit: str = "1"
    scope: str = "trial"
    distribution: str = "normal"
    kind: Literal["A", "B"] = "A"
    moved: FloatArray | None = None
    dof: FloatArray | float = np.inf
    sizes: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def sensitivity(self) -> FloatArray:
        """Change of each coefficient per unit of the input, (m,). It is signed where the input is
        one number, else the root of the sum of squares over its elements.
        """
        moved = np.sqrt(self.variance) if self.moved is None else self.moved
        return moved / self.standard


def lines(
    problem: Likelihood,
    g: FloatArray,
    parts: Sequence[Component],
    scatter: Noise,
    slope: FloatArray,
    further: Mapping[str, slice] | None = None,
) -> list[Line]:
    """Budget lines of all parts of the problem's covariance.

    Parameters
    ----------
    g : (m, n)
        Linear estimators, such as `JointInformation.gain`.
    parts, scatter, slope
        What the covariance was assembled from; `parts` in the order of their columns.
    further : mapping of str to slice
        Further sources, as columns of the covariance's shared unknowns.
    """
    whole, data, squares = problem.covariance, problem.data, g**2
    visit = np.unique(data.visit, return_inverse=True)[1]

    def less(variance: FloatArray) -> FloatArray:
        return np.maximum(whole.variance - variance, LEAST_VARIANCE)

    def independent(name: str, variance: FloatArray) -> Line:
        return Line(name, squares @ variance, replace(whole, variance=less(variance)))

    def shared(name: str, which: slice) -> Line:
        moved = g @ whole.shared[:, which]
        rest = replace(whole, shared=np.delete(whole.shared, which, axis=1))
        single = moved[:, 0] if moved.shape[1] == 1 else None
        return Line(name, (moved**2).sum(axis=1), rest, kind="B", moved=single)

    def of_visits(x: FloatArray) -> FloatArray:
        return np.asarray((group_sums(x, visit) ** 2).sum(axis=1), dtype=np.float64)

    record2 = (data.u_lift_N / data.lift_N) ** 2
    record, each = independent(RECORD_NOISE, record2), squares * record2
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = (each**2 / np.maximum(data.n_eff - 1, 1)).sum(axis=1)
        record_dof = np.nan_to_num(record.variance**2 / spread, nan=np.inf)
    relative2 = np.full(data.n, scatter.relative**2)
    force2 = (scatter.force_N / data.lift_N) ** 2
    sizes = {
        "relative": squares @ relative2,
        "force_N": squares @ force2,
        "height_m": of_visits(scatter.height_m * g * slope),
        "common": of_visits(scatter.common * g),
    }
    for k, (size, age) in enumerate(zip(scatter.drift, ages(data).T, strict=False)):
        sizes[f"drift{k}"] = size**2 * _drifted(g, age)
    listed = [replace(record, standard=float(np.sqrt(np.mean(record2))), dof=record_dof)]
    known: dict[str, Any]
    for name, standard, unit, scope, known in (
        ("relative", scatter.relative, "1", "trial", {"variance": less(relative2)}),
        ("force_N", scatter.force_N, "N", "trial", {"variance": less(force2)}),
        ("height_m", scatter.height_m, "m", "visit", {"per_visit": np.zeros(data.n)}),
        ("common", scatter.common, "1", "visit", {"common": 0.0}),
        ("drift", scatter.drift_rms, "1", "campaign", {"drift": 0 * whole.drift}),
    ):
        mine = {key: size for key, size in sizes.items() if key.startswith(name)}
        variance, spread = sum(mine.values(), np.zeros(len(g))), _spread(scatter, mine, len(g))
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = np.where(spread > 0, 2 * variance**2 / spread, scatter.dof)
        without = replace(whole, **known)
        listed.append(
            Line(SCATTER_NAMES[name], variance, without, standard, unit, scope, dof=dof, sizes=mine)
        )
    assumed = whole.variance - trial_variance(data, scatter)
    for part, which in _columns(data, parts):
        variance = independent_variance(data, part, slope)
        assumed = assumed - variance
        grouped = part.scope in GROUPED
        listed.append(
            replace(
                shared(part.name, which) if grouped else independent(part.name, variance),
                kind="A" if part.is_measured else "B",
                standard=part.size(data),
                unit=UNITS[part.on][0],
                scope=part.scope,
                distribution=part.distribution,
            )
        )
    # the variance floor, where nothing scatters at all
    if np.any(assumed > 1e-3 * whole.variance):
        listed.append(independent("least scatter assumed", np.maximum(assumed, 0.0)))
    # further sources have no input of their own
    for name, which in (further or {}).items():
        listed.append(replace(shared(name, which), unit="", scope="", distribution=""))
    return [line for line in listed if line.standard > 0]


def _columns(data: Observations, parts: Sequence[Component]) -> Iterator[tuple[Component, slice]]:
    """Each component and its shared unknowns, none for an independent one."""
    stop = 0
    for part in parts:
        start = stop
        if part.scope in GROUPED:
            stop += int(groups(data, part.scope).max()) + 1
        yield part, slice(start, stop)


def _drifted(g: FloatArray, age: FloatArray) -> FloatArray:
    """Variance (m,) of estimators g (m, n) by a drift of unit size; `age` (n,) as in `Covariance`,
    in run order.
    """
    memory = np.exp(-np.abs(np.diff(age, prepend=age[:1])))
    memory[:1] = 0.0
    one, x = np.ones((len(age), 1)), np.ascontiguousarray(g.T)
    product = semiseparable.product(one, memory[:, None], x)
    return np.asarray(np.maximum(np.einsum("nm,nm->m", x, product), 0.0))


def _spread(scatter: Noise, sizes: Mapping[str, FloatArray], m: int) -> FloatArray:
    """Variance (m,) of the estimated sum of some variances `sizes` of the scatter."""
    k = len(scatter.sizes)
    by_size = np.array([sizes.get(name, np.zeros(m)) for name in scatter.sizes]).reshape(k, m)
    log_covariance = np.array(scatter.log_covariance).reshape(k, k)
    return np.asarray(4 * np.einsum("im,ij,jm->m", by_size, log_covariance, by_size))


def u_without(
    problem: Likelihood, jacobian: FloatArray, budget: Sequence[Line], u: FloatArray
) -> dict[str, FloatArray]:
    """Standard uncertainty of each coefficient, (p,), were one source known exactly, by its name.

    The trials are then weighted again: sources are correlated through the fit, so the variance
    falls by more or less than the source's contribution. `u` (p,) are those of the fit, to which
    the result is scaled.
    """

    def spread(covariance: Covariance) -> FloatArray:
        joint = joint_information(replace(problem, covariance=covariance), jacobian)
        return np.sqrt(np.diag(joint.parameter_covariance))

    whole = spread(problem.covariance)
    scale = u / np.where(whole > 0, whole, 1.0)
    return {
        line.component: np.zeros(len(u)) if line.without is None else scale * spread(line.without)
        for line in budget
    }


def effective_dof(budget: Sequence[Line], scatter: Noise) -> FloatArray:
    """Welch-Satterthwaite degrees of freedom (m,) of a budget, at least `LEAST_DOF`.

    The formula assumes independent variance estimates. The components of the scatter are estimated
    together, so they are combined with their covariance from the fit of the noise. For independent
    components this is the same formula.
    """
    variance = np.sum([line.variance for line in budget], axis=0)
    sizes = {name: size for line in budget for name, size in line.sizes.items()}
    spread = _spread(scatter, sizes, len(variance))
    for line in budget:
        if not line.sizes.keys() & set(scatter.sizes):
            spread = spread + 2 * line.variance**2 / line.dof
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(spread > 0, np.maximum(2 * variance**2 / spread, LEAST_DOF), np.inf)


class Quantity(NamedTuple):
    """Some of the joint unknowns: their `members`, how a sentence calls them, and the factor to the
    `unit` shown.
    """

    name: str
    members: slice
    called: str
    scale: float
    unit: str


def halvings(fit: LeastSquaresFit) -> dict[str, Halving]:
    """Remedies that would halve the uncertainty of every determined coefficient: measuring another
    quantity, or more trials.

    Sufficient remedies come first; within each group they are ordered by the uncertainty that they
    leave.
    """
    estimates = fit.estimates.values()
    known = [i for i, e in enumerate(estimates) if np.isfinite(e.u) and e.u > 0 and not e.at_bound]
    if not known:
        return {}
    joint = joint_information(fit.problem, fit.problem.jacobian(fit.theta)[:, known])
    others = [Quantity("L_inf", joint.levels, "the L_inf values", 100.0, "%")]
    for part, members in _columns(fit.problem.data, fit.parts):
        if (size := members.stop - members.start) and part.standard:
            _, factor, unit = UNITS[part.on]
            called = f"the {part.name}{' values' if size > 1 else ''}"
            others.append(Quantity(part.name, members, called, factor * part.standard, unit))
    places = list(enumerate(known, joint.parameters.start))
    for at, i in places:
        name, unit = fit.names[i], fit.model.parameters[i].unit
        others.append(Quantity(name, slice(at, at + 1), letter(name), 1.0, unit))
    halving = {}
    for at, i in places:
        scale = float(np.sqrt(fit.covariance[i, i] / joint.covariance[at, at]))
        remedies = [
            _remedy(letter(fit.names[i]), at, other, joint.covariance, scale)
            for other in others
            if other.members.start != at
        ]
        worth = [r for r in remedies if r.u_best < (1 - MIN_REDUCTION) * r.u]
        halving[fit.names[i]] = Halving(
            knowledge=tuple(sorted(worth, key=lambda r: (not np.isfinite(r.needed), r.u_best))),
            repeats=_repeats(letter(fit.names[i]), at, joint, scale),
        )
    return halving


def _variance(covariance: FloatArray, i: int, members: slice) -> Callable[[float], float]:
    """Variance of unknown i as a function of further information on each of `members`."""
    value, vector = np.linalg.eigh(covariance[members, members])
    value = np.maximum(value, 1e-15 * value.max(initial=0.0))
    share = (vector.T @ covariance[members, i]) ** 2
    return lambda x: float(covariance[i, i] - (share * x / (1 + x * value)).sum())


def _remedy(who: str, i: int, other: Quantity, covariance: FloatArray, scale: float) -> Remedy:
    """Effect of a measurement of another quantity on the uncertainty of coefficient i."""
    variance, members = _variance(covariance, i, other.members), other.members
    whole, best = variance(0.0), max(variance(EXACT_INFORMATION), 0.0)
    u, u_best, r = scale * whole**0.5, scale * best**0.5, (1 - best / whole) ** 0.5
    correlated, needed = f"multiple r = {r:.2f}", float("nan")
    if members.stop - members.start == 1:
        correlated = f"r = {signed(float(np.copysign(r, covariance[i, members.start])), 2)}"
    effect = (
        f"With exact {other.name}, u({who}) would be {plain(u_best, 2)} instead of {plain(u, 2)}"
    )
    if best < whole / 4:
        needed = other.scale / _crossing(variance, whole / 4, 1e-35, 1e35) ** 0.5
        size = f"{plain(needed, 2)} {other.unit}".removesuffix(" 1")
        effect = f"Knowing {other.called} independently to {size} would halve u({who})"
    return Remedy(
        quantity=other.name,
        needed=needed,
        u=u,
        u_best=u_best,
        unit=other.unit,
        text=f"{who} correlates with {other.called} ({correlated}). {effect}",
    )


def _repeats(who: str, i: int, joint: JointInformation, scale: float) -> Repeats:
    """Number of repeats of the campaign that would halve the uncertainty of coefficient i.

    N repeats are one campaign, all variances divided by N, with 1/N of the statements' information.
    """
    left = _variance(joint.covariance, i, joint.shared)

    def variance(times: float) -> float:
        return left(1 / times - 1) / times

    whole, limit = variance(1.0), variance(ENDLESS_REPEATS)
    if limit < whole / 4:
        times = _crossing(variance, whole / 4, 1.0, ENDLESS_REPEATS)
        text = f"{plain(times, 3)} times the trials, in the same design, would halve u({who})"
        return Repeats(times=times, text=text)
    text = (
        f"No number of repeats would halve u({who}): shared errors keep it at"
        f" {plain(scale * limit**0.5, 2)} or more, from {plain(scale * whole**0.5, 2)}"
    )
    return Repeats(times=float("inf"), text=text)


def _crossing(f: Callable[[float], float], value: float, low: float, high: float) -> float:
    """Argument from `low` to `high` at which a monotone `f` has a value."""
    from scipy.optimize import brentq

    def above(log: float) -> float:
        return f(float(np.exp(log))) - value

    return float(np.exp(brentq(above, float(np.log(low)), float(np.log(high)), xtol=1e-10)))


def degeneracies(fit: LeastSquaresFit) -> tuple[Degeneracy, ...]:
    """Pairs correlated beyond `DEGENERATE`: parameters with each other, with L_inf, and with a
    height offset or exponent if it were unknown; undetermined parameters first.
    """
    problem, theta, pairs = fit.problem, fit.theta, []
    known = [i for i, e in enumerate(fit.estimates.values()) if np.isfinite(e.u)]
    names = [fit.names[i] for i in known]

    def add(name: str, other: str, r: float, text: str) -> None:
        pairs.append(Degeneracy(pair=(name, other), r=r, text=f"{letter(name)} {text}"))

    for name in fit.names:
        if name not in names:
            add(name, "anything", 1.0, "is not identifiable from these trials")
    if not names:
        return tuple(pairs)
    jacobian = problem.jacobian(theta)[:, known]
    joint = joint_information(problem, jacobian)
    unknowns = np.eye(len(joint.covariance))
    shown = np.vstack([unknowns[joint.parameters], problem.data.shown(unknowns[joint.levels])])
    pairwise = correlation(shown @ joint.covariance @ shown.T)
    others = {name: letter(name) for name in names}
    others |= {f"L_inf at {t:.0%}": f"L_inf at {t:.0%} throttle" for t in problem.data.levels}
    for j, (other, called) in enumerate(others.items()):
        for name, r in zip(names[:j], pairwise[j].tolist(), strict=False):
            if abs(r) > DEGENERATE:
                add(name, other, r, f"and {called} are confounded: r = {signed(r, 3)}")
    columns = {"height offset": problem.height_slope(theta) / 1000}
    if "n" not in names:
        columns["exponent n"] = problem.log_ratio(theta)
    for other, column in columns.items():
        freed = joint_information(problem, np.column_stack([jacobian, column]))
        if column.any() and not freed.determined.all():
            add(names[0], other, 1.0, f"and the {other} are not distinguishable in these trials")
            continue
        size = f"{plain(float(freed.u[-1]), 2)}{' mm' if other == 'height offset' else ''}"
        with_other = correlation(freed.parameter_covariance)[-1].tolist()
        for name, r, u in zip(names, with_other, freed.u.tolist(), strict=False):
            if abs(r) > DEGENERATE:
                text = (
                    f"and an unknown {other} are confounded: r = {signed(r, 3)}. With a free"
                    f" {other}, u({letter(name)}) would be {plain(u, 2)} instead of"
                    f" {plain(fit.estimates[name].u, 2)}, and u({other}) = {size}"
                )
                add(name, other, r, text)
    return tuple(pairs)


def correlation(covariance: FloatArray) -> FloatArray:
    """Symmetric correlation matrix of a covariance; 0 off the diagonal where a variance is 0."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(size > 0, size, 1.0)
    unit = 0.5 * (covariance + covariance.T) / np.outer(safe, safe)
    result: FloatArray = np.clip(unit, -1.0, 1.0)
    np.fill_diagonal(result, 1.0)
    return result
