"""Content of safety.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nearlift.declare import Boundary
from nearlift.flight.fitted import FittedFlights
from nearlift.flight.paper import PublishedFlights
from nearlift.flight.roll import Roll
from nearlift.results.document import IfAny


@dataclass(frozen=True, slots=True, kw_only=True)
class PresetFlights:
    """The paper's models under one preset."""

    meaning: str
    boundaries: Mapping[Boundary, PublishedFlights]


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyResult:
    """Flights of the paper's and the fitted models near the boundaries, and roll near a wall."""

    schema: str = "nearlift.safety/1"
    presets: Mapping[str, PresetFlights]
    fitted: Mapping[Boundary, FittedFlights]
    roll: IfAny[Roll] = None
