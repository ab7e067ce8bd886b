"""The next visits of a campaign, their gain and their cost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from nearlift.declare import Boundary
from nearlift.nomenclature import letter
from nearlift.results.document import Real, as_json
from nearlift.rounding import plain


@dataclass(frozen=True, slots=True, kw_only=True)
class NextVisit:
    """One visit: `z_hat` is infinite in free air, `supply_V` None where it is left as it is.

    `approach` is +1 where the last move leads away from the boundary, -1 where closer; `via_m` is
    where to drive to first, to arrive so, None where that is so anyway.
    """

    z_hat: Real
    distance_m: Real
    throttles: tuple[Real, ...]
    supply_V: float | None
    approach: int
    via_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NextVisits:
    """The next visits at one boundary, in order.

    Attributes
    ----------
    aim : tuple of str
        The coefficient, or the two explanations to distinguish.
    now, after : float
        What is known of it with the trials there are, and with these visits: the coefficient's
        standard uncertainty, or the expected evidence (non-centrality) that parts the two.
    wanted : float or None
        Where to stop, in the same unit.
    visits_wanted : int or None
        Visits until then by this plan, planned again every batch; None where none are enough.
    visits_evenly : int or None
        The same where all stations are visited equally often.
    best : float
        What no number of visits betters.
    sees : float
        Chance to see then, or after these visits, a structure in distance that the same knowledge
        by all stations equally often would see with a chance of `sees_evenly`.
    """

    boundary: Boundary
    base_model: str
    trials: int
    throttles: int
    aim: tuple[str, ...]
    now: Real
    after: Real
    wanted: float | None
    visits_wanted: int | None
    visits_evenly: int | None
    best: Real
    sees: Real
    sees_evenly: Real
    visits: tuple[NextVisit, ...]
    notes: tuple[str, ...] = ()

    @property
    def parts(self) -> bool:
        """Whether two explanations are to be distinguished."""
        return len(self.aim) > 1

    @property
    def lines(self) -> list[str]:
        """Gain of the visits, where to stop, and their cost."""
        return [self._gain, *([self.stop] if self.wanted is not None else []), self._cost]

    @property
    def brief(self) -> list[str]:
        """The visits in one line, and where to stop, or what they bring."""
        places = ", ".join(
            ("free air" if math.isinf(v.z_hat) else f"{1e3 * v.distance_m:.4g} mm")
            + (f" at {v.supply_V:.2f} V" if v.supply_V is not None else "")
            for v in self.visits
        )
        outcome = self._gain if self.wanted is None else self.stop
        return [f"next at the {self.boundary}: {places}", outcome]

    @property
    def _name(self) -> str:
        return " and ".join(self.aim) if self.parts else f"u({letter(self.aim[0])})"

    @property
    def _gain(self) -> str:
        new = f"{len(self.visits)} visits ({self.throttles * len(self.visits)} trials)"
        now, after = plain(self.now, 2), plain(self.after, 2)
        if self.parts:
            return f"{self._name}: expected evidence {now} now, {after} after these {new}"
        return f"{self._name} = {now} now, about {after} after these {new}"

    @property
    def stop(self) -> str:
        """The line that says where to stop."""
        assert self.wanted is not None
        what = (
            f"{self._name} distinguished (expected evidence {plain(self.wanted, 2)})"
            if self.parts
            else f"{self._name} = {plain(self.wanted, 2)}"
        )
        if self.visits_wanted == 0:
            return f"{what}: reached" + (
                ""
                if self.parts
                else "; for structure in distance go on at all stations equally often"
            )
        if self.visits_wanted is None:
            why = (
                "the unknown forms of the two"
                if self.parts
                else "the stated uncertainties that all trials share"
            )
            if self._out_of_reach:
                return f"{what}: out of reach of these stations; {why} leave {plain(self.best, 2)}"
            return f"{what}: not within thousands of visits of these stations"
        more = f"{self._trials(self.visits_wanted)} more trials"
        evenly = (
            f"{self._trials(self.visits_evenly)} at all stations equally often"
            if self.visits_evenly is not None
            else "never at all stations equally often"
        )
        return f"{what} after about {more}; {evenly}"

    @property
    def _out_of_reach(self) -> bool:
        assert self.wanted is not None
        return self.best < self.wanted if self.parts else self.best > self.wanted

    def _trials(self, visits: int) -> str:
        return f"{self.throttles * visits:,}".replace(",", " ")

    @property
    def _cost(self) -> str:
        if not math.isfinite(self.sees):
            return "no number of even visits to all stations would answer this"
        return (
            "cost: an unmodelled dependence on distance is found with"
            f" {100 * self.sees:.0f} % probability instead of {100 * self.sees_evenly:.0f} %"
        )

    @property
    def content(self) -> dict[str, Any]:
        """Content as JSON."""
        content: dict[str, Any] = as_json(self)
        return content | {"text": self.lines}
