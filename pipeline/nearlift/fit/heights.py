"""Height errors beyond first order: where the slope of the curve is not sufficient, and their
treatment.

The covariance takes a height error e as ``e f'``, f the log ratio. This omits the even part, ``(f(z
+ e) + f(z - e)) / 2 - f(z)``, which does not average to zero. Through the estimator's gain it
shifts each coefficient; where a shift exceeds `LIMIT` standard uncertainties,

- an error that all trials share (a zero error) becomes an unknown with its declared distribution,
  and is integrated over by quadrature;
- errors of several elements (of each stop, each station) keep their covariance, and the prediction
  becomes its mean over them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import gum, solver
from nearlift.likelihood.budget import GROUPED, Component, groups
from nearlift.likelihood.finite import where_finite
from nearlift.likelihood.problem import Problem
from nearlift.results import Noise
from nearlift.results.fit import HeightTreatment

#: Shift of a coefficient, in standard uncertainties, above which the slope does not suffice; it
#: costs a 90 % interval 0.2 % of coverage.
LIMIT = 0.1
#: Standard deviation of the logarithm of a height scatter above which it is too uncertain to
#: correct for.
MAX_LOG_SD = 0.5
#: Number of quadrature nodes.
NODES = 41
#: Fall of the log density beyond which a node is ignored: exp(-16) = 1e-7.
NEGLIGIBLE = 16.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightPlan:
    """Height errors beyond the linear range: shared ones to integrate over, and the rest.

    The rest is a standard deviation over which the prediction is averaged. The assessment of every
    height error is kept.
    """

    shared: tuple[Component, ...] = ()
    blur_m: float = 0.0
    assessments: tuple[HeightTreatment, ...] = ()


def plan_height_errors(
    problem: Problem,
    theta: FloatArray,
    parts: Sequence[Component],
    scatter: Noise,
    slope: FloatArray,
) -> HeightPlan:
    """Assess every height error of a fit, and plan for those that the slope does not carry."""
    data = problem.data
    heights = [c for c in parts if c.on == "height" and c.standard > 0]
    if not len(theta) or not (heights or scatter.height_m):
        return HeightPlan()
    g = gum.gain(problem, theta)
    white = problem.project(problem.jacobian(theta).T)
    u = np.sqrt(np.diag(np.linalg.pinv(white @ white.T, hermitian=True)))
    first = {
        line.component: np.sqrt(np.diag(line.covariance))
        for line in gum.lines(problem, g, parts, scatter, slope)
    }
    # one unknown that all of these trials share
    alone = [c for c in heights if c.scope in GROUPED and groups(data, c.scope).max(initial=0) == 0]
    several = [(c.name, c.standard) for c in heights if c not in alone]
    if scatter.height_m:
        several.append((gum.NAMES["height_m"], scatter.height_m))
    index = scatter.sizes.index("height_m") if "height_m" in scatter.sizes else None
    # a scatter of heights that repeats do not determine cannot be corrected for
    sd_unidentified = index is not None and scatter.log_covariance[index][index] > MAX_LOG_SD**2

    spread = float(np.sqrt(sum(s**2 for _, s in several)))
    # nor is there a mean over heights at which the model has no value; a single wrong lift can make
    # the scatter so large
    mean = (
        bool(several)
        and not sd_unidentified
        and bool(np.isfinite(replace(problem, blur_m=spread).log_ratio(theta)).all())
    )

    def assess(errors: list[tuple[str, float]], treatment: str) -> list[HeightTreatment]:
        """First- and second-order effect on the most affected coefficient of errors of one kind,
        which are judged together.
        """
        together = float(np.sqrt(sum(s**2 for _, s in errors)))
        moved = np.abs(where_finite(lambda x: g @ x, _even(problem, theta, together)))
        # an undetermined coefficient does not shift; any other shifts without limit where the model
        # has no value so far off
        shift = np.where(u > 0, np.nan_to_num(moved, nan=np.inf) / np.where(u > 0, u, 1.0), 0.0)
        worst = int(np.argmax(shift))
        treatments = []
        for name, standard in errors:
            part = float(shift[worst]) * (standard / together) ** 2
            size = float(first[name][worst]) if name in first else 0.0
            treatments.append(
                HeightTreatment(
                    component=name,
                    standard_m=standard,
                    coefficient=problem.names[worst],
                    ratio=part * float(u[worst]) / size if size > 0 else np.inf,
                    shift=part,
                    treatment=treatment if shift[worst] > LIMIT else "slope",
                )
            )
        return treatments

    treatments = assess([(c.name, c.standard) for c in alone], "exact")
    treatments += assess(several, "mean" if mean else "slope")
    exact = {m.component for m in treatments if m.treatment == "exact"}
    return HeightPlan(
        shared=tuple(c for c in alone if c.name in exact),
        blur_m=spread if any(m.treatment == "mean" for m in treatments) else 0.0,
        assessments=tuple(treatments),
    )


def _even(problem: Problem, theta: FloatArray, size_m: float) -> FloatArray:
    """Even part of a height error's effect on log ratio, (n,); nan where it has no value."""
    up, here, down = (problem.log_ratio(theta, e) for e in (size_m, 0.0, -size_m))
    return (up + down) / 2 - here


