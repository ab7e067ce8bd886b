"""The Crazyflie's system identification CSV: ``weight[g],pwm,vbat[V],rpm1,...`` or
``...,thrust[g]``, without a clock.

Grams are gram-force. The craft hangs upside down and weights may be negative, so say `sign`. Which
gravity its calibration used is the lab's to know: 9.8, 9.80665 and 9.807 are all in use.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nearlift.readers import stand
from nearlift.readers.channel import Contents
from nearlift.readers.per_file import Format, Names, reader_of


def _known(names: set[str]) -> bool:
    return "pwm" in names and bool(names & {"weight", "thrust"}) and "vbat" in names


def contents(path: Path, dialect: Mapping[str, Any], names: Names) -> Contents:
    """The channels of a system identification file; raises as `stand.contents`."""
    return stand.contents(
        path,
        names,
        title="Crazyflie system identification",
        known=_known,
        texts=(),
        speeds=lambda n: re.fullmatch(r"rpm\d", n) is not None,
    )


CRAZYFLIE = Format(
    name="crazyflie",
    title="Crazyflie system identification CSV, one file per trial",
    recognises=lambda head, name: _known(stand.bare(stand.header(head))),
    contents=contents,
)
CRAZYFLIE_READER = reader_of(CRAZYFLIE)
