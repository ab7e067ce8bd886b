"""Interim analyses: the significance that a claim needs while a campaign is still being recorded.

Under repeated analyses, noise exceeds any fixed threshold sooner or later. Before the last trial a
claim must therefore cross the O'Brien-Fleming boundary: the z-score required is larger by
sqrt(scheduled / measured). It depends on the progress of the campaign, not on when or how often it
was looked at. See docs/decisions.md#interim-analyses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.results.diagnosis import InterimClaim

#: Final level of the boundary over the false-alarm rate; all analyses together add at most twice
#: that share of false alarms (reflection principle).
INTERIM_SHARE = 0.1


def nominal_level(at_end: float, fraction: float) -> float:
    """Two-sided nominal p-value of the O'Brien-Fleming boundary (1979, Biometrics 35, 549).

    Parameters
    ----------
    at_end : float
        P-value required with all trials measured.
    fraction : float
        Trials measured over trials scheduled, in (0, 1].
    """
    from scipy.special import ndtr, ndtri

    return float(2 * ndtr(ndtri(at_end / 2) / np.sqrt(fraction)))


@dataclass(frozen=True, slots=True, kw_only=True)
class InterimLook:
    """Progress of a boundary's campaign: trials whose turn has come, out of those scheduled."""

    trials: int
    scheduled: int

    def level(self, rate: float) -> float:
        """P-value required for a claim at this look; `rate` is that required at the end."""
        return nominal_level(INTERIM_SHARE * rate, self.trials / self.scheduled)

    def claim(self, rate: float) -> InterimClaim:
        """The requirement as diagnosis.json holds it, with a sentence."""
        level = self.level(rate)
        text = (
            f"a look at {self.trials} of {self.scheduled} trials; claims need p < {level:.1g}, and"
            f" p < {rate:g} once all are measured"
        )
        return InterimClaim(
            trials=self.trials, scheduled=self.scheduled, p_value_needed=level, text=text
        )
