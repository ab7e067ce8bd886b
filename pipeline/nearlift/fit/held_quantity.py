"""The held quantity, and the exponent of the lift ratio that follows from it.

Every published ratio holds something constant: a model of the flow gives g, and lift scales as g^n.
The paper, like Cheeseman and Bennett, takes n = 1. Momentum theory at constant power gives 2/3,
blade-element theory at constant speed 0.60 to 0.82 for a rotor of this size. Lift alone hardly
separates n from the coefficient. Logged quantities can. A quantity q that varies with the load as q
~ (L / L_inf)^s was not held. Lift scales as speed squared and, at fixed flow, as power to 2/3. The
exponent s therefore converts that of theory at constant q into that at constant throttle:

    n = n_speed / (1 - 2 s_speed)        n = (2/3) / (1 - (2/3) s_power)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import solver
from nearlift.fit.information import joint_information
from nearlift.likelihood import student
from nearlift.likelihood.problem import Likelihood
from nearlift.results import Estimate, Observations
from nearlift.results.fit import ExponentFit, HeldQuantity, LoggedResponse
from nearlift.rounding import chance, plus_minus

#: Exponent at constant power by momentum theory, and least and greatest at constant rotor speed by
#: our blade-element closure (solidity times lift slope 0.75 to 1.14; docs/assumptions.md).
POWER, SPEED_EXPONENTS = 2 / 3, (0.6, 0.82)
#: Plausible exponents, each with its assumption.
PLAUSIBLE_EXPONENTS = {
    1.0: "the ratio as published",
    SPEED_EXPONENTS[1]: "constant speed, at most",
    POWER: "constant power",
    SPEED_EXPONENTS[0]: "constant speed, at least",
}
#: Bounds of a free exponent. Ours: the plausible ones with room to either side.
EXPONENT_BOUNDS = (0.1, 3.0)
#: Distance from a bound, relative to a parameter's scale, at which it is at the bound. Ours: far
#: below any uncertainty.
BOUND_MARGIN = 1e-4
#: Significance level of the test that a logged quantity was held. Ours: one false alarm in a
#: hundred campaigns, since it changes the exponent (docs/assumptions.md).
HELD_TEST_LEVEL = 0.01
#: Least denominator of the formulas above: part of the change of lift at constant speed or power.
#: Ours: at less, an error of the exponent counts tenfold.
MIN_CHANGE_LEFT = 0.1
#: Fewest visits in one session for a response. Ours: six are left after a level and a slope.
MIN_RESPONSE_VISITS = 8
QUANTITY_NAMES = {"speed_Hz": "rotor speed", "power_W": "power", "supply_V": "supply voltage"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Response of a logged quantity to the boundary at fixed throttle, and its logarithm far from
    the boundary, per throttle (K,), with standard uncertainty `u_log_far`.
    """

    logged: LoggedResponse
    log_far: FloatArray
    u_log_far: FloatArray


def examine(
    problem: Likelihood, theta: FloatArray, reach90: float, declared: str
) -> tuple[HeldQuantity, tuple[Response, ...]]:
    """The first coefficient at plausible exponents and at those that the logs support; responses of
    the logged quantities. `theta` (p,) is the published model's optimum.

    `reach90` is half of the coefficient's 90 % interval in standard uncertainties, `declared` the
    held quantity that the manifest states.
    """
    free = free_exponent(problem, theta)
    log_ratio = problem.log_ratio(theta)
    answers = {q: response(problem.data, log_ratio, q) for q in logged(problem.data)}
    responses = tuple(r for r in answers.values() if r is not None)
    implied = {r.logged.quantity: r.logged.exponents for r in responses}
    # power also depends on the motor's efficiency
    supported = implied.get("speed_Hz") or implied.get("power_W")

    def at(exponents: Sequence[float]) -> tuple[ExponentFit, ...]:
        return tuple(
            ExponentFit.around(value, u, reach90, n=n, supposes=PLAUSIBLE_EXPONENTS.get(n))
            for n, value, u in at_exponents(problem, theta, exponents)
        )

    held = HeldQuantity(
        declared=declared,
        coefficient=problem.names[0],
        plausible=at(list(PLAUSIBLE_EXPONENTS)),
        exponent_from_lift=Estimate.around(*free[:2], reach90) if free else None,
        logged=tuple(r.logged for r in responses),
        supported_exponents=supported,
        supported=at(supported) if supported else (),
        text="",
    )
    unanswered = [QUANTITY_NAMES[q] for q, r in answers.items() if r is None and q != "supply_V"]
    return replace(held, text=_text(held, unanswered)), responses


def _text(held: HeldQuantity, unanswered: Sequence[str]) -> str:
    """Effect of the exponent on the coefficient, and the exponents that lift and logs support;
    `unanswered` are logged quantities whose response is not estimable.
    """
    parts, name = [], held.coefficient
    if held.plausible:
        ends = " to ".join(
            f"{x.value:.3g} (n = {x.n:.2g})"
            for x in (f(held.plausible, key=lambda x: x.value) for f in (min, max))
        )
        parts.append(f"Over the plausible exponents the base fit’s {name} runs from {ends}.")
    if held.exponent_from_lift:
        n = plus_minus(held.exponent_from_lift.value, held.exponent_from_lift.u)
        parts.append(f"Lift alone gives n = {n}, if the form is true.")
    else:
        parts.append(f"From lift alone the exponent and {name} are confounded.")
    for r in held.logged:
        verdict = "does not follow the boundary" if r.held else "was not constant"
        answer = plus_minus(r.response.value, r.response.u)
        parts.append(
            f"The {QUANTITY_NAMES[r.quantity]} logged {verdict}: it scales as lift to the power"
            f" {answer}"
            f" ({chance(r.p_value)}), and varied by {100 * r.spread:.2g} % within a throttle."
        )
    if unanswered:
        parts.append(
            f"Too few visits in a session have {' and '.join(unanswered)} to infer the exponent."
        )
    elif not held.supported_exponents:
        parts.append("Logged rpm or power would determine the exponent.")
    elif held.supported:
        low, high = held.supported_exponents
        values = [x.value for x in held.supported]
        parts.append(
            f"By theory the logs allow {low:.2f} < n < {high:.2f}: {name} from {min(values):.3g}"
            f" to {max(values):.3g}."
        )
    return " ".join(parts)


