"""Candidate models: a base model with effects as a function of one flat vector, with derivatives
and weak priors.

A stated zero error of the distance is a parameter of every candidate. Near a boundary the lift is
far from linear in the distance, so a column of the covariance does not carry it. It is the effect
`height_offset` with the stated uncertainty as its prior, and belongs to no explanation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue, derivative
from nearlift.declare import Effect, FloatArray, LiftModel, Parameter, Prior, compose
from nearlift.fit import height_error
from nearlift.likelihood.budget import Component
from nearlift.likelihood.problem import needed, slope_with_distance
from nearlift.likelihood.subspace import cosines
from nearlift.loop.families import indicators
from nearlift.results import IntArray, Observations

#: Cosines in the smooth relative deformation of an effect's form, with amplitudes as 1 / order.
FORM_ORDER = 4
#: Standard deviation of a size in the search over that of its prior: weak, but a 40 mm datum error
#: is no explanation.
WIDE = 4.0
#: Standard deviations of parameters that differ by session, over that of their prior; the likeliest
#: is chosen.
SESSION_SPREADS = (0.1, 0.3, 1.0, 3.0)
#: Name of the stated zero error of the distance, in place of that of the effect.
DATUM = "distance_datum"
#: A search composes the same parts again for each of its visits left out.
_composed = lru_cache(maxsize=1024)(compose)


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """Entries `start` to `stop` of one parameter in the flat vector: one per session where it
    differs by session.

    `effect` is empty for a parameter of the base model.
    """

    parameter: Parameter
    effect: str
    start: int
    stop: int


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """The base model with effects that may explain its residual; `data` has its derived covariates
    and `lift_inf_N`.

    `datum` is the stated zero error of the distance, whose parameter follows the base model's.
    """

    base: LiftModel
    effects: tuple[Effect, ...]
    data: Observations
    datum: Effect | None = None
    session_spread: float = 1.0

    @property
    def name(self) -> str:
        """Names of the effects, or "base"."""
        return " + ".join(e.name for e in self.effects) or "base"

    @property
    def _parts(self) -> tuple[Effect, ...]:
        return (*filter(None, (self.datum,)), *self.effects)

    @cached_property
    def model(self) -> LiftModel:
        """The composed lift model."""
        return _composed(self.base, *self._parts) if self._parts else self.base

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """Layout of the flat vector, the base model's parameters first."""
        owner = {p.name: e.name for e in self._parts for p in e.parameters}
        slots, at = [], 0
        for p in self.model.parameters:
            width = int(self.data.session.max()) + 1 if p.per == "session" else 1
            slots.append(Slot(parameter=p, effect=owner.get(p.name, ""), start=at, stop=at + width))
            at += width
        return tuple(slots)

    @property
    def size(self) -> int:
        """Length of the flat vector."""
        return self.slots[-1].stop if self.slots else 0

    @cached_property
    def known(self) -> dict[str, object]:
        """Geometry and covariates that the composed model needs."""
        return needed(self.model, self.data)

    def log_ratio(self, vector: FloatArray, data: Observations | None = None) -> FloatArray:
        """Log L / L_inf, (n,) or (m, n), at vectors (P,) or (m, P); nan where the ratio is not
        positive and finite. `data` are other trials of the same campaign.
        """
        where = self.data if data is None else data
        known = self.known if data is None else needed(self.model, data)
        vector = np.asarray(vector, dtype=float)
        values = {}
        for s in self.slots:
            if s.parameter.per == "session":
                # a session beyond those of the fit has the null value
                unseen = np.full((*vector.shape[:-1], 1), s.parameter.value)
                each = np.concatenate([vector[..., s.start : s.stop], unseen], axis=-1)
                values[s.parameter.name] = each[..., np.minimum(where.session, s.stop - s.start)]
            else:
                values[s.parameter.name] = vector[..., s.start, None]
        ratio = np.asarray(self.model.evaluate(where.z_hat, **known, **values), dtype=float)
        with np.errstate(invalid="ignore", divide="ignore"):
            log: FloatArray = np.log(np.where((ratio > 0) & (ratio < np.inf), ratio, np.nan))
        return np.broadcast_to(log, (*vector.shape[:-1], where.n))

    @cached_property
    def _widths(self) -> IntArray:
        return np.array([s.stop - s.start for s in self.slots], dtype=np.int64)

    def _each(self, value: Callable[[Slot], float]) -> FloatArray:
        """Attribute of each slot, repeated for all of its entries, (P,)."""
        return np.repeat(np.array([value(s) for s in self.slots], dtype=float), self._widths)

    @cached_property
    def null(self) -> FloatArray:
        """Vector of the parameters' declared values, (P,)."""
        return self._each(lambda s: s.parameter.value)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds, (P,) each."""
        low = self._each(lambda s: s.parameter.bounds[0])
        return low, self._each(lambda s: s.parameter.bounds[1])

    @cached_property
    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Prior mean and standard deviation of each entry, (P,) each.

        Standard deviations of sizes are scaled by `WIDE`, or by `session_spread` where they differ
        by session. Those of the base model are infinite.
        """

        def moments_of(s: Slot) -> tuple[float, float]:
            if not s.effect:
                return s.parameter.value, np.inf
            mean, sd = moments(s.parameter)
            if s.parameter.per == "session":
                return mean, sd * self.session_spread
            return mean, sd if s.parameter.grid or s.effect == DATUM else sd * WIDE

        each = np.reshape([moments_of(s) for s in self.slots], (-1, 2))
        mean, sd = np.repeat(each, self._widths, axis=0).T
        return mean, sd

    @cached_property
    def by_session(self) -> NDArray[np.bool_]:
        """Mask of the entries that differ by session, (P,)."""
        return self._each(lambda s: s.parameter.per == "session") > 0

    @cached_property
    def at_datum(self) -> NDArray[np.bool_]:
        """Mask of the zero error of the distance, (P,)."""
        return self._each(lambda s: s.effect == DATUM) > 0

    def entries_of(self, effect: str) -> IntArray:
        """Indices of one effect's entries; of the base model's for an empty name."""
        return np.flatnonzero(self._each(lambda s: s.effect == effect))

    def sizes(self) -> IntArray:
        """Indices of the effects' entries that are not shapes."""
        return np.flatnonzero(
            self._each(lambda s: s.effect not in ("", DATUM) and not s.parameter.grid)
        )

    def jacobian(self, vector: FloatArray) -> FloatArray:
        """Derivative of log ratio by the vector, (n, P), or (m, n, P) at (m, P); 0 where the ratio
        has no value.

        Central differences in one broadcast call. Entries that differ by session step together:
        each moves the trials of its session alone.
        """
        if not self.size:
            return np.zeros((*vector.shape[:-1], self.data.n, 0))
        low, high = self.bounds
        _, sd = self.prior
        width = np.where(np.isfinite(sd), sd, np.minimum(high - low, 10.0))
        moved = np.repeat(np.eye(len(self.slots), dtype=bool), self._widths, axis=1)
        change, apart = derivative.central(
            self.log_ratio, vector, np.maximum(np.abs(vector), 10 * width), low, high, moved
        )
        trials = np.arange(self.data.n)
        result = np.zeros((*vector.shape[:-1], self.data.n, self.size))
        for i, s in enumerate(self.slots):
            entry = s.start + self.data.session * (s.parameter.per == "session")
            result[..., trials, entry] = change[..., i, :] / apart[..., entry]
        return np.nan_to_num(result, copy=False)

    def height_slope(self, vector: FloatArray, data: Observations) -> FloatArray:
        """Slope with distance of the log ratio at one vector, 1/m, (n,); 0 in free air."""
        return slope_with_distance(
            lambda z: self.log_ratio(vector, replace(data, z_hat=z)), data.z_hat, data.radius_m
        )

    def shapes(self) -> Iterator[FloatArray]:
        """Null vectors with every combination of the shapes' grid values."""
        shaped = [s for s in self.slots if s.parameter.grid and s.effect]
        for combination in product(*(s.parameter.grid for s in shaped)):
            vector = self.null.copy()
            for s, value in zip(shaped, combination, strict=True):
                vector[s.start : s.stop] = value
            yield vector

    def contribution(self, vector: FloatArray, effect: Effect) -> FloatArray:
        """Contribution of one effect to log lift at `vector`, (n,); 0 where there is no value."""
        without = vector.copy()
        mine = self.entries_of(effect.name)
        without[mine] = self.null[mine]
        return np.nan_to_num(self.log_ratio(vector) - self.log_ratio(without))

    def form_discrepancy(self, vector: FloatArray, sd: float) -> FloatArray:
        """Columns (n, t) of form uncertainty, unknowns of unit variance: each effect's contribution
        times smooth deformations of relative standard deviation `sd`.

        These run along the effect's covariate, throttle, and distance unless it acts on force. A
        true effect rarely scales with speed or distance exactly as its declared form does.
        """
        if sd <= 0:
            return np.zeros((self.data.n, 0))
        data, columns = self.data, []
        known = {**data.covariates, "z_hat": data.z_hat, "throttle": data.throttle}
        weight = 1 / np.arange(1, FORM_ORDER + 1)
        weight *= sd * np.sqrt(2 / np.sum(weight**2))
        for effect in self.effects:
            part = self.contribution(vector, effect)[:, None]
            distance = () if effect.acts_on == "force" else ("z_hat",)
            for name in dict.fromkeys((effect.varies_with, "throttle", *distance)):
                if name in known:
                    columns.append(part * cosines(known[name], FORM_ORDER) * weight)
        return np.hstack([*columns, self.restarts(vector, sd)])

    def restarts(self, vector: FloatArray, sd: float) -> FloatArray:
        """Columns (n, t) of unit-variance unknowns: differences between sessions of effects that
        restart, of a relative standard deviation `sd`.
        """
        columns = [np.zeros((self.data.n, 0))]
        for effect in self.effects:
            if effect.varies_with == "since_start_s" and self.data.session.max() > 0:
                part = self.contribution(vector, effect)[:, None]
                columns.append(part * indicators(self.data.session) * sd)
        return np.hstack(columns)


