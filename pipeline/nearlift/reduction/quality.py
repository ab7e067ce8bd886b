"""Quality codes of trials. CAPITALS reject the trial from every fit, lower case only warns; nothing
is dropped silently.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.errors import DeclarationError


@dataclass(frozen=True, slots=True, kw_only=True)
class Code:
    """One code: its name, whether it rejects the trial, and what it says."""

    name: str
    rejects: bool
    meaning: str

    def __post_init__(self) -> None:
        if self.rejects != self.name.isupper() or self.rejects == self.name.islower():
            raise DeclarationError(
                f"quality code {self.name}",
                "breaks the convention",
                "CAPITALS reject, lower case warns",
            )


CODES = (
    Code(
        name="MISSING",
        rejects=True,
        meaning="the schedule lists the trial, but there is no record of it",
    ),
    Code(name="EMPTY", rejects=True, meaning="the file is empty"),
    Code(
        name="MALFORMED",
        rejects=True,
        meaning=(
            "the record cannot be read: it is damaged, or contradicts its own structure, its check"
            " sum or the manifest"
        ),
    ),
    Code(
        name="PENDING",
        rejects=True,
        meaning="the file was still being written; the next run reads it again",
    ),
    Code(
        name="NO_DATA", rejects=True, meaning="no sample is left once tare and settle are taken off"
    ),
    Code(
        name="TOO_SHORT", rejects=True, meaning="fewer than five samples are left: an aborted run"
    ),
    Code(
        name="SHORT",
        rejects=True,
        meaning=(
            "less than 95 % of the planned samples; where no length is planned, cut off with less"
            " than 95 % of the campaign's usual ones, or less than half of them in any case"
        ),
    ),
    Code(
        name="OUT_OF_RANGE",
        rejects=True,
        meaning="too many samples hold no number (NaN, OVER, #NV)",
    ),
    Code(name="SATURATED", rejects=True, meaning="the load cell was at the end of its range"),
    Code(name="STUCK", rejects=True, meaning="the channel stood still: it repeats one value"),
    Code(
        name="GAPS",
        rejects=True,
        meaning="the clock column shows that too many samples are missing",
    ),
    Code(
        name="DRIFT",
        rejects=True,
        meaning="the force drifts within the record by more than the limit",
    ),
    Code(
        name="MIXED",
        rejects=True,
        meaning=(
            "the force steps from one level to another in the middle of the record: two throttles"
            " in one trial, or samples of it are damaged"
        ),
    ),
    Code(
        name="HEIGHT",
        rejects=True,
        meaning="the traverse did not reach the distance of the schedule",
    ),
    Code(
        name="TARE",
        rejects=True,
        meaning=(
            "the force changes within the tare: the rotors were not at rest all through it, or"
            " samples of it are damaged"
        ),
    ),
    Code(
        name="IMPLAUSIBLE",
        rejects=True,
        meaning="the lift is more than a hundred times the vehicle's weight",
    ),
    Code(
        name="NO_LIFT",
        rejects=True,
        meaning=(
            "the mean lift is zero, negative, or a small fraction of its throttle's: the rotors did"
            " not turn, or pull the other way"
        ),
    ),
    Code(
        name="DUPLICATE",
        rejects=True,
        meaning="the record is byte for byte that of an earlier trial",
    ),
    Code(name="EXCLUDED", rejects=True, meaning="excluded by the manifest"),
    Code(
        name="truncated",
        rejects=False,
        meaning="the file ends within a line; the cut sample was left out",
    ),
    Code(
        name="salvaged",
        rejects=False,
        meaning=(
            "the check sum is wrong; what came before the damage was kept, as the manifest asks"
        ),
    ),
    Code(
        name="short",
        rejects=False,
        meaning="fewer samples than planned, or less than 95 % of the campaign's usual ones",
    ),
    Code(
        name="out_of_range", rejects=False, meaning="some samples hold no number and were left out"
    ),
    Code(name="gaps", rejects=False, meaning="the clock column shows missing samples"),
    Code(
        name="clock",
        rejects=False,
        meaning=(
            "the clock column stands still or runs backwards somewhere; the samples' order was kept"
        ),
    ),
    Code(
        name="drift",
        rejects=False,
        meaning="the force drifts within the record, by less than the limit",
    ),
    Code(
        name="slow",
        rejects=False,
        meaning=(
            "the level wanders about as slowly as the record is long: one record cannot tell how"
            " far its mean is off, and the uncertainty is a guess on the large side"
        ),
    ),
    Code(
        name="dead_speed", rejects=False, meaning="a rotor's speed reads zero while there is lift"
    ),
    Code(
        name="spikes",
        rejects=False,
        meaning=(
            "single samples stand far from the others; they were left out, and what they are worth"
            " is in the uncertainty"
        ),
    ),
    Code(
        name="saturated",
        rejects=False,
        meaning=(
            "single samples lay at the end of the load cell's range; they were left out, and what"
            " they are worth is in the uncertainty"
        ),
    ),
    Code(
        name="unsettled",
        rejects=False,
        meaning="the first samples averaged differ from the rest: `settle` may be too short",
    ),
    Code(
        name="other_throttle",
        rejects=False,
        meaning="the lift is that of another throttle at this distance: is the label wrong?",
    ),
    Code(
        name="outlying",
        rejects=False,
        meaning="the lift stands farther from its repeats and neighbours than noise allows",
    ),
    Code(
        name="not_rising",
        rejects=False,
        meaning="far from the boundary, this throttle lifts no more than the next lower one",
    ),
)
_BY_NAME = {c.name: c for c in CODES}
#: The one code that is the user's judgement, not the tool's.
EXCLUDED = "EXCLUDED"


def code(name: str) -> Code:
    """The code of that name."""
    return _BY_NAME[name]


def joined(names: list[str] | tuple[str, ...]) -> str:
    """The text of a `quality` column: codes in the order of `CODES`, each once."""
    present = set(names)
    unknown = present - _BY_NAME.keys()
    if unknown:
        raise KeyError(f"not quality codes: {sorted(unknown)}")
    return " ".join(c.name for c in CODES if c.name in present)


def rejected(quality: NDArray[Any]) -> NDArray[np.bool_]:
    """Mask of the trials that fits leave out, from a `quality` column."""
    return np.array([any(name.isupper() for name in text.split()) for text in quality], dtype=bool)


def reason(text: str, fault: str = "") -> str:
    """Why a trial was left out, in words, from its `quality` text and its `fault`; empty where it
    was not.
    """
    words = "; ".join(
        f"{name} ({_BY_NAME[name].meaning})" for name in text.split() if _BY_NAME[name].rejects
    )
    return f"{words}: {fault}" if words and fault else words


def faulty(quality: NDArray[Any]) -> NDArray[np.bool_]:
    """Mask of the trials that are left out for a fault of their own, whether or not the manifest
    excludes them too.
    """
    return rejected(np.array([text.replace(EXCLUDED, "") for text in quality], dtype=object))


def remarks(quality: NDArray[Any]) -> list[str]:
    """One line on the codes that reject nothing, with the number of accepted trials that carry
    each; none where there are none.
    """
    accepted = [text.split() for text in quality[~rejected(quality)] if text]
    told = [
        f"{c.name} {n}"
        for c in CODES
        if not c.rejects and (n := sum(c.name in names for names in accepted))
    ]
    count = len(accepted)
    return (
        [
            (
                f"{count} accepted trial{'s carry' if count > 1 else ' carries'} a remark:"
                f" {', '.join(told)}"
            )
        ]
        if told
        else []
    )


def completeness(text: str) -> str:
    """What a `quality` text says of the record itself: ``complete``, ``truncated``, ``malformed``,
    ``pending`` or ``missing``.
    """
    names = set(text.split())
    for word, signs in (
        ("missing", {"MISSING"}),
        ("pending", {"PENDING"}),
        ("malformed", {"MALFORMED", "salvaged"}),
        (
            "truncated",
            {"truncated", "EMPTY", "NO_DATA", "SHORT", "TOO_SHORT", "short", "GAPS", "gaps"},
        ),
    ):
        if names & signs:
            return word
    return "complete"
