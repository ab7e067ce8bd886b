"""The quantity that a trial holds constant, and the exponent of the lift ratio that follows from
it.

Every published ratio holds something constant: a model of the flow gives g, and lift scales as g^n.
The paper, like Cheeseman and Bennett, takes n = 1. Momentum theory at constant power gives 2/3,
blade-element theory at constant speed 0.60 to 0.82 for a rotor of this size. Lift alone hardly
separates n from the coefficient. Logged quantities can. A quantity q that varies with the load as q
~ (L / L_inf)^s was not held. Lift scales as speed squared and, at fixed flow, as power to 2/3. The
exponent s therefore converts that of theory at constant q into that at constant throttle:

    n = n_speed / (1 - 2 s_speed)        n = (2/3) / (1 - (2/3) s_power)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import solver
from nearlift.fit.information import parameter_covariance
from nearlift.fit.significance import REJECTS, chance, f_test, percent
from nearlift.likelihood import student
from nearlift.likelihood.problem import Problem
from nearlift.results import Estimate, IntArray, Observations
from nearlift.results.assumptions import (
    ExponentFit,
    ExponentRange,
    HeldQuantity,
    LoggedResponse,
)
from nearlift.rounding import plus_minus

#: Plausible exponents, each with its assumption.
PLAUSIBLE = {
    1.0: "the ratio as published",
    0.82: "constant speed, at most",
    2 / 3: "constant power",
    0.6: "constant speed, at least",
}
#: Exponents n at constant speed (blade-element theory, solidity times lift slope 0.75 to 1.14) and
#: at constant power (momentum theory).
SPEED = (0.6, 0.82)
POWER = 2 / 3
#: Exponents at which the curve of the coefficient is drawn.
CURVE = np.round(np.arange(0.5, 1.2001, 0.05), 2)
#: Significance level of the test that a logged quantity was held.
NOT_HELD = 0.01
#: Least denominator of the formulas above: part of the change of lift at constant speed or power.
LEAST_LEFT = 0.1
#: Fewest visits in one session for a response: six are left after a level and a slope.
ENOUGH = 8
FOLLOWS = "The exponent n of the lift ratio depends on what else is constant."
#: What the manifest's `held` means for the exponent.
DECLARED = {
    "throttle": f"Constant throttle fixes neither rotor speed nor power. {FOLLOWS}",
    "voltage": f"Constant voltage fixes neither rotor speed nor power. {FOLLOWS}",
    "rpm": "At constant rotor speed blade-element theory predicts n between 0.60 and 0.82.",
    "power": "At constant power momentum theory predicts n = 2/3.",
}
NAMES = {"speed_Hz": "rotor speed", "power_W": "power", "supply_V": "supply voltage"}


@dataclass(frozen=True, slots=True, kw_only=True)
class AtExponent:
    """The first coefficient with the ratio to the power `n`."""

    n: float
    value: float
    u: float
    chi2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Response of a logged quantity to the boundary at fixed throttle, and its logarithm far from
    the boundary, per throttle (K,), with standard uncertainty `u_log_far`.
    """

    logged: LoggedResponse
    log_far: FloatArray
    u_log_far: FloatArray


def examine(
    problem: Problem, theta: FloatArray, noise_dof: float, reach90: float, declared: str
) -> tuple[HeldQuantity, tuple[Response, ...]]:
    """The first coefficient over the supported exponents, from the published model's optimum (p,).

    The exponents are those that the logs support, else the plausible ones; the responses of the
    logged quantities are included. `reach90` is half of its 90 % interval in standard
    uncertainties, `declared` the held quantity that the manifest states.
    """
    n, u_n, least = free_exponent(problem, theta)
    log_ratio = problem.log_ratio(theta)
    answers = {q: response(problem.data, log_ratio, q) for q in logged(problem.data)}
    responses = tuple(r for r in answers.values() if r is not None)
    implied = {r.logged.quantity: r.logged.exponents for r in responses}
    # power also depends on the motor's efficiency
    supported = implied.get("speed_Hz") or implied.get("power_W")

    def at(exponents: Sequence[float]) -> tuple[ExponentFit, ...]:
        tested = [
            (x, f_test(x.chi2 - least, 1, noise_dof))
            for x in at_exponents(problem, theta, exponents)
        ]
        return tuple(
            ExponentFit.around(
                x.value, x.u, reach90, n=x.n, p_value=test.p_value if test else float("nan")
            )
            for x, test in tested
        )

    plausible = tuple(replace(x, supposes=PLAUSIBLE[x.n]) for x in at(list(PLAUSIBLE)))
    judged = at(supported) if supported else plausible
    held = HeldQuantity(
        declared=declared,
        declared_text=DECLARED[declared],
        coefficient=problem.names[0],
        plausible=plausible,
        exponent_from_lift=Estimate.around(n, u_n, reach90) if np.isfinite(n) else None,
        logged=tuple(r.logged for r in responses),
        supported_exponents=supported,
        range=ExponentRange(
            source="logged quantities" if supported else "plausible exponents",
            low=min(x.value for x in judged),
            high=max(x.value for x in judged),
            lo90=min(x.lo90 for x in judged),
            hi90=max(x.hi90 for x in judged),
        )
        if judged
        else None,
        curve=at(CURVE.tolist()),
        text="",
    )
    unanswered = [NAMES[q] for q, r in answers.items() if r is None and q != "supply_V"]
    return replace(held, text=_words(held, unanswered)), responses


