"""How much of an effect the coefficients and the lift far away leave to be seen."""

from __future__ import annotations

import numpy as np

from nearlift.declare import Effect
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.search_problem import SearchProblem

#: An effect whose columns keep less than this share of their energy beside theta and L_inf cannot
#: be seen.
SILENT = 1e-4


def visibility(stage: SearchProblem, effect: Effect) -> float:
    """Largest share of the energy of an effect's columns that theta and L_inf leave, over its
    shapes.
    """
    shares, basis = [], orthonormal(stage.base_fit.jacobian)
    for e, columns in stage.library:
        if e.name == effect.name:
            whole = stage.space.covariance.whiten(columns.T).T
            white = stage.space.project(columns.T).T
            left = white - basis @ (basis.T @ white)
            shares.append(float(np.sum(left**2) / max(np.sum(whole**2), 1e-300)))
    return max(shares, default=0.0)
