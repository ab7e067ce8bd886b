"""How else one might pick the missing terms: rival methods on the same
candidates.

All of them get a `Task`: trials, the true covariance (as a whitening), the base model linearised at
its fit, and the library as columns. Each returns the names that it adds to the model; none can say
"adequate" or "unexplained" but by naming nothing.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

Array = np.ndarray
Peer = Callable[["Task"], tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class Task:
    """What every method is given.

    Attributes
    ----------
    lift_N, z_hat, level : (n,)
        Trials: lift, distance over radius, index of the throttle.
    ratio : (n,)
        The fitted base curve.
    jacobian : (n, p)
        d log ratio / d theta there.
    whiten : callable
        Applies the inverse square root of the covariance of log lift along the first axis.
    candidates : dict of (n,) or (n, k)
        Effect to its column or columns of log lift.
    """

    lift_N: Array
    z_hat: Array
    level: Array
    ratio: Array
    jacobian: Array
    whiten: Callable[[Array], Array]
    candidates: Mapping[str, Array]

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Candidates as (n, k), scaled to unit rms."""
        wide = {
            name: np.asarray(c, dtype=float).reshape(len(self.lift_N), -1)
            for name, c in self.candidates.items()
        }
        return {
            name: c / np.maximum(np.sqrt((c**2).mean(axis=0)), 1e-300) for name, c in wide.items()
        }

    @cached_property
    def projected(self) -> tuple[Array, dict[str, Array]]:
        """Log lift and candidates, whitened, with L_inf per throttle and theta projected out."""
        fixed = self.whiten(np.hstack([np.eye(self.level.max() + 1)[self.level], self.jacobian]))
        q, _ = np.linalg.qr(fixed)
        off = lambda x: x - q @ (q.T @ x)  # noqa: E731
        return off(self.whiten(np.log(self.lift_N) - np.log(self.ratio))), {
            name: off(self.whiten(c)) for name, c in self.columns.items()
        }

    @property
    def taken(self) -> int:
        """Unknowns that the projection has used up."""
        return int(self.level.max()) + 1 + self.jacobian.shape[1]


def stepwise_p(task: Task, threshold: float = 0.05) -> tuple[str, ...]:
    """Forward selection with backward checks at p < 0.05 on Delta L = L / L_far - 1, errors taken
    as independent.
    """
    import statsmodels.api as sm

    far = task.z_hat == task.z_hat.max()
    reference = np.array(
        [task.lift_N[far & (task.level == k)].mean() for k in range(task.level.max() + 1)]
    )
    response = task.lift_N / reference[task.level] - 1 - (task.ratio / task.ratio[far].mean() - 1)
    fixed = np.column_stack([np.ones(len(response)), task.jacobian * task.ratio[:, None]])

    def p_values(names: tuple[str, ...]) -> dict[str, float]:
        design = np.hstack([fixed, *(task.columns[n] for n in names)])
        found = sm.OLS(response, design).fit()
        result, at = {}, fixed.shape[1]
        for name in names:
            k = task.columns[name].shape[1]
            if k == 1:
                result[name] = float(found.pvalues[at])
            else:
                result[name] = float(found.f_test(np.eye(design.shape[1])[at : at + k]).pvalue)
            at += k
        return {name: p if np.isfinite(p) else 1.0 for name, p in result.items()}

    chosen: tuple[str, ...] = ()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _ in range(2 * len(task.columns)):
            trials = {
                name: p_values((*chosen, name))[name] for name in task.columns if name not in chosen
            }
            if not trials or min(trials.values()) >= threshold:
                break
            chosen = (*chosen, min(trials, key=lambda n: trials[n]))
            kept = p_values(chosen)
            chosen = tuple(n for n in chosen if kept[n] < threshold)
    return chosen


def _stepwise(task: Task, price: float) -> tuple[str, ...]:
    """Forward and backward steps on n log(RSS) + price x unknowns, whitened data; statsmodels' AIC
    or BIC up to a constant.
    """
    import statsmodels.api as sm

    y, columns = task.projected
    n = len(y)

    def cost(names: tuple[str, ...]) -> float:
        k = task.taken + sum(columns[m].shape[1] for m in names)
        left = y if not names else sm.OLS(y, np.hstack([columns[m] for m in names])).fit().resid
        return n * float(np.log(left @ left)) + price * k

    chosen: tuple[str, ...] = ()
    best = cost(chosen)
    for _ in range(3 * len(columns)):
        moves = [(*chosen, m) for m in columns if m not in chosen] + [
            tuple(m for m in chosen if m != gone) for gone in chosen
        ]
        costs = [cost(m) for m in moves]
        if not moves or min(costs) >= best - 1e-9:
            break
        best, chosen = min(costs), moves[int(np.argmin(costs))]
    return chosen


