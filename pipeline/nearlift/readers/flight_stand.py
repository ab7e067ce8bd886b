"""Tyto Robotics' Flight Stand, software version 2: CSV whose columns are called ``Powertrain 1 -
force Fz (thrust) (N)``.

Its micro sign is a Greek letter and its product sign a dot operator, where RCbenchmark's are U+00B5
and U+00B7: names are folded before they are compared.
"""

from __future__ import annotations

import re

from nearlift.readers.stand import stand_reader

_THRUST = re.compile(r"powertrain \d+ - force fz.*")

READER = stand_reader(
    name="flight-stand",
    title="Tyto Flight Stand v2",
    known=lambda names: "time" in names and any(map(_THRUST.fullmatch, names)),
    speeds=lambda name: name.endswith("rotation speed"),
    texts=("app message",),
)
