"""What thrust stands' CSV files share: commas, points, one header line with units in the names."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nearlift.errors import InputRefused
from nearlift.readers.channel import (
    AS_FORCE,
    Channel,
    Contents,
    Names,
    RecordsDialect,
    fold,
    split_unit,
)
from nearlift.readers.dialect import UNSTATED
from nearlift.readers.per_file import Format, reader_of
from nearlift.readers.seam import Reader
from nearlift.readers.table import Layout
from nearlift.readers.text import from_text, head_of, with_rate

#: A stand that shows this much lift turns, whatever its speed channel says, N.
LIFTS_N = 0.02


def header(head: bytes) -> list[str]:
    """The cells of a first line, a phantom one at its end kept; none where it is no UTF-8 text."""
    try:
        line = head.split(b"\n", 1)[0].decode("utf-8-sig")
    except UnicodeDecodeError:
        return []
    try:
        return [cell.strip() for cell in next(csv.reader([line.rstrip("\r")]), [])]
    except csv.Error:
        return []


def bare(names: Sequence[str]) -> set[str]:
    """Names as they are compared, their units taken off."""
    return {fold(split_unit(name)[0]) for name in names}


def stand_reader(
    *,
    name: str,
    title: str,
    known: Callable[[set[str]], bool],
    speeds: Callable[[str], bool],
    texts: Sequence[str] = (),
) -> Reader:
    """The reader of one stand's files, one for each trial.

    `known` tells whether bare names are those of the format, `speeds` whether one is that of a
    rotor's speed: one that is zero throughout while there is lift is remarked on. `texts` are the
    bare names of columns that hold text.
    """

    def contents(path: Path, dialect: RecordsDialect, names: Names) -> Contents:
        """The channels of a file; refuses another header, or a line that is unlike it."""
        head, _ = head_of(path)
        if not head.strip(b"\0"):
            return Contents(channels=(), kind=title, codes=("EMPTY",))
        cells = header(head)
        trailing = bool(cells) and cells[-1] == ""
        columns = cells[:-1] if trailing else cells
        if not known(bare(columns)):
            raise InputRefused(
                f"{path}, line 1",
                f"has not the header of {title}",
                '`nearlift inspect FILE` says what it is; another version may want reader = "text"',
            )
        twice = sorted({name for name in columns if columns.count(name) > 1})
        if twice:
            raise InputRefused(
                f"{path}, line 1",
                f"has more than one column {twice[0]!r}",
                "rename or drop one of them",
            )
        layout = Layout(
            encoding="utf-8-sig" if head.startswith(b"\xef\xbb\xbf") else "utf-8",
            trailing=trailing,
            names=tuple(columns),
            units=tuple(split_unit(name)[1] for name in columns),
            first=2,
            texts=tuple(i for i, name in enumerate(columns) if fold(split_unit(name)[0]) in texts),
        )
        turning = tuple(name for name in columns if speeds(fold(split_unit(name)[0])))
        file = from_text(path, UNSTATED, names if names is None else (*names, *turning), layout)
        codes = (*file.codes, *_dead(file.channels, turning))
        if not len(file.channels) or not len(file.channels[0].values):
            codes = (*codes, "NO_DATA")
        file = replace(file, kind=title, codes=codes, notes=())
        return with_rate(file) if names is None else file

    return reader_of(
        Format(
            name=name,
            title=f"{title} CSV, one file per trial",
            recognises=lambda head, _: known(bare(header(head))),
            contents=contents,
        )
    )


def _dead(channels: Sequence[Channel], turning: Sequence[str]) -> tuple[str, ...]:
    """`dead_speed` where the stand lifts and all its speeds, or one of more than two, read zero."""
    factor = {"N": 1.0, "gf": 9.80665e-3, "kgf": 9.80665}
    force = [
        c
        for c in channels
        if re.search("thrust|weight|force fz", fold(c.name)) and np.isfinite(c.values).any()
    ]
    lifts = [
        np.nanmax(np.abs(c.values)) * factor.get(AS_FORCE.get(c.unit, c.unit), 0.0) for c in force
    ]
    speeds = [c for c in channels if c.name in turning and len(c.values)]
    if not lifts or not speeds or max(lifts) < LIFTS_N:
        return ()
    still = [not np.any(np.nan_to_num(c.values)) for c in speeds]
    # a stand with two kinds of probe uses one; a craft with four rotors turns all
    several = len(still) > 2
    return ("dead_speed",) if all(still) or (several and any(still)) else ()
