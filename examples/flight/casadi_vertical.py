"""Vertical flight above the exported ground, for CasADi and acados.

    dz/dt = v,   dv/dt = g (u R(z) - 1)

with u the thrust that the command would give far away over the vehicle's weight, and R of
`lift_model_casadi.py` (`nearlift export CAMPAIGN --casadi`), smooth between its stations.
"""

from __future__ import annotations

import casadi as ca
from lift_model_casadi import RANGE, ratio

G = 9.80665


def dynamics(radius_m):
    """State (z in m, v in m/s), command u, and the state's derivative."""
    state, command = ca.SX.sym("state", 2), ca.SX.sym("u")
    lift = command * ratio("ground", state[0] / radius_m)
    return state, command, ca.vertcat(state[1], G * (lift - 1))


def acados_model(radius_m):
    """The same as acados takes it."""
    from acados_template import AcadosModel

    model = AcadosModel()
    model.name = "near_ground"
    model.x, model.u, model.f_expl_expr = dynamics(radius_m)
    return model


def landing(radius_m, start_m, steps=60, seconds=2.0):
    """Heights, speeds and commands of the descent with the least change of command, at rest at both
    ends, from a height to the nearest station, below which the model is flat.
    """
    state, command, slope = dynamics(radius_m)
    flow = ca.Function("flow", [state, command], [slope])
    low, h = RANGE["ground"][0] * radius_m, seconds / steps
    problem = ca.Opti()
    x, u = problem.variable(2, steps + 1), problem.variable(1, steps)
    for k in range(steps):
        middle = x[:, k] + h / 2 * flow(x[:, k], u[k])
        problem.subject_to(x[:, k + 1] == x[:, k] + h * flow(middle, u[k]))
    problem.subject_to(x[:, 0] == ca.vertcat(start_m, 0))
    problem.subject_to(x[:, -1] == ca.vertcat(low, 0))
    problem.subject_to(x[0, :] >= low)
    problem.subject_to(problem.bounded(0, u, 2))
    problem.minimize(ca.sumsqr(u[1:] - u[:-1]))
    problem.set_initial(x[0, :], ca.linspace(start_m, low, steps + 1).T)
    problem.set_initial(u, 1)
    problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    found = problem.solve()
    return found.value(x[0, :]), found.value(x[1, :]), found.value(u)
