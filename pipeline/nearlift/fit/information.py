"""Information of a fit: its uncertainty budget after the GUM, and what would reduce it.

Near its optimum the estimator is linear in the trials' log lift, ``theta = G y`` with ``G = (J' P
J)^-1 J' P``. P is the inverse covariance with L_inf projected out. The covariance is a sum of
sources, ``C = sum C_i``, so the variance is the sum of ``G C_i G'``. No source is left out or
counted twice, and the shares add to one for the estimator that was used.

Coefficients, log L_inf and the stated errors are also unknowns estimated together
(`JointInformation`). The inverse of their information is their covariance. An independent
measurement of a quantity adds to its diagonal element. N repeats of the whole campaign multiply the
trials' information and leave the stated part as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.likelihood import budget, semiseparable
from nearlift.likelihood.budget import GROUPED, INPUTS, Component, groups, independent_variance
from nearlift.likelihood.covariance import LEAST_VARIANCE, Covariance, group_sums
from nearlift.likelihood.noise import trial_variance
from nearlift.likelihood.problem import Likelihood
from nearlift.likelihood.variance_components import ages
from nearlift.nomenclature import letter
from nearlift.results import Noise
from nearlift.results.fit import Degeneracy, Halving, Remedy, Repeats
from nearlift.rounding import plain, signed

if TYPE_CHECKING:
    from nearlift.fit.least_squares import LeastSquaresFit

#: Least effective degrees of freedom: a 90 % interval then has 6.3 standard uncertainties to either
#: side.
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
NAMES = {
    "relative": "proportional scatter",
    "force_N": "force scatter",
    "height_m": "height scatter",
    "common": "visit-to-visit scatter",
    "drift": "slow drift",
}
#: Absolute correlation above which a pair is degenerate: knowing one would reduce u of the other to
#: sqrt(1 - r^2) = 0.31 of it; and above which a remedy calls it confounded (0.44).
DEGENERATE, TRADES = 0.95, 0.9
#: Least relative reduction of an uncertainty for which a remedy is listed; u is printed to two
#: digits.
WORTH = 0.05
#: Number of repeats at which scatter is taken as absent: 1e-4 of its u is left.
MOST_REPEATS = 1e8
#: Fraction of its length that a parameter's row must keep once L_inf is projected out; least
#: eigenvalue of the scaled information along a determined direction; and greatest share of a
#: determined parameter in an undetermined one. The floating-point precision is 2e-16.
KEPT, SEEN, BLIND = 1e-6, 1e-13, 1e-6


def parameter_covariance(
    white: FloatArray, whole: FloatArray | None = None
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Covariance (p, p) of the parameters from their whitened Jacobian (p, n), and a mask of the
    determined ones.

    Undetermined directions are left out of the inverse; an undetermined parameter has infinite
    uncertainty. `whole` (p,) is the length of each row before L_inf was projected out. A parameter
    that keeps none of it, as where all trials are at one distance, is undetermined.
    """
    seen = np.linalg.norm(white, axis=1) > (0.0 if whole is None else KEPT * whole)
    white = np.where(seen[:, None], white, 0.0)
    information = white @ white.T
    size = np.sqrt(np.diag(information))
    unit = np.outer(*[np.where(size > 0, size, 1.0)] * 2)
    value, vector = np.linalg.eigh(information / unit)
    blind = value < SEEN
    inverse = (vector[:, ~blind] / value[~blind]) @ vector[:, ~blind].T
    determined = seen & np.all(np.abs(vector[:, blind]) < BLIND, axis=1)
    return np.asarray(inverse / unit, dtype=np.float64), determined


def gain(problem: Likelihood, theta: FloatArray) -> FloatArray:
    """The linear estimator G, (p, n): change of each coefficient per unit change of each trial's
    log lift, L_inf free.
    """
    white = problem.project(problem.jacobian(theta).T)
    return parameter_covariance(white)[0] @ problem.covariance.unwhiten(white)


