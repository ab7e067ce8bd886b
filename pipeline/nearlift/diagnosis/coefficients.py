"""The model's coefficients before and after, with three intervals that answer three different questions."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Effect, FloatArray
from nearlift.diagnosis import discrepancy
from nearlift.diagnosis.candidate import WIDE, Candidate, Fitted, moments
from nearlift.diagnosis.noise_floor import orthonormal
from nearlift.diagnosis.search import Answer, Stage


def spread(stage: Stage, fitted: Fitted, nuisance: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Value and standard uncertainty of the base model's coefficients at a fit.

    `nuisance` (n, t) are columns of further unit-variance unknowns, such as a tube or undetected effects: they widen the
    covariance, and the coefficients move to where the data then want them (one Gauss-Newton step).
    """
    p = len(stage.theta)
    _, sd = fitted.candidate.prior
    mean, _ = fitted.candidate.prior
    weight2 = np.where(np.isfinite(sd), 1 / sd**2, 0.0)
    j, r = fitted.jacobian, fitted.residual
    if nuisance is not None and nuisance.shape[1]:
        white = stage.space.project(nuisance.T).T
        u, s, _ = np.linalg.svd(white, full_matrices=False)
        shrink = s**2 / (1 + s**2)
        j_solved = j - u @ (shrink[:, None] * (u.T @ j))
        information = j.T @ j_solved + np.diag(weight2)
        gradient = j_solved.T @ r - weight2 * np.where(weight2 > 0, fitted.vector - mean, 0.0)
        step = np.linalg.lstsq(information, gradient, rcond=1e-12)[0]
    else:
        information = j.T @ j + np.diag(weight2)
        step = np.zeros(len(fitted.vector))
    covariance = _inverse(information)
    low, high = fitted.candidate.bounds
    value = np.clip(fitted.vector + step, low, high)[:p]
    return value, np.sqrt(np.maximum(np.diag(covariance)[:p], 0))


def joint(stage: Stage, fitted: Fitted, tube: FloatArray | None = None) -> FloatArray:
    """Covariance of everything fitted, coefficients first and the effects' parameters after them as the candidate's slots say: (P, P).

    `tube` (n, t) are unit-variance columns of form uncertainty.
    """
    _, sd = fitted.candidate.prior
    j = fitted.jacobian
    if tube is not None and tube.shape[1]:
        u, s, _ = np.linalg.svd(stage.space.project(tube.T).T, full_matrices=False)
        j = j - u @ ((1 - 1 / np.sqrt(1 + s**2))[:, None] * (u.T @ j))
    return _inverse(j.T @ j + np.diag(np.where(np.isfinite(sd), 1 / sd**2, 0.0)))


def _inverse(information: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    result: FloatArray = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-13) / np.outer(scale, scale)
    return result


def constrained_columns(stage: Stage, chosen: tuple[str, ...], declared: dict[str, float]) -> FloatArray:
    """Every effect that was not named, at its physical prior's size, as unit-variance columns (n, t).

    `declared` overrides the size (in units of the prior) where the bench declares how well it knows an effect.
    """
    columns = [np.zeros((stage.data.n, 0))]
    for effect in {e.name: e for e, _ in stage.library}.values():
        if effect.name in chosen:
            continue
        candidate = Candidate(base=stage.base, effects=(effect,), data=stage.data)
        _, sd = candidate.prior
        sizes = candidate.sizes()
        shapes = [c for e, c in stage.library if e.name == effect.name]
        # one unknown size whose shape is unknown too: each shape carries its share of the variance
        for c in shapes:
            columns.append(c * (sd[sizes] / WIDE) * declared.get(effect.name, 1.0) / np.sqrt(len(shapes)))
    return np.hstack(columns)


