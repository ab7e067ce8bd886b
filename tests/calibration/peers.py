"""Rival methods of picking the missing terms, on the same candidates.

Each gets a `Task`: the trials, the true covariance (as a whitening), the base model linearised at
its fit, and the library as columns. It returns the effects that it adds to the model; none can
answer "adequate" or "unexplained" but by naming nothing.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import statsmodels.api as sm
from scipy.special import softmax
from scipy.stats import multivariate_normal
from sklearn.linear_model import LassoCV
from tests.calibration.bench import Array

Names = tuple[str, ...]
#: Steps of expectation and maximisation; the weights then change in the fourth digit.
STACKING_STEPS = 500


@dataclass(frozen=True, kw_only=True)
class Task:
    """Trials, shape (n,); the fitted base curve `ratio` and its `jacobian` d log ratio / d theta,
    (n, p); `whiten` applies the inverse square root of the covariance of log lift; `columns` (n, k)
    are the candidates `names`, scaled to unit rms.
    """

    lift_N: Array
    z_hat: Array
    level: Array
    ratio: Array
    jacobian: Array
    whiten: Callable[[Array], Array]
    names: Names
    columns: Array

    @cached_property
    def fixed(self) -> Array:
        """Whitened columns of L_inf per throttle and of theta."""
        return self.whiten(np.hstack([np.eye(self.level.max() + 1)[self.level], self.jacobian]))

    @cached_property
    def projected(self) -> tuple[Array, Array]:
        """Log lift and candidates, whitened, with L_inf per throttle and theta projected out."""
        q, _ = np.linalg.qr(self.fixed)
        y, x = self.whiten(np.log(self.lift_N / self.ratio)), self.whiten(self.columns)
        return y - q @ (q.T @ y), x - q @ (q.T @ x)

    def named(self, chosen: list[int] | Array) -> Names:
        """Names of these columns."""
        return tuple(self.names[i] for i in chosen)


def stepwise_p(task: Task, threshold: float = 0.05) -> Names:
    """Forward selection with backward checks at p < 0.05 on Delta L = L / L_far - 1, errors taken
    as independent.
    """
    far = task.z_hat == task.z_hat.max()
    levels = range(task.level.max() + 1)
    reference = np.array([task.lift_N[far & (task.level == k)].mean() for k in levels])
    response = task.lift_N / reference[task.level] - task.ratio / task.ratio[far].mean()
    fixed = np.column_stack([np.ones(len(response)), task.jacobian * task.ratio[:, None]])

    def p_values(chosen: list[int]) -> Array:
        found = sm.OLS(response, np.hstack([fixed, task.columns[:, chosen]])).fit()
        return np.nan_to_num(found.pvalues[fixed.shape[1] :], nan=1.0)

    chosen: list[int] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _ in range(2 * len(task.names)):
            p = {i: p_values([*chosen, i])[-1] for i in range(len(task.names)) if i not in chosen}
            if not p or min(p.values()) >= threshold:
                break
            chosen.append(min(p, key=lambda i: p[i]))
            kept = p_values(chosen)
            chosen = [i for i, value in zip(chosen, kept, strict=True) if value < threshold]
    return task.named(chosen)


def _stepwise(task: Task, price: float) -> Names:
    """Forward and backward steps on n log(RSS) + price x unknowns, whitened data."""
    y, x = task.projected

    def cost(chosen: list[int]) -> float:
        left = y - x[:, chosen] @ np.linalg.lstsq(x[:, chosen], y, rcond=None)[0]
        return len(y) * float(np.log(left @ left)) + price * len(chosen)

    chosen: list[int] = []
    best = cost(chosen)
    for _ in range(3 * len(task.names)):
        moves = [[*chosen, i] for i in range(len(task.names)) if i not in chosen]
        moves += [[i for i in chosen if i != gone] for gone in chosen]
        costs = [cost(move) for move in moves]
        if not moves or min(costs) >= best - 1e-9:
            break
        best, chosen = min(costs), moves[int(np.argmin(costs))]
    return task.named(chosen)


def lasso_cv(task: Task) -> Names:
    """Cross-validated Lasso on whitened data; whatever is not exactly zero is chosen."""
    y, x = task.projected
    x = x / np.maximum(np.sqrt((x**2).mean(axis=0)), 1e-12)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = LassoCV(cv=5, fit_intercept=False, max_iter=20000, alphas=60).fit(x, y)
    return task.named(np.flatnonzero(found.coef_))


def models_up_to(task: Task, largest: int) -> list[list[int]]:
    """Every set of up to `largest` effects, by their places."""
    count = range(len(task.names))
    return [list(m) for k in range(largest + 1) for m in itertools.combinations(count, k)]


def bic_weights(task: Task, largest: int) -> tuple[list[list[int]], Array]:
    """Models of up to `largest` effects, and their probabilities by BIC."""
    (y, x), models = task.projected, models_up_to(task, largest)
    gram, cross, n = x.T @ x, x.T @ y, len(y)
    rss = [
        y @ y - cross[m] @ np.linalg.lstsq(gram[np.ix_(m, m)], cross[m], rcond=1e-10)[0]
        for m in models
    ]
    size = np.array([len(m) for m in models])
    score = -0.5 * (n * np.log(np.maximum(rss, 1e-300)) + np.log(n) * size)
    return models, softmax(score)


def bic_average(task: Task, largest: int = 3) -> Names:
    """Bayesian model average by BIC over all models of up to `largest` effects; those with
    inclusion above one half.
    """
    models, weight = bic_weights(task, largest)
    inclusion = [sum(weight[[i in m for m in models]]) for i in range(len(task.names))]
    return task.named(np.flatnonzero(np.array(inclusion) > 0.5))


def stacking_weights(task: Task, fold: Array, largest: int = 2) -> tuple[list[list[int]], Array]:
    """Models of up to `largest` effects, and weights of the greatest log score on the folds left
    out (Yao, Vehtari, Simpson and Gelman 2018, Bayesian Analysis 13, 917).
    """
    models = models_up_to(task, largest)
    y, x = task.whiten(np.log(task.lift_N / task.ratio)), task.whiten(task.columns)
    score = np.array([_held_out(y, np.hstack([task.fixed, x[:, m]]), fold) for m in models])
    density, weight = softmax(score, axis=0), np.full(len(models), 1 / len(models))
    for _ in range(STACKING_STEPS):
        weight = weight * np.mean(density / (weight @ density), axis=1)
    return models, weight


def _held_out(y: Array, design: Array, fold: Array) -> Array:
    """Log predictive density of each fold by a linear fit to all others, of unit noise."""
    information, cross, each = design.T @ design, design.T @ y, []
    for part in (fold == f for f in np.unique(fold)):
        mine, theirs = design[part], y[part]
        cov = np.linalg.pinv(information - mine.T @ mine, rcond=1e-12, hermitian=True)
        mean = mine @ (cov @ (cross - mine.T @ theirs))
        spread = np.eye(len(theirs)) + mine @ cov @ mine.T
        each.append(multivariate_normal(mean, spread, allow_singular=True).logpdf(theirs))
    return np.array(each)


PEERS: dict[str, Callable[[Task], Names]] = {
    "stepwise p < 0.05 on Delta L, independent errors": stepwise_p,
    "stepwise AIC, full covariance": lambda task: _stepwise(task, 2.0),
    "stepwise BIC, full covariance": lambda task: _stepwise(task, float(np.log(len(task.lift_N)))),
    "Lasso, cross-validated": lasso_cv,
    "Bayesian model average, inclusion > 0.5": bic_average,
}
