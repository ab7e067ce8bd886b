"""Share of an effect's signature that the coefficients and L_inf do not absorb."""

from __future__ import annotations

import numpy as np

from nearlift.declare import Effect
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.search_problem import SearchProblem

#: Visibility below which an effect cannot be detected, a share of squared norm.
SILENT = 1e-4


def visibility(stage: SearchProblem, effect: Effect) -> float:
    """Share of the squared norm of an effect's whitened columns outside the span of theta and
    L_inf, the largest over its shapes; 0 without columns.
    """
    shares, basis = [], orthonormal(stage.base_fit.jacobian)
    for e, columns in stage.library:
        if e.name == effect.name:
            whole = stage.space.covariance.whiten(columns.T).T
            white = stage.space.project(columns.T).T
            left = white - basis @ (basis.T @ white)
            shares.append(float(np.sum(left**2) / max(np.sum(whole**2), 1e-300)))
    return max(shares, default=0.0)
