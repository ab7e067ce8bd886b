"""A table in a file as a schedule: its columns that are those of trials.csv, with their units."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from nearlift.errors import InputRefused
from nearlift.onboarding import headings
from nearlift.readers import guarded
from nearlift.readers.base import FORCE_UNITS, RecordsDialect
from nearlift.readers.files import content_of, is_packed
from nearlift.readers.guarded import Malformed
from nearlift.readers.text import cells_of
from nearlift.schedule import BY_NAME, MEANS, REQUIRED
from nearlift.units import NUMBER

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputTable:
    """A text table whose `cells` are under a schedule's names where they are known.

    `units` are those of the schedule's columns (empty: unknown), `written` their headings.
    """

    cells: pd.DataFrame
    units: Mapping[str, str]
    written: Mapping[str, str]

    @property
    def lists_trials(self) -> bool:
        """Whether it may be a schedule: it has a distance and another setting, and no clock."""
        other = {"trial", "boundary", "throttle", "lift"} & self.units.keys()
        clocked = any(map(headings.is_clock, {*self.cells, *self.written.values()}))
        if "distance" not in self.units or not other or (clocked and "trial" not in self.units):
            return False
        # in a record one setting lasts for many samples
        settings = self.cells.reindex(columns=["boundary", "distance", "throttle"], fill_value="")
        return len(settings) <= MOST_REPEATS * int((settings != settings.shift()).any(axis=1).sum())

    @property
    def means(self) -> bool:
        """Whether it may be a table of mean lifts: lifts by distance."""
        return "lift" in self.units and self.lists_trials

    def ids(self, wanted: Collection[str]) -> list[str] | None:
        """Trial of every row, from the column with all these ids or files' names; else None."""
        for _, cells in self.cells.items():
            stems = cells.map(lambda cell: Path(cell).stem if Path(cell).suffix else cell)
            for candidate in (cells, stems):
                if set(wanted) <= set(candidate):
                    return candidate.to_list()
        return None

    def row_ids(self) -> list[str]:
        """Trial of every row, from the column of that name, else counted."""
        if "trial" in self.units and self.cells["trial"].is_unique and all(self.cells["trial"]):
            return self.cells["trial"].to_list()
        return [str(i) for i in range(1, len(self.cells) + 1)]

    def schedule(self, ids: list[str], means: bool, of_records: bool = False) -> ProposedSchedule:
        """Schedule of this table.

        Parameters
        ----------
        ids : list of str
            Trial or record of every row.
        means : bool
            Whether its lifts are taken along.
        of_records : bool
            Whether a row is a record, whose pieces bring their throttle.
        """
        header = "record" if of_records else "trial"
        left_out = {"trial", header, *(() if means else MEANS), *["throttle"] * of_records}
        # names of files stay, under their own heading
        listed = self.cells.rename(columns={"trial": self.written.get("trial", "trial")})
        trials = listed.drop(columns=left_out, errors="ignore")
        trials.insert(0, header, ids)
        return ProposedSchedule(
            trials=trials,
            units={
                name: unit
                for name, unit in self.units.items()
                if name not in left_out and BY_NAME[name].kind == "quantity"
            },
            lacking=tuple(
                name
                for name in REQUIRED[1:]
                if name not in self.units and not (of_records and name == "throttle")
            ),
            ordered=not means or "start" in self.units,
        )


def table_of(path: Path, dialect: RecordsDialect) -> InputTable | None:
    """Table in a file; None where it has none, or is too large for a schedule."""
    if path.stat().st_size > MOST_BYTES:
        return None
    try:
        asked = path, MOST_BYTES + 1
        content = guarded.run(content_of, *asked) if is_packed(path) else content_of(*asked)
        if len(content) > MOST_BYTES:
            return None
        layout, rows = cells_of(content, str(path), dialect)
    except (InputRefused, Malformed):
        return None
    if not rows:
        return None
    columns = [
        [c.replace(",", ".") if layout.decimal == "," else c for c in row]
        for row in zip(*rows, strict=True)
    ]
    stated = [
        f"{name} ({unit})" if unit and not headings.named(name)[1] else name
        for name, unit in zip(layout.names, layout.units, strict=True)
    ]
    meant = columns_meant(stated, columns)
    places = {place: name for name, (place, _) in sorted(meant.items(), key=lambda x: x[1][0])}
    places |= {p: n for p, n in enumerate(layout.names) if p not in places and n not in BY_NAME}
    return InputTable(
        cells=pd.DataFrame({name: columns[place] for place, name in places.items()}),
        units={name: unit for name, (_, unit) in meant.items()},
        written={name: layout.names[place] for name, (place, _) in meant.items()},
    )


