"""Tyto Robotics' Flight Stand, software version 2: CSV whose columns are called ``Powertrain 1 -
force Fz (thrust) (N)``.

Its micro sign is a Greek letter and its product sign a dot operator, where RCbenchmark's are U+00B5
and U+00B7: names are folded before they are compared.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nearlift.readers import stand
from nearlift.readers.channel import Contents
from nearlift.readers.per_file import Format, Names, reader_of

_THRUST = re.compile(r"powertrain \d+ - force fz.*")


def _known(names: set[str]) -> bool:
    return "time" in names and any(_THRUST.fullmatch(name) for name in names)


def contents(path: Path, dialect: Mapping[str, Any], names: Names) -> Contents:
    """The channels of a Flight Stand file; raises as `stand.contents`."""
    return stand.contents(
        path,
        names,
        title="Tyto Flight Stand v2",
        known=_known,
        texts=("app message",),
        speeds=lambda n: n.endswith("rotation speed"),
    )


FLIGHT_STAND = Format(
    name="flight-stand",
    title="Tyto Flight Stand v2 CSV, one file per trial",
    recognises=lambda head, name: _known(stand.bare(stand.header(head))),
    contents=contents,
)
FLIGHT_STAND_READER = reader_of(FLIGHT_STAND)