def before_and_after(stage: Stage, answer: Answer, declared: dict[str, float]) -> dict[str, Any]:
    """The `coefficients` block of diagnosis.json."""
    from scipy.stats import t

    quantile = float(t.ppf(0.95, stage.noise.dof))
    names = [p.name for p in stage.base.parameters]
    base_value, base_u = spread(stage, stage.base_fit)
    before = {n: {"value": v, "lo90": v - quantile * u, "hi90": v + quantile * u} for n, v, u in zip(names, base_value, base_u, strict=True)}
    best = answer.best
    value, u = spread(stage, best)
    # structure without a name is no noise: it is carried, and the base fit leans away from it
    carried = discrepancy.covariates(answer.first) if answer.verdict == "unexplained" else []
    unnamed = discrepancy.columns(stage, carried) if carried else np.zeros((stage.data.n, 0))
    members = [(e.fitted, e.tube) for e in answer.accepted] or [(stage.base_fit, unnamed)]
    spans = [spread(stage, fitted, tube) for fitted, tube in members]
    if carried:
        value, u = spans[0]
    chosen = answer.accepted[0].effects if answer.accepted else ()
    tube = members[0][1]
    wide_value, wide_u = spread(stage, best, np.hstack([tube, constrained_columns(stage, chosen, declared)]))
    after = {}
    for i, name in enumerate(names):
        ends = [(v[i] - quantile * s[i], v[i] + quantile * s[i]) for v, s in (*spans, (value, u))]
        after[name] = {
            "value": value[i],
            "lo90": min(low for low, _ in ends),
            "hi90": max(high for _, high in ends),
            "conditional": [value[i] - quantile * u[i], value[i] + quantile * u[i]],
            "constrained": [wide_value[i] - quantile * wide_u[i], wide_value[i] + quantile * wide_u[i]],
        }
    return {"before": before, "after": after, "carried": carried}


def silent(stage: Stage, effects: tuple[Effect, ...], limit: float) -> list[dict[str, Any]]:
    """Effects that the coefficients and L_inf absorb, and the bias they may do unseen.

    `bias_at_detection_limit` is the shift of the headline coefficient, in its own standard uncertainties, by an effect just
    too small to be seen (non-centrality 16), or at its physical prior's size where it can never be seen. `u` is that uncertainty, of the
    base fit under the loop's noise floor; the one in fit.json has the noise of repeats.
    """
    from nearlift.diagnosis.search import visibility

    if not stage.base.parameters:
        return []
    jacobian = stage.base_fit.jacobian
    basis = orthonormal(jacobian)
    information = jacobian.T @ jacobian
    covariance = _inverse(information)
    found = []
    for effect in effects:
        columns = [c for e, c in stage.library if e.name == effect.name and c.shape[1] == 1]
        if not columns:
            continue
        share = visibility(stage, effect)
        white = stage.space.project(columns[0].T).T[:, 0]
        left = white - basis @ (basis.T @ white)
        shift = covariance @ jacobian.T @ white / np.sqrt(np.diag(covariance))
        most = int(np.argmax(np.abs(shift)))
        prior_size = _size(effect)
        hidden = share < limit
        size = prior_size if hidden else min(4.0 / max(float(np.linalg.norm(left)), 1e-300), prior_size)
        if np.linalg.norm(white) == 0:
            continue
        if hidden or abs(shift[most]) * size > 1.0:
            found.append(
                {
                    "effect": effect.name,
                    "absorbed_by": stage.base.parameters[most].name,
                    "share_visible": share,
                    "bias_at_detection_limit": float(abs(shift[0]) * size),
                    "in_units_of": f"u({stage.base.parameters[0].name})",
                    "u": float(np.sqrt(covariance[0, 0])),
                    "u_of": "base fit, noise floor of the loop",
                    "hidden": hidden,
                }
            )
    return sorted(found, key=lambda f: -f["bias_at_detection_limit"])


def _size(effect: Effect) -> float:
    sizes = [p for p in effect.parameters if not p.grid]
    return moments(sizes[0])[1]