@lru_cache(maxsize=1024)
def moments(parameter: Parameter) -> tuple[float, float]:
    """Mean and standard deviation of a prior; location and scale of a half-normal one."""
    prior = parameter.prior
    if prior.distribution in ("norm", "halfnorm"):
        return prior.loc, prior.scale
    frozen = prior.frozen()
    return float(frozen.mean()), float(frozen.std())


def library_columns(
    base: LiftModel, effects: tuple[Effect, ...], data: Observations, theta: FloatArray
) -> list[tuple[Effect, FloatArray]]:
    """First-order columns (n, k) of each effect at its null, one entry per combination of shapes;
    without those that are zero.
    """
    library = []
    for effect in effects:
        candidate = Candidate(base=base, effects=(effect,), data=data)
        for vector in candidate.shapes():
            vector[: len(theta)] = theta
            columns = candidate.jacobian(vector)[:, candidate.sizes()]
            if np.any(columns):
                library.append((effect, columns))
    return library


def is_datum(part: Component) -> bool:
    """Whether a stated uncertainty is of the distance of all trials."""
    return part.on == "height" and part.standard > 0 and part.scope in ("boundary", "campaign")


def stated_datum(parts: Iterable[Component], model: LiftModel, data: Observations) -> Effect | None:
    """The zero error of the distance as an effect, within bounds that move no trial through the
    boundary; None where no uncertainty is stated.
    """
    stated = [part for part in parts if is_datum(part)]
    if not stated:
        return None
    effect, sd = catalogue.effect("height_offset"), height_error.standard_m(stated)
    (offset,) = effect.parameters
    low, high = offset.bounds
    offset = replace(
        offset,
        prior=Prior(distribution="norm", scale=sd),
        bounds=(max(low, -height_error.room_m(model, data)), high),
    )
    return replace(effect, name=DATUM, parameters=(offset,))
