"""Interim looks: what a claim needs while a campaign is still being recorded.

Looked at again and again, noise exceeds any one threshold sooner or later. Before the last trial a
claim is held to O'Brien and Fleming's boundary instead: the standard score that it needs is larger
by the root of (scheduled / measured). The boundary hangs on how far the campaign is, not on when or
how often it was looked at. See docs/decisions/0016-interim-looks.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.results.diagnosis import InterimClaim

#: The boundary is aimed at this share of the false-alarm rate; all looks together then claim in at
#: most twice that share of nulls (reflection).
INTERIM_SHARE = 0.1


def nominal_level(at_end: float, fraction: float) -> float:
    """Two-sided p-value of O'Brien and Fleming's boundary (1979, Biometrics 35, 549), constant in
    the sum of scores.

    Parameters
    ----------
    at_end : float
        The p-value asked for with all trials measured.
    fraction : float
        Trials measured over trials scheduled, above 0, at most 1.
    """
    from scipy.special import ndtr, ndtri

    return float(2 * ndtr(ndtri(at_end / 2) / np.sqrt(fraction)))


@dataclass(frozen=True, slots=True, kw_only=True)
class InterimLook:
    """How far a boundary's campaign is: trials that had their turn, and trials scheduled, more of
    them.
    """

    trials: int
    scheduled: int

    def level(self, rate: float) -> float:
        """P-value that a claim needs at this look, where `rate` is enough at the end."""
        return nominal_level(INTERIM_SHARE * rate, self.trials / self.scheduled)

    def claim(self, rate: float) -> InterimClaim:
        """What a claim needs at this look."""
        level = self.level(rate)
        text = (
            f"a look at {self.trials} of {self.scheduled} trials; claims need p < {level:.1g}, and"
            f" p < {rate:g} once all are measured"
        )
        return InterimClaim(
            trials=self.trials, scheduled=self.scheduled, p_value_needed=level, text=text
        )
