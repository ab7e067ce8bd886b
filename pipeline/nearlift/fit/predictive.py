"""Leave-one-visit-out prediction: how well a model predicts each visit of the traverse from all the
others, by `fit.deletion`.

Shared unknowns are estimated from the other visits as far as those determine them. A model is
therefore not scored on the errors alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import deletion
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.results import IntArray
from nearlift.results.fit import ModelScore


@dataclass(frozen=True, slots=True, kw_only=True)
class VisitScores:
    """Predictive scores of each visit given all others; arrays (v,).

    Attributes
    ----------
    visit : int array
        Label, as in the trials.
    log_density : array
        Log predictive density of the visit's log lifts, jointly.
    squares : array
        Sum of squared errors of log lift.
    n : int array
        Trials of the visit.
    skipped : int
        Visits that the others do not determine, such as the only one at some throttle.
    """

    visit: IntArray
    log_density: FloatArray
    squares: FloatArray
    n: IntArray
    skipped: int = 0


def leave_visit_out(fit: LeastSquaresFit) -> VisitScores:
    """Predict each visit of a fit from all the others."""
    visit, density, squares, count, skipped = [], [], [], [], 0
    for block in deletion.visits(fit):
        value, vector = np.linalg.eigh(block.information)
        determined = value.min(axis=1) > deletion.DETERMINED * block.whole
        skipped += int((~determined).sum())
        value, vector, weighed = value[determined], vector[determined], block.weighed[determined]
        turned = np.einsum("mij,mi->mj", vector, weighed)
        error = np.einsum("mij,mj->mi", vector, turned / value)
        size = block.index.shape[1]
        visit.append(fit.problem.data.visit[block.index[determined, 0]])
        density.append(
            0.5
            * (
                np.log(value).sum(axis=1)
                - (turned**2 / value).sum(axis=1)
                - size * np.log(2 * np.pi)
            )
        )
        squares.append((error**2).sum(axis=1))
        count.append(np.full(int(determined.sum()), size, dtype=np.int64))
    order = np.argsort(np.concatenate(visit), kind="stable")
    label, log_density, square, n = (
        np.concatenate(x)[order] for x in (visit, density, squares, count)
    )
    return VisitScores(visit=label, log_density=log_density, squares=square, n=n, skipped=skipped)


def score(scores: VisitScores, reference: VisitScores) -> ModelScore:
    """Scores relative to a reference, over visits in which both predict the same trials."""
    _, rows, other = np.intersect1d(
        scores.visit, reference.visit, assume_unique=True, return_indices=True
    )
    same = scores.n[rows] == reference.n[other]
    rows, other = rows[same], other[same]
    v = len(rows)
    excess = scores.log_density[rows] - reference.log_density[other]
    d_rmse = _rmse(scores, rows) - _rmse(reference, other)
    n, a, b = scores.n[rows], scores.squares[rows], reference.squares[other]
    without = np.sqrt((a.sum() - a) / np.maximum(n.sum() - n, 1)) - np.sqrt(
        (b.sum() - b) / np.maximum(n.sum() - n, 1)
    )
    spread = (
        float(np.sqrt((v - 1) / v * ((without - without.mean()) ** 2).sum()))
        if v > 1
        else float("nan")
    )
    return ModelScore(
        visits=v,
        skipped=scores.skipped,
        elpd=float(scores.log_density[rows].sum()),
        d_elpd=float(excess.sum()),
        u_d_elpd=float(np.sqrt(v) * excess.std(ddof=1)) if v > 1 else float("nan"),
        rmse=_rmse(scores, rows),
        d_rmse=d_rmse,
        u_d_rmse=spread,
    )


def _rmse(held: VisitScores, rows: IntArray) -> float:
    n = int(held.n[rows].sum())
    return float(np.sqrt(held.squares[rows].sum() / n)) if n else float("nan")
