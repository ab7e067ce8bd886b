"""gym-pybullet-drones with the exported ground, in place of its one constant for every rotor.

    from gym_pybullet_drones.envs.CtrlAviary import CtrlAviary
    env = near_ground(CtrlAviary, radius_m=0.023)(physics=Physics.PYB_GND)

Each rotor gains by its own height above the floor, so that a tilted vehicle is righted; the model
is that of a level one. `lift_model.py` (`nearlift export CAMPAIGN --python`) stands on the path.
"""

from __future__ import annotations

import numpy as np
from lift_model import ratio


def gained_N(lift_per_rpm2, rpm, heights_m, radius_m):
    """What the ground adds to each rotor's thrust, N."""
    gain = np.array([ratio("ground", z / radius_m)[0] - 1 for z in heights_m])
    return gain * lift_per_rpm2 * np.square(rpm)


def near_ground(aviary, radius_m):
    """A kind of aviary whose physics with a ground effect takes it from the export."""
    import pybullet

    class NearGround(aviary):
        def _groundEffect(self, rpm, nth_drone):  # its name in BaseAviary
            drone, client = self.DRONE_IDS[nth_drone], self.CLIENT
            links = pybullet.getLinkStates(
                drone, list(range(4)), computeForwardKinematics=1, physicsClientId=client
            )
            if np.abs(self.rpy[nth_drone, :2]).max() >= np.pi / 2:
                return
            heights_m = [link[0][2] for link in links]
            for i, force in enumerate(gained_N(self.KF, rpm, heights_m, radius_m)):
                pybullet.applyExternalForce(
                    drone, i, [0, 0, force], [0, 0, 0], pybullet.LINK_FRAME, physicsClientId=client
                )

    return NearGround
