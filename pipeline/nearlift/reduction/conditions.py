"""What holds for every record of a campaign: sample rate, head and settling, limits of quality."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """How records were taken, and what the quality codes are judged by.

    Attributes
    ----------
    rate_Hz : float
        Nominal sample rate.
    tare_s, settle_s : float
        Rotors-stopped head, and what is discarded after it.
    drift, missing, out_of_range : float
        Fractions, from ``[quality]``: of the trial's lift that the drift over the record may reach;
        of the samples that may be absent; of the samples that may hold no number.
    range_N : float or None
        Capacity of the load cell.
    """

    rate_Hz: float
    tare_s: float = 0.0
    settle_s: float = 0.0
    drift: float = 0.05
    missing: float = 0.05
    out_of_range: float = 0.01
    range_N: float | None = None
