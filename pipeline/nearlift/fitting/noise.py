"""How trials scatter, from repeats that no model touches where there are enough of them.

Restricted maximum likelihood of variance components - in proportion to lift, additive, height of a visit, common to a visit - about the
mean of each (distance, throttle) cell. A height error of one visit moves all its throttles together, in proportion to the
slope of the curve; that slope is the only thing taken from a model, and only to first order.

Where distances were hardly visited again, what the trials of a visit share is learnt from how whole visits scatter about the fitted
curve: between distances only, trials within a distance keep their cell means. Few visits cannot tell a small size from none, and the
likeliest size is then too often none; the likelihood is multiplied by the root of each of these sizes, which keeps it off zero by about
a standard error (after Chung, Rabe-Hesketh, Dorie, Gelman & Liu 2013, Psychometrika 78, 685, who multiply by the size itself).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray, LiftModel
from nearlift.fitting.covariance import LEAST_VARIANCE, Covariance, group_sums
from nearlift.fitting.problem import height_slope, need
from nearlift.results import IntArray, Noise, Observations

#: Repeats must leave this many degrees of freedom, or the scatter is taken about the model instead.
ENOUGH = 12
#: Said of noise where visits are too few to show what their trials share.
UNSEEN = "what the trials of a visit have in common cannot be told"
#: Power of a visit's sizes by which the likelihood is multiplied where fewer degrees of freedom than `FEW` tell them; by what covers
#: (docs/coverage.md).
OFF_ZERO, FEW = 0.5, 30
#: Few visits are not asked to tell a scatter of stops beyond this part of the least distance.
WORST_STOP = 0.1
#: Cells whose means are taken away at most: what that costs grows with trials times cells.
MOST_CELLS = 400
#: Trials over which noise common to a visit fades: not at all.
WHOLE_VISIT = 1e6


def trial_covariance(
    data: Observations, noise: Noise, slope: FloatArray, shared: FloatArray | None = None, extra: FloatArray | float = 0.0
) -> Covariance:
    """The covariance of log lift that a `Noise` implies; `slope` is d log ratio / dz per metre, `extra` a further variance."""
    own = (data.u_lift_N / data.lift_N) ** 2 + noise.relative**2 + (noise.force_N / data.lift_N) ** 2 + extra
    return Covariance(
        variance=np.maximum(own, LEAST_VARIANCE),
        visit=data.visit,
        per_visit=noise.height_m * slope,
        shared=np.zeros((data.n, 0)) if shared is None else shared,
        serial=noise.serial,
        serial_length=noise.serial_length,
    )


def cells(data: Observations) -> IntArray:
    """Index of each trial's (distance, throttle) cell."""
    cell: IntArray = np.unique(np.stack([data.z_hat, data.throttle]), axis=1, return_inverse=True)[1].astype(np.int64)
    return cell