@dataclass(frozen=True, slots=True, kw_only=True)
class Marginal:
    """A fit with a shared height error integrated over: a mixture of normal distributions, one per
    node.

    Attributes
    ----------
    offset_m, weight : (K,)
        Nodes, and their posterior probability.
    theta : (K, p), covariance : (K, p, p)
        The coefficients at each node.
    best : int
        Index of the node with the highest joint density.
    chi2 : float
        Least chi2, the declared distribution's part included.
    log_integral : float
        Log of the integral of ``exp(-chi2 / 2)`` over the declared distribution, the coefficients
        at their mean.
    """

    offset_m: FloatArray
    weight: FloatArray
    theta: FloatArray
    covariance: FloatArray
    best: int
    chi2: float
    log_integral: float

    @property
    def mean(self) -> FloatArray:
        """Mean of the coefficients, (p,)."""
        return np.asarray(self.weight @ self.theta, dtype=np.float64)

    @property
    def between(self) -> FloatArray:
        """Covariance (p, p) of the coefficients due to the height error."""
        off = self.theta - self.mean
        return np.asarray((self.weight[:, None] * off).T @ off, dtype=np.float64)

    @property
    def within(self) -> FloatArray:
        """Mean covariance (p, p) of the coefficients at a known height."""
        return np.asarray(np.einsum("k,kpq->pq", self.weight, self.covariance), dtype=np.float64)

    def offset(self) -> tuple[float, float]:
        """Posterior mean and standard deviation of the height error, m."""
        mean = float(self.weight @ self.offset_m)
        return mean, float(np.sqrt(self.weight @ (self.offset_m - mean) ** 2))

    def quantile(self, i: int, probability: float, dof: float) -> float:
        """Quantile of coefficient i, with Student's t at each node."""
        from scipy.optimize import brentq
        from scipy.stats import norm, t

        sd = np.sqrt(self.covariance[:, i, i])
        kind = t(dof) if np.isfinite(dof) else norm()
        keep = self.weight > 0
        middle, wide = self.theta[keep, i], sd[keep]

        def excess(x: float) -> float:
            return float(self.weight[keep] @ kind.cdf((x - middle) / wide)) - probability

        reach = 12 * float(wide.max())
        return float(brentq(excess, middle.min() - reach, middle.max() + reach))


