"""Truth of a synthetic campaign: a lift model, effects on it, and noise of every kind that a
bench has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from nearlift.declare import Effect, FloatArray, LiftModel, compose


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchNoise:
    """Sizes of everything random; all but `quantum_N` may be zero.

    Attributes
    ----------
    sample_N : float
        White noise of a sample, sd.
    tone_N, tone_Hz : float
        Rotor tone at the largest throttle: amplitude and frequency. Amplitude grows with lift,
        frequency with the root of lift, as a rotor's does. At rest there is no tone.
    drift_N : float
        Slow drift of the zero over a record, sd of the change from its head to its end.
    zero_N : float
        Zero of the cell at the start of a trial, sd; the tare removes it.
    trial : float
        Of a trial's lift, relative sd.
    height_m : float
        Of a visit's distance, sd; its trials share it.
    quantum_N : float
        One count of the cell's converter.
    """

    sample_N: float = 2e-3
    tone_N: float = 4e-3
    tone_Hz: float = 130.0
    drift_N: float = 1e-4
    zero_N: float = 5e-3
    trial: float = 0.005
    height_m: float = 0.05e-3
    quantum_N: float = 9.8e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """One boundary's truth.

    Attributes
    ----------
    parameters : mapping of str to float
        Of the model; a parameter left out has its declared value.
    effects : tuple of (Effect, values)
        Effects that act. One whose values are left out does nothing.
    lift_inf_N : mapping of float to float
        Throttle (a fraction) to lift far away, N.
    geometry : mapping of str to value
        What the model needs of the vehicle (`spacing_hat`, `diagonal_hat`).
    """

    model: LiftModel
    lift_inf_N: Mapping[float, float]
    parameters: Mapping[str, float] = field(default_factory=dict)
    effects: tuple[tuple[Effect, Mapping[str, float]], ...] = ()
    geometry: Mapping[str, object] = field(default_factory=dict)
    noise: BenchNoise = BenchNoise()

    def lift_N(
        self, z_hat: FloatArray, throttle: FloatArray, columns: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Expected lift of trials (n,), N, without noise; `columns` are covariates (n,) by their
        inside names, for effects.

        Raises
        ------
        DeclarationError
            An effect needs what neither `columns` nor `geometry` has.
        """
        far = np.array([self.lift_inf_N[t] for t in throttle])
        whole = compose(self.model, *(effect for effect, _ in self.effects))
        values = dict(self.parameters)
        for _, given in self.effects:
            values |= given
        known = {"throttle": throttle, "lift_inf_N": far, **columns, **self.geometry}
        needs = {name: known[name] for name in whole.needs if name in known}
        return np.asarray(far * whole(z_hat, **needs, **values), dtype=np.float64)