def estimate(
    data: Observations,
    model: LiftModel,
    parameters: dict[str, float],
    jacobian: FloatArray | None = None,
    shared: FloatArray | None = None,
    extra: FloatArray | float = 0.0,
) -> Noise:
    """Variance components of the trials.

    Parameters
    ----------
    data : Observations
    model, parameters
        Whose slope carries a height error into lift.
    jacobian : (n, p) or None
        d log ratio / d theta; used only where repeats or revisits are too few, when scatter is taken about the fitted model.
    shared, extra
        What the budget declares, as in `trial_covariance`: scatter that it accounts for is not counted again.

    Returns
    -------
    Noise
    """
    from scipy.optimize import minimize

    if (some := _most_visited(data)) is not None:
        few = None if shared is None else shared[some]
        return estimate(data.take(some), model, parameters, None, few, np.broadcast_to(extra, data.n)[some])
    slope = height_slope(model, data, parameters)
    log_lift = np.log(data.lift_N)
    layout = _layout(data, jacobian)
    if not layout.model_free:
        known = {n: need(data, n, model.name) for n in model.needs}
        log_lift = log_lift - np.log(np.asarray(model.evaluate(data.z_hat, **parameters, **known), dtype=float))
    mean = layout.mean
    # the same restricted likelihood for whatever of the mean is taken away first, and nothing large to cancel
    centred = log_lift - mean @ (mean.T @ log_lift)
    dof = max(data.n - mean.shape[1], 1)
    start = max(float(np.sqrt(np.mean(centred**2))), 1e-6)

    def noise_of(sizes: FloatArray) -> Noise:
        named: dict[str, Any] = {name: float(size) for name, size in zip(guess, sizes, strict=True)}
        return replace(Noise(relative=0.0, serial_length=WHOLE_VISIT), **named)

    def deviance(log_sizes: FloatArray) -> float:
        return _deviance(trial_covariance(data, noise_of(np.exp(log_sizes)), slope, shared, extra), mean, centred)[0]

    def with_slope(log_sizes: FloatArray) -> tuple[float, FloatArray]:
        covariance = trial_covariance(data, noise_of(np.exp(log_sizes)), slope, shared, extra)
        value, by_variance, by_visit = _deviance(covariance, mean, centred, acts)
        change = {"relative": by_variance.sum(), "force_N": by_variance @ data.lift_N**-2.0, **dict(zip(acts, by_visit, strict=True))}
        # by the logarithm of a standard deviation: twice its square times the change by variance
        steep = np.array([2 * np.exp(2 * x) * change[name] for name, x in zip(guess, log_sizes, strict=True)])
        return value - 2 * OFF_ZERO * float(of_few @ log_sizes), steep - 2 * OFF_ZERO * of_few

    typical_slope = np.sqrt(np.mean(slope**2))
    guess = {"relative": np.log(start)}
    if layout.repeated:
        guess["force_N"] = np.log(0.3 * start * np.median(data.lift_N))
    if 0 < layout.between < np.inf:
        # what a visit's trials have in common whatever the distance (a drift, a sag) is not a height error
        guess["serial"] = np.log(0.3 * start)
        if typical_slope > 0:
            guess["height_m"] = np.log(0.5 * start / typical_slope)
    acts = {name: act for name, act in (("serial", np.ones(data.n)), ("height_m", slope)) if name in guess}
    of_few = np.array([float(layout.between < FEW and name in acts) for name in guess])
    bounds = {name: (g - 9, g + 4) for name, g in guess.items()}
    if "height_m" in guess and layout.between < FEW:
        # visits that tell next to nothing of it would let it grow to where no slope could carry it
        most = float(np.log(WORST_STOP * data.z_hat.min() * data.radius_m))
        bounds["height_m"] = (min(bounds["height_m"][0], most - 9), min(bounds["height_m"][1], most))
        guess["height_m"] = min(guess["height_m"], most - 1)
    # the slope in closed form: differences leave the minimum where their rounding puts it, and the order of trials would show
    found = minimize(with_slope, list(guess.values()), method="L-BFGS-B", jac=True, bounds=list(bounds.values()))
    # a component at the bottom of its range is indistinguishable from none
    at_floor = found.x <= np.array([b[0] for b in bounds.values()]) + 0.5
    seen = [i for i in range(len(guess)) if not at_floor[i]]
    inside = [i for i in seen if found.x[i] < list(bounds.values())[i][1] - SMALL]
    best = _settled(lambda x: with_slope(x)[1], np.asarray(found.x, dtype=np.float64), inside)
    spread = _log_covariance(deviance, np.where(at_floor, -np.inf, best), seen)
    return replace(
        noise_of(np.where(at_floor, 0.0, np.exp(best))),
        source=layout.source,
        dof=float(dof),
        sizes=tuple(name for i, name in enumerate(guess) if i in seen),
        log_covariance=tuple(tuple(float(x) for x in row) for row in spread),
        between=layout.between,
    )