def density(parts: Sequence[Component]) -> tuple[Callable[[FloatArray], FloatArray], float]:
    """Density of the sum of shared height errors, per metre, and its effective half-width."""
    from scipy.stats import norm

    sd = float(np.sqrt(sum(c.standard**2 for c in parts if c.distribution == "normal")))
    half = [float(c.standard * np.sqrt(3)) for c in parts if c.distribution == "uniform"]
    reach = 8 * sd + sum(half)
    nodes, weights = np.polynomial.legendre.leggauss(64)

    def convolved(x: FloatArray, boxes: list[float]) -> FloatArray:
        if not boxes:
            return np.asarray(norm.pdf(x, scale=sd), dtype=np.float64)
        first, rest = boxes[0], boxes[1:]
        if rest:
            return np.asarray(
                sum(
                    w / 2 * convolved(x - first * n, rest)
                    for n, w in zip(nodes, weights, strict=True)
                ),
                dtype=np.float64,
            )
        if sd:
            return np.asarray(
                (norm.cdf((x + first) / sd) - norm.cdf((x - first) / sd)) / (2 * first),
                dtype=np.float64,
            )
        return np.where(np.abs(x) <= first, 1 / (2 * first), 0.0)

    return lambda x: convolved(np.asarray(x, dtype=float), half), reach


def integrate(
    problem: Problem, theta: FloatArray, u: FloatArray, parts: Sequence[Component]
) -> Marginal:
    """Integrate over a height error that all trials share; `problem` must not carry it already.

    The range is narrowed to that of the posterior, which may be far narrower than the declared
    distribution.
    """
    from scipy.integrate import trapezoid

    prior, reach = density(parts)

    def at_heights(nodes: FloatArray, start: FloatArray) -> solver.Minima:
        return solver.minimise(
            lambda at, rows: problem.linearised(at, nodes[rows, None]),
            start,
            problem.model.bounds,
            u,
        )

    low, high, start = -reach, reach, np.tile(theta, (NODES, 1))
    for _ in range(5):
        nodes = np.linspace(low, high, NODES)

        minima = at_heights(nodes, start)
        optima, chi2 = minima.theta, minima.chi2
        with np.errstate(divide="ignore"):
            joint = np.log(prior(nodes)) - chi2 / 2
        kept = np.flatnonzero(joint > joint.max() - NEGLIGIBLE)
        if len(kept) > NODES // 2:
            break
        step = nodes[1] - nodes[0]
        low, high = max(nodes[kept[0]] - step, -reach), min(nodes[kept[-1]] + step, reach)
        whole = np.isfinite(chi2)
        start = np.zeros((NODES, len(theta)))
        for i in range(len(theta)):
            start[:, i] = np.interp(np.linspace(low, high, NODES), nodes[whole], optima[whole, i])
    covariance = np.zeros((NODES, len(theta), len(theta)))
    for k in kept:
        white = problem.project(problem.jacobian(optima[k], nodes[k]).T)
        covariance[k] = np.linalg.pinv(white @ white.T, hermitian=True)
    size = np.linalg.slogdet(covariance[kept])[1] / 2
    weight = np.zeros(NODES)
    weight[kept] = np.exp(joint[kept] + size - (joint[kept] + size).max())
    weight[[0, -1]] /= 2
    weight /= weight.sum()
    best = int(kept[np.argmax(joint[kept])])
    mean = weight @ optima
    fine = np.linspace(nodes[kept[0]], nodes[kept[-1]], 401)
    with np.errstate(divide="ignore"):
        along = np.log(prior(fine)) - problem.chi2(np.tile(mean, (len(fine), 1)), fine[:, None]) / 2
    top = along.max()
    log_integral = float(top + np.log(trapezoid(np.exp(along - top), fine)))
    most = float(prior(np.zeros(1))[0])
    penalty = -2 * float(np.log(prior(nodes[best : best + 1])[0] / most))
    return Marginal(
        offset_m=nodes,
        weight=weight,
        theta=optima,
        covariance=covariance,
        best=best,
        chi2=float(chi2[best] + penalty),
        log_integral=log_integral,
    )
