"""TOML of unknown origin within bounds: size, depth and digits are judged before anything is
parsed.

The parser recurses over brackets, takes quadratic time over dotted keys, and computes whole numbers
of any length. What passes here costs it less than a second.
"""

from __future__ import annotations

import re
import tomllib
from typing import Any

from nearlift.errors import ManifestError

#: A manifest of five hundred velocity cases has 150 kB.
MOST_BYTES = 1 << 19
#: Brackets within brackets, and parts of a dotted key; a manifest needs four.
DEEPEST = 8
#: Of one number; a double precision one is exact with 17.
MOST_DIGITS = 60
#: Strings and comments are skipped whole; a quote that opens and never closes is left to the
#: parser, which ends there.
_TOKEN = re.compile(
    r'"""(?:[^"\\]|\\[\s\S]|"(?!""))*+"{3,5}'
    r"|'''(?:[^']|'(?!''))*+'{3,5}"
    r'|"(?:[^"\\\n]|\\.)*+"(?!")'
    r"|'[^'\n]*+'(?!')"
    r"|\#[^\n]*+|[\w+-]++|[^\w+-]"
)


def loads(content: bytes, where: str) -> dict[str, Any]:
    """The tables of a TOML file, with or without a byte order mark.

    Raises
    ------
    ManifestError
        It is too large, too deep, no UTF-8, or no TOML.
    """
    if len(content) > MOST_BYTES:
        raise ManifestError(
            where,
            f"has {len(content)} bytes",
            f"a manifest has at most {MOST_BYTES}; trials belong into the schedule",
        )
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as fault:
        raise ManifestError(
            where, f"is not UTF-8 text ({fault.reason} at byte {fault.start})", "save it as UTF-8"
        ) from None
    _bounded(text, where)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as fault:
        raise ManifestError(where, f"is not valid TOML: {fault}", "mend that line") from None


def _bounded(text: str, where: str) -> None:
    """Refuse brackets, dotted keys and numbers beyond what any manifest has."""
    line, brackets, dots = 1, 0, 0
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token in "\"'":
            return
        if token in "[{":
            brackets, dots = brackets + 1, 0
        elif token in "]}":
            brackets -= 1
        elif token == ".":
            dots += 1
        elif token in "\n=,":
            dots = 0
        if max(brackets, dots) >= DEEPEST:
            raise ManifestError(
                f"{where}, line {line}",
                f"is nested more than {DEEPEST} deep",
                "no key of a manifest is",
            )
        if len(token) > MOST_DIGITS and token.lstrip("+-")[:1].isdigit():
            raise ManifestError(
                f"{where}, line {line}",
                f"holds a number of {len(token)} digits",
                "17 digits say all that there is to say",
            )
        line += token.count("\n")
