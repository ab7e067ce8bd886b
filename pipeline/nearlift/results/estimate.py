"""An estimate with its interval, and the noise of trials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.results.serial import Above, Below, Json, Unbounded


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertainValue:
    """A number with its standard uncertainty and 90 % interval, in `unit`."""

    value: float
    u: Unbounded
    lo90: Below
    hi90: Above
    unit: str = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate(UncertainValue):
    """A parameter of a model, and whether it is at the end of its range."""

    at_bound: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """How trials scatter about any smooth curve.

    Attributes
    ----------
    relative : float
        Standard deviation in proportion to lift, beyond what the records themselves show.
    force_N : float
        Standard deviation of an additive force.
    height_m : float
        Standard deviation of the height of one visit of the traverse, shared by the visit's trials.
    common : float
        Standard deviation, in proportion to lift, of what else the trials of a visit have in
        common.
    drift : tuple of float
        Standard deviations, in proportion to lift, of slow drifts between trials, one for each
        length in `likelihood.variance_components.DRIFT_LENGTHS`.
    source : str
        What they were estimated from.
    dof : float
        Degrees of freedom behind them.
    sizes, log_covariance : tuple
        The names of what was estimated (`drift0` and so on for the drifts), and the covariance of
        the logarithms of their sizes: how well the noise itself is known. Empty where it was
        declared.
    modes : tuple
        Logarithms of the sizes at each mode of their posterior, force as a fraction of the median
        lift: where the search among nearly the same trials begins.
    """

    relative: float
    force_N: float = 0.0
    height_m: float = 0.0
    common: float = 0.0
    drift: tuple[float, ...] = ()
    source: str = "declared"
    dof: float = np.inf
    sizes: tuple[str, ...] = ()
    log_covariance: tuple[tuple[float, ...], ...] = ()
    modes: tuple[tuple[float, ...], ...] = ()

    def record(self) -> dict[str, object]:
        """Its block in a product."""
        sizes = {
            name: getattr(self, name) for name in ("relative", "force_N", "height_m", "common")
        }
        drift = float(np.sqrt(np.sum(np.square(self.drift))))
        return {
            **sizes,
            "drift": drift,
            "drift_by_length": list(self.drift),
            "source": self.source,
            "dof": self.dof,
        }

    @classmethod
    def recorded(cls, block: Json) -> Noise:
        """The noise of such a block."""
        known = {name: block[name] for name in ("relative", "force_N", "height_m", "common")}
        dof = np.inf if block["dof"] is None else block["dof"]
        drift = tuple(block["drift_by_length"])
        return cls(**known, drift=drift, source=block["source"], dof=dof)
