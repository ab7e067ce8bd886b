"""An explanation of what the base model leaves: fitted effects, the evidence for them, and whether
they may be named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.loop.candidate_fit import Fitted
from nearlift.loop.evidence import CREDIT, ExplanationEvidence
from nearlift.loop.random_walk_gain import waves
from nearlift.loop.structure import Structure

#: Least share of the variance of a form's uncertainty that is kept: the evidence for a form as
#: printed is against smooth deformations, and knows nothing of others.
LEAST_SHARE = 0.2


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """A fitted candidate with its evidence.

    Its form is uncertain by `form_sd`; `random_walk_gain` is the size of the gain's random walk.
    `left` is the test for structure on its residuals, None if other tests exclude it.

    `gain` is the drop of chi2 by its declared form, with a size for each session where an effect
    restarts. `needed` is whether each of its effects explains, by that, most of the structure that
    is there without it. The form's uncertainty is not used for that, since with a large effect that
    the coefficients absorb it could explain anything.
    """

    fitted: Fitted
    form_sd: float
    random_walk_gain: float = 0.0
    left: Structure | None
    gain: float
    evidence: ExplanationEvidence
    needed: bool = True
    confirmed: bool | None = None

    @property
    def accepted(self) -> bool:
        """Whether it may be named: nothing is left beyond the threshold, each name is `needed` and
        plainly likelier than none.

        `confirmed` is set where something else decides: visits left out (`few_visits`), or the
        share of the structure (`search.accept_inexact`).
        """
        if not self.eligible:
            return False
        if self.confirmed is not None:
            return self.confirmed
        return self.left is not None and not self.left.present and self.evidence.over_none > CREDIT

    @property
    def eligible(self) -> bool:
        """Whether each effect is `needed`, and no parameter at its bound."""
        return self.needed and not self.fitted.at_bound

    @property
    def may_be_named(self) -> bool:
        """Whether it may be named or be a rival, if any explanation is accepted."""
        return self.accepted or (
            self.evidence.over_none > 0
            and not self.fitted.at_bound
            and (self.needed or len(self.effects) == 1)
        )

    def without_rivals(self) -> Explanation:
        """Explanation without rivals, so that the trials determine its form as well.

        The variance of the form is the mean over exact and discrepant form, at least `LEAST_SHARE`.
        """
        share = max(self.evidence.form_share, LEAST_SHARE)
        return replace(self, form_sd=self.form_sd * float(np.sqrt(share)))

    @property
    def nuisances(self) -> dict[str, FloatArray]:
        """Unit-variance columns (n, t) of its form discrepancy and random-walk gain, by name."""
        candidate = self.fitted.candidate
        columns = {
            f"form of {self.name}": candidate.form_discrepancy(self.fitted.vector, self.form_sd)
        }
        if self.random_walk_gain:
            columns["gain that wanders"] = self.random_walk_gain * waves(candidate.data)
        return columns

    @property
    def form_discrepancy(self) -> FloatArray:
        """All nuisance columns, (n, t)."""
        return np.hstack([*self.nuisances.values()])

    @property
    def name(self) -> str:
        """Names of its effects."""
        return self.fitted.candidate.name

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of its effects, a tuple."""
        return tuple(e.name for e in self.fitted.candidate.effects)
