"""Refusals. Each says where, what, and what to do, and knows the exit code that the command line
ends with.
"""

from __future__ import annotations

from collections.abc import Collection


class NearliftError(Exception):
    """Base of every refusal.

    Parameters
    ----------
    where : str
        The file, key or trial at fault, as the user knows it.
    what : str
        What is wrong, with the value found.
    remedy : str
        What to do about it; with the number that would have been enough where there is one.
    """

    exit_code = 4

    def __init__(self, where: str, what: str, remedy: str = "") -> None:
        super().__init__(where, what, remedy)
        self.where, self.what, self.remedy = where, what, remedy

    def __str__(self) -> str:
        tail = f"\n  {self.remedy}" if self.remedy else ""
        return f"{self.where}: {self.what}{tail}"


def brief(text: str, most: int = 400) -> str:
    """A text as a refusal quotes it: the middle of a long one is left out."""
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"


def did_you_mean(name: str, known: Collection[str]) -> str:
    """``did you mean 'supply'?``, or an empty text where nothing known is like the name."""
    import difflib

    close = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {close[0]!r}?" if close else ""


class UsageError(NearliftError):
    """The command line asks for something that does not exist."""

    exit_code = 2


class ManifestError(NearliftError):
    """campaign.toml or the schedule breaks the contract."""

    exit_code = 2


class DeclarationError(NearliftError):
    """A model, effect or reader contradicts itself; raised at import."""

    exit_code = 2


class InputRefused(NearliftError):
    """A file that cannot be read, or numbers that cannot be true."""


class ProductError(NearliftError):
    """A product on disk is missing, damaged or of another schema."""


class NotConverged(NearliftError):
    """A fit or a chain did not reach what was asked of it."""

    exit_code = 5


#: Exit code of a run that finished although some trials were rejected.
SOME_TRIALS_REJECTED = 3
INTERRUPTED = 130
