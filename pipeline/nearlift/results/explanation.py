"""What one effect is in one campaign: the answer of `diagnose --explain`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class WithinTrialPower:
    """The mean relative change of lift over a record that would be found, from its standard
    uncertainty over so many visits.
    """

    u_of_mean: float
    visits: int
    limit: float