def _words(held: HeldQuantity, unanswered: Sequence[str]) -> str:
    """Effect of the exponent on the coefficient, and the exponents that lift and logs support;
    `unanswered` are logged quantities whose response is not estimable.
    """
    parts, name = [], held.coefficient
    if held.plausible:
        least, most = (
            min(held.plausible, key=lambda x: x.value),
            max(held.plausible, key=lambda x: x.value),
        )
        ends = f"{least.value:.3g} (n = {least.n:.2g}) to {most.value:.3g} (n = {most.n:.2g})"
        parts.append(f"Over the plausible exponents the base fit’s {name} runs from {ends}.")
    if held.exponent_from_lift:
        n = plus_minus(held.exponent_from_lift.value, held.exponent_from_lift.u)
        parts.append(f"Lift alone gives n = {n}, if the form is true.")
        excluded = [
            f"{x.n:.2g} ({chance(x.p_value)})" for x in held.plausible if x.p_value < REJECTS
        ]
        if excluded:
            parts.append(
                f"Under this form it rejects n = {', '.join(excluded)}, as a wrong form would."
            )
    else:
        parts.append(f"From lift alone the exponent and {name} are confounded.")
    parts += [_answer(r) for r in held.logged]
    if unanswered:
        parts.append(
            f"Too few visits in a session have {' and '.join(unanswered)} to infer the exponent."
        )
    elif not held.supported_exponents:
        parts.append("Logged rpm or power would determine the exponent.")
    elif held.range:
        low, high = held.supported_exponents
        parts.append(
            f"By theory the logs allow {low:.2f} < n < {high:.2f}: {name} from"
            f" {held.range.low:.3g} to {held.range.high:.3g}."
        )
    return " ".join(parts)


def _answer(r: LoggedResponse) -> str:
    what, answer = (
        NAMES[r.quantity],
        f"{plus_minus(r.response.value, r.response.u)}, {chance(r.p_value)}",
    )
    spread = f"it varied by {percent(r.spread)} % within a throttle"
    if r.held:
        return f"The {what} logged does not follow the boundary (response {answer}); {spread}."
    return (
        f"The {what} logged was not constant: it scales as lift to the power"
        f" {r.response.value:+.2g} ± {r.response.u:.1g} ({chance(r.p_value)}); {spread}."
    )