@dataclass(frozen=True, slots=True)
class Line:
    """One source of error, for all m coefficients (or other linear estimators) at once.

    Attributes
    ----------
    standard : float
        Standard uncertainty of the input in `unit`; the root mean square where trials or records
        differ.
    kind : str
        ``"A"`` from repeats, ``"B"`` stated.
    covariance : (m, m)
        Contribution to the covariance.
    without : Covariance or None
        Covariance of the trials if the source were known exactly; None where nothing else scatters.
    moved : (m,) or None
        Signed contribution, where the input is one number.
    dof : (m,) or float
        Effective degrees of freedom of the contribution; inf for a stated one.
    sizes : dict of (m,)
        Variance by each component of `Noise`, for lines of the scatter of trials.
    """

    component: str = ""
    standard: float = 1.0
    unit: str = "1"
    scope: str = "trial"
    distribution: str = "normal"
    kind: Literal["A", "B"] = "A"
    covariance: FloatArray = field(kw_only=True)
    without: Covariance | None = field(default=None, kw_only=True)
    moved: FloatArray | None = field(default=None, kw_only=True)
    dof: FloatArray | float = field(default=np.inf, kw_only=True)
    sizes: dict[str, FloatArray] = field(default_factory=dict, kw_only=True)

    @property
    def variance(self) -> FloatArray:
        """Contribution to the variance of each coefficient, (m,)."""
        return np.maximum(np.diag(self.covariance), 0.0)

    @property
    def sensitivity(self) -> FloatArray:
        """Change of each coefficient per unit of the input, (m,). It is signed where the input is
        one number, else the root of the sum of squares over its elements.
        """
        moved = np.sqrt(self.variance) if self.moved is None else self.moved
        return moved / self.standard


def uncertainty_budget(fit: LeastSquaresFit) -> tuple[Line, ...]:
    """The budget of a fit."""
    return lines(fit.problem, gain(fit.problem, fit.theta), fit.parts, fit.noise, fit.slope)


