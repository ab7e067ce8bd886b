"""A table in a file as a schedule: its columns that are those of trials.csv, with their units."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from nearlift.errors import InputRefused
from nearlift.onboarding import headings
from nearlift.readers.base import (
    AS_FORCE,
    FORCE_UNITS,
    Channel,
    Contents,
    RecordsDialect,
    fold,
    parted,
)
from nearlift.readers.files import content_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.text import cells_of
from nearlift.schedule import BLANK, BY_NAME, MEANS, STANDARD_ERROR
from nearlift.units import NUMBER

#: Largest table that is taken for a schedule, bytes.
MOST_BYTES = 4 << 20
#: Rows in a row at one setting, on average, beyond which a table is a record in steps.
MOST_REPEATS = 50
#: A throttle within the name of a column of lifts.
LEVEL = re.compile(r"(?<!\d)(\d+(?:\.\d+)?) ?(?:%|percent|pct|([uµμ]s))")
#: A mean with its standard deviation: ``1.234 ± 0.005``, ``1.234 ± 0.4%`` of the mean,
#: ``1.234(5)`` in its last digits, or ``1.234(0.005)``.
WITH_SD = re.compile(
    r"((?<!\d)-?\d++(?:\.(\d*+))?(?:[eE][-+]?\d++)?)\s*+(?:\((\d++(?:\.\d++)?)\)?"
    r"|(?:±|\+/-|\+-|\\pm)\s*+(\d++(?:\.\d*+)?(?:[eE][-+]?\d++)?)\s*+(%?))"
)
SD_WITH_COMMAS = re.compile(r"\d,\d++\s*+(?:±|\+/-|\+-|\\pm|\()\s*+\d++[,)]")
#: Units by which the only column of its kind is known, whatever it is called.
BY_UNIT = {"distance": ("mm", "cm", "m", "in", "um"), "throttle": ("percent",)}


class ProposedSchedule(NamedTuple):
    """A trials.csv, the units of its columns (empty: unknown), and refusals of its cells."""

    trials: pd.DataFrame
    units: dict[str, str]
    refusals: tuple[InputRefused, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputTable:
    """A text table whose `cells` are under a schedule's names where they are known.

    `units` are those of the schedule's columns (empty: unknown), `written` their headings.
    `notes` are remarks on columns that are not taken.
    """

    path: Path
    cells: pd.DataFrame
    units: Mapping[str, str]
    written: Mapping[str, str]
    kind: str
    notes: tuple[str, ...]

    @property
    def lists_trials(self) -> bool:
        """Whether it may be a schedule: it has a distance and another setting, and no clock."""
        clocked = any(map(headings.is_clock, {*self.cells, *self.written.values()}))
        if "distance" not in self.units or (clocked and "trial" not in self.units):
            return False
        if self.units.keys().isdisjoint({"trial", "boundary", "throttle", "lift"}):
            return False
        # in a record one setting lasts for many samples
        settings = self.cells.reindex(columns=["boundary", "distance", "throttle"], fill_value="")
        return len(settings) <= MOST_REPEATS * int((settings != settings.shift()).any(axis=1).sum())

    @property
    def means(self) -> bool:
        """Whether it may be a table of mean lifts: lifts by distance."""
        return "lift" in self.units and self.lists_trials

    @property
    def contents(self) -> Contents:
        """Its columns of numbers as channels, under their headings, NaN where a cell is blank;
        notes on other columns.
        """
        channels = []
        for name, cells in self.cells.items():
            heading, unit = self.written.get(str(name), str(name)), self.units.get(str(name), "")
            if cells.map(_is_number).all() and not _blank(cells).all():
                values = cells.mask(_blank(cells), "nan").to_numpy(np.float64)
                channels.append(Channel(name=heading, unit=unit, values=values))
        notes = (*self.notes, *(refusal.what for refusal in self.schedule().refusals))
        return Contents(channels=tuple(channels), kind=self.kind, notes=notes)

    def ids(self, wanted: Collection[str]) -> tuple[list[str], list[str]]:
        """Trial of every row, and the wanted names that no row has.

        Trials are taken from the column with most of these ids or files' names. Names that differ
        only in case or Unicode form are equal.
        """
        alike = {fold(name): name for name in wanted}
        best: tuple[list[str], list[str]] = ([], [*wanted])
        for _, cells in self.cells.items():
            for candidate in (cells, cells.map(lambda cell: trial_of(Path(cell)))):
                rows = candidate.to_list()
                if len(alike) == len(wanted):
                    rows = [alike.get(fold(row), row) for row in rows]
                lacking = sorted({*wanted} - {*rows})
                best = min(best, (rows, lacking), key=lambda column: len(column[1]))
        return best

    def schedule(self, ids: Sequence[str] = (), header: str = "trial") -> ProposedSchedule:
        """Schedule of this table.

        `ids` are the records of its rows. Without them the table has its lifts. Its trials are then
        its own, or counted, and rows without a lift are left out. `header` is ``"record"`` where
        records bring their throttle.
        """
        left_out = {"trial", header, *["throttle"] * (header == "record")}
        if ids or not self.means:
            left_out |= {*MEANS}
        cells = self.cells
        if not ids:
            cells = cells[~_blank(cells["lift"])] if self.means else cells
            stated = cells.get("trial", pd.Series("", cells.index))
            named = stated.is_unique and stated.all()
            ids = stated.to_list() if named else [str(i + 1) for i in range(len(stated))]
        # names of files stay, under their own heading
        listed = cells.rename(columns={"trial": self.written.get("trial", "trial")})
        trials = listed.drop(columns=left_out, errors="ignore")
        trials.insert(0, header, ids)
        units = {n: u for n, u in self.units.items() if BY_NAME[n].kind == "quantity"}
        units = {n: u for n, u in units.items() if n in trials}
        return ProposedSchedule(trials, units, tuple(self._refusals(trials[[*units]], cells)))

    def _refusals(self, quantities: pd.DataFrame, cells: pd.DataFrame) -> Iterator[InputRefused]:
        """Refusals of cells that a schedule cannot have, one for each column."""
        free = cells.get("boundary", pd.Series("", cells.index)) == "none"
        for name, column in quantities.drop(columns="start", errors="ignore").items():
            bad = ~column.map(_is_number)
            if name in ("distance", "throttle"):
                bad |= _blank(column) & ~(free & (name == "distance"))
            for row, cell in column[bad].head(1).items():
                where = f"column {self.written[str(name)]!r}, row {int(str(row)) + 1}"
                remedy = "write a number into each row, all in one unit (merged cells show it"
                remedy += " once); only in free air, boundary none, is there no distance"
                what = f"{where} is {cell!r}: a number is needed"
                yield InputRefused(str(self.path), what, remedy)


def trial_of(file: Path) -> str:
    """Name of a file without its suffix, and without that of its compression."""
    return Path(file.name.removesuffix(".gz")).stem


def table_of(path: Path, dialect: RecordsDialect) -> InputTable | None:
    """Table in a file; None where it has none, or is too large for a schedule."""
    try:
        content = content_of(path, MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            return None
        layout, rows = cells_of(_without_bars(content), str(path), dialect)
    except (InputRefused, Malformed):
        return None
    if not rows:
        return None
    cells = pd.DataFrame(rows, dtype=object)
    # no cell of these is a number, which would show the decimal comma
    commas = cells.apply(lambda column: column.str.contains(SD_WITH_COMMAS).all()).any()
    if layout.decimal == "," or commas:
        cells = cells.apply(lambda column: column.str.replace(",", "."))
    stated = [
        f"{name} ({unit})" if unit and not headings.named(name)[1] else name
        for name, unit in zip(layout.names, layout.units, strict=True)
    ]
    for place, name in enumerate(stated):
        stated[place], cells[place] = _without_unit(name, cells[place])
    names, cells = _lengthened(stated, cells)
    written = list(layout.names) if names == stated else list(names)
    for place, name in enumerate(list(names)):
        pairs = [pair for cell in cells[place] if (pair := _mean_and_sd(cell))]
        if len(pairs) == len(cells) and any(sd for _, sd in pairs):
            bare, unit = headings.named(name)
            # "Thrust ± SD" and "Thrust (SD)" name both
            bare, unit = re.split(r"[±+(]", bare)[0].rstrip() or bare, f" ({unit})" if unit else ""
            cells[place], cells[len(names)] = zip(*pairs, strict=True)
            names[place] = f"{bare}{unit}"
            for headers in (names, written):
                headers.append(f"{bare} sd{unit}")
    meant, notes = _columns_meant(names, [cells[place].to_list() for place in cells])
    places = {place: name for name, (place, _) in meant.items()}
    places |= {p: n for p, n in enumerate(written) if p not in places and n not in BY_NAME}
    if "lift" in meant and (lost := int(_blank(cells[meant["lift"][0]]).sum())):
        notes.append(f"{lost} of {len(cells)} rows have no lift and are left out")
    return InputTable(
        path=path,
        cells=cells[list(places)].set_axis(list(places.values()), axis="columns"),
        units={name: unit for name, (_, unit) in meant.items()},
        written={name: written[place] for name, (place, _) in meant.items()},
        kind=f"table: {layout.spoken}" if layout.spoken else "table",
        notes=tuple(notes),
    )


def _without_bars(content: bytes) -> bytes:
    """A Markdown table without outer bars and the rule below its header; other text as it is."""
    lines = [line for whole in content.splitlines() if (line := whole.strip())]
    if not all(line.startswith(b"|") and line.endswith(b"|") for line in lines):
        return content
    return b"".join(line[1:-1] + b"\n" for line in lines if line.strip(b"|:- "))


def _without_unit(name: str, cells: pd.Series[str]) -> tuple[str, pd.Series[str]]:
    """Heading with the one unit of cells such as ``30 mm``, and the cells without it."""
    pairs = cells.map(lambda cell: (cell, "") if WITH_SD.fullmatch(cell) else parted(cell))
    numbers = pairs.map(lambda pair: _mean_and_sd(pair[0]) is not None)
    units = {unit for _, unit in pairs[~_blank(cells)]}
    bare, unit = headings.named(name)
    is_id = headings.schedule_column(name)[0] == "trial"
    if len(units) != 1 or units == {""} or not numbers.all() or is_id or unit not in ("", *units):
        return name, cells
    return f"{bare} ({units.pop()})", pairs.map(lambda pair: pair[0])


def _mean_and_sd(cell: str) -> tuple[str, str] | None:
    """Mean and standard deviation (empty: none) of a cell; None where it has other content."""
    if _is_number(cell):
        return cell, ""
    match = WITH_SD.fullmatch(cell)
    if match is None:
        return None
    mean, decimals, digits, sd, percent = match.groups()
    if sd:
        return mean, f"{abs(float(mean)) * float(sd) / 100:.4g}" if percent else sd
    places, of_sd = len(decimals or ""), len(digits.partition(".")[2])
    # last digits of a power, or in other decimals than the mean: neither is certain
    if "e" in mean.lower() or of_sd not in (0, places):
        return None
    return mean, digits if of_sd else f"{float(f'{digits}e-{places}'):.{places}f}"


def _lengthened(names: list[str], cells: pd.DataFrame) -> tuple[list[str], pd.DataFrame]:
    """The table with one lift a row.

    Lifts at several throttles may be side by side, in columns such as ``50 % (gf)`` or
    ``1500 us (N)``. Any other table is returned as it is.
    """
    lifts = {}
    for place, name in enumerate(names):
        bare, unit = headings.named(name)
        level = LEVEL.search(bare)
        if level and AS_FORCE.get(unit, unit) in FORCE_UNITS:
            lifts[place] = level[1], "us" if level[2] else "percent", unit
    units = {lift[1:] for lift in lifts.values()}
    others = [place for place in range(len(names)) if place not in lifts]
    distances = [p for p in others if headings.schedule_column(names[p])[0] == "distance"]
    # each distance once: not the samples of a record
    if len(lifts) < 2 or len(units) > 1 or len(distances) != 1 or not cells[distances[0]].is_unique:
        return names, cells
    throttle_unit, unit = units.pop()
    tables = [
        cells[others].assign(throttle=level, lift=cells[place])
        for place, (level, _, _) in lifts.items()
    ]
    columns = [names[p] for p in others] + [f"throttle ({throttle_unit})", f"lift ({unit})"]
    return columns, pd.concat(tables, ignore_index=True).set_axis(range(len(columns)), axis=1)


def _columns_meant(
    names: Sequence[str], columns: Sequence[Sequence[str]]
) -> tuple[dict[str, tuple[int, str]], list[str]]:
    """Place and unit of each of the schedule's columns, and notes on columns that may mean one.

    A column is known by its name, else by the table's shape: the only length, the only force. The
    schedule's own name comes before others.
    """
    meant: dict[str, tuple[int, str]] = {}
    notes = []
    for place, name in sorted(enumerate(names), key=lambda x: not headings.is_own_name(x[1])):
        known, unit = headings.schedule_column(name)
        # a time of day has no unit
        is_number = known != "start" or NUMBER.fullmatch(columns[place][0])
        if known in meant and BY_NAME[known].kind == "quantity":
            taken = names[meant[known][0]]
            notes.append(f"column {name!r} may be the {known}, too: {taken!r} is taken for it")
        if known:
            meant.setdefault(known, (place, unit if is_number else "s"))
    places = {place for place, _ in meant.values()}
    numeric = [p for p, c in enumerate(columns) if p not in places and all(map(_is_number, c))]
    units = {p: headings.named(names[p])[1] for p in numeric}
    for known, usual in BY_UNIT.items():
        fitting = [p for p in numeric if units[p] in usual]
        if known not in meant and len(fitting) == 1:
            meant[known] = fitting[0], units[fitting[0]]
            numeric.remove(fitting[0])
    forces = {p: AS_FORCE.get(units[p], units[p]) for p in numeric}
    forces = {p: unit for p, unit in forces.items() if unit in ("", *FORCE_UNITS)}
    errors = [p for p in forces if headings.says(names[p], "standard_error")]
    scatter = [p for p in forces if headings.says(names[p], "scatter") and p not in errors]
    if "lift" not in meant and {"distance", "throttle"} <= meant.keys():
        may = [p for p in forces if forces[p] or headings.says(names[p], "lift")]
        may = [p for p in may if not headings.says(names[p], "other_statistic", "scatter")]
        chosen = headings.likely_force([(names[p], forces[p]) for p in may])
        if chosen is not None:
            meant["lift"] = may[chosen], forces[may[chosen]]
    if "lift" in meant and "lift_sd" not in meant:
        if len(scatter) == 1:
            meant["lift_sd"] = scatter[0], forces[scatter[0]]
        notes += [f"column {names[p]!r} is not read: {STANDARD_ERROR}" for p in errors]
    return dict(sorted(meant.items(), key=lambda item: item[1])), notes


def _blank(cells: pd.Series[str]) -> pd.Series[bool]:
    return cells.str.lower().isin(BLANK)


def _is_number(cell: str) -> bool:
    """Whether a cell is a finite number, or blank."""
    number = NUMBER.fullmatch(cell) and math.isfinite(float(cell))
    return bool(number) or cell.lower() in BLANK


def several(path: Path, dialect: RecordsDialect) -> InputRefused | None:
    """Refusal of a text with more than one table, below or next to each other; None of one."""
    if path.stat().st_size > MOST_BYTES:
        return None
    lines = path.read_bytes().decode(str(dialect.get("encoding", "utf-8")), "replace").splitlines()
    # the cells of a line, by the separator that cuts it into most; a dash is a blank
    cut = (max((line.split(sign) for sign in ";\t|,"), key=len) for line in lines)
    cells = [[cell.strip(" -") for cell in line] for line in cut]
    # names above two rows at least
    headers = [m.start() for m in re.finditer("(?=hnn)", "".join(map(_kind, cells)))]
    headers = [i for i in headers if len(cells[i]) == len(cells[i + 1])]
    what = ""
    if len(headers) > 1:
        where = ", ".join(str(i + 1) for i in headers[:4])
        what = f"holds {len(headers)} tables, with their columns' names in lines {where}"
    elif headers and len({*cells[headers[0]]} - {""}) < len(cells[headers[0]]) - 1:
        what = f"has two tables side by side, from line {headers[0] + 1} on: names of columns"
        what += " repeat, or leave gaps"
    return InputRefused(str(path), what, "save each as a file of its own") if what else None


def _kind(cells: Sequence[str]) -> str:
    """Kind of a line: header, numbers, or a blank for any other."""
    filled = [cell for cell in cells if cell]
    numbers = sum(map(bool, (NUMBER.fullmatch(cell.replace(",", ".")) for cell in filled)))
    if len(filled) < 2 or 0 < numbers < len(filled):
        return " "
    return "n" if numbers else "h"
