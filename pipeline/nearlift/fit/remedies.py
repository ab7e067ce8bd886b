"""Remedies that halve a coefficient's uncertainty: measuring another quantity, or more trials.

Coefficients, log L_inf and the budget's shared unknowns, with their declared uncertainty, are
estimated together. The inverse of their information is their covariance. An independent measurement
of a quantity adds to its diagonal element. N repeats of the whole campaign multiply the trials'
information and leave the declared part as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood import budget
from nearlift.nomenclature import letter
from nearlift.results.fit import Halving, Remedy, Repeats
from nearlift.rounding import plain, signed

#: Least relative reduction of an uncertainty for which a remedy is listed; u is printed to two
#: digits.
WORTH = 0.05
#: Absolute correlation above which two quantities are called confounded.
TRADES = 0.9
#: Factor and unit in which the error of an input is shown.
SCALES = {
    "height": (1e3, "mm"),
    "force": (1e3, "mN"),
    "linearity": (1e3, "mN"),
    "gain": (1e2, "%"),
    **dict.fromkeys(budget.INPUTS, (1e2, "%")),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Unknowns:
    """Information (q, q) of the trials on all unknowns, the diagonal of the declared part, and the
    groups of unknowns: name, scale, unit, indices.
    """

    trials: FloatArray
    declared: FloatArray
    groups: tuple[tuple[str, float, str, tuple[int, ...]], ...]

    def covariance(self, times: float = 1.0) -> FloatArray:
        information = times * self.trials + np.diag(self.declared)
        size = np.sqrt(np.maximum(np.diag(information), 1e-300))
        inverse: FloatArray = np.linalg.pinv(
            information / np.outer(size, size), rcond=1e-14, hermitian=True
        ) / np.outer(size, size)
        return inverse


def halvings(fit: LeastSquaresFit) -> dict[str, Halving]:
    """Remedies that would halve the uncertainty of every determined coefficient.

    Sufficient remedies come first; within each group they are ordered by the uncertainty that they
    leave.
    """
    known = [
        i
        for i, e in enumerate(fit.estimates.values())
        if np.isfinite(e.u) and e.u > 0 and not e.at_bound
    ]
    if not known:
        return {}
    unknowns = _unknowns(fit, known)
    joint = unknowns.covariance()
    halving = {}
    for position, i in enumerate(known):
        scale = np.sqrt(fit.covariance[i, i] / joint[position, position])
        listed = [
            _remedy(fit.names[i], position, len(known), joint, group, scale)
            for group in unknowns.groups
            if group[3] != (position,)
        ]
        worth = [r for r in listed if r.u_best < (1 - WORTH) * r.u]
        halving[fit.names[i]] = Halving(
            knowledge=tuple(sorted(worth, key=lambda r: (not np.isfinite(r.needed), r.u_best))),
            repeats=_repeats(fit.names[i], position, unknowns, scale),
        )
    return halving


def _unknowns(fit: LeastSquaresFit, known: list[int]) -> _Unknowns:
    problem = fit.problem
    data, levels = problem.data, problem.data.level_columns.T
    blocks = [problem.jacobian(fit.theta)[:, known], levels.T]
    groups: list[tuple[str, float, str, tuple[int, ...]]] = [
        (fit.names[i], 1.0, fit.model.parameters[i].unit, (k,)) for k, i in enumerate(known)
    ]
    first = len(known)
    groups.append(("L_inf", 100.0, "%", tuple(range(first, first + len(levels)))))
    first += len(levels)
    declared = [0.0] * first
    for part in fit.parts:
        sensitivity = budget.columns(data, part, fit.slope)
        if not sensitivity.shape[1] or not part.standard:
            continue
        (scale, unit), end = SCALES[part.on], first + sensitivity.shape[1]
        groups.append((part.name, scale * part.standard, unit, tuple(range(first, end))))
        blocks.append(sensitivity)
        declared += [1.0] * sensitivity.shape[1]
        first = end
    bare = replace(problem.covariance, shared=np.zeros((data.n, 0)))
    white = bare.whiten(np.hstack(blocks).T)
    return _Unknowns(trials=white @ white.T, declared=np.array(declared), groups=tuple(groups))


def _remedy(
    coefficient: str,
    i: int,
    coefficients: int,
    joint: FloatArray,
    group: tuple[str, float, str, tuple[int, ...]],
    scale: float,
) -> Remedy:
    name, unit_scale, unit, members = group
    rows = list(members)
    cross, within = joint[i, rows], joint[np.ix_(rows, rows)]
    value, vector = np.linalg.eigh(within)
    share = (vector.T @ cross) ** 2
    whole = float(joint[i, i])

    def left(w2: float) -> float:
        return whole - float((share / np.maximum(value + w2, 1e-300)).sum())

    best = max(left(0.0), 0.0)
    needed = float("nan")
    if best < whole / 4:
        low, high = -40.0, 40.0
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (middle, high) if left(np.exp(middle)) < whole / 4 else (low, middle)
        needed = float(np.exp(low / 2)) * unit_scale
    single = len(rows) == 1
    r = (
        float(cross[0] / np.sqrt(whole * within[0, 0]))
        if single
        else float(np.sqrt(max(1 - best / whole, 0.0)))
    )
    u, u_best = float(scale * np.sqrt(whole)), float(scale * np.sqrt(best))
    known_to = float(np.sqrt(np.diag(within).mean())) * unit_scale
    who = letter(coefficient)
    what, each = (
        (letter(name) if rows[0] < coefficients else f"the {name}", name)
        if single
        else (f"the {name} values", name)
    )
    if np.isfinite(needed):
        size = plain(needed, 2) + ("" if unit == "1" else f" {unit}")
        words = f"Knowing {what} independently to {size} would halve u({who})"
    else:
        words = f"With exact {each}, u({who}) would be {plain(u_best, 2)} instead of {plain(u, 2)}"
    verb = "is confounded with" if single and abs(r) > TRADES else "correlates with"
    correlation = f"r = {signed(r, 2)}" if single else f"multiple r = {r:.2f}"
    text = f"{who} {verb} {what} ({correlation}). {words}"
    return Remedy(
        quantity=name,
        r=r,
        known_to=known_to,
        needed=needed,
        u=u,
        u_best=u_best,
        unit=unit,
        text=text,
    )


def _repeats(coefficient: str, i: int, unknowns: _Unknowns, scale: float) -> Repeats:
    whole = unknowns.covariance()[i, i]
    limit = unknowns.covariance(1e8)[i, i]
    u, u_limit = float(scale * np.sqrt(whole)), float(scale * np.sqrt(limit))
    who = letter(coefficient)
    if limit >= whole / 4:
        text = (
            f"No number of repeats would halve u({who}): shared errors keep it at"
            f" {plain(u_limit, 2)} or more, from {plain(u, 2)}"
        )
        return Repeats(times=float("inf"), u_limit=u_limit, text=text)
    low, high = 0.0, float(np.log(1e8))
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (
            (low, middle)
            if unknowns.covariance(np.exp(middle))[i, i] < whole / 4
            else (middle, high)
        )
    times = float(np.exp(high))
    text = f"{plain(times, 3)} times the trials, in the same design, would halve u({who})"
    return Repeats(times=times, u_limit=u_limit, text=text)
