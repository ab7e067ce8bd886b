"""Influential trials and visits: those whose removal shifts the headline coefficient, and its value
without them.

The closed form (`fit.deletion`) selects candidates; a fit without the trial, scatter included,
decides. Outliers inflate the scatter that they are judged by, and two can mask each other. The
search therefore goes forward: an outlier is left out, and the rest is examined again.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit.deletion import influence
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.likelihood.budget import Component
from nearlift.results import Estimate
from nearlift.results.fit import Influence, Suspect

#: Median relative variance up to which trials repeat exactly: just above the variance floor.
EXACT = 1.1e-12
#: Shift of the headline in closed form, in its standard uncertainties, from which a trial is fitted
#: without.
LOOK = 0.6
#: Shift of the headline between fits, in its standard uncertainties, from which a trial is named.
#: Below one, since leaving out a glitch shifts it by less than the glitch did: the information of
#: the trial is lost too (docs/decisions.md#outliers).
MOVES = 0.8
#: `LOOK` for a visit that is an outlier as a whole.
LOOK_AT_ODD = 0.25
#: Maximum number of trials named, and of fits for each name.
MOST, TRIES = 10, 4


def screen(
    whole: LeastSquaresFit,
    parts: tuple[Component, ...],
    outlying: Collection[str] = (),
    odd: Collection[str] = (),
    odd_visits: Collection[int] | NDArray[np.int64] = (),
) -> Influence:
    """Name the outlying trials, and the trials and visits that move the headline.

    The limit of such a move is `MOVES` of its standard uncertainty.

    Parameters
    ----------
    whole : LeastSquaresFit
        To all accepted trials; they all stay in it.
    parts : tuple of Component
        The whole budget.
    outlying : collection of str
        Trials that repeats and neighbours contradict (`reduction.outliers`).
    odd : collection of str
        Trials far from the rest, though no farther than noise allows. They may mask each other, so
        they are also left out together.
    odd_visits : collection of int
        Visits far from the rest: since few visits determine the scatter of visits, the closed form
        understates their influence.

    Returns
    -------
    Influence
        No fit is made where none of these is an outlier and none is near the limit.
    """
    data = whole.problem.data
    if not whole.names:
        return Influence(why_not=f"{whole.model.name} has no free coefficient")
    if np.median(whole.problem.covariance.variance) <= EXACT:
        return Influence(
            why_not=(
                "the trials repeat exactly, so nothing shows how far noise may move a coefficient"
            )
        )
    search = _Search(whole=whole, parts=parts)
    kept = ~np.isin(data.trial, list(outlying))
    named = np.flatnonzero(~kept).tolist()
    clean = search.without(~kept) or whole
    joined = search.together(clean, kept, np.isin(data.trial, list(odd)))
    if joined.any():
        kept &= ~joined
        named += np.flatnonzero(joined).tolist()
        clean = search.without(~kept) or clean
    while len(named) < MOST and (step := search.next_trial(clean, kept)):
        i, clean = step
        kept[i] = False
        named.append(i)
    suspects = [search.alone(i, str(data.trial[i]) in outlying) for i in named[:MOST]]
    suspects += search.visits(clean, kept, odd_visits)
    return Influence(
        suspects=tuple(suspects), without_all=_headline(clean) if len(named) > 1 else None
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Search:
    """Fits without some of the trials of `whole`."""

    whole: LeastSquaresFit
    parts: tuple[Component, ...]
    made: dict[bytes, LeastSquaresFit | None] = field(default_factory=dict)

    def without(self, out: NDArray[np.bool_]) -> LeastSquaresFit | None:
        """The model fitted without the trials `out`, scatter included; None where that fails."""
        if not out.any():
            return self.whole
        key = out.tobytes()
        if key not in self.made:
            try:
                self.made[key] = fit(
                    self.whole.model, self.whole.problem.data.take(~out), self.parts
                )
            except NotConverged:
                self.made[key] = None
        return self.made[key]

    def next_trial(
        self, clean: LeastSquaresFit, kept: NDArray[np.bool_]
    ) -> tuple[int, LeastSquaresFit] | None:
        """The first trial whose removal shifts the headline by `MOVES`, and the fit without."""
        at = np.flatnonzero(kept)
        moved = influence(clean)
        for j in _far(moved.of_trial[:, 0], moved.residual**2, clean):
            out = ~kept
            out[at[j]] = True
            again = self.without(out)
            if again and _moves(clean, again):
                return int(at[j]), again
        return None

    def together(
        self, clean: LeastSquaresFit, kept: NDArray[np.bool_], odd: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Odd trials that shift the headline by `MOVES` with the other odd ones left out; all of
        them, if only all do.
        """
        odd = odd & kept
        base = self.without(~kept | odd) if odd.any() else None
        if base is None or not _moves(clean, base):
            return np.zeros_like(odd)
        single = np.zeros_like(odd)
        for i in np.flatnonzero(odd)[:MOST]:
            out = ~kept | odd
            out[i] = False
            again = self.without(out)
            single[i] = again is None or _moves(base, again)
        return single if single.any() else odd

    def visits(
        self,
        clean: LeastSquaresFit,
        kept: NDArray[np.bool_],
        odd: Collection[int] | NDArray[np.int64],
    ) -> list[Suspect]:
        """Visits of several trials that shift the headline by `MOVES`, named trials left out."""
        data, moved, suspects = self.whole.problem.data, influence(clean), []
        look = np.where(np.isin(moved.visit, list(odd)), LOOK_AT_ODD, LOOK)
        for j in _far(moved.of_visit[:, 0], moved.chi2, clean, look):
            members = (data.visit == moved.visit[j]) & kept
            again = self.without(members | ~kept) if members.sum() > 1 else None
            if again and _moves(clean, again):
                shift = float(again.theta[0] - clean.theta[0])
                ids = tuple(str(t) for t in data.trial[members])
                suspects.append(
                    Suspect(
                        kind="visit",
                        id=str(moved.visit[j]),
                        trials=ids,
                        outlying=False,
                        without=_headline(again),
                        shift=shift,
                    )
                )
        return suspects

    def alone(self, i: int, outlying: bool) -> Suspect:
        """One trial, and the headline of a fit without it alone."""
        data = self.whole.problem.data
        again = self.without(np.arange(data.n) == i)
        return Suspect(
            kind="trial",
            id=str(data.trial[i]),
            trials=(str(data.trial[i]),),
            outlying=outlying,
            without=_headline(again) if again else None,
            shift=float(again.theta[0] - self.whole.theta[0]) if again else float("nan"),
        )


def _headline(fitted: LeastSquaresFit) -> Estimate:
    return fitted.estimates[fitted.names[0]]


def _far(
    shift: FloatArray, chi2: FloatArray, clean: LeastSquaresFit, look: FloatArray | float = LOOK
) -> list[int]:
    """The few largest shifts of the headline that are worth a fit, the largest first.

    An outlier inflates the scatter and with it the uncertainty that its shift is compared with; its
    share of chi2 corrects for that.
    """
    narrower = np.sqrt(np.clip(1 - chi2 / max(clean.chi2, clean.dof), 0.0, 1.0))
    ratio = np.abs(shift) / (look * _headline(clean).u * np.maximum(narrower, 1e-3))
    order = np.argsort(-np.nan_to_num(ratio), kind="stable")[:TRIES]
    return [int(i) for i in order if ratio[i] > 1]


def _moves(clean: LeastSquaresFit, again: LeastSquaresFit) -> bool:
    """Whether the headlines differ by more than `MOVES` of the smaller standard uncertainty."""
    return bool(
        abs(again.theta[0] - clean.theta[0]) > MOVES * min(_headline(clean).u, _headline(again).u)
    )
