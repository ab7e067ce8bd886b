"""RotorPy with the exported ground: a `Multirotor` whose rotors gain what `lift_model.py` says.

    PYTHONPATH=processed/CAMPAIGN/export python rotorpy_near_ground.py 0.023

flies a landing without the ground's effect, with it, and with it known to the controller, into
landing.png. z is the rotor plane's height above the floor; rotors gain alike.
"""

from __future__ import annotations

import sys

import numpy as np
from lift_model import ratio
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor


class NearGround(Multirotor):
    """A vehicle above a floor at z = 0; `radius_m` is its rotors' radius."""

    def __init__(self, params, radius_m, **chosen):
        super().__init__(params, **chosen)
        self.radius_m, self.z_m = radius_m, np.inf

    def _s_dot_fn(self, t, s, cmd_rotor_speeds):
        self.z_m = s[2]
        return super()._s_dot_fn(t, s, cmd_rotor_speeds)

    def compute_body_wrench(self, body_rates, rotor_speeds, body_airspeed_vector):
        """Force and moment with what the ground adds to each rotor's thrust."""
        force, moment = super().compute_body_wrench(body_rates, rotor_speeds, body_airspeed_vector)
        more = np.zeros((len(rotor_speeds), 3))
        gain = ratio("ground", self.z_m / self.radius_m)[0] - 1
        more[:, 2] = gain * self.k_eta * rotor_speeds**2
        return force + more.sum(axis=0), moment + np.cross(self.rotor_geometry, more).sum(axis=0)


def land(vehicle, radius_m, known=False, step_s=0.01):
    """Times, heights and set-points of a descent at 0.1 m/s from 0.3 m to 0.03 m, then hover;
    `known` divides the controller's thrust by the ratio at the measured height.
    """
    control, rows = SE3Control(quad_params), []
    state = {"x": np.array([0.0, 0.0, 0.3]), "v": np.zeros(3), "w": np.zeros(3)}
    state |= {"q": np.array([0.0, 0.0, 0.0, 1.0]), "wind": np.zeros(3)}
    hover = np.sqrt(quad_params["mass"] * 9.81 / (4 * quad_params["k_eta"]))
    state["rotor_speeds"] = np.full(4, hover)
    for t in np.arange(0.0, 5.0, step_s):
        z0 = max(0.3 - 0.1 * t, 0.03)
        flat = {"x": np.array([0.0, 0.0, z0]), "yaw": 0.0, "yaw_dot": 0.0}
        flat["x_dot"] = np.array([0.0, 0.0, -0.1 if z0 > 0.03 else 0.0])
        flat |= {name: np.zeros(3) for name in ("x_ddot", "x_dddot", "x_ddddot")}
        command = control.update(t, state, flat)
        if known:
            at = ratio("ground", state["x"][2] / radius_m)[0]
            command["cmd_motor_speeds"] = command["cmd_motor_speeds"] / np.sqrt(at)
        rows.append((t, state["x"][2], z0))
        state = vehicle.step(state, command, step_s)
    return np.array(rows).T


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    r = float(sys.argv[1])
    figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    flights = (
        ("no ground effect", land(Multirotor(quad_params), r)),
        ("ground effect", land(NearGround(quad_params, r), r)),
        ("ground effect, known to the controller", land(NearGround(quad_params, r), r, known=True)),
    )
    for (label, (t, z, _)), style in zip(flights, ("-", "-", "--"), strict=True):
        axes.plot(t, 1e3 * z, style, label=label)
    axes.plot(t, 1e3 * flights[0][1][2], "k:", label="set-point")
    axes.set(xlabel="time (s)", ylabel="rotor plane above the floor (mm)", ylim=(0, None))
    axes.legend(frameon=False)
    figure.savefig("landing.png", dpi=150)