def at_exponents(
    problem: Problem, theta: FloatArray, exponents: Sequence[float]
) -> tuple[AtExponent, ...]:
    """The first coefficient refitted in one batch at each exponent at which that converges."""
    n = np.asarray(exponents, dtype=float)
    target = problem.project(np.log(problem.data.lift_N))
    bounds = problem.model.bounds

    def linearised(at: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        left = target - n[rows, None] * problem.project(problem.log_ratio(at))
        return left, -n[rows, None, None] * problem.project(problem.slopes(at))

    jacobian = problem.slopes(theta)
    u = np.sqrt(np.diag(parameter_covariance(problem.project(jacobian))[0]))
    start, scale = np.tile(theta, (len(n), 1)), np.where(u > 0, u, 1.0)
    minima = solver.minimise(linearised, start, bounds, scale)
    best = solver.refine(linearised, minima.theta, bounds)
    answers = []
    for k in np.flatnonzero(minima.converged):
        jacobian = n[k] * problem.slopes(best[k])
        covariance, determined = parameter_covariance(
            problem.project(jacobian), np.linalg.norm(problem.covariance.whiten(jacobian), axis=1)
        )
        u_value = float(np.sqrt(covariance[0, 0])) if determined[0] else np.inf
        answers.append(
            AtExponent(
                n=float(n[k]), value=float(best[k, 0]), u=u_value, chi2=float(minima.chi2[k])
            )
        )
    return tuple(answers)


def free_exponent(problem: Problem, theta: FloatArray) -> tuple[float, float, float]:
    """Best-fitting exponent and its standard uncertainty with theta free, both nan at a bound or
    where theta can replace the exponent; and the least chi2.
    """
    low, high = problem.model.bounds
    low, high = np.r_[low, 0.1], np.r_[high, 3.0]

    def linearised(x: FloatArray, _: IntArray) -> tuple[FloatArray, FloatArray]:
        at, n = x[:, :-1], x[:, -1:]
        ratio = problem.log_ratio(at)
        slopes = np.concatenate([n[:, :, None] * problem.slopes(at), ratio[:, None]], axis=1)
        return problem.left(n * ratio), -problem.project(slopes)

    size = np.maximum(np.abs(np.r_[theta, 1.0]), 0.05)
    start = np.clip(np.r_[theta, 1.0], low + 1e-6 * size, high - 1e-6 * size)
    minimum = solver.minimise(linearised, start[None], (low, high), size).theta
    best = solver.refine(linearised, minimum, (low, high))
    r, slopes = (x[0] for x in linearised(best, np.zeros(1, dtype=np.int64)))
    best, chi2 = best[0], min(float(r @ r), float(problem.chi2(theta)))
    information = (slopes * size[:, None]) @ (slopes * size[:, None]).T
    at_bound = np.any(best - low < 1e-4 * size) or np.any(high - best < 1e-4 * size)
    if at_bound or np.linalg.cond(information) > 1e12:
        return float("nan"), float("nan"), chi2
    u = float(np.sqrt(np.linalg.inv(information)[-1, -1]) * size[-1])
    # along so flat a valley the search's last place is no estimate
    if u > high[-1] - low[-1]:
        return float("nan"), float("nan"), chi2
    return float(best[-1]), u, chi2


def logged(data: Observations) -> dict[str, FloatArray]:
    """Logged speed, power and supply that are positive in every trial; power from supply and
    current where it was not logged itself.
    """
    known = dict(data.covariates)
    if "power_W" not in known and {"supply_V", "current_A"} <= known.keys():
        known["power_W"] = known["supply_V"] * known["current_A"]
    wanted = {name: known[name] for name in ("speed_Hz", "power_W", "supply_V") if name in known}
    return {name: x for name, x in wanted.items() if np.isfinite(x).all() and (x > 0).all()}


def response(data: Observations, log_ratio: FloatArray, quantity: str) -> Response | None:
    """Response of `quantity` to the change of lift at fixed throttle within a session; None where
    not estimable.

    Least squares of its logarithm on `log_ratio` (n,), a level per throttle and one per session.
    The covariance is the sandwich clustered by visit, since drift (of a battery) is common to a
    visit's trials.
    """
    from scipy.stats import t

    y = np.log(logged(data)[quantity])
    levels, sessions = data.level_columns, int(data.session.max()) + 1
    k, columns = levels.shape[1], [levels, np.eye(sessions)[data.session][:, 1:]]
    q, _ = np.linalg.qr(np.hstack(columns))
    alone = log_ratio - q @ (q.T @ log_ratio)
    visits = np.unique(data.visit, return_inverse=True)[1]
    dof = visits.max() + 1 - sessions - 1
    # distance and session changed together: the ratio does not vary within a session
    if dof < ENOUGH - 2 or not alone @ alone > 1e-4 * (log_ratio - log_ratio.mean()) @ (
        log_ratio - log_ratio.mean()
    ):
        return None
    # sessions about their mean, so that a throttle's level is that of the whole campaign
    about = columns[1] - columns[1].mean(axis=0)
    x = np.column_stack([columns[0], log_ratio, about])
    inverse = np.linalg.pinv(x.T @ x)
    beta = inverse @ (x.T @ y)
    residual = y - x @ beta
    scores = np.zeros((visits.max() + 1, x.shape[1]))
    np.add.at(scores, visits, x * residual[:, None])
    covariance = inverse @ (scores.T @ scores) @ inverse * (visits.max() + 1) / dof
    slope, u = float(beta[k]), float(np.sqrt(covariance[k, k]))
    within = y - levels @ np.linalg.lstsq(levels, y, rcond=None)[0]
    # what is constant to rounding was held
    p = float(2 * t.sf(abs(slope) / u, dof)) if u > 1e-9 else float(abs(slope) < 1e-6)
    estimate = Estimate.around(slope, u, student.NORMAL_90)
    return Response(
        logged=LoggedResponse(
            quantity=quantity,
            response=estimate,
            p_value=p,
            held=p >= NOT_HELD,
            spread=float(np.sqrt(np.mean(within**2))),
            exponents=_implied(quantity, estimate),
        ),
        log_far=data.shown(beta[:k]),
        u_log_far=np.sqrt(np.diag(data.shown(data.shown(covariance[:k, :k]).T))),
    )


def _implied(quantity: str, slope: Estimate) -> tuple[float, float] | None:
    """Least and greatest exponent at constant throttle that theory implies over the slope's 90 %
    interval.

    None for other quantities, and where lift would follow the quantity's own change alone.
    """
    at_constant, follows = {"speed_Hz": (SPEED, 2.0), "power_W": ((POWER,), POWER)}.get(
        quantity, ((), 1.0)
    )
    left = 1 - follows * np.array([slope.lo90, slope.hi90])
    if not at_constant or left.min() < LEAST_LEFT:
        return None
    implied = np.outer(at_constant, 1 / left)
    return float(implied.min()), float(implied.max())
