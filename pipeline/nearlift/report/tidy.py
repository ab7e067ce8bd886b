"""A table as CSV: the same bytes everywhere, numbers to nine digits, and no cell that a spreadsheet
would run as a formula.
"""

from __future__ import annotations

import csv
import io
import math
from typing import Any

from nearlift.report.evidence import Columns

#: A text cell that begins with one of these is a formula to a spreadsheet.
FORMULA = ("=", "+", "-", "@", "\t", "\r")


def to_csv(table: Columns) -> bytes:
    """UTF-8 text, comma separated, a header line, line feeds between lines; what is not a number is
    left empty.
    """
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(map(cell, values.tolist()) for values in table.values()), strict=True))
    return sink.getvalue().encode()


def cell(value: Any) -> str:
    """One cell: a number, or text that no spreadsheet takes for a formula."""
    if isinstance(value, float):
        return f"{value:.9g}" if math.isfinite(value) else ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return str(value)
    text = "" if value is None else str(value)
    return f"'{text}" if text.startswith(FORMULA) else text