def columns_meant(
    names: Sequence[str], columns: Sequence[Sequence[str]]
) -> dict[str, tuple[int, str]]:
    """Place and unit of each of the schedule's columns.

    A column is known by its name, else by the table's shape: the only length, the only force.
    """
    meant: dict[str, tuple[int, str]] = {}
    for place, name in enumerate(names):
        known, unit = headings.schedule_column(name)
        if known == "start" and not NUMBER.fullmatch(columns[place][0]):
            # a time of day has no unit
            unit = "s"
        if known:
            meant.setdefault(known, (place, unit))
    taken = {place for place, _ in meant.values()}
    numeric = [p for p, c in enumerate(columns) if p not in taken and all(map(_is_number, c))]
    for known, usual in BY_UNIT.items():
        fitting = [p for p in numeric if headings.named(names[p])[1] in usual]
        if known not in meant and len(fitting) == 1:
            meant[known] = fitting[0], headings.named(names[fitting[0]])[1]
            numeric.remove(fitting[0])
    forces = {p: headings.force_unit(names[p]) for p in numeric}
    forces = {p: unit for p, unit in forces.items() if unit in ("", *FORCE_UNITS)}
    words = {p: headings.words(names[p]) for p in forces}
    if "lift" not in meant and {"distance", "throttle"} <= meant.keys():
        no_mean = headings.OTHER_STATISTICS | headings.SCATTER_WORDS
        may = [p for p in forces if not words[p] & no_mean]
        may = [p for p in may if forces[p] or words[p] & headings.LIFT_WORDS]
        chosen = headings.likely_force([(names[p], forces[p]) for p in may])
        if chosen is not None:
            meant["lift"] = may[chosen], forces[may[chosen]]
    scatter = [p for p in forces if words[p] & headings.SCATTER_WORDS]
    if "lift" in meant and "lift_sd" not in meant and len(scatter) == 1:
        meant["lift_sd"] = scatter[0], forces[scatter[0]]
    return meant


def _is_number(cell: str) -> bool:
    return not cell or (NUMBER.fullmatch(cell) is not None and math.isfinite(float(cell)))


# ---- several tables in one file


def several(path: Path, dialect: RecordsDialect) -> InputRefused | None:
    """Refusal of a text with more than one table, below or next to each other; None of one."""
    if path.stat().st_size > MOST_BYTES:
        return None
    lines = path.read_bytes().decode(str(dialect.get("encoding", "utf-8")), "replace").splitlines()
    # the cells of a line, by the separator that cuts it into most
    cells = [max((line.split(sign) for sign in ";\t|,"), key=len) for line in lines]
    # first and last row of each table
    tables: list[tuple[int, int]] = []
    for at in range(1, len(lines)):
        if not _is_row(cells[at]):
            continue
        if tables and tables[-1][1] == at - 1:
            tables[-1] = tables[-1][0], at
        elif _is_header(cells[at - 1], len(cells[at])):
            tables.append((at, at))
    tables = [(first, last) for first, last in tables if last > first]
    if not tables:
        return None
    first = tables[0][0]
    heads = cells[first - 1]
    aside = len({*heads} - {"", "-"}) < len(heads) - 1
    if len(tables) == 1 and not aside:
        return None
    where = ", ".join(f"lines {a} to {b + 1}" for a, b in tables[:4])
    what = f"holds {len(tables)} tables: {where}"
    if len(tables) == 1:
        what = (
            f"has two tables side by side, from line {first} on: its columns' names repeat, or"
            " leave gaps"
        )
    return InputRefused(str(path), what, "save each as a file of its own")


def _is_row(cells: Sequence[str]) -> bool:
    """Whether cells are numbers, some of them blank."""
    filled = [c.strip() for c in cells if c.strip() not in ("", "-")]
    return len(filled) > 1 and all(NUMBER.fullmatch(c.replace(",", ".")) for c in filled)


def _is_header(cells: Sequence[str], width: int) -> bool:
    """Whether cells may be names of so many columns."""
    filled = [c.strip() for c in cells if c.strip()]
    return len(cells) == width and len(filled) > 1 and not any(map(NUMBER.fullmatch, filled))
