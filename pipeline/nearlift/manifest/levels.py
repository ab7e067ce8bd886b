"""[levels] of the manifest: whether L_inf is free for every throttle, or a curve."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from nearlift.manifest.quantities import Section


class Levels(Section):
    """How the lift far from every boundary hangs on throttle.

    Attributes
    ----------
    by : str
        "throttle": a level for each; "curve": its logarithm is a polynomial of the logarithms of
        `of`.
    of : list of str
        Columns of the schedule, the throttle among them, such as ``["throttle", "supply"]``.
    degree : int or None
        Of the polynomial, 1 being a power law; judged by visits left out where it is not given.
    """

    by: Literal["throttle", "curve"]
    of: list[str] = ["throttle"]
    degree: Annotated[int, Field(ge=1, le=4)] | None = None

    @model_validator(mode="after")
    def _of_a_curve(self) -> Self:
        given = self.model_fields_set - {"by"}
        if self.by == "throttle" and given:
            raise ValueError(f'{" and ".join(sorted(given))} go with by = "curve"')
        if "throttle" not in self.of:
            raise ValueError('of needs "throttle": without it all throttles would share one L_inf')
        if len(set(self.of)) < len(self.of):
            raise ValueError("of names a column twice")
        return self
