"""Errors shared by trials: each declared component as shared unknowns in the likelihood.

A component is one unknown per element of its scope. In log lift a gain error counts 1, a force
error 1 / L, and a height error the slope d log ratio / dz. An error of a model's input counts the
model's own derivative (`fit.inputs`). Scopes `sample` and `trial` are independent from trial to
trial and only widen each trial's variance. Every other scope is a column (or several) of `shared`,
and no number of repeats averages it down.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.campaign.rig import Uncertainty
from nearlift.declare import FloatArray
from nearlift.results import IntArray, Observations

#: Inputs that a model takes as known: a component on one is relative, on the exponent absolute.
INPUTS = ("rotor_radius", "rotor_spacing", "exponent", "mass", "air_density")
GROUPED = ("distance", "throttle", "record", "session", "boundary", "campaign")


@dataclass(frozen=True, slots=True, kw_only=True)
class Component:
    """One line of the budget: `standard` is m on height, N on force, a fraction on gain and inputs;
    `range_N` bends a cell's line. The zero of a record of many trials is measured: each trial
    has its own standard uncertainty, and `standard` is 0.

    An input has its `derivative` from `inputs.acting`; `moves` are the geometries that go with a
    rotor spacing.
    """

    name: str
    on: str
    scope: str
    standard: float = 0.0
    distribution: str = "normal"
    range_N: float | None = None
    derivative: Callable[[Observations], FloatArray] | None = field(default=None, compare=False)
    moves: tuple[str, ...] = ()

    @property
    def is_measured(self) -> bool:
        """Whether the records say its size, and not the manifest."""
        return self.on == "zero"

    def size(self, data: Observations) -> float:
        """The standard uncertainty, of a measured one as these trials have it."""
        if self.on == "zero" and data.u_zero_N is not None:
            return float(np.sqrt(np.mean(data.u_zero_N**2)))
        return self.standard

    def sensitivity(self, data: Observations, slope: FloatArray) -> FloatArray:
        """Change of log lift per standard uncertainty, (n,)."""
        if self.on == "height":
            return self.standard * slope
        if self.on == "force":
            return self.standard / data.lift_N
        if self.on == "zero":
            # planned trials are pieces of no record
            return np.zeros(data.n) if data.u_zero_N is None else data.u_zero_N / data.lift_N
        if self.on == "linearity":
            # zero at zero force, `standard` at full range: the lowest such departure from a
            # straight line is quadratic
            assert self.range_N is not None
            return self.standard * data.lift_N / self.range_N**2
        if self.on in INPUTS:
            assert self.derivative is not None
            return self.standard * self.derivative(data)
        return np.full(data.n, self.standard)


def stated(parts: Iterable[Component]) -> list[str]:
    """The phrase "the stated uncertainties (a, b)"; nothing where the manifest states none."""
    names = list(dict.fromkeys(part.name for part in parts if not part.is_measured))
    return [f"the stated uncertainties ({', '.join(names)})"] if names else []


def components(campaign: Campaign) -> tuple[Component, ...]:
    """The budget of a campaign.

    It has the `[[uncertainty]]` list, the load cell's accuracy, the zero that the trials of a
    record share, and an offset where nothing was tared.
    """
    listed = [_declared(u, campaign) for u in campaign.uncertainty]
    cell = campaign.load_cell
    accuracy = None if cell.accuracy is None else cell.accuracy / np.sqrt(3)
    if accuracy is not None and cell.range is not None:
        listed.append(
            Component(
                name="load cell linearity",
                on="linearity",
                scope="campaign",
                standard=accuracy,
                distribution="uniform",
                range_N=cell.range,
            )
        )
    if campaign.segments is not None and cell.tare not in (0.0, "none"):
        listed.append(Component(name="zero of a record", on="zero", scope="record"))
    if cell.tare == "none" and accuracy is not None:
        listed.append(
            Component(
                name="untared zero",
                on="force",
                scope="session",
                standard=accuracy,
                distribution="uniform",
            )
        )
    return tuple(listed)


def _declared(u: Uncertainty, campaign: Campaign) -> Component:
    vehicle = campaign.vehicle
    standard = u.standard()
    if not u.relative:
        standard /= campaign.nominal(u.on) or 1.0
    moves = ("spacing_hat", *(() if vehicle.rotor_diagonal else ("diagonal_hat",)), "layout_hat")
    return Component(
        name=u.name,
        on=u.on,
        standard=standard,
        distribution=u.distribution,
        scope=u.scope,
        moves=moves,
    )


def groups(data: Observations, scope: str) -> IntArray:
    """Index of the scope's element that each trial belongs to, (n,)."""
    if scope == "distance":
        return np.unique(data.z_hat, return_inverse=True)[1].astype(np.int64)
    if scope == "throttle":
        return data.level
    if scope == "session":
        return data.session
    if scope == "record" and data.record is not None:
        return np.unique(data.record, return_inverse=True)[1].astype(np.int64)
    return np.zeros(data.n, dtype=np.int64)


def independent_variance(data: Observations, part: Component, slope: FloatArray) -> FloatArray:
    """Variance of log lift that one component adds to each trial by itself, (n,)."""
    if part.scope in GROUPED:
        return np.zeros(data.n)
    return part.sensitivity(data, slope) ** 2 / (
        np.maximum(data.n_eff, 1) if part.scope == "sample" else 1.0
    )


def own_variance(data: Observations, parts: tuple[Component, ...], slope: FloatArray) -> FloatArray:
    """Variance of log lift from the components that are independent from trial to trial, (n,)."""
    return sum((independent_variance(data, part, slope) for part in parts), np.zeros(data.n))


def columns(data: Observations, part: Component, slope: FloatArray) -> FloatArray:
    """Sensitivities (n, m) to the m shared unknowns of one component; (n, 0) for an independent
    one.
    """
    if part.scope not in GROUPED:
        return np.zeros((data.n, 0))
    group = groups(data, part.scope)
    result: FloatArray = np.eye(group.max() + 1)[group] * part.sensitivity(data, slope)[:, None]
    return result


def shared(data: Observations, parts: tuple[Component, ...], slope: FloatArray) -> FloatArray:
    """All shared components side by side, (n, m)."""
    return np.hstack([np.zeros((data.n, 0)), *(columns(data, part, slope) for part in parts)])