def lines(
    problem: Likelihood,
    g: FloatArray,
    parts: Sequence[Component],
    scatter: Noise,
    slope: FloatArray,
    further: Mapping[str, slice] | None = None,
) -> tuple[Line, ...]:
    """Budget lines of all parts of the problem's covariance.

    Parameters
    ----------
    g : (m, n)
        Linear estimators; see `gain`.
    parts, scatter, slope
        What the covariance was assembled from; `parts` in the order of their columns.
    further : mapping of str to slice
        Further sources, as columns of the covariance's shared unknowns.
    """
    whole, data = problem.covariance, problem.data

    def independent(variance: FloatArray) -> Line:
        rest = replace(whole, variance=np.maximum(whole.variance - variance, LEAST_VARIANCE))
        return Line(covariance=(g * variance) @ g.T, without=rest)

    def shared(which: slice) -> Line:
        moved = g @ whole.shared[:, which]
        return Line(
            covariance=moved @ moved.T,
            without=replace(whole, shared=np.delete(whole.shared, which, axis=1)),
            moved=moved[:, 0] if moved.shape[1] == 1 else None,
        )

    def of_visits(sensitivity: FloatArray, size: float) -> FloatArray:
        moved = size * group_sums(sensitivity, np.unique(data.visit, return_inverse=True)[1])
        return moved @ moved.T

    def of_scatter(name: str, line: Line, sizes: Mapping[str, FloatArray] | None = None) -> Line:
        variances = {k: np.diag(c) for k, c in (sizes or {name: line.covariance}).items()}
        variance, spread = _scatter_variance(scatter, variances, len(g))
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = np.where(spread > 0, 2 * variance**2 / spread, scatter.dof)
        return replace(line, component=NAMES[name], dof=dof, sizes=variances)

    record2 = (data.u_lift_N / data.lift_N) ** 2
    contribution = g**2 * record2
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = (contribution**2 / np.maximum(data.n_eff - 1, 1)).sum(axis=1)
        record_dof = np.nan_to_num(contribution.sum(axis=1) ** 2 / squares, nan=np.inf)
    age = ages(data)
    drifts = {f"drift{k}": size**2 * _drifted(g, age[:, k]) for k, size in enumerate(scatter.drift)}
    relative = independent(np.full(data.n, scatter.relative**2))
    force = independent((scatter.force_N / data.lift_N) ** 2)
    height = Line(
        standard=scatter.height_m,
        unit="m",
        scope="visit",
        covariance=of_visits(g * slope, scatter.height_m),
        without=replace(whole, per_visit=np.zeros(data.n)),
    )
    common = Line(
        standard=scatter.common,
        scope="visit",
        covariance=of_visits(g, scatter.common),
        without=replace(whole, common=0.0),
    )
    drift = Line(
        standard=scatter.drift_rms,
        scope="campaign",
        covariance=sum(drifts.values(), np.zeros((len(g), len(g)))),
        without=replace(whole, drift=0 * whole.drift),
    )
    listed = [
        replace(
            independent(record2),
            component=RECORD_NOISE,
            standard=float(np.sqrt(np.mean(record2))),
            dof=record_dof,
        ),
        of_scatter("relative", replace(relative, standard=scatter.relative)),
        of_scatter("force_N", replace(force, standard=scatter.force_N, unit="N")),
        of_scatter("height_m", height),
        of_scatter("common", common),
        of_scatter("drift", drift, drifts),
    ]
    first, assumed = 0, whole.variance - trial_variance(data, scatter)
    for part in parts:
        variance = independent_variance(data, part, slope)
        assumed = assumed - variance
        if part.scope in GROUPED:
            which = slice(first, first + int(groups(data, part.scope).max()) + 1)
            first, line = which.stop, shared(which)
        else:
            line = independent(variance)
        listed.append(
            replace(
                line,
                component=part.name,
                kind="A" if part.is_measured else "B",
                standard=part.size(data),
                unit=UNITS[part.on][0],
                scope=part.scope,
                distribution=part.distribution,
            )
        )
    # the variance floor, where nothing scatters at all
    if np.any(assumed > 1e-3 * whole.variance):
        floor = independent(np.maximum(assumed, 0.0))
        listed.append(replace(floor, component="least scatter assumed"))
    for name, which in (further or {}).items():
        line = shared(which)
        listed.append(replace(repeated(name, line.covariance), kind="B", without=line.without))
    return tuple(line for line in listed if line.standard > 0)


def repeated(name: str, covariance: FloatArray) -> Line:
    """A line without an input of its own: the only one of coefficients whose covariance (p, p)
    comes from repeats as a whole.
    """
    return Line(component=name, unit="", scope="", distribution="", covariance=covariance)


def _drifted(g: FloatArray, age: FloatArray) -> FloatArray:
    """G M G' (p, p) of a drift of unit size; `age` (n,) as in `Covariance`, in run order."""
    memory = np.exp(-np.abs(np.diff(age, prepend=age[:1])))
    memory[:1] = 0.0
    one = np.ones((len(age), 1))
    return np.asarray(
        g @ semiseparable.product(one, memory[:, None], np.ascontiguousarray(g.T)), dtype=np.float64
    )


def _scatter_variance(
    scatter: Noise, sizes: Mapping[str, FloatArray], p: int
) -> tuple[FloatArray, FloatArray]:
    """Variance due to some components of the scatter, and that of its estimate; (p,) each."""
    index = [i for i, name in enumerate(scatter.sizes) if name in sizes]
    variances = np.array([sizes[scatter.sizes[i]] for i in index]).reshape(len(index), p)
    whole = np.array(scatter.log_covariance).reshape(len(scatter.sizes), len(scatter.sizes))
    spread = whole[np.ix_(index, index)]
    return variances.sum(axis=0), 4 * np.einsum("ip,ij,jp->p", variances, spread, variances)


