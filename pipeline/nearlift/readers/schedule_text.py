"""The text of trials.csv and the manifest's constants as columns of cells that know their lines."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from nearlift import units
from nearlift.campaign.manifest import Campaign
from nearlift.errors import InputRefused, ManifestError, brief
from nearlift.readers.columns import BY_NAME, ColumnTexts


def text_of(path: Path) -> str:
    """The file as text; refuses one that is missing or no UTF-8."""
    if not path.is_file():
        raise InputRefused(
            str(path),
            "is missing",
            "the schedule lists every trial; name it under [trials] file = ...",
        )
    try:
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise InputRefused(
            str(path), f"is not UTF-8 text (byte {fault.start})", "save it as UTF-8"
        ) from None


def unended(path: Path, text: str) -> list[str]:
    """A note where the last line has no end: `300` that was cut to `30` reads as well."""
    last = text[max(text.rfind("\n"), text.rfind("\r")) + 1 :]
    if not last.strip():
        return []
    note = (
        f"{path.name} ends within a line, {brief(repr(last), 80)}: if it was cut off there, that"
        " row is wrong and more may be lost; end the line"
    )
    return [note]


def columns_of(campaign: Campaign, path: Path, text: str) -> dict[str, ColumnTexts]:
    """Every column's texts, constants included, in the file's order."""
    header: list[str] = []
    columns: list[list[str]] = []
    lines: list[int] = []
    # what stands in many rows is kept once
    kept: dict[str, str] = {}
    reader = csv.reader(io.StringIO(_without_remarks(text), newline=""), strict=True)
    try:
        for row in reader:
            if not any(cell.strip() for cell in row):
                continue
            if not header:
                header = _header(path, reader.line_num, row)
                columns = [[] for _ in header]
                continue
            if len(row) != len(header):
                raise InputRefused(
                    f"{path}, line {reader.line_num}",
                    f"has {len(row)} cells under {len(header)} column names",
                    "mend that line (a decimal comma makes two cells of one)",
                )
            lines.append(reader.line_num)
            for column, cell in zip(columns, row, strict=True):
                column.append(kept.setdefault(cell, cell))
    except csv.Error as fault:
        raise InputRefused(
            f"{path}, line {reader.line_num}", f"is not CSV: {fault}", "mend that line"
        ) from None
    if not header:
        raise InputRefused(
            str(path), "is empty", "the first line names the columns, then one line per trial"
        )
    if not lines:
        raise InputRefused(
            str(path), "lists no trial", "one line per trial, in the order in which they were run"
        )
    cells = {
        name: ColumnTexts(name, column, path.name, lines)
        for name, column in zip(header, columns, strict=True)
    }
    for name, value in campaign.trials.constants.items():
        if name in cells:
            raise ManifestError(
                f"trials.constants.{name}",
                f"stands beside a column {name!r} of {path.name}",
                "keep one of them",
            )
        cells[name] = _constant(campaign, name, value, len(lines))
    return cells


def _without_remarks(text: str) -> str:
    """The same with lines above the header that begin with ``#`` made blank; a header behind ``#``
    is left to be refused by its names.
    """
    above = re.match(r"(?:[ \t]*(?:#[^\r\n]*)?(?:\r\n|\r|\n))*", text)
    remarks = above[0] if above else ""
    if any(
        {"trial"} < {cell.strip(' \t"#') for cell in line.split(",")} & BY_NAME.keys()
        for line in remarks.splitlines()
    ):
        return text
    return re.sub(r"#[^\r\n]*", "", remarks) + text[len(remarks) :]


def _header(path: Path, line: int, row: list[str]) -> list[str]:
    """The columns' names."""
    header = [name.strip() for name in row]
    if len(header) == 1 and any(d in header[0] for d in ";\t"):
        raise InputRefused(
            str(path),
            "is not separated by commas",
            "save it with commas between cells and points in decimals",
        )
    twice = sorted(n for n, k in Counter(header).items() if k > 1)
    if twice:
        raise InputRefused(
            f"{path}, line {line}",
            f"the column {twice[0]!r} stands twice",
            "rename or drop one of them",
        )
    if "" in header:
        raise InputRefused(
            f"{path}, line {line}",
            f"column {header.index('') + 1} has no name",
            "name it, or take the stray comma away",
        )
    return header


def _constant(campaign: Campaign, name: str, value: object, n: int) -> ColumnTexts:
    """A constant as a column of texts; one with its own unit is brought to that of the column."""
    known = BY_NAME.get(name)
    text = str(value)
    if (
        known is not None
        and known.kind == "quantity"
        and isinstance(value, str)
        and not units.NUMBER.fullmatch(text.strip())
        and not (name == "start" and "T" in text)
    ):
        si = units.quantity(value, known.dimension, f"trials.constants.{name}")
        unit = campaign.trials.units.get(name)
        if unit is None:
            raise ManifestError(
                f"trials.constants.{name}",
                "has a unit of its own, but the column has none",
                f'add {name} = "{units.SI[known.dimension]}" under [trials.units]',
            )
        factor, offset = units.to_si(unit, known.dimension, f"trials.units.{name}")
        text = repr((si - offset) / factor)
    return ColumnTexts(name, [text] * n, "campaign.toml", [])


def csv_text(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A schedule as it is written: a line of names, a line for each trial."""
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return sink.getvalue()
