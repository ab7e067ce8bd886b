"""The manifest's `[design]`: a campaign before it is run."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from nearlift.declare import Boundary
from nearlift.manifest.quantities import (
    Angle,
    Duration,
    Force,
    Length,
    Scatter,
    Section,
    Share,
    Temperature,
    Voltage,
)


class PlannedNoise(Section):
    """How trials are expected to scatter: in proportion to lift, additive, and a visit's height."""

    relative: Share
    force: Scatter = 0.0
    height: Length = 0.0


class Planned(Section):
    """A campaign before it is run, for `nearlift design`: where, how often, in how much time, and
    what will be logged.

    `distances` are as the traverse shows them; one that stands twice is visited twice a round.
    `lift` is L_inf at each throttle; `supply` and `tilt` list what these will range over (within
    each session; visit by visit), `temperature` over the whole campaign.
    """

    distances: dict[Boundary, list[Length]]
    throttles: list[Share] = Field(min_length=1)
    lift: list[Force] | None = None
    visits: int = Field(default=15, ge=1, le=10_000)
    sessions: int = Field(default=5, ge=1, le=10_000)
    trial: Duration = 20.0
    move: Duration = 8.0
    change: Duration = 300.0
    overshoot: Length | None = None
    supply: list[Voltage] | None = Field(default=None, min_length=2, max_length=2)
    temperature: list[Temperature] | None = Field(default=None, min_length=2, max_length=2)
    tilt: list[Angle] | None = None
    logs: list[str] = Field(default=[])
    noise: PlannedNoise | None = None
    expected: dict[Boundary, dict[str, float]] = Field(default={})

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        if self.lift is not None and len(self.lift) != len(self.throttles):
            raise ValueError(
                f"lift lists {len(self.lift)} values for {len(self.throttles)} throttles"
            )
        if len(set(self.throttles)) != len(self.throttles):
            raise ValueError("a throttle stands twice")
        if not self.distances or not all(self.distances.values()):
            raise ValueError('distances lists no station; write { ground = ["30 mm", "40 mm"] }')
        return self