def u_without(
    problem: Likelihood, theta: FloatArray, budget_lines: Sequence[Line], u: FloatArray
) -> dict[str, FloatArray]:
    """Standard uncertainty of each coefficient, (p,), were one source known exactly, by its name.

    The trials are then weighted again. Sources are correlated through the fit, so it is not the
    variance less the source's contribution. A zero error that adds little may limit the gain by
    knowing another source. `u` (p,) are those of the fit, to which the result is scaled.
    """
    jacobian = problem.jacobian(theta)

    def spread(covariance: Covariance) -> FloatArray:
        white = replace(problem, covariance=covariance).project(jacobian.T)
        return np.sqrt(np.maximum(np.diag(parameter_covariance(white)[0]), 0.0))

    whole = spread(problem.covariance)
    scale = u / np.where(whole > 0, whole, 1.0)
    return {
        line.component: np.zeros(len(u)) if line.without is None else scale * spread(line.without)
        for line in budget_lines
    }


def freedom(
    problem: Likelihood,
    g: FloatArray,
    parts: Sequence[Component],
    scatter: Noise,
    slope: FloatArray,
) -> FloatArray:
    """Effective degrees of freedom (m,) of linear estimators g (m, n) of the trials' log lift."""
    return effective_dof(lines(problem, g, parts, scatter, slope), scatter, len(g))


def effective_dof(budget_lines: Sequence[Line], scatter: Noise, p: int) -> FloatArray:
    """Welch-Satterthwaite degrees of freedom (p,) of a budget, at least `LEAST_DOF`.

    The formula assumes independent variance estimates. The components of the scatter are estimated
    together, so they are combined with their covariance from the fit of the noise. For independent
    components this is the same formula.
    """
    variance: FloatArray = sum((line.variance for line in budget_lines), np.zeros(p))
    sizes = {name: size for line in budget_lines for name, size in line.sizes.items()}
    _, spread = _scatter_variance(scatter, sizes, p)
    for line in budget_lines:
        if not line.sizes.keys() & set(scatter.sizes):
            spread = spread + 2 * line.variance**2 / line.dof
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(spread > 0, np.maximum(2 * variance**2 / spread, LEAST_DOF), np.inf)


class Quantity(NamedTuple):
    """Some of the joint unknowns: their `members`, and the factor to the `unit` shown."""

    name: str
    members: slice
    scale: float
    unit: str


class JointInformation(NamedTuple):
    """Information (q, q) of the trials on coefficients, levels and stated errors, and the diagonal
    (q,) that the statements add.
    """

    trials: FloatArray
    stated: FloatArray
    quantities: list[Quantity]

    def covariance(self, times: float = 1.0) -> FloatArray:
        """Covariance (q, q) from `times` as many trials."""
        information = times * self.trials + np.diag(self.stated)
        size = np.sqrt(np.maximum(np.diag(information), 1e-300))
        unit = np.outer(size, size)
        inverse: FloatArray = np.linalg.pinv(information / unit, rcond=1e-14, hermitian=True) / unit
        return inverse


