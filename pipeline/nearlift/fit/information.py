"""Information of a fit: its uncertainty budget after the GUM, and what would reduce it.

Near its optimum the estimator is linear in the trials' log lift, ``theta = G y`` with ``G = (J' P
J)^-1 J' P``. P is the inverse covariance with L_inf projected out. The covariance is a sum of
sources, ``C = sum C_i``, so the variance is the sum of ``G C_i G'``. No source is left out or
counted twice, and the shares add to one for the estimator that was used.

Coefficients, log L_inf and the stated errors are also unknowns estimated together (`Joint`). The
inverse of their information is their covariance. An independent measurement of a quantity adds to
its diagonal element. N repeats of the whole campaign multiply the trials' information and leave the
stated part as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.likelihood import budget, semiseparable
from nearlift.likelihood.budget import GROUPED, INPUTS, Component, groups, independent_variance
from nearlift.likelihood.covariance import LEAST_VARIANCE, Covariance, group_sums
from nearlift.likelihood.noise import trial_variance
from nearlift.likelihood.problem import Problem
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
#: Unit of a component's standard uncertainty, by what it is on.
UNITS = {
    "height": "m",
    "force": "N",
    "gain": "1",
    "linearity": "N",
    "zero": "N",
    "lag": "s",
    **dict.fromkeys(INPUTS, "1"),
}
#: Line of the noise within each trial's own record.
RECORD_NOISE = "noise within a record"
#: Lines of the components of `Noise`.
NAMES = {
    "relative": "proportional scatter",
    "force_N": "force scatter",
    "height_m": "height scatter",
    "common": "visit-to-visit scatter",
    "drift": "slow drift",
}
#: Absolute correlation above which a pair is degenerate: knowing one would reduce u of the other to
#: sqrt(1 - r^2) = 0.31 of it.
DEGENERATE = 0.95
#: Least relative reduction of an uncertainty for which a remedy is listed; u is printed to two
#: digits.
WORTH = 0.05
#: Number of repeats that stands for no scatter at all.
MOST_REPEATS = 1e8
#: Absolute correlation above which two quantities are called confounded.
TRADES = 0.9
#: Factor and unit in which the error of an input is shown.
SCALES = {
    "height": (1e3, "mm"),
    "force": (1e3, "mN"),
    "linearity": (1e3, "mN"),
    "gain": (1e2, "%"),
    **dict.fromkeys(INPUTS, (1e2, "%")),
}


def parameter_covariance(
    white: FloatArray, whole: FloatArray | None = None
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Covariance (p, p) of the parameters from their whitened Jacobian (p, n), and a mask of the
    determined ones.

    Undetermined directions are left out of the inverse; an undetermined parameter has infinite
    uncertainty. `whole` (p,) is the length of each row before L_inf was projected out. A parameter
    that keeps none of it, as where all trials are at one distance, is undetermined.
    """
    seen = np.linalg.norm(white, axis=1) > (0.0 if whole is None else 1e-6 * whole)
    white = np.where(seen[:, None], white, 0.0)
    information = white @ white.T
    size = np.sqrt(np.diag(information))
    scale = np.where(size > 0, size, 1.0)
    value, vector = np.linalg.eigh(information / np.outer(scale, scale))
    blind = value < 1e-13
    inverse = (vector[:, ~blind] / value[~blind]) @ vector[:, ~blind].T
    determined = seen & np.all(np.abs(vector[:, blind]) < 1e-6, axis=1)
    return np.asarray(inverse / np.outer(scale, scale), dtype=np.float64), determined


