"""Influential trials and visits: those without which the headline coefficient would be another, and
what it would be.

The closed form (`fit.deletion`) says where to look; a fit without the trial, scatter and all,
decides. Outliers widen the scatter that they are judged by, and two can hide each other, so the
search goes forward: what stands out is left aside, and the rest looked at again.
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
from nearlift.results.influence import Influence, Suspect

#: Relative variance of a trial that is no scatter but the floor under none.
EXACT = 1.1e-12
#: A trial is fitted without if the closed form says that the headline would move by this part of
#: its standard uncertainty.
LOOK = 0.6
#: The part of its standard uncertainty by which a trial must move the headline to be named. Below
#: one, since a glitch moves the headline by more than leaving the trial out does: what the trial
#: would have said is lost too.
MOVES = 0.8
#: The same for a visit that stands off as a whole.
LOOK_AT_ODD = 0.25
#: Most trials, and most visits, that are named; and most that are fitted without for each name.
MOST, TRIES = 10, 4


def screen(
    whole: LeastSquaresFit,
    parts: tuple[Component, ...],
    outlying: Collection[str] = (),
    odd: Collection[str] = (),
    odd_visits: Collection[int] | NDArray[np.int64] = (),
) -> Influence:
    """Name the trials that are outlying or move the headline by `MOVES` of its standard
    uncertainty, and the visits that do the latter.

    Parameters
    ----------
    whole : LeastSquaresFit
        To all accepted trials; they all stay in it.
    parts : tuple of Component
        The whole budget.
    outlying : collection of str
        Trials that repeats and neighbours contradict (`reduction.outliers`).
    odd : collection of str
        Trials that stand far off, if not farther than noise allows. Together they may hide each
        other, so they are left out together, too.

    odd_visits : collection of int
        Visits that stand far off: as a visit's scatter is learnt from few visits, the closed form
        says too little of them.

    Returns
    -------
    Influence
        Without such trials, and without one near the limit, it costs no fit.
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
        """The model fitted anew, scatter and all; None where that fails."""
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
        """The trial that moves the headline most, by more than its standard uncertainty, and the
        fit without it; None if there is none.
        """
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
        """Those odd trials that move the headline by more than its standard uncertainty where the
        others are left out; all, if only all do.
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
        """The visits of several trials that move the headline by more than its standard
        uncertainty, the trials named left aside.
        """
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
        """One trial, and the headline without it alone."""
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

    What an outlier adds to the scatter widens the uncertainty that it is held against; its part of
    chi2 says by how much.
    """
    narrower = np.sqrt(np.clip(1 - chi2 / max(clean.chi2, clean.dof), 0.0, 1.0))
    ratio = np.abs(shift) / (look * _headline(clean).u * np.maximum(narrower, 1e-3))
    order = np.argsort(-np.nan_to_num(ratio), kind="stable")[:TRIES]
    return [int(i) for i in order if ratio[i] > 1]


def _moves(clean: LeastSquaresFit, again: LeastSquaresFit) -> bool:
    """Whether the headline differs by more than `MOVES` of the smaller of its standard
    uncertainties.
    """
    return bool(
        abs(again.theta[0] - clean.theta[0]) > MOVES * min(_headline(clean).u, _headline(again).u)
    )