def _raised(
    problem: Likelihood, theta: FloatArray, exponents: Sequence[float], free: bool
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Coefficients and exponent (p + 1,) of each fit that converges, and their standard
    uncertainties.

    A fit starts from `theta` (p,) and one of the exponents, which is held if not `free`.
    """

    def slopes(x: FloatArray) -> FloatArray:
        ratio, n = problem.log_ratio(x[:, :-1]), x[:, -1:, None]
        return np.concatenate([n * problem.slopes(x[:, :-1]), free * ratio[:, None]], axis=1)

    system = solver.System(
        lambda x, _: problem.left(x[:, -1:] * problem.log_ratio(x[:, :-1])),
        lambda x, _: -problem.project(slopes(x)),
    )
    ends = zip(problem.model.bounds, EXPONENT_BOUNDS, strict=True)
    low, high = (np.r_[end, n] for end, n in ends)
    scale = np.maximum(np.abs(np.r_[theta, 1.0]), 0.05)
    start = np.column_stack([np.tile(theta, (len(exponents), 1)), exponents])
    if free:
        start = np.clip(start, low + 1e-6 * scale, high - 1e-6 * scale)
    minima = solver.minimise(system, start, (low, high), scale)
    best = solver.refine(system, minima.theta, (low, high))
    for x in best[minima.converged]:
        jacobian = slopes(x[None])[0][: len(x) - (not free)]
        u = joint_information(problem, jacobian.T).u
        inside = (x - low > BOUND_MARGIN * scale) & (high - x > BOUND_MARGIN * scale)
        yield x, np.where(inside[: len(u)], u, np.inf) if free else u


def at_exponents(
    problem: Likelihood, theta: FloatArray, exponents: Sequence[float]
) -> list[tuple[float, float, float]]:
    """Exponent, refitted first coefficient and its standard uncertainty, at each exponent at which
    that converges.
    """
    fits = _raised(problem, theta, exponents, free=False)
    return [(float(x[-1]), float(x[0]), float(u[0])) for x, u in fits]


def free_exponent(
    problem: Likelihood, theta: FloatArray
) -> tuple[float, float, float, float] | None:
    """Best-fitting exponent and the first coefficient with it free, each with its standard
    uncertainty; None at a bound or where theta can replace the exponent.
    """
    for x, u in _raised(problem, theta, [1.0], free=True):
        # along so flat a valley the search's last place is no estimate
        if np.isfinite(u).all() and u[-1] <= np.ptp(EXPONENT_BOUNDS):
            return float(x[-1]), float(u[-1]), float(x[0]), float(u[0])
    return None


def logged(data: Observations) -> dict[str, FloatArray]:
    """Logged speed, power and supply that are positive in every trial; power from supply and
    current where it was not logged itself.
    """
    known = dict(data.covariates)
    if "power_W" not in known and {"supply_V", "current_A"} <= known.keys():
        known["power_W"] = known["supply_V"] * known["current_A"]
    wanted = {name: known[name] for name in QUANTITY_NAMES if name in known}
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
    levels, sessions = data.level_design, int(data.session.max()) + 1
    k, session = levels.shape[1], np.eye(sessions)[data.session][:, 1:]
    q, _ = np.linalg.qr(np.hstack([levels, session]))
    alone = log_ratio - q @ (q.T @ log_ratio)
    visits = np.unique(data.visit, return_inverse=True)[1]
    dof = visits.max() + 1 - sessions - 1
    # distance and session changed together: the ratio does not vary within a session
    if dof < MIN_RESPONSE_VISITS - 2 or not alone @ alone > 1e-4 * len(y) * np.var(log_ratio):
        return None
    # sessions about their mean, so that a throttle's level is that of the whole campaign
    x = np.column_stack([levels, log_ratio, session - session.mean(axis=0)])
    inverse = np.linalg.pinv(x.T @ x)
    beta = inverse @ (x.T @ y)
    scores = np.zeros((visits.max() + 1, x.shape[1]))
    np.add.at(scores, visits, x * (y - x @ beta)[:, None])
    covariance = inverse @ (scores.T @ scores) @ inverse * (visits.max() + 1) / dof
    slope, u = float(beta[k]), float(np.sqrt(covariance[k, k]))
    within = y - levels @ np.linalg.lstsq(levels, y, rcond=None)[0]
    # a quantity that is constant to rounding was held
    p = float(2 * t.sf(abs(slope) / u, dof)) if u > 1e-9 else float(abs(slope) < 1e-6)
    estimate = Estimate.around(slope, u, student.quantile(0.95, dof))
    return Response(
        logged=LoggedResponse(
            quantity=quantity,
            response=estimate,
            p_value=p,
            held=p >= HELD_TEST_LEVEL,
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
    at_constant, follows = {"speed_Hz": (SPEED_EXPONENTS, 2.0), "power_W": ((POWER,), POWER)}.get(
        quantity, ((), 1.0)
    )
    left = 1 - follows * np.array([slope.lo90, slope.hi90])
    if not at_constant or left.min() < MIN_CHANGE_LEFT:
        return None
    implied = np.outer(at_constant, 1 / left)
    return float(implied.min()), float(implied.max())
