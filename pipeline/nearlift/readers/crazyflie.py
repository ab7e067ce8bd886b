"""The Crazyflie's system identification CSV: ``weight[g],pwm,vbat[V],rpm1,...`` or
``...,thrust[g]``, without a clock.

Grams are gram-force. The craft hangs upside down and weights may be negative, so say `sign`. Which
gravity its calibration used is the lab's to know: 9.8, 9.80665 and 9.807 are all in use.
"""

from __future__ import annotations

import re

from nearlift.readers.stand import stand_reader

READER = stand_reader(
    name="crazyflie",
    title="Crazyflie system identification",
    known=lambda names: names >= {"pwm", "vbat"} and bool(names & {"weight", "thrust"}),
    speeds=lambda name: re.fullmatch(r"rpm\d", name) is not None,
)
