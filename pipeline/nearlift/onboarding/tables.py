"""A table as a schedule: the columns that are those of trials.csv, with their units."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.errors import InputRefused
from nearlift.onboarding import headings
from nearlift.readers import guarded
from nearlift.readers.base import FORCE_UNITS, RecordsDialect
from nearlift.readers.files import content_of, is_packed
from nearlift.readers.guarded import Malformed
from nearlift.readers.text import cells_of
from nearlift.schedule import BY_NAME, MEANS, REQUIRED
from nearlift.units import NUMBER

if TYPE_CHECKING:
    import pandas as pd

#: Largest table that is taken for a schedule, bytes.
MOST_BYTES = 4 << 20
#: Rows in a row at one setting, on average, beyond which a table is a record in steps.
MOST_REPEATS = 50
#: Units by which the only column of its kind is known, whatever it is called.
BY_UNIT = {"distance": ("mm", "cm", "m", "in", "um"), "throttle": ("percent",)}


@dataclass(frozen=True, kw_only=True)
class ProposedSchedule:
    """A trials.csv and the manifest's statements about it.

    These are the `units` of its columns (empty: unknown), the columns that it is `lacking`, and
    whether its rows are in run order.
    """

    trials: pd.DataFrame
    units: Mapping[str, str]
    lacking: tuple[str, ...] = ()
    ordered: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class InputTable:
    """A text table: names, cells with decimal points, and the place and unit of each column of a
    schedule.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    meant: Mapping[str, tuple[int, str]]

    @property
    def lists_trials(self) -> bool:
        """Whether it may be a schedule: it has a distance and another setting, and no clock."""
        other = {"trial", "boundary", "throttle", "lift"} & self.meant.keys()
        clocked = any(map(headings.is_clock, self.names)) and "trial" not in self.meant
        if "distance" not in self.meant or not other or clocked:
            return False
        # in a record one setting lasts for many samples
        settings = zip(*(self.cells(n) for n in ("boundary", "distance", "throttle")), strict=True)
        return len(self.rows) <= MOST_REPEATS * sum(1 for _ in itertools.groupby(settings))

    @property
    def means(self) -> bool:
        """Whether it may be a table of mean lifts: lifts by distance."""
        return "lift" in self.meant and self.lists_trials

    def cells(self, name: str) -> list[str]:
        """The cells of one of the schedule's columns; blank where there is none."""
        return [row[self.meant[name][0]] if name in self.meant else "" for row in self.rows]

    def ids(self, wanted: Collection[str]) -> list[str] | None:
        """The trial of every row, from the column with all these ids or files' names; else None."""
        for cells in zip(*self.rows, strict=True):
            ids = [Path(cell).stem if Path(cell).suffix else cell for cell in cells]
            for candidate in (list(cells), ids):
                if set(wanted) <= set(candidate):
                    return candidate
        return None

    def row_ids(self) -> list[str]:
        """The trial of every row, from the column of that name, else counted."""
        cells = self.cells("trial")
        if len(set(cells)) == len(cells) and all(cells):
            return cells
        return [str(i) for i in range(1, len(self.rows) + 1)]

    def wanted(self, means: bool) -> list[str]:
        """Further needs of a diagnosis, where the trials near some boundary are few."""
        from nearlift.loop.admission import LEAST_TRIALS

        sides = Counter(self.cells("boundary")).items()
        fewest = min(n for side, n in sides if side != "none" or n == len(self.rows))
        enough = LEAST_TRIALS + len(set(self.cells("throttle"))) + 1
        if fewest >= enough or (means and "lift_sd" in self.meant):
            return []
        return [
            f"trials.csv: lift_sd, if it is known: {fewest} rows without it give no diagnosis"
            if means
            else f"trials.csv: more trials, if there are any: {fewest} near a boundary give a"
            f" coefficient, {enough} a diagnosis as well"
        ]

    def schedule(self, ids: list[str], means: bool, of_records: bool = False) -> ProposedSchedule:
        """The table as a schedule; `means`: with mean lifts; `of_records`: a row is a record, whose
        pieces bring their throttle.
        """
        import pandas as pd

        left_out = {"trial", *(() if means else MEANS), *(("throttle",) if of_records else ())}
        known = {p: name for name, (p, _) in self.meant.items() if name not in left_out}
        further = {p: n for p, n in enumerate(self.names) if p not in known and n not in BY_NAME}
        trials = pd.DataFrame(self.rows)[[*sorted(known), *further]].rename(columns=known | further)
        trials.insert(0, "record" if of_records else "trial", ids)
        needed = [name for name in REQUIRED[1:] if not (of_records and name == "throttle")]
        return ProposedSchedule(
            trials=trials,
            units={
                name: unit
                for name, (_, unit) in self.meant.items()
                if name not in left_out and BY_NAME[name].kind == "quantity"
            },
            lacking=tuple(name for name in needed if name not in self.meant),
            ordered=not means or "start" in self.meant,
        )


