"""Cells of text files: what is a number, what loggers write where there is none, and what is
neither.
"""

from __future__ import annotations

import math
import re

from nearlift.errors import InputRefused
from nearlift.units import NUMBER

#: What loggers write where there is no number, in lower case.
NO_NUMBER = re.compile(
    r"(?:[-+]?(?:nan|inf)|over|ovf?l|o\.?l|#nv|#?n/a|na|null|-?1\.#(?:inf|qnan|ind))?"
)


def value_of(text: str, decimal: str = ".") -> float | None:
    """The cell's number, NaN for a word that means "no number", None where it is neither."""
    plain = text.strip()
    if decimal == ",":
        # a point in a file of decimal commas would be a thousands separator or another dialect:
        # neither is a number here
        plain = (
            plain.replace(",", ".")
            if "." not in plain and plain.count(",") <= 1
            else (plain if NO_NUMBER.fullmatch(plain.lower()) else "?")
        )
    if NUMBER.fullmatch(plain):
        value = float(plain)
        return value if math.isfinite(value) else math.nan
    words = {plain.lower(), text.strip().lower()}
    return math.nan if any(map(NO_NUMBER.fullmatch, words)) else None


def number(text: str, at: str, column: str, decimal: str = ".") -> float:
    """The cell's number, NaN for a word that means "no number".

    Raises
    ------
    InputRefused
        It is neither.
    """
    value = value_of(text, decimal)
    if value is not None:
        return value
    other = "point" if decimal == "." else "comma"
    remedy = (
        f"write decimals with a {other}"
        if re.fullmatch(r"[-+]?\d+[.,]\d+", text)
        else "every cell must be a number; mend the line, or take the trial out of the schedule"
    )
    raise InputRefused(at, f"{text!r} in column {column!r} is not a number", remedy)
