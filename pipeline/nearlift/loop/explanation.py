"""An explanation of what the base model leaves: fitted effects, the evidence for them, and whether
they may be named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.loop.candidate_fit import Fitted
from nearlift.loop.evidence import CREDIT, ExplanationEvidence
from nearlift.loop.structure import Structure
from nearlift.loop.wander import waves

#: Where nothing else would do, what an explanation leaves refutes it below this chance only: one
#: test in twenty finds what is not there.
MARGINAL = 0.005
#: Least share of the variance of a form's uncertainty that is kept: the evidence for a form as
#: printed is against smooth deformations, and knows nothing of others.
LEAST_SHARE = 0.2


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """One candidate, its form uncertain by `form_sd` and a gain that wanders by `wander` beside it
    (see `wander`), with the evidence for it.

    `left` is the whole test run again on what it leaves; None where it could not be named whatever
    that says.

    `gain` is the drop of chi2 by its declared form, with a size for each session where an effect
    restarts. `needed` says whether each of its effects accounts by that for the greater part of the
    structure that is there without it: a form's uncertainty, granted to a large effect that the
    coefficients absorb, could account for anything.
    """

    fitted: Fitted
    form_sd: float
    wander: float = 0.0
    left: Structure | None
    gain: float
    evidence: ExplanationEvidence
    needed: bool = True
    confirmed: bool | None = None

    @property
    def accepted(self) -> bool:
        """Whether it may be named: nothing is left beyond the threshold, each name is `needed` and
        plainly likelier than none.

        `confirmed` is set where something else decides: visits left out (`few_visits`), nearly all
        being accounted for (`second_look`), or nothing else that would do (`forgiven`).
        """
        if not self.eligible:
            return False
        if self.confirmed is not None:
            return self.confirmed
        return self.left is not None and not self.left.present and self.evidence.over_none > CREDIT

    @property
    def by_chance(self) -> bool:
        """Whether the test finds something in what it leaves, and no more than chance may."""
        return self.left is not None and self.left.present and not self.refuted

    @property
    def refuted(self) -> bool:
        """Whether what it leaves is more than chance may; also where nobody tested that."""
        return self.left is None or self.left.p_value <= MARGINAL

    @property
    def tenable(self) -> bool:
        """Whether it may be named where something is: accepted, or refused by nothing but a test
        that finds what is not there once in twenty.
        """
        plain = self.eligible and self.evidence.over_none > CREDIT
        return self.accepted or (plain and self.by_chance)

    @property
    def eligible(self) -> bool:
        """Whether nothing forbids to name it: each effect is `needed`, and of a possible size."""
        return self.needed and not self.fitted.at_bound

    @property
    def possible(self) -> bool:
        """Whether it may stand beside one that was accepted, by its evidence alone: no size at the
        end of what is possible is an explanation, nor are two effects of which one would do.
        """
        return (
            self.evidence.over_none > 0
            and not self.fitted.at_bound
            and (self.needed or len(self.effects) == 1)
        )

    def without_rivals(self) -> Explanation:
        """The same where nothing stands beside it. The trials then tell of its form, too: the
        variance of that is the mean over both readings, or what no evidence takes away.
        """
        share = max(self.evidence.form_share, LEAST_SHARE)
        return replace(self, form_sd=self.form_sd * float(np.sqrt(share)))

    @property
    def nuisances(self) -> dict[str, FloatArray]:
        """Unit-variance columns (n, t) of its form's uncertainty and of a wander beside it, by what
        they are.
        """
        candidate = self.fitted.candidate
        columns = {f"form of {self.name}": candidate.tube(self.fitted.vector, self.form_sd)}
        if self.wander:
            columns["gain that wanders"] = self.wander * waves(candidate.data)
        return columns

    @property
    def tube(self) -> FloatArray:
        """All of them, side by side."""
        return np.hstack([*self.nuisances.values()])

    @property
    def name(self) -> str:
        """Names of its effects."""
        return self.fitted.candidate.name

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of its effects, one by one."""
        return tuple(e.name for e in self.fitted.candidate.effects)