def _deviance(
    covariance: Covariance, mean: FloatArray, centred: FloatArray, acts: dict[str, FloatArray] | None = None
) -> tuple[float, FloatArray, FloatArray]:
    """Minus twice the restricted log likelihood, and its change with each trial's variance (n,) and with what a visit shares by `acts`.

    With P = C^-1 - U U', U the part of C^-1 that the mean takes, the change with a component V is tr(P V) - y' P V P y.
    Without `acts` the changes are not worked out.
    """
    from scipy.linalg import solve_triangular

    x, white = covariance.whiten(mean.T), covariance.whiten(centred)
    try:
        triangle = np.linalg.cholesky(x @ x.T)
    except np.linalg.LinAlgError:
        triangle = np.linalg.qr(x.T)[1].T
    diagonal = np.abs(np.diag(triangle))
    explained = solve_triangular(triangle, x @ white, lower=True, check_finite=False)
    value = float(covariance.log_det + 2 * np.log(np.maximum(diagonal, 1e-30)).sum() + white @ white - explained @ explained)
    if acts is None:
        return value, np.zeros(0), np.zeros(0)
    rows = solve_triangular(triangle, x, lower=True, check_finite=False)
    # C^-1 is the visits' own precision less what the shared unknowns take; then the mean's part and the data's, all as columns
    taken = np.vstack([covariance.unwhiten(rows), covariance.unwhiten(white - explained @ rows)[None], covariance.shared_precision()])
    by_variance, by_visit = -np.sum(taken**2, axis=0), np.zeros(len(acts))
    for index, precision in covariance.precision_blocks():
        by_variance[index] += np.diagonal(precision, axis1=1, axis2=2)
        for i, act in enumerate(acts.values()):
            h = act[index]
            by_visit[i] += np.sum(h * (precision @ h[:, :, None])[:, :, 0]) - np.sum(np.einsum("kmi,mi->km", taken[:, index], h) ** 2)
    return value, by_variance, by_visit


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """About which mean (an orthonormal basis, (n, q)) the trials' scatter is taken, and what of it that can show.

    `model_free`: cell means alone; `repeated`: trials repeat within cells often enough to part force from proportion; `between`: degrees of
    freedom between visits (inf where trials share no visit, so that there is nothing to tell).
    """

    mean: FloatArray
    model_free: bool
    repeated: bool
    between: float
    source: str


def _layout(data: Observations, jacobian: FloatArray | None) -> _Layout:
    label, visit = cells(data), np.unique(data.visit, return_inverse=True)[1]
    repeats, again = _repeats(label, visit)
    about_cells = f"scatter of repeats about cell means ({repeats} degrees of freedom)"
    many = label.max() >= MOST_CELLS
    if repeats >= ENOUGH and again >= ENOUGH and not many:
        return _Layout(mean=_basis(np.eye(label.max() + 1)[label]), model_free=True, repeated=True, between=again, source=about_cells)
    curve = np.eye(len(data.levels))[data.level]
    if jacobian is not None:
        curve = np.hstack([curve, jacobian])
    curve = _basis(curve)
    about_curve = "scatter about the fitted model (too few repeats)"
    if not np.isfinite(again):
        return _Layout(mean=curve, model_free=False, repeated=False, between=np.inf, source=about_curve)
    between = _gained(curve, visit)
    if repeats >= ENOUGH and not many:
        # what throttles make of a distance stays free; how far distances lie apart is the curve's to say
        distance = np.unique(data.z_hat, return_inverse=True)[1]
        share, cell = (_basis(np.eye(x.max() + 1)[x]) for x in (distance, label))
        wider = _basis(np.hstack([curve, cell - share @ (share.T @ cell)]))
        # unless visits of a distance ran other throttles, when it would take what tells of visits
        if _gained(wider, visit) == between:
            curve, about_curve = wider, about_cells
    if between < 1:
        told = f"{UNSEEN} ({visit.max() + 1} visits, none to spare): every interval has no end"
    else:
        told = f"what the trials of a visit have in common from the scatter of {visit.max() + 1} visits about the fitted curve"
        told += f" ({between:.0f} degrees of freedom; revisits alone leave {again:.0f})"
    return _Layout(mean=curve, model_free=False, repeated=repeats >= ENOUGH, between=between, source=f"{about_curve}; {told}")