def joint_information(fit: LeastSquaresFit, which: Sequence[int]) -> JointInformation:
    """Information on the coefficients `which`, the levels, and all errors that trials share."""
    problem, data = fit.problem, fit.problem.data
    quantities = [
        Quantity(fit.names[i], slice(k, k + 1), 1.0, fit.model.parameters[i].unit)
        for k, i in enumerate(which)
    ]
    blocks = [problem.jacobian(fit.theta)[:, list(which)], data.level_design]
    free = first = len(which) + data.unknown_levels
    quantities.append(Quantity("L_inf", slice(len(which), free), 100.0, "%"))
    for part in fit.parts:
        blocks.append(columns := budget.columns(data, part, fit.slope))
        members = slice(first, first + columns.shape[1])
        first = members.stop
        if columns.shape[1] and part.standard:
            _, scale, unit = UNITS[part.on]
            quantities.append(Quantity(part.name, members, scale * part.standard, unit))
    alone = replace(problem.covariance, shared=np.zeros((data.n, 0)))
    white = alone.whiten(np.hstack(blocks).T)
    stated = np.r_[np.zeros(free), np.ones(first - free)]
    return JointInformation(white @ white.T, stated, quantities)


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
    joint = joint_information(fit, known)
    covariance, halving = joint.covariance(), {}
    for k, i in enumerate(known):
        scale = float(np.sqrt(fit.covariance[i, i] / covariance[k, k]))
        remedies = [
            _remedy(fit.names[i], k, len(known), covariance, quantity, scale)
            for quantity in joint.quantities
            if quantity.members.start != k
        ]
        worth = [r for r in remedies if r.u_best < (1 - WORTH) * r.u]
        halving[fit.names[i]] = Halving(
            knowledge=tuple(sorted(worth, key=lambda r: (not np.isfinite(r.needed), r.u_best))),
            repeats=_repeats(fit.names[i], k, joint, scale),
        )
    return halving


def _remedy(
    coefficient: str,
    i: int,
    coefficients: int,
    covariance: FloatArray,
    quantity: Quantity,
    scale: float,
) -> Remedy:
    """How a measurement of one quantity would reduce the uncertainty of coefficient `i`."""
    name, members, factor, unit = quantity
    cross, within = covariance[i, members], covariance[members, members]
    whole, single = float(covariance[i, i]), len(within) == 1
    value, vector = np.linalg.eigh(within)
    share = (vector.T @ cross) ** 2

    def left(variance: float) -> float:
        """Variance of the coefficient once the quantity is measured with this variance."""
        return whole - float((share / np.maximum(value + variance, 1e-300)).sum())

    best, needed = max(left(0.0), 0.0), float("nan")
    if best < whole / 4:
        needed = float(np.sqrt(_crossing(left, whole / 4, -40.0, 40.0))) * factor
    u, u_best = float(scale * np.sqrt(whole)), float(scale * np.sqrt(best))
    who, what, verb = letter(coefficient), f"the {name} values", "correlates with"
    r = float(np.sqrt(max(1 - best / whole, 0.0)))
    correlation = f"multiple r = {r:.2f}"
    if single:
        r = float(cross[0] / np.sqrt(whole * within[0, 0]))
        correlation = f"r = {signed(r, 2)}"
        what = letter(name) if members.start < coefficients else f"the {name}"
        verb = "is confounded with" if abs(r) > TRADES else verb
    words = f"With exact {name}, u({who}) would be {plain(u_best, 2)} instead of {plain(u, 2)}"
    if np.isfinite(needed):
        size = f"{plain(needed, 2)} {'' if unit == '1' else unit}".strip()
        words = f"Knowing {what} independently to {size} would halve u({who})"
    return Remedy(
        quantity=name,
        r=r,
        known_to=float(np.sqrt(np.diag(within).mean())) * factor,
        needed=needed,
        u=u,
        u_best=u_best,
        unit=unit,
        text=f"{who} {verb} {what} ({correlation}). {words}",
    )


def _repeats(coefficient: str, i: int, joint: JointInformation, scale: float) -> Repeats:
    """How often the campaign would have to be repeated to halve the uncertainty."""

    def variance(times: float) -> float:
        return float(joint.covariance(times)[i, i])

    whole, limit = variance(1.0), variance(MOST_REPEATS)
    u, u_limit, who = scale * whole**0.5, scale * limit**0.5, letter(coefficient)
    times = float("inf")
    text = (
        f"No number of repeats would halve u({who}): shared errors keep it at"
        f" {plain(u_limit, 2)} or more, from {plain(u, 2)}"
    )
    if limit < whole / 4:
        times = _crossing(variance, whole / 4, 0.0, float(np.log(MOST_REPEATS)))
        text = f"{plain(times, 3)} times the trials, in the same design, would halve u({who})"
    return Repeats(times=times, text=text)


