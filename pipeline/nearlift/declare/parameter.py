"""Numbers that a declaration holds: parameters with their priors, where a formula came from, and
what it must reproduce.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from nearlift.errors import DeclarationError

if TYPE_CHECKING:
    from scipy.stats._distn_infrastructure import rv_continuous_frozen


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """A distribution of `scipy.stats`, named in data and resolved only when it is evaluated.

    Attributes
    ----------
    distribution : str
        Name in `scipy.stats`, such as ``"norm"`` or ``"uniform"``.
    loc, scale : float
        As scipy defines them (for ``"uniform"`` the lower end and the width).
    shape : tuple of float
        Shape parameters, where the distribution has any.
    """

    distribution: str
    loc: float = 0.0
    scale: float = 1.0
    shape: tuple[float, ...] = ()

    def frozen(self) -> rv_continuous_frozen:
        """The scipy distribution."""
        import scipy.stats

        family: Any = getattr(scipy.stats, self.distribution)
        result: rv_continuous_frozen = family(*self.shape, loc=self.loc, scale=self.scale)
        return result

    def __str__(self) -> str:
        if self.distribution == "uniform":
            return f"uniform on [{self.loc:g}, {self.loc + self.scale:g}]"
        if self.distribution == "norm":
            return f"normal, mean {self.loc:g}, sd {self.scale:g}"
        if self.distribution == "lognorm" and self.loc == 0:
            return f"log-normal, median {self.scale:g}, sd of the logarithm {self.shape[0]:g}"
        if self.distribution == "expon" and self.loc == 0:
            return f"exponential, mean {self.scale:g}"
        if self.distribution == "halfnorm" and self.loc == 0:
            return f"half-normal, scale {self.scale:g}"
        inside = ", ".join(f"{s:g}" for s in (*self.shape, self.loc, self.scale))
        return f"{self.distribution}({inside})"


def uniform(low: float, high: float) -> Prior:
    """A flat prior between two ends."""
    return Prior(distribution="uniform", loc=low, scale=high - low)


def normal(mean: float, sd: float) -> Prior:
    """A normal prior; the parameter's bounds truncate it."""
    return Prior(distribution="norm", loc=mean, scale=sd)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A free number of a model or an effect.

    Attributes
    ----------
    name : str
        Keyword of `evaluate`.
    unit : str
        SI unit, ``"1"`` if dimensionless.
    value : float
        For a model the published value (also where a fit starts), for an effect the null at which
        it does nothing.
    bounds : (float, float)
        Closed interval that fits and samplers keep to.
    prior : Prior
        Distribution before the data; for an effect of physically plausible size.
    meaning : str
        One sentence, with sign.
    grid : tuple of float
        Starting values of a search, for a shape (a length, a time constant, an exponent). Nothing
        depends on a shape at the effect's null. Empty for a size.
    per : str
        ``"session"``: one such number for each session, passed to `evaluate` already spread over
        the trials.
    usual_lift_N : float
        Largest median lift at which bounds and prior hold. Beyond it both grow in proportion to
        lift, as the errors of larger load cells do.
    plausible : (float, float)
        Usual values. Beyond them another effect may have the same shape.
    size_unit : str
        Unit of an effect's dimensionless size in words. One that begins with ``"fraction of "``, as
        ``"fraction of lift"``, is printed in per cent.
    """

    name: str
    unit: str
    value: float
    bounds: tuple[float, float]
    prior: Prior
    meaning: str
    grid: tuple[float, ...] = ()
    per: Literal["", "session"] = ""
    usual_lift_N: float = math.inf
    plausible: tuple[float, float] = (-math.inf, math.inf)
    size_unit: str = ""

    def __post_init__(self) -> None:
        low, high = self.bounds
        if not (low < high and low <= self.value <= high):
            raise DeclarationError(
                f"parameter {self.name}",
                f"value {self.value} and bounds {self.bounds} disagree",
                "order them low < high, with the value inside",
            )
        if not self.meaning:
            raise DeclarationError(
                f"parameter {self.name}",
                "has no meaning",
                "say in one sentence what it is, with its sign",
            )

    def at_lift(self, lift_N: float) -> Parameter:
        """The parameter for a campaign of this median lift, N."""
        factor = lift_N / self.usual_lift_N
        if not factor > 1:
            return self
        low, high = self.bounds
        prior = replace(self.prior, scale=factor * self.prior.scale)
        return replace(self, bounds=(factor * low, factor * high), prior=prior)


@dataclass(frozen=True, slots=True)
class Source:
    """Source of a formula, with every doubt about its transmission.

    `bibtex` holds keys of `report/documents/references.py`. Without one the report makes an entry
    from the citation.
    """

    citation: str
    equation: str = ""
    doi: str = ""
    bibtex: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Check:
    """A number that the declaration must reproduce: `evaluate(x, **arguments)` equals `expected`
    within `tolerance`.
    """

    x: float
    expected: float
    arguments: Mapping[str, Any] = field(default_factory=dict)
    quoted_by: str = ""
    tolerance: float = 5e-7


def null(x: float, /, **arguments: Any) -> Check:
    """The check that an effect does nothing to `x` at its declared parameter values."""
    return Check(x=x, expected=x, arguments=arguments, quoted_by="null")
