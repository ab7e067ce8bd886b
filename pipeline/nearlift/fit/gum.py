"""Uncertainty budget of a fit after the GUM: each source's contribution to each variance.

Near its optimum the estimator is linear in the trials' log lift, ``theta = G y`` with ``G = (J' P
J)^-1 J' P``. P is the inverse covariance with L_inf projected out. The covariance is a sum of
parts, ``C = sum C_i``, so the variance is the sum of ``G C_i G'``. No part is left out or counted
twice, and the shares add to one for the estimator that was used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood import semiseparable
from nearlift.likelihood.budget import GROUPED, INPUTS, Component, groups, independent_variance
from nearlift.likelihood.covariance import group_sums
from nearlift.likelihood.noise import trial_variance
from nearlift.likelihood.problem import Problem
from nearlift.likelihood.variance_components import ages
from nearlift.results import Noise, Observations

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One source of error, for all p coefficients at once.

    Attributes
    ----------
    component, distribution, scope, unit : str
        `unit` is that of `standard`.
    kind : str
        ``"A"`` from repeats, ``"B"`` declared.
    standard : float
        Standard uncertainty of the input; the root mean square where trials or records differ.
    covariance : (p, p)
        Contribution to the covariance of the coefficients.
    sensitivity : (p,)
        Change of each coefficient per unit of the input: signed where the input is one number, else
        the root of the sum of squares over its elements. ``|sensitivity| standard`` is the
        contribution in both cases.
    dof : (p,)
        Effective degrees of freedom of the contribution; inf for a declared one.
    sizes : dict of (p,)
        Variance by each component of `Noise`, for lines of the scatter of trials.
    """

    component: str
    kind: Literal["A", "B"]
    distribution: str
    scope: str
    standard: float
    unit: str
    covariance: FloatArray
    sensitivity: FloatArray
    dof: FloatArray
    sizes: dict[str, FloatArray] = field(default_factory=dict)


def gain(problem: Problem, theta: FloatArray) -> FloatArray:
    """The linear estimator G, (p, n): change of each coefficient per unit change of each trial's
    log lift, L_inf free.
    """
    jacobian = problem.jacobian(theta)
    white = problem.project(jacobian.T)
    return np.asarray(
        inverse_information(white) @ problem.covariance.unwhiten(white), dtype=np.float64
    )


def inverse_information(white: FloatArray) -> FloatArray:
    """Covariance (p, p) of the coefficients from their whitened Jacobian (p, n)."""
    size = np.linalg.norm(white, axis=1)
    scale = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(
        (white / scale[:, None]) @ (white / scale[:, None]).T, rcond=1e-13, hermitian=True
    )
    return np.asarray(inverse / np.outer(scale, scale), dtype=np.float64)


def uncertainty_budget(fit: LeastSquaresFit) -> tuple[Line, ...]:
    """The budget of a fit."""
    return lines(fit.problem, gain(fit.problem, fit.theta), fit.parts, fit.noise, fit.slope)


def lines(
    problem: Problem, g: FloatArray, parts: Sequence[Component], scatter: Noise, slope: FloatArray
) -> tuple[Line, ...]:
    """Budget lines of all parts of the problem's covariance.

    Parameters
    ----------
    g : (p, n)
        See `gain`.
    parts, scatter, slope
        What the covariance was assembled from.
    """
    data = problem.data
    budget = [
        *_repeats(data, g, scatter, slope),
        *(_declared(data, g, part, slope) for part in parts),
    ]
    # the variance floor, where nothing scatters at all
    assumed = problem.covariance.variance - sum(
        (independent_variance(data, part, slope) for part in parts), trial_variance(data, scatter)
    )
    if np.any(assumed > 1e-3 * problem.covariance.variance):
        covariance = (g * np.maximum(assumed, 0.0)) @ g.T
        name, infinite = "least scatter assumed", np.full(len(g), np.inf)
        budget.append(_line(name, "A", "normal", "trial", 1.0, "1", covariance, infinite))
    return tuple(line for line in budget if line.standard > 0)


