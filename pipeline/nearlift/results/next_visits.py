"""The next visits of a campaign and their gain."""

from __future__ import annotations

from dataclasses import dataclass

from nearlift.declare import Boundary
from nearlift.results.document import Real


@dataclass(frozen=True, slots=True, kw_only=True)
class NextVisit:
    """One visit: `z_hat` is infinite in free air, `supply_V` None where it is left as it is.

    `approach` is +1 where the last move leads away from the boundary, -1 where closer.
    """

    z_hat: Real
    distance_m: Real
    throttles: tuple[Real, ...]
    supply_V: float | None
    approach: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NextVisits:
    """The next visits at one boundary, in order.

    Attributes
    ----------
    aim : tuple of str
        The coefficient, or the two explanations to distinguish.
    now, after : float
        The coefficient's standard uncertainty, or the expected evidence (non-centrality) between
        the two, with the present trials and with these visits.
    wanted : float or None
        Where to stop, in the same unit.
    visits_wanted : int or None
        Visits until then by this plan, planned again every batch; None where none are enough.
    best : float
        What no number of visits betters.
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
    best: Real
    visits: tuple[NextVisit, ...]
    notes: tuple[str, ...] = ()

    @property
    def parts(self) -> bool:
        """Whether two explanations are to be distinguished."""
        return len(self.aim) > 1
