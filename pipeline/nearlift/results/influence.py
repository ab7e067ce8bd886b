"""What single trials and visits are worth to a base fit: a block of fit.json."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nearlift.results.estimate import Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class Suspect:
    """A trial or visit that is named, and the headline coefficient fitted without it.

    Attributes
    ----------
    kind : str
    id : str
        The trial's, or the visit's label.
    trials : tuple of str
        The trial, or those of the visit.
    outlying : bool
        Beyond what noise allows, whether or not the headline depends on it.
    without : Estimate or None
        A visit's also without the trials named; None where that fit failed.
    shift : float
        That less the headline (a visit's: less the headline without the trials named).
    text : str
        The same in words.
    """

    kind: Literal["trial", "visit"]
    id: str
    trials: tuple[str, ...]
    outlying: bool
    without: Estimate | None
    shift: float
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Influence:
    """What single trials and visits are worth to one fit.

    Attributes
    ----------
    suspects : tuple of Suspect
    without_all : Estimate or None
        The headline without any trial named; None unless several are.
    unscreened : int
        Trials without repeats to compare them with.
    why_not : str
        Why nothing could be screened; empty where it could.
    """

    suspects: tuple[Suspect, ...] = ()
    without_all: Estimate | None = None
    unscreened: int = 0
    why_not: str = ""
