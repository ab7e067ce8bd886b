"""Conditions of all records of a campaign: sample rate, head and settling, limits of quality."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Nominal sample rate, rotors-stopped head and what is discarded after it, and what the quality
    codes are judged by: the capacity `range_N` of the load cell, and fractions, from ``[quality]``:
    of the trial's lift that the drift over the record may reach; of the samples that may be absent;
    of the samples that may hold no number.
    """

    rate_Hz: float
    tare_s: float = 0.0
    settle_s: float = 0.0
    drift: float = 0.05
    missing: float = 0.05
    out_of_range: float = 0.01
    range_N: float | None = None
