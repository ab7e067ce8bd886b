"""Conditions of all records of a campaign: sample rate, head and settling, limits of quality."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Nominal sample rate, rotors-stopped head, settling time and limits of the quality codes.

    `range_N` is the capacity of the load cell. The fractions are from ``[quality]``. `drift` is the
    largest drift over the record, as a fraction of the trial's lift. `missing` is the fraction of
    the samples that may be absent. `out_of_range` is the fraction that may hold no number.
    """

    rate_Hz: float
    tare_s: float = 0.0
    settle_s: float = 0.0
    drift: float = 0.05
    missing: float = 0.05
    out_of_range: float = 0.01
    range_N: float | None = None
