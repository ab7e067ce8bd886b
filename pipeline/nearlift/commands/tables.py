"""A spreadsheet's table as a schedule: which columns are those of trials.csv, in which units."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from nearlift import units
from nearlift.campaign.manifest import BLANK
from nearlift.commands import meaning
from nearlift.errors import InputRefused
from nearlift.readers import text
from nearlift.readers.channel import RecordsDialect
from nearlift.readers.dialect import sniff
from nearlift.readers.table import CellSyntax
from nearlift.schedule import BY_NAME, MEANS, REQUIRED, csv_text
from nearlift.units import NUMBER

#: A schedule is written by hand, or by a spreadsheet.
MOST_BYTES = 4 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A text table: names and cells as they stand, decimal points, and the place of each of the
    schedule's columns that was recognised, with its unit.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    meant: Mapping[str, tuple[int, str]]

    @property
    def lists_trials(self) -> bool:
        """Whether it may be a schedule: a distance, what makes it one of trials, and no clock."""
        other = {"trial", "boundary", "throttle", "lift"} & self.meant.keys()
        clocked = any(map(meaning.is_clock, self.names))
        return "distance" in self.meant and bool(other) and not clocked

    @property
    def means(self) -> bool:
        """Whether it may be a table of mean lifts: lift by distance, and no clock."""
        return self.lists_trials and "lift" in self.meant

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
        if "trial" in self.meant:
            cells = [row[self.meant["trial"][0]] for row in self.rows]
            if len(set(cells)) == len(cells) and all(cells):
                return cells
        return [str(i) for i in range(1, len(self.rows) + 1)]

    def wanted(self, means: bool) -> list[str]:
        """What else a diagnosis wants, where the trials near some boundary are few."""
        from nearlift.loop.admission import LEAST_TRIALS

        def cells(name: str) -> list[str]:
            return [row[self.meant[name][0]] if name in self.meant else "" for row in self.rows]

        fewest = min(
            n
            for side, n in Counter(cells("boundary")).items()
            if side != "none" or n == len(self.rows)
        )
        enough = LEAST_TRIALS + len(set(cells("throttle"))) + 1
        if fewest >= enough or (means and "lift_sd" in self.meant):
            return []
        return [
            f"trials.csv: lift_sd, if it is known: {fewest} rows without it give no diagnosis"
            if means
            else f"trials.csv: more trials, if there are any: {fewest} near a boundary give a"
            f" coefficient, {enough} a diagnosis as well"
        ]

    def schedule(self, ids: list[str], means: bool, of_records: bool = False) -> tuple[str, str]:
        """The table as trials.csv, and the [trials] section that goes with it; `means`: with the
        columns of mean lifts; `of_records`: a row is a record, whose pieces say their throttle.
        """
        left_out: tuple[str, ...] = () if means else MEANS
        wanted = [n for n in REQUIRED[1:] if n not in self.meant]
        if of_records:
            left_out, wanted = (*left_out, "throttle"), [n for n in wanted if n != "throttle"]
        names = {
            place: name
            for name, (place, _) in self.meant.items()
            if name != "trial" and name not in left_out
        }
        places = sorted(names) + [
            i for i, name in enumerate(self.names) if i not in names and name not in BY_NAME
        ]
        first = "record" if of_records else "trial"
        header = [first, *(names.get(i, self.names[i]) for i in places)]
        pairs = zip(ids, self.rows, strict=True)
        made = csv_text(header, ([trial, *(row[i] for i in places)] for trial, row in pairs))
        given = {n: u for n, (_, u) in self.meant.items() if n in names.values()}
        ordered = not means or "start" in self.meant
        return made, trials_section(given, wanted, ordered=ordered)


def trials_section(given: Mapping[str, str], lacking: Collection[str], *, ordered: bool) -> str:
    """[trials] with these columns and units; what no column says is a constant to fill in."""
    lines = ["[trials]", 'file = "trials.csv"                  # one row per trial']
    if not ordered:
        lines.append(
            f'order = "{BLANK}"                    # "run": rows stand as they were run; "unknown":'
            " a published table"
        )
    lines.append("[trials.units]")
    for name, unit in given.items():
        if BY_NAME[name].kind == "quantity":
            remark = "" if unit else _remark(name)
            lines.append(f'{name:<8} = "{unit or BLANK}"{remark}')
    spread = "lift" in given and "lift_sd" not in given
    if spread:
        lines.append(
            f'# lift_sd = "{given["lift"] or "N"}"                  # standard deviation of a lift:'
            " fewer than 45 rows want it"
        )
    if lacking or spread:
        lines.append("[trials.constants]                   # the same for every trial")
        lines += [f'{name:<8} = "{BLANK}"' for name in lacking]
        lines += ["# lift_sd = 0.1"] if spread else []
    return "\n".join(lines) + "\n"


def _remark(name: str) -> str:
    """What to fill in for a column's unit."""
    usual = units.USUAL.get(BY_NAME[name].dimension, (units.SI[BY_NAME[name].dimension],))
    return f"{'':<11}# {' | '.join(usual)}"


def table_of(path: Path, dialect: RecordsDialect) -> Table | None:
    """A file as such a table; None where it is none, or is too large for one."""
    if path.stat().st_size > MOST_BYTES:
        return None
    content = path.read_bytes()
    try:
        layout = sniff(content, str(path), text.given(dialect))
        lines = content.decode(layout.encoding).splitlines()[layout.first - 1 :]
        rows = tuple(_rows(lines, layout.cells, len(layout.names)))
    except (InputRefused, UnicodeDecodeError, csv.Error):
        return None
    if not rows or any(len(row) != len(layout.names) for row in rows):
        return None
    meant: dict[str, tuple[int, str]] = {}
    for place, name in enumerate(layout.names):
        unit = layout.units[place]
        known, unit = meaning.schedule_column(
            f"{name} ({unit})" if unit and not meaning.named(name)[1] else name
        )
        if known == "start" and not NUMBER.fullmatch(rows[0][place]):
            # a time of day needs no unit
            unit = "s"
        if known and known not in meant:
            meant[known] = (place, unit)
    return Table(names=layout.names, rows=rows, meant=meant)


def _rows(lines: Collection[str], cells: CellSyntax, width: int) -> Iterator[tuple[str, ...]]:
    for line in lines:
        if not cells.skips(line):
            row = cells.split(line)[: width if cells.trailing else None]
            yield tuple(c.replace(",", ".") if cells.decimal == "," else c for c in row)