def stepwise_aic(task: Task) -> tuple[str, ...]:
    """Stepwise AIC with the full covariance."""
    return _stepwise(task, 2.0)


def stepwise_bic(task: Task) -> tuple[str, ...]:
    """Stepwise BIC with the full covariance."""
    return _stepwise(task, float(np.log(len(task.lift_N))))


def lasso_cv(task: Task) -> tuple[str, ...]:
    """Cross-validated Lasso on whitened data; whatever is not exactly zero is chosen."""
    from sklearn.linear_model import LassoCV

    y, columns = task.projected
    names, x = _flat(columns)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = LassoCV(cv=5, fit_intercept=False, max_iter=20000, alphas=60).fit(x, y)
    return tuple(dict.fromkeys(n for n, c in zip(names, found.coef_, strict=True) if c != 0.0))


def thresholded(task: Task) -> tuple[str, ...]:
    """Sequentially thresholded ridge regression (SINDy), the threshold by five-fold
    cross-validation.
    """
    from sklearn.linear_model import Ridge
    from sklearn.model_selection import KFold

    y, columns = task.projected
    names, x = _flat(columns)

    def run(x: Array, y: Array, threshold: float) -> Array:
        coefficients = Ridge(alpha=1e-3, fit_intercept=False).fit(x, y).coef_
        for _ in range(20):
            alive = np.abs(coefficients) >= threshold
            fresh = np.zeros(x.shape[1])
            if alive.any():
                fresh[alive] = Ridge(alpha=1e-3, fit_intercept=False).fit(x[:, alive], y).coef_
            if np.array_equal(fresh != 0, coefficients != 0):
                return fresh
            coefficients = fresh
        return coefficients

    folds = list(KFold(5, shuffle=True, random_state=0).split(x))
    top = float(np.abs(Ridge(alpha=1e-3, fit_intercept=False).fit(x, y).coef_).max())
    thresholds = top * np.geomspace(1e-3, 1.001, 15)
    errors = [
        sum(float(((y[b] - x[b] @ run(x[a], y[a], t)) ** 2).sum()) for a, b in folds)
        for t in thresholds
    ]
    found = run(x, y, thresholds[int(np.argmin(errors))])
    return tuple(dict.fromkeys(n for n, c in zip(names, found, strict=True) if c != 0.0))


def bic_average(task: Task, largest: int = 3) -> tuple[str, ...]:
    """Bayesian model average by BIC over all models of up to `largest` effects; those with
    inclusion above one half.
    """
    y, columns = task.projected
    names, x = _flat(columns)
    gram, cross, total, n = x.T @ x, x.T @ y, float(y @ y), len(y)
    where = {name: [i for i, m in enumerate(names) if m == name] for name in columns}
    models = [m for k in range(largest + 1) for m in itertools.combinations(columns, k)]
    score = np.empty(len(models))
    for i, model in enumerate(models):
        at = [j for name in model for j in where[name]]
        explained = 0.0
        if at:
            explained = float(
                cross[at] @ np.linalg.lstsq(gram[np.ix_(at, at)], cross[at], rcond=1e-10)[0]
            )
        score[i] = -0.5 * (n * np.log(max(total - explained, 1e-300)) + np.log(n) * len(at))
    weight = np.exp(score - score.max())
    weight /= weight.sum()
    return tuple(
        name
        for name in columns
        if sum(w for m, w in zip(models, weight, strict=True) if name in m) > 0.5
    )


def _flat(columns: Mapping[str, Array]) -> tuple[list[str], Array]:
    """One column after the other, scaled to unit rms after projection, with the effect each belongs
    to.
    """
    names = [name for name, c in columns.items() for _ in range(c.shape[1])]
    x = np.hstack(list(columns.values()))
    return names, x / np.maximum(np.sqrt((x**2).mean(axis=0)), 1e-12)


PEERS: dict[str, Peer] = {
    "stepwise p < 0.05 on Delta L, independent errors": stepwise_p,
    "stepwise AIC, full covariance": stepwise_aic,
    "stepwise BIC, full covariance": stepwise_bic,
    "Lasso, cross-validated": lasso_cv,
    "SINDy-style thresholded least squares": thresholded,
    "Bayesian model average, inclusion > 0.5": bic_average,
}
