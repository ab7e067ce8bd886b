"""Share of an effect's signature that the coefficients and L_inf do not absorb."""

from __future__ import annotations

import numpy as np

from nearlift.declare import Effect
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.search_problem import SearchProblem

#: Visibility below which an effect cannot be detected, a share of squared norm.
SILENT = 1e-4


def visible(problem: SearchProblem) -> tuple[Effect, ...]:
    """The effects of the library that leave a mark."""
    known = {e.name: e for e, _ in problem.library}
    return tuple(e for e in known.values() if visibility(problem, e) > SILENT)


def visibility(problem: SearchProblem, effect: Effect) -> float:
    """Share of the squared norm of an effect's whitened columns outside the span of theta and
    L_inf, the largest over its shapes; 0 without columns.
    """
    shapes = [columns for e, columns in problem.library if e.name == effect.name]
    if not shapes:
        return 0.0
    together = np.hstack(shapes).T
    whole, white = problem.space.covariance.whiten(together), problem.space.project(together)
    basis = orthonormal(problem.base_jacobian)
    left = white - (white @ basis) @ basis.T
    first = np.cumsum([0, *(columns.shape[1] for columns in shapes[:-1])])
    part, of = (np.add.reduceat(np.sum(x**2, axis=1), first) for x in (left, whole))
    return float(np.max(part / np.maximum(of, 1e-300)))
