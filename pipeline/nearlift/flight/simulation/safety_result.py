"""Content of safety.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nearlift.declare import Boundary
from nearlift.flight.simulation.claims import JudgedClaim
from nearlift.flight.simulation.fitted import FittedFlights
from nearlift.flight.simulation.published import PublishedFlights
from nearlift.flight.simulation.roll import RollResult
from nearlift.flight.simulation.route import RouteResult


@dataclass(frozen=True, slots=True, kw_only=True)
class PresetFlights:
    """The paper's models under one preset."""

    meaning: str
    boundaries: Mapping[Boundary, PublishedFlights]


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyResult:
    """Flights of the paper's and the fitted models near the boundaries; route, claims and roll."""

    schema: str
    presets: Mapping[str, PresetFlights]
    fitted: Mapping[Boundary, FittedFlights]
    route: RouteResult | None
    claims: tuple[JudgedClaim, ...]
    roll: RollResult