def _repeats(cell: IntArray, visit: IntArray) -> tuple[int, float]:
    """Degrees of freedom within cells, and those between visits that cell means leave; inf where no two trials share a visit."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    n, count, visits = len(cell), int(cell.max()) + 1, int(visit.max()) + 1
    if visits == n:
        return n - count, np.inf
    # what the two sets of indicators span in common: the indicators of what neither of them parts
    met = csr_array((np.ones(n), (cell, count + visit)), shape=(count + visits, count + visits))
    return n - count, float(visits - connected_components(met, directed=False)[0])


def _most_visited(data: Observations) -> NDArray[np.bool_] | None:
    """The trials of the stations visited most, where the cells of all are more than `MOST_CELLS` and repeats at those tell enough."""
    label = cells(data)
    if label.max() < MOST_CELLS:
        return None
    station = np.unique(data.z_hat, return_inverse=True)[1]
    visits, each = (np.bincount(np.unique(np.stack([station, of]), axis=1)[0]) for of in (data.visit, label))
    order = np.argsort(-visits, kind="stable")
    some = np.isin(station, order[np.cumsum(each[order]) <= MOST_CELLS])
    if not some.any():
        return None
    repeats, again = _repeats(*(np.unique(x[some], return_inverse=True)[1] for x in (label, data.visit)))
    return some if repeats >= ENOUGH and again >= ENOUGH else None


def _gained(mean: FloatArray, visit: IntArray) -> float:
    """Degrees of freedom between visits that a mean (an orthonormal basis) leaves."""
    along = group_sums(mean.T, visit) / np.sqrt(np.bincount(visit))
    return float(visit.max() + 1 - (np.linalg.eigvalsh(along @ along.T) > 1 - 1e-9).sum())


#: A step in the logarithm of a size that may be a last one.
SMALL = 0.05


def _settled(gradient: Callable[[FloatArray], FloatArray], at: FloatArray, inside: list[int]) -> FloatArray:
    """Newton's steps in the log sizes named by `inside` from a minimum to where the gradient vanishes.

    A search stops where the deviance, a large number, no longer falls, and where exactly depends on the processor.
    """
    if not inside:
        return at
    unit = np.eye(len(at))[inside] * 1e-4
    curved = np.array([(gradient(at + u) - gradient(at - u))[inside] for u in unit]) / 2e-4
    if np.linalg.eigvalsh(curved + curved.T).min() <= 0:
        return at
    for _ in range(3):
        step = np.linalg.solve(curved, -gradient(at)[inside])
        if not np.abs(step).max() < SMALL:
            break
        at = at + step @ np.eye(len(at))[inside]
    return at


#: Step in the logarithm of a size by which the deviance's curvature is taken.
STEP = 0.1


def _log_covariance(deviance: Callable[[FloatArray], float], at: FloatArray, seen: list[int]) -> FloatArray:
    """Covariance of the log sizes named by `seen`, from the curvature of the restricted deviance (twice its inverse)."""
    unit = np.eye(len(at))[seen] * STEP
    top = deviance(at)
    curved = np.zeros((len(seen), len(seen)))
    for i, a in enumerate(unit):
        curved[i, i] = deviance(_moved(at, a)) + deviance(_moved(at, -a)) - 2 * top
        for j, b in enumerate(unit[:i]):
            mixed = sum(s * deviance(_moved(at, a + s * b)) - s * deviance(_moved(at, s * b - a)) for s in (1, -1))
            curved[i, j] = curved[j, i] = mixed / 4
    value, vector = np.linalg.eigh(curved / STEP**2)
    # a direction without curvature is one that the repeats say nothing about: known to a factor of e, no better
    result: FloatArray = (vector * (2 / np.maximum(value, 2.0))) @ vector.T
    return result


def _moved(at: FloatArray, step: FloatArray) -> FloatArray:
    return np.where(np.isfinite(at), at + step, at)


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal columns that span the same, (n, rank)."""
    u, size, _ = np.linalg.svd(columns, full_matrices=False)
    result: FloatArray = u[:, size > 1e-9 * size[0]]
    return result