def gain(problem: Problem, theta: FloatArray) -> FloatArray:
    """The linear estimator G, (p, n): change of each coefficient per unit change of each trial's
    log lift, L_inf free.
    """
    white = problem.project(problem.jacobian(theta).T)
    covariance, _ = parameter_covariance(white)
    return np.asarray(covariance @ problem.covariance.unwhiten(white), dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One source of error, for all m coefficients (or other linear estimators) at once.

    Attributes
    ----------
    kind : str
        ``"A"`` from repeats, ``"B"`` stated.
    standard : float
        Standard uncertainty of the input in `unit`; the root mean square where trials or records
        differ.
    covariance : (m, m)
        Contribution to the covariance.
    without : Covariance or None
        Covariance of the trials if the source were known exactly; None where nothing else scatters.
    sensitivity : (m,)
        Change of each coefficient per unit of the input, signed where the input is one number.
        Else it is the root of the sum of squares over the input's elements. In both cases
        ``|sensitivity| standard`` is the contribution.
    dof : (m,)
        Effective degrees of freedom of the contribution; inf for a stated one.
    sizes : dict of (m,)
        Variance by each component of `Noise`, for lines of the scatter of trials.
    """

    component: str
    kind: Literal["A", "B"]
    distribution: str = "normal"
    scope: str = "trial"
    standard: float
    unit: str = "1"
    covariance: FloatArray
    without: Covariance | None
    sensitivity: FloatArray
    dof: FloatArray
    sizes: dict[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def from_contribution(
        cls, component: str, kind: Literal["A", "B"], standard: float, **more: Any
    ) -> Line:
        """A line from its contribution, by default of a stated error."""
        u = np.sqrt(np.maximum(np.diag(more["covariance"]), 0.0))
        usual = {
            "sensitivity": u / standard if standard > 0 else np.zeros(len(u)),
            "dof": np.full(len(u), np.inf),
        }
        return cls(component=component, kind=kind, standard=standard, **(usual | more))


def uncertainty_budget(fit: LeastSquaresFit) -> tuple[Line, ...]:
    """The budget of a fit."""
    return lines(fit.problem, gain(fit.problem, fit.theta), fit.parts, fit.noise, fit.slope)


def lines(
    problem: Problem,
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
    budget_lines, first = _repeats(problem, g, scatter, slope), 0
    assumed = whole.variance - trial_variance(data, scatter)
    for part in parts:
        variance, standard = independent_variance(data, part, slope), part.size(data)
        assumed = assumed - variance
        if part.scope in GROUPED:
            which = slice(first, first + int(groups(data, part.scope).max()) + 1)
            moved, first = g @ whole.shared[:, which], which.stop
            covariance, without = moved @ moved.T, _less(whole, which)
        else:
            moved = np.zeros((len(g), 0))
            covariance, without = _independent(whole, g, variance)
        line = Line.from_contribution(
            part.name,
            "A" if part.is_measured else "B",
            standard,
            unit=UNITS[part.on],
            scope=part.scope,
            distribution=part.distribution,
            covariance=covariance,
            without=without,
        )
        if moved.shape[1] == 1 and standard > 0:
            line = replace(line, sensitivity=moved[:, 0] / standard)
        budget_lines.append(line)
    # the variance floor, where nothing scatters at all
    if np.any(assumed > 1e-3 * whole.variance):
        covariance, without = _independent(whole, g, np.maximum(assumed, 0.0))
        budget_lines.append(
            Line.from_contribution(
                "least scatter assumed", "A", 1.0, covariance=covariance, without=without
            )
        )
    for name, which in (further or {}).items():
        moved = g @ whole.shared[:, which]
        budget_lines.append(
            Line.from_contribution(
                name,
                "B",
                1.0,
                unit="",
                scope="",
                distribution="",
                covariance=moved @ moved.T,
                without=_less(whole, which),
            )
        )
    return tuple(line for line in budget_lines if line.standard > 0)


def _independent(
    whole: Covariance, g: FloatArray, variance: FloatArray
) -> tuple[FloatArray, Covariance]:
    """Contribution of a variance (n,) of each trial alone, and the covariance without it."""
    rest = np.maximum(whole.variance - variance, LEAST_VARIANCE)
    contribution: FloatArray = (g * variance) @ g.T
    return contribution, replace(whole, variance=rest)


def _less(whole: Covariance, which: slice) -> Covariance:
    """The covariance without some of its shared unknowns."""
    return replace(whole, shared=np.delete(whole.shared, which, axis=1))


def repeated(name: str, u: FloatArray) -> Line:
    """The only line of coefficients whose uncertainties `u` (p,) come from repeats as a whole."""
    return Line.from_contribution(
        name, "A", 1.0, unit="", scope="", distribution="", covariance=np.diag(u**2), without=None
    )


def u_without(
    problem: Problem, theta: FloatArray, budget_lines: Sequence[Line], u: FloatArray
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


def _repeats(problem: Problem, g: FloatArray, scatter: Noise, slope: FloatArray) -> list[Line]:
    """Lines of the noise within records and of the scatter of trials and visits."""
    data, whole = problem.data, problem.covariance
    record = data.u_lift_N / data.lift_N
    contribution = g**2 * record**2
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = (contribution**2 / np.maximum(data.n_eff - 1, 1)).sum(axis=1)
        dof = np.nan_to_num(contribution.sum(axis=1) ** 2 / squares, nan=np.inf)
    rms = float(np.sqrt(np.mean(record**2)))
    covariance, without = _independent(whole, g, record**2)
    within = Line.from_contribution(
        RECORD_NOISE, "A", rms, dof=dof, covariance=covariance, without=without
    )
    visit, age = np.unique(data.visit, return_inverse=True)[1], ages(data)
    by_height, by_common = group_sums(g * slope, visit), group_sums(g, visit)
    drift = {f"drift{k}": size**2 * _drifted(g, age[:, k]) for k, size in enumerate(scatter.drift)}
    relative = _independent(whole, g, np.full(data.n, scatter.relative**2))
    force = _independent(whole, g, (scatter.force_N / data.lift_N) ** 2)
    total_drift = float(np.sqrt(np.sum(np.square(scatter.drift))))
    listed = [within]
    for kind, scope, standard, unit, each, without in (
        ("relative", "trial", scatter.relative, "1", *relative),
        ("force_N", "trial", scatter.force_N, "N", *force),
        (
            "height_m",
            "visit",
            scatter.height_m,
            "m",
            by_height @ by_height.T * scatter.height_m**2,
            replace(whole, per_visit=np.zeros(data.n)),
        ),
        (
            "common",
            "visit",
            scatter.common,
            "1",
            by_common @ by_common.T * scatter.common**2,
            replace(whole, common=0.0),
        ),
        ("drift", "campaign", total_drift, "1", drift, replace(whole, drift=0 * whole.drift)),
    ):
        parts = each if isinstance(each, dict) else {kind: each}
        sizes = {name: np.diag(c) for name, c in parts.items()}
        variance, known = _scatter_variance(scatter, sizes, len(g))
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = np.where(known > 0, 2 * variance**2 / known, scatter.dof)
        covariance = sum(parts.values(), np.zeros((len(g), len(g))))
        listed.append(
            Line.from_contribution(
                NAMES[kind],
                "A",
                standard,
                unit=unit,
                scope=scope,
                covariance=covariance,
                without=without,
                dof=dof,
                sizes=sizes,
            )
        )
    return listed


def _drifted(g: FloatArray, age: FloatArray) -> FloatArray:
    """G M G' (p, p) of a drift of unit size; `age` (n,) as in `Covariance`, in run order."""
    memory = np.exp(-np.abs(np.diff(age, prepend=age[:1])))
    memory[:1] = 0.0
    one = np.ones((len(age), 1))
    return np.asarray(
        g @ semiseparable.product(one, memory[:, None], np.ascontiguousarray(g.T)), dtype=np.float64
    )


def _scatter_variance(
    scatter: Noise, sizes: dict[str, FloatArray], p: int
) -> tuple[FloatArray, FloatArray]:
    """Variance due to some components of the scatter, and that of its estimate; (p,) each."""
    names = [name for name in scatter.sizes if name in sizes]
    index = [scatter.sizes.index(name) for name in names]
    variances = np.array([sizes[name] for name in names]).reshape(len(names), p)
    spread = np.array(scatter.log_covariance).reshape(len(scatter.sizes), len(scatter.sizes))[
        np.ix_(index, index)
    ]
    return variances.sum(axis=0), 4 * np.einsum("ip,ij,jp->p", variances, spread, variances)


def freedom(
    problem: Problem, g: FloatArray, parts: Sequence[Component], scatter: Noise, slope: FloatArray
) -> FloatArray:
    """Effective degrees of freedom (m,) of linear estimators g (m, n) of the trials' log lift."""
    return effective_dof(lines(problem, g, parts, scatter, slope), scatter, len(g))


def effective_dof(budget_lines: Sequence[Line], scatter: Noise, p: int) -> FloatArray:
    """Welch-Satterthwaite degrees of freedom (p,) of a budget, at least `LEAST_DOF`.

    The formula assumes independent variance estimates. The components of the scatter are estimated
    together, so they are combined with their covariance from the fit of the noise. For independent
    components this is the same formula.
    """
    variance: FloatArray = sum((np.diag(line.covariance) for line in budget_lines), np.zeros(p))
    sizes = {name: size for line in budget_lines for name, size in line.sizes.items()}
    _, spread = _scatter_variance(scatter, sizes, p)
    for line in budget_lines:
        if not line.sizes.keys() & set(scatter.sizes):
            spread = spread + 2 * np.diag(line.covariance) ** 2 / line.dof
    return np.where(
        spread > 0,
        np.maximum(2 * variance**2 / np.where(spread > 0, spread, 1.0), LEAST_DOF),
        np.inf,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """Some of the joint unknowns: their `members`, and the factor to the `unit` shown."""

    name: str
    members: slice
    scale: float = 1.0
    unit: str = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """Information (q, q) of the trials on coefficients, levels and stated errors, and the diagonal
    (q,) that the statements add.
    """

    trials: FloatArray
    stated: FloatArray
    quantities: tuple[Quantity, ...]

    @classmethod
    def from_fit(cls, fit: LeastSquaresFit, which: Sequence[int]) -> Joint:
        """Information on the coefficients `which`, the levels, and all errors that trials share."""
        problem, data, p = fit.problem, fit.problem.data, len(which)
        quantities = [
            Quantity(name=fit.names[i], members=slice(k, k + 1), unit=fit.model.parameters[i].unit)
            for k, i in enumerate(which)
        ]
        blocks = [problem.jacobian(fit.theta)[:, list(which)], data.level_columns]
        first = p + data.unknown_levels
        quantities.append(Quantity(name="L_inf", members=slice(p, first), scale=100.0, unit="%"))
        for part in fit.parts:
            columns = budget.columns(data, part, fit.slope)
            members = slice(first, first + columns.shape[1])
            if columns.shape[1] and part.standard:
                scale, unit = SCALES[part.on]
                scale *= part.standard
                quantities.append(Quantity(name=part.name, members=members, scale=scale, unit=unit))
            blocks.append(columns)
            first = members.stop
        alone = replace(problem.covariance, shared=np.zeros((data.n, 0)))
        white = alone.whiten(np.hstack(blocks).T)
        stated = np.ones(len(white))
        stated[: p + data.unknown_levels] = 0.0
        return cls(trials=white @ white.T, stated=stated, quantities=tuple(quantities))

    def covariance(self, times: float = 1.0) -> FloatArray:
        """Covariance (q, q) from `times` as many trials."""
        information = times * self.trials + np.diag(self.stated)
        size = np.sqrt(np.maximum(np.diag(information), 1e-300))
        inverse: FloatArray = np.linalg.pinv(
            information / np.outer(size, size), rcond=1e-14, hermitian=True
        ) / np.outer(size, size)
        return inverse


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
    joint = Joint.from_fit(fit, known)
    covariance, halving = joint.covariance(), {}
    for k, i in enumerate(known):
        scale = float(np.sqrt(fit.covariance[i, i] / covariance[k, k]))
        listed = [
            _remedy(fit.names[i], k, len(known), covariance, quantity, scale)
            for quantity in joint.quantities
            if quantity.members.start != k
        ]
        worth = [r for r in listed if r.u_best < (1 - WORTH) * r.u]
        halving[fit.names[i]] = Halving(
            knowledge=tuple(sorted(worth, key=lambda r: (not np.isfinite(r.needed), r.u_best))),
            repeats=_campaigns(fit.names[i], k, joint, scale),
        )
    return halving


def _remedy(
    coefficient: str,
    i: int,
    coefficients: int,
    joint: FloatArray,
    quantity: Quantity,
    scale: float,
) -> Remedy:
    """How a measurement of one quantity would reduce the uncertainty of coefficient `i`."""
    members, name = quantity.members, quantity.name
    cross, within, whole = joint[i, members], joint[members, members], float(joint[i, i])
    value, vector = np.linalg.eigh(within)
    share = (vector.T @ cross) ** 2

    def left(variance: float) -> float:
        """Variance of the coefficient once the quantity is measured with this variance."""
        return whole - float((share / np.maximum(value + variance, 1e-300)).sum())

    best, needed = max(left(0.0), 0.0), float("nan")
    if best < whole / 4:
        needed = np.sqrt(_crossing(left, whole / 4, -40.0, 40.0)) * quantity.scale
    single = len(cross) == 1
    r = (
        float(cross[0] / np.sqrt(whole * within[0, 0]))
        if single
        else float(np.sqrt(max(1 - best / whole, 0.0)))
    )
    u, u_best = float(scale * np.sqrt(whole)), float(scale * np.sqrt(best))
    who = letter(coefficient)
    what, each = f"the {name} values", name
    if single:
        what = letter(name) if members.start < coefficients else f"the {name}"
    words = f"With exact {each}, u({who}) would be {plain(u_best, 2)} instead of {plain(u, 2)}"
    if np.isfinite(needed):
        size = f"{plain(needed, 2)}{'' if quantity.unit == '1' else f' {quantity.unit}'}"
        words = f"Knowing {what} independently to {size} would halve u({who})"
    verb = "is confounded with" if single and abs(r) > TRADES else "correlates with"
    correlation = f"r = {signed(r, 2)}" if single else f"multiple r = {r:.2f}"
    return Remedy(
        quantity=name,
        r=r,
        known_to=float(np.sqrt(np.diag(within).mean())) * quantity.scale,
        needed=needed,
        u=u,
        u_best=u_best,
        unit=quantity.unit,
        text=f"{who} {verb} {what} ({correlation}). {words}",
    )


def _campaigns(coefficient: str, i: int, joint: Joint, scale: float) -> Repeats:
    """How often the campaign would have to be repeated to halve the uncertainty."""

    def variance(times: float) -> float:
        return float(joint.covariance(times)[i, i])

    whole, limit = variance(1.0), variance(MOST_REPEATS)
    u, u_limit = scale * whole**0.5, scale * limit**0.5
    who = letter(coefficient)
    if limit >= whole / 4:
        text = (
            f"No number of repeats would halve u({who}): shared errors keep it at"
            f" {plain(u_limit, 2)} or more, from {plain(u, 2)}"
        )
        return Repeats(times=float("inf"), u_limit=u_limit, text=text)
    times = _crossing(variance, whole / 4, 0.0, float(np.log(MOST_REPEATS)))
    text = f"{plain(times, 3)} times the trials, in the same design, would halve u({who})"
    return Repeats(times=times, u_limit=u_limit, text=text)


def _crossing(f: Callable[[float], float], value: float, low: float, high: float) -> float:
    """Argument at which a monotone `f` has a value, searched between the logarithms given."""
    from scipy.optimize import brentq

    root = brentq(lambda x: f(float(np.exp(x))) - value, low, high, xtol=1e-10)
    return float(np.exp(root))


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
    names = [fit.names[i] for i in known]
    covariance = Joint.from_fit(fit, known).covariance()[: p + k, : p + k]
    shown = np.zeros((p + len(data.levels), p + k))
    shown[:p, :p], shown[p:, p:] = np.eye(p), data.shown(np.eye(k))
    correlation = _correlation(shown @ covariance @ shown.T)
    others = [(names[i], letter(names[i]), i) for i in range(p)]
    for j, throttle in enumerate(data.levels):
        level = f"L_inf at {throttle:.0%}"
        others.append((level, f"{level} throttle", p + j))
    for other, called, j in others:
        for i, name in enumerate(names):
            r = float(correlation[i, j])
            if i < j and abs(r) > DEGENERATE:
                text = f"{letter(name)} and {called} are confounded: r = {signed(r, 3)}"
                pairs.append(Degeneracy(pair=(name, other), r=r, text=text))
    free = {"height offset": ("mm", problem.height_slope(fit.theta) / 1000)}
    if "n" not in names:
        free["exponent n"] = "", problem.log_ratio(fit.theta)
    for other, (unit, column) in free.items():
        pairs += _if_unknown(fit, known, other, unit, column)
    return tuple(pairs)


def _if_unknown(
    fit: LeastSquaresFit, known: list[int], other: str, unit: str, column: FloatArray
) -> Iterator[Degeneracy]:
    """Coefficients that a further unknown with this effect on log lift (n,) would be confounded
    with.
    """
    white = fit.problem.project(np.vstack([fit.problem.jacobian(fit.theta)[:, known].T, column]))
    if not white[-1] @ white[-1] > 0:
        return
    first = fit.names[known[0]]
    information = white @ white.T
    if np.linalg.cond(_correlation(information)) > 1e12:
        text = f"{letter(first)} and the {other} are not distinguishable in these trials"
        yield Degeneracy(pair=(first, other), r=1.0, text=text)
        return
    covariance: FloatArray = np.linalg.inv(information).astype(np.float64)
    correlation, u = _correlation(covariance), np.sqrt(np.diag(covariance))
    known_to = f"{plain(float(u[-1]), 2)} {unit}".strip()
    for k, i in enumerate(known):
        name, r, now = fit.names[i], float(correlation[k, -1]), float(fit.covariance[i, i]) ** 0.5
        if abs(r) > DEGENERATE:
            who = letter(name)
            text = (
                f"{who} and an unknown {other} are confounded: r = {signed(r, 3)}. With a free"
                f" {other}, u({who}) would be {plain(float(u[k]), 2)} instead of {plain(now, 2)},"
                f" and u({other}) = {known_to}"
            )
            yield Degeneracy(
                pair=(name, other), r=r, text=text, u_if_free=float(u[k]), known_to=known_to
            )


def _correlation(covariance: FloatArray) -> FloatArray:
    """Correlation matrix of a covariance, or of an information."""
    size = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(size, size), dtype=np.float64)
