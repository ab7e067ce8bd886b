"""Quality codes of trials: CAPITALS reject a trial from every fit, lower case only warns."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import BoolArray

#: Codes and their meanings, in the order of a `quality` column.
CODES = {
    "MISSING": "the schedule lists the trial, but there is no record of it",
    "EMPTY": "the file is empty",
    "MALFORMED": (
        "the record cannot be read: it is damaged, or contradicts its own structure, its check"
        " sum or the manifest"
    ),
    "PENDING": "the file was still being written; the next run reads it again",
    "NO_DATA": "no sample is left once tare and settle are taken off",
    "TOO_SHORT": "fewer than five samples are left: an aborted run",
    "SHORT": (
        "less than 95 % of the planned samples. Without a planned length: cut off below 95 % of"
        " the campaign's usual length, or below half of it"
    ),
    "OUT_OF_RANGE": "too many samples hold no number (NaN, OVER, #NV)",
    "SATURATED": "the load cell was at the end of its range",
    "STUCK": "the channel repeats one value",
    "GAPS": "the clock column shows that too many samples are missing",
    "DRIFT": "the force drifts within the record by more than the limit",
    "MIXED": (
        "the force steps to another level within the record: two throttles in one trial,"
        " rotors that stop before its end, or damaged samples"
    ),
    "HEIGHT": "the traverse did not reach the distance of the schedule",
    "TARE": (
        "the force changes within the tare: the rotors were not at rest all through it, or"
        " samples of it are damaged"
    ),
    "IMPLAUSIBLE": "the lift is more than a hundred times the vehicle's weight",
    "NO_LIFT": (
        "the mean lift is zero, negative, or a small fraction of its throttle's: the rotors did"
        " not turn, or pull the other way"
    ),
    "DUPLICATE": "the record is that of an earlier trial",
    "EXCLUDED": "excluded by the manifest",
    "truncated": "the file ends within a line; the cut sample was left out",
    "short": "fewer samples than planned, or less than 95 % of the campaign's usual ones",
    "out_of_range": "some samples hold no number and were left out",
    "gaps": "the clock column shows missing samples",
    "clock": ("the clock column stops or runs backwards somewhere; the samples' order was kept"),
    "drift": "the force drifts within the record, by less than the limit",
    "slow": (
        "the level drifts as slowly as the record is long: the uncertainty of its mean is a"
        " conservative guess"
    ),
    "dead_speed": "a rotor's speed reads zero while there is lift",
    "spikes": (
        "single readings are impossible or far from all others; they were left out of the mean"
        " and its uncertainty"
    ),
    "saturated": (
        "single samples were at the end of the load cell's range; they were left out, and the"
        " uncertainty includes that"
    ),
    "unsettled": (
        "the first samples differ from the rest, and those of rotors that start were left out:"
        " `tare` or `settle` may be too short"
    ),
    "other_throttle": (
        "the lift is that of another throttle at this distance: is the label wrong?"
    ),
    "outlying": "the lift is an outlier among its repeats and neighbours",
    "not_rising": "far from the boundary, this throttle lifts no more than the next lower one",
}
#: State of a record that has one of these codes, the worst first.
STATES = {
    "missing": {"MISSING"},
    "pending": {"PENDING"},
    "malformed": {"MALFORMED"},
    "truncated": {"truncated", "EMPTY", "NO_DATA", "SHORT", "TOO_SHORT", "short", "GAPS", "gaps"},
}
#: The one code that is the user's judgement, not the tool's.
EXCLUDED = "EXCLUDED"


def joined(names: Iterable[str]) -> str:
    """The text of a `quality` column: codes in the order of `CODES`, each once."""
    present = set(names)
    if unknown := present - CODES.keys():
        raise KeyError(f"not quality codes: {sorted(unknown)}")
    return " ".join(name for name in CODES if name in present) if present else ""


def rejected(quality: NDArray[Any], aside: str = "") -> BoolArray:
    """Mask of the trials that fits leave out, from a `quality` column, one code left aside."""
    # thousands of trials share a few texts
    rejects = {t: any(c.isupper() and c != aside for c in t.split()) for t in {*quality}}
    return np.array([rejects[text] for text in quality], dtype=bool)


def reason(text: str, fault: str = "") -> str:
    """Why a trial was left out, in words, by `quality` and `fault`; empty where it was not."""
    words = "; ".join(f"{name} ({CODES[name]})" for name in text.split() if name.isupper())
    return f"{words}: {fault}" if words and fault else words


def remarks(quality: NDArray[Any]) -> list[str]:
    """A line on the codes that reject nothing: how many accepted trials carry each; or none."""
    accepted = [text.split() for text in quality[~rejected(quality)] if text]
    if not accepted:
        return []
    counts = Counter(itertools.chain(*accepted))
    said = ", ".join(f"{name} {counts[name]}" for name in CODES if counts[name])
    carry = "s carry" if len(accepted) > 1 else " carries"
    return [f"{len(accepted)} accepted trial{carry} a remark: {said}"]


def completeness(text: str) -> str:
    """A record as its `quality` says: complete, truncated, malformed, pending or missing."""
    names = set(text.split())
    return next((state for state, signs in STATES.items() if names & signs), "complete")
