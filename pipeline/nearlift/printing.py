"""The one place that prints: characters that a terminal would obey are shown as escapes."""

from __future__ import annotations

import os
import sys
import unicodedata

#: Control, direction, surrogate and line characters, by their category; but ends of lines and tabs.
_UNPRINTABLE, _KEPT = ("Cc", "Cf", "Cs", "Co", "Zl", "Zp"), "\n\t"


def printable(text: str) -> str:
    r"""The text with what is not printable as escapes, such as ``\x1b``."""
    if text.isascii() and text.replace("\n", "").replace("\t", "").isprintable():
        return text
    return "".join(
        c
        if c in _KEPT or unicodedata.category(c) not in _UNPRINTABLE
        else c.encode("unicode_escape", "surrogatepass").decode("ascii")
        for c in text
    )


def say(text: str, *, err: bool = False) -> None:
    """Print a text and the end of its line; a stderr that is closed or full is no failure."""
    import click

    try:
        click.echo(printable(text), err=err)  # noqa: TID251
    except OSError:
        if not err:
            raise
        # what is left in its buffer would be a failure at the end
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