def table_of(path: Path, dialect: RecordsDialect) -> InputTable | None:
    """A file as such a table; None where it is none, or is too large for one."""
    if path.stat().st_size > MOST_BYTES:
        return None
    try:
        length = MOST_BYTES + 1
        packed = is_packed(path)
        content = guarded.run(content_of, path, length) if packed else content_of(path, length)
        if len(content) > MOST_BYTES:
            return None
        layout, cells = cells_of(content, str(path), dialect)
    except (InputRefused, Malformed):
        return None
    point = layout.decimal == "."
    rows = tuple(tuple(c if point else c.replace(",", ".") for c in row) for row in cells)
    names = [
        f"{name} ({unit})" if unit and not headings.named(name)[1] else name
        for name, unit in zip(layout.names, layout.units, strict=True)
    ]
    return InputTable(names=layout.names, rows=rows, meant=columns_meant(names, rows))


def columns_meant(
    names: Sequence[str], rows: Collection[tuple[str, ...]]
) -> dict[str, tuple[int, str]]:
    """The place and unit of each of the schedule's columns: by its name, else by the table's shape
    (the only length, the only force).
    """
    meant: dict[str, tuple[int, str]] = {}
    columns = list(zip(*rows, strict=True))
    for place, name in enumerate(names):
        known, unit = headings.schedule_column(name)
        if known == "start" and not NUMBER.fullmatch(columns[place][0]):
            # a time of day has no unit
            unit = "s"
        if known and known not in meant:
            meant[known] = (place, unit)
    taken = {place for place, _ in meant.values()}
    numeric = {
        place: name
        for place, name in enumerate(names)
        if place not in taken and all(map(_is_number, columns[place]))
    }
    for known, usual in BY_UNIT.items():
        fitting = [p for p, name in numeric.items() if headings.named(name)[1] in usual]
        if known not in meant and len(fitting) == 1:
            meant[known] = fitting[0], headings.named(numeric.pop(fitting[0]))[1]
    if "lift" not in meant and {"distance", "throttle"} <= meant.keys():
        _add_lift(meant, numeric)
    scatter = [
        place
        for place, name in numeric.items()
        if headings.words(name) & headings.SCATTER_WORDS
        and headings.force_unit(name) in ("", *FORCE_UNITS)
    ]
    if "lift" in meant and "lift_sd" not in meant and len(scatter) == 1:
        meant["lift_sd"] = scatter[0], headings.force_unit(numeric[scatter[0]])
    return meant


def _add_lift(meant: dict[str, tuple[int, str]], numeric: Mapping[int, str]) -> None:
    """Add the lift of a table of means: the one column in a unit of force, or called one, that is
    no other statistic.
    """
    unit = {place: headings.force_unit(name) for place, name in numeric.items()}
    said = {place: headings.words(name) for place, name in numeric.items()}
    other = headings.OTHER_STATISTICS | headings.SCATTER_WORDS | headings.COMMAND_WORDS
    forces = [
        p
        for p in numeric
        if not said[p] & other
        and (unit[p] in FORCE_UNITS or (not unit[p] and said[p] & headings.LIFT_WORDS))
    ]
    called_mean = [p for p in forces if said[p] & headings.MEAN_WORDS]
    with_unit = [p for p in forces if unit[p]]
    chosen = next((c[0] for c in (forces, called_mean, with_unit) if len(c) == 1), None)
    if chosen is not None:
        meant["lift"] = chosen, unit[chosen]


def _is_number(cell: str) -> bool:
    return not cell or (NUMBER.fullmatch(cell) is not None and math.isfinite(float(cell)))


# ---- several tables in one file


def several(path: Path, dialect: RecordsDialect) -> InputRefused | None:
    """The refusal of a text with more than one table, below or next to each other; None of one."""
    if path.stat().st_size > MOST_BYTES:
        return None
    lines = path.read_bytes().decode(str(dialect.get("encoding", "utf-8")), "replace").splitlines()
    cells = [_cells(line) for line in lines]
    tables: list[tuple[int, int]] = []
    for at in range(1, len(lines)):
        if not _is_row(cells[at]):
            continue
        if tables and tables[-1][1] == at - 1:
            tables[-1] = tables[-1][0], at
        elif _is_header(cells[at - 1], len(cells[at])):
            tables.append((at, at))
    whole = [(a, b) for a, b in tables if b > a]
    if len(whole) > 1:
        where = ", ".join(f"lines {a} to {b + 1}" for a, b in whole[:4])
        return InputRefused(
            str(path), f"holds {len(whole)} tables: {where}", "save each as a file of its own"
        )
    heads = cells[whole[0][0] - 1] if whole else []
    names = [c for c in heads if c not in ("", "-")]
    if len(names) < len(heads) - 1 or len(set(names)) < len(names):
        return InputRefused(
            f"{path}, line {whole[0][0]}",
            "has two tables side by side: its columns' names repeat, or leave gaps",
            "save each as a file of its own",
        )
    return None


def _cells(line: str) -> list[str]:
    """The cells of a line, by the separator that cuts it into most."""
    return max((line.split(sign) for sign in (";", "\t", "|", ",")), key=len)


def _is_row(cells: Sequence[str]) -> bool:
    """Whether cells are numbers, some of them blank."""
    filled = [c.strip() for c in cells if c.strip() not in ("", "-")]
    return len(filled) > 1 and all(NUMBER.fullmatch(c.replace(",", ".")) for c in filled)


def _is_header(cells: Sequence[str], width: int) -> bool:
    """Whether cells may be names of so many columns."""
    filled = [c.strip() for c in cells if c.strip()]
    return len(cells) == width and len(filled) > 1 and not any(map(NUMBER.fullmatch, filled))
