"""CSV of thrust stands: commas, points, one header line with units in the names. Each product is
one `Stand`.

RCbenchmark 1520, 1580 and 1585 write a byte order mark and a trailing comma. The unit of `Thrust`
follows a preference of the user (gf, kgf, N): it is read from the header and must be the
manifest's. The clock of averaged step tests runs backwards between its first rows; the order of the
rows is kept.

Tyto Robotics' Flight Stand, software version 2, calls its columns ``Powertrain 1 - force Fz
(thrust) (N)``. Its micro sign is a Greek letter and its product sign a dot operator. RCbenchmark's
are U+00B5 and U+00B7. So names are folded before they are compared.

The Crazyflie's system identification CSV is ``weight[g],pwm,vbat[V],rpm1,...`` or
``...,thrust[g]``, without a clock. Grams are gram-force. The craft hangs upside down and weights
may be negative, so `sign` is needed.
"""

from __future__ import annotations

import csv
import functools
import re
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import numpy as np

from nearlift import units
from nearlift.errors import InputRefused
from nearlift.readers import base
from nearlift.readers.dialect import Dialect
from nearlift.readers.files import content_of
from nearlift.readers.table import Layout
from nearlift.readers.text import by_layout, plain

#: Lift from which on rotors turn, whatever their speed channel reads, N.
MIN_LIFT_N = 0.02


class Stand(NamedTuple):
    """The files of one product: forms of the names of columns, folded and without units. Files of
    it have a column of each form in `needs`; `speeds` are those of rotors.
    """

    title: str
    needs: tuple[str, ...]
    speeds: str


def _header(head: bytes) -> list[str]:
    """The cells of a first line, a blank one at its end kept; none where it is no UTF-8 text."""
    try:
        line = head.split(b"\n", 1)[0].decode("utf-8-sig").rstrip("\r")
        return [cell.strip() for cell in next(csv.reader([line]), [])]
    except (UnicodeDecodeError, csv.Error):
        return []


def _is_of(stand: Stand, head: bytes, name: str = "") -> bool:
    names = _header(head)
    return all(any(_fits(name, form) for name in names) for form in stand.needs)


def _fits(name: str, form: str) -> bool:
    """Whether a name is of a form: shell wildcards, alternatives between bars."""
    plain = base.fold(base.split_unit(name)[0])
    return any(fnmatchcase(plain, one) for one in form.split("|"))


def contents(
    stand: Stand, path: Path, dialect: base.RecordsDialect, names: base.Names
) -> base.Contents:
    """The channels of a file; refuses another header, or a line that is unlike it."""
    content = content_of(path)
    if not content.strip(b"\0"):
        return base.Contents(kind=stand.title, codes=("EMPTY",))
    if not _is_of(stand, content):
        what = f"has not the header of {stand.title}"
        remedy = '`nearlift inspect FILE` identifies it; another version may need reader = "text"'
        raise InputRefused(f"{path}, line 1", what, remedy)
    columns = _header(content)
    trailing = columns[-1] == ""
    columns = columns[:-1] if trailing else columns
    if len(set(columns)) < len(columns):
        what = f"has more than one column {max(columns, key=columns.count)!r}"
        raise InputRefused(f"{path}, line 1", what, "rename or drop one of them")
    speeds = [name for name in columns if _fits(name, stand.speeds)]
    also = None if names is None else (*names, *speeds)
    text = plain(content, str(path), Dialect(encoding="utf-8"))
    layout = Layout(
        trailing=trailing,
        names=tuple(columns),
        units=tuple(base.split_unit(name)[1] for name in columns),
        first=2,
        texts=tuple(i for i, name in enumerate(columns) if _fits(name, "app message")),
    )
    file = by_layout(text, layout, also, str(path))
    empty = not file.channels or not len(file.channels[0].values)
    codes = (*file.codes, *["dead_speed"] * _dead(file, speeds), *["NO_DATA"] * empty)
    return replace(file, kind=stand.title, codes=codes, notes=())


def _dead(file: base.Contents, speeds: list[str]) -> bool:
    """Whether there is lift, and all speeds, or one of more than two, read zero."""
    lifts = [
        units.to_si(unit, "force", c.name)[0] * float(np.nanmax(np.abs(c.values), initial=0.0))
        for c in file.channels
        if re.search("thrust|weight|force fz", base.fold(c.name))
        and (unit := base.AS_FORCE.get(c.unit, c.unit)) in base.FORCE_UNITS
    ]
    still = [
        not np.nan_to_num(c.values).any()
        for c in file.channels
        if c.name in speeds and len(c.values)
    ]
    # with two kinds of probe one is used; a craft with four rotors turns all
    some = bool(still) and (all(still) or (len(still) > 2 and any(still)))
    return some and max(lifts, default=0.0) >= MIN_LIFT_N


def _reader(name: str, stand: Stand) -> base.Reader:
    return base.Reader(
        name=name,
        title=f"{stand.title} CSV, one file per trial",
        contents=functools.partial(contents, stand),
        recognises=functools.partial(_is_of, stand),
    )


RCBENCHMARK = _reader(
    "rcbenchmark",
    Stand("RCbenchmark 15xx", ("time", "esc signal", "thrust", "voltage"), "motor*speed*"),
)
FLIGHT_STAND = _reader(
    "flight-stand",
    Stand("Tyto Flight Stand v2", ("time", "powertrain [0-9]* - force fz*"), "*rotation speed"),
)
CRAZYFLIE = _reader(
    "crazyflie",
    Stand("Crazyflie system identification", ("pwm", "vbat", "weight|thrust"), "rpm[0-9]"),
)
