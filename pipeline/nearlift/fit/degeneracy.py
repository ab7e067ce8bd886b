"""Degenerate pairs of quantities: so strongly correlated that trials hardly separate them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.likelihood.problem import Problem
from nearlift.nomenclature import letter
from nearlift.results.fit import Degeneracy
from nearlift.rounding import plain, signed

#: Absolute correlation above which a pair is degenerate: knowing one would reduce u of the other to
#: sqrt(1 - r^2) = 0.31 of it.
DEGENERATE = 0.95


def degeneracies(
    problem: Problem,
    theta: FloatArray,
    jacobian: FloatArray,
    covariance: FloatArray,
    determined: NDArray[np.bool_],
) -> tuple[Degeneracy, ...]:
    """Pairs correlated beyond `DEGENERATE`: parameters with each other, with L_inf, and with a
    height offset or exponent if it were unknown; undetermined parameters first.
    """
    data = problem.data
    pairs = [
        Degeneracy(
            pair=(a, "anything"),
            r=1.0,
            text=f"{letter(a)} is not identifiable from these trials",
        )
        for a, known in zip(problem.names, determined, strict=True)
        if not known
    ]
    names = tuple(a for a, known in zip(problem.names, determined, strict=True) if known)
    if not names:
        return tuple(pairs)
    jacobian, covariance = jacobian[:, determined], covariance[np.ix_(determined, determined)]
    sd = np.sqrt(np.diag(covariance))
    # one, the other, what it is called in a sentence, and their correlation
    correlated = [
        (names[j], a, letter(a), covariance[i, j] / (sd[i] * sd[j]))
        for i, a in enumerate(names)
        for j in range(i)
    ]
    toll = problem.d_shown_levels_d_theta(jacobian)
    _, given = problem.log_levels(theta)
    total = given + toll @ covariance @ toll.T
    cross = toll @ covariance
    for level, throttle in enumerate(data.levels):
        inf = f"L_inf at {throttle:.0%}"
        for i, a in enumerate(names):
            r = cross[level, i] / (np.sqrt(total[level, level]) * sd[i])
            correlated.append((a, inf, f"{inf} throttle", r))
    pairs += [
        Degeneracy(
            pair=(a, b),
            r=float(r),
            text=f"{letter(a)} and {called} are confounded: r = {signed(r, 3)}",
        )
        for a, b, called, r in correlated
        if abs(r) > DEGENERATE
    ]
    slope = problem.height_slope(theta)
    for name, unit, column in (
        ("height offset", "mm", slope / 1000),
        ("exponent n", "", problem.log_ratio(theta)),
    ):
        if "n" in names and name == "exponent n":
            continue
        wide = problem.project(np.hstack([jacobian, column[:, None]]).T)
        alone = problem.project(column)
        information = wide @ wide.T
        if not alone @ alone > 0:
            continue
        size = np.sqrt(np.outer(np.diag(information), np.diag(information)))
        if np.linalg.cond(information / size) > 1e12:
            text = f"{letter(names[0])} and the {name} are not distinguishable in these trials"
            pairs.append(Degeneracy(pair=(names[0], name), r=1.0, text=text))
            continue
        joint = np.linalg.inv(information)
        for i, a in enumerate(names):
            r = joint[i, -1] / np.sqrt(joint[i, i] * joint[-1, -1])
            if abs(r) > DEGENERATE:
                u = float(np.sqrt(joint[i, i]))
                sd_free = f"{plain(float(np.sqrt(joint[-1, -1])), 2)} {unit}".strip()
                text = (
                    f"{letter(a)} and an unknown {name} are confounded: r = {signed(r, 3)}. With"
                    f" a free {name}, u({letter(a)}) would be {plain(u, 2)} instead of"
                    f" {plain(sd[i], 2)}, and u({name}) = {sd_free}"
                )
                pairs.append(
                    Degeneracy(pair=(a, name), r=float(r), text=text, u_if_free=u, known_to=sd_free)
                )
    return tuple(pairs)