def _crossing(f: Callable[[float], float], value: float, low: float, high: float) -> float:
    """Argument at which a monotone `f` has a value, searched between the logarithms given."""
    from scipy.optimize import brentq

    return float(np.exp(brentq(lambda x: f(float(np.exp(x))) - value, low, high, xtol=1e-10)))


def degeneracies(fit: LeastSquaresFit) -> tuple[Degeneracy, ...]:
    """Pairs correlated beyond `DEGENERATE`: parameters with each other, with L_inf, and with a
    height offset or exponent if it were unknown; undetermined parameters first.
    """
    problem, data = fit.problem, fit.problem.data
    known = [i for i, e in enumerate(fit.estimates.values()) if np.isfinite(e.u)]
    pairs = [
        Degeneracy(
            pair=(name, "anything"),
            r=1.0,
            text=f"{letter(name)} is not identifiable from these trials",
        )
        for i, name in enumerate(fit.names)
        if i not in known
    ]
    if not known:
        return tuple(pairs)
    p, k = len(known), data.unknown_levels
    covariance = joint_information(fit, known).covariance()[: p + k, : p + k]
    shown = np.zeros((p + len(data.levels), p + k))
    shown[:p, :p], shown[p:, p:] = np.eye(p), data.shown(np.eye(k))
    correlation = _correlation(shown @ covariance @ shown.T)
    names = [fit.names[i] for i in known]
    others = {name: letter(name) for name in names}
    others |= {f"L_inf at {t:.0%}": f"L_inf at {t:.0%} throttle" for t in data.levels}
    for j, (other, called) in enumerate(others.items()):
        for i, name in enumerate(names[:j]):
            r = float(correlation[i, j])
            if abs(r) > DEGENERATE:
                text = f"{letter(name)} and {called} are confounded: r = {signed(r, 3)}"
                pairs.append(Degeneracy(pair=(name, other), r=r, text=text))
    jacobian = problem.jacobian(fit.theta)[:, known].T
    unknown = {"height offset": problem.height_slope(fit.theta) / 1000}
    if "n" not in names:
        unknown["exponent n"] = problem.log_ratio(fit.theta)
    for other, column in unknown.items():
        white = problem.project(np.vstack([jacobian, column]))
        if not white[-1] @ white[-1] > 0:
            continue
        information = white @ white.T
        if np.linalg.cond(_correlation(information)) > 1e12:
            text = f"{letter(names[0])} and the {other} are not distinguishable in these trials"
            pairs.append(Degeneracy(pair=(names[0], other), r=1.0, text=text))
            continue
        covariance = np.linalg.inv(information).astype(np.float64)
        correlation, u = _correlation(covariance), np.sqrt(np.diag(covariance)).tolist()
        size = f"{plain(u[-1], 2)}{' mm' if other == 'height offset' else ''}"
        for i, name in enumerate(names):
            r, who = float(correlation[i, -1]), letter(name)
            now = float(fit.covariance[known[i], known[i]]) ** 0.5
            if abs(r) > DEGENERATE:
                text = (
                    f"{who} and an unknown {other} are confounded: r = {signed(r, 3)}. With a free"
                    f" {other}, u({who}) would be {plain(u[i], 2)} instead of {plain(now, 2)}, and"
                    f" u({other}) = {size}"
                )
                pairs.append(Degeneracy(pair=(name, other), r=r, text=text, u_if_free=u[i]))
    return tuple(pairs)


def _correlation(covariance: FloatArray) -> FloatArray:
    """Correlation matrix of a covariance, or of an information."""
    size = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(size, size), dtype=np.float64)
