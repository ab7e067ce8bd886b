"""A record reduced to its row, by whichever process holds the samples: only the row travels."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nearlift.errors import InputRefused
from nearlift.readers.seam import Record
from nearlift.reduction.conditions import Conditions
from nearlift.reduction.record import Reduced, reduce_record


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A worker's answer for one trial.

    `fault` says what is wrong with a MALFORMED record; `refusal` is there where it cannot be read
    in the way that the manifest asks for.
    """

    trial: str
    reduced: Reduced
    source_sha256: str = ""
    source: str = ""
    samples: int = 0
    notes: tuple[str, ...] = ()
    fault: str = ""
    refusal: InputRefused | None = None


def row_of(
    record: Record, conditions: Conditions, tare_after_N: float = math.nan, source_sha256: str = ""
) -> Row:
    """A record reduced; raises as `reduce_record` does."""
    reduced = reduce_record(
        record.force_N,
        conditions,
        time_s=record.time_s,
        tare_after_N=tare_after_N,
        codes=record.codes,
        where=f"{record.source}, trial {record.trial!r}",
    )
    return Row(
        trial=record.trial,
        reduced=reduced,
        source_sha256=source_sha256,
        source=record.source,
        samples=len(record.force_N),
        notes=record.notes,
        fault=record.fault,
    )