def _repeats(data: Observations, g: FloatArray, scatter: Noise, slope: FloatArray) -> list[Line]:
    record = data.u_lift_N / data.lift_N
    contribution = g**2 * record**2
    with np.errstate(divide="ignore", invalid="ignore"):
        record_dof = contribution.sum(axis=1) ** 2 / (
            contribution**2 / np.maximum(data.n_eff - 1, 1)
        ).sum(axis=1)
    rms, record_dof = float(np.sqrt(np.mean(record**2))), np.nan_to_num(record_dof, nan=np.inf)
    within = (g * record**2) @ g.T
    budget = [_line(RECORD_NOISE, "A", "normal", "trial", rms, "1", within, record_dof)]
    visit, age = np.unique(data.visit, return_inverse=True)[1], ages(data)
    by_height, by_common = group_sums(g * slope, visit), group_sums(g, visit)
    covariances = {
        "relative": scatter.relative**2 * g @ g.T,
        "force_N": (g * (scatter.force_N / data.lift_N) ** 2) @ g.T,
        "height_m": by_height @ by_height.T * scatter.height_m**2,
        "common": by_common @ by_common.T * scatter.common**2,
    }
    for k, size in enumerate(scatter.drift):
        covariances[f"drift{k}"] = size**2 * _drifted(g, age[:, k])
    for kind, scope, standard, unit in (
        ("relative", "trial", scatter.relative, "1"),
        ("force_N", "trial", scatter.force_N, "N"),
        ("height_m", "visit", scatter.height_m, "m"),
        ("common", "visit", scatter.common, "1"),
        ("drift", "campaign", float(np.sqrt(np.sum(np.square(scatter.drift)))), "1"),
    ):
        each = {name: c for name, c in covariances.items() if name.startswith(kind)}
        sizes = {name: np.diag(c) for name, c in each.items()}
        covariance: FloatArray = sum(each.values(), np.zeros((len(g), len(g))))
        variance, known = _scatter_variance(scatter, sizes, len(g))
        with np.errstate(divide="ignore", invalid="ignore"):
            dof = np.where(known > 0, 2 * variance**2 / known, scatter.dof)
        line = _line(NAMES[kind], "A", "normal", scope, standard, unit, covariance, dof)
        budget.append(replace(line, sizes=sizes))
    return budget


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


def _drifted(g: FloatArray, age: FloatArray) -> FloatArray:
    """G M G' (p, p) of a drift of unit size; `age` (n,) as in `Covariance`, in run order."""
    memory = np.exp(-np.abs(np.diff(age, prepend=age[:1])))
    memory[:1] = 0.0
    one = np.ones((len(age), 1))
    return np.asarray(
        g @ semiseparable.product(one, memory[:, None], np.ascontiguousarray(g.T)), dtype=np.float64
    )


def _line(
    name: str,
    kind: Literal["A", "B"],
    distribution: str,
    scope: str,
    standard: float,
    unit: str,
    covariance: FloatArray,
    dof: FloatArray,
) -> Line:
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Line(
        component=name,
        kind=kind,
        distribution=distribution,
        scope=scope,
        standard=standard,
        unit=unit,
        covariance=covariance,
        sensitivity=u / standard if standard > 0 else np.zeros(len(u)),
        dof=dof,
    )


def further(name: str, kind: Literal["A", "B"], moved: FloatArray) -> Line:
    """Line of a source that consists of several unit-variance unknowns; `moved` (p, k) is the
    effect of each on each coefficient.
    """
    return _line(name, kind, "", "", 1.0, "", moved @ moved.T, np.full(len(moved), np.inf))


def _declared(data: Observations, g: FloatArray, part: Component, slope: FloatArray) -> Line:
    never = np.full(len(g), np.inf)
    grouped = part.scope in GROUPED
    size = g * part.sensitivity(data, slope)
    shared = group_sums(size, groups(data, part.scope)) if grouped else np.zeros((len(g), 0))
    covariance = shared @ shared.T + (g * independent_variance(data, part, slope)) @ g.T
    standard = part.size(data)
    line = _line(
        part.name,
        "A" if part.is_measured else "B",
        part.distribution,
        part.scope,
        standard,
        UNITS[part.on],
        covariance,
        never,
    )
    if shared.shape[1] == 1 and standard > 0:
        return replace(line, sensitivity=shared[:, 0] / standard)
    return line


def freedom(
    problem: Problem, g: FloatArray, parts: Sequence[Component], scatter: Noise, slope: FloatArray
) -> FloatArray:
    """Effective degrees of freedom (m,) of linear estimators g (m, n) of the trials' log lift."""
    return effective_dof(lines(problem, g, parts, scatter, slope), scatter, len(g))


def effective_dof(budget: Sequence[Line], scatter: Noise, p: int) -> FloatArray:
    """Welch-Satterthwaite degrees of freedom (p,) of a budget, at least `LEAST_DOF`.

    The formula assumes independent variance estimates. The components of the scatter are estimated
    together, so they are combined with their covariance from the fit of the noise. For independent
    components this is the same formula.
    """
    variance: FloatArray = sum((np.diag(line.covariance) for line in budget), np.zeros(p))
    sizes = {name: size for line in budget for name, size in line.sizes.items()}
    _, spread = _scatter_variance(scatter, sizes, p)
    for line in budget:
        if not line.sizes.keys() & set(scatter.sizes):
            spread = spread + 2 * np.diag(line.covariance) ** 2 / line.dof
    return np.where(
        spread > 0,
        np.maximum(2 * variance**2 / np.where(spread > 0, spread, 1.0), LEAST_DOF),
        np.inf,
    )


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
