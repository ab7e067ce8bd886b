"""What a model, an effect and a parameter are: frozen values that check themselves when they are
made.

A declaration is one immutable value at the end of its own file. Evaluation, fitting, sampling,
documentation and tests all read it; nothing about it is written twice. The keyword-only names of
`evaluate` are the table of what it needs, so a declaration whose function and table disagree cannot
be imported.

Broadcasting is part of the contract: with parameters of shape (m, 1) and x of shape (n,),
`evaluate` returns (m, n).
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nearlift.errors import DeclarationError

if TYPE_CHECKING:
    from scipy.stats._distn_infrastructure import rv_continuous_frozen

FloatArray = NDArray[np.float64]
Evaluate = Callable[..., Any]
Boundary = Literal["ground", "ceiling", "sidewall"]
BOUNDARIES: tuple[Boundary, ...] = get_args(Boundary)


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


@dataclass(frozen=True, slots=True, kw_only=True)
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
        What is believed before the data; for an effect the physically plausible size.
    meaning : str
        One sentence, with sign.
    grid : tuple of float
        For a shape (a length, a time constant, an exponent) that nothing depends on at the effect's
        null: the values at which a search starts. Empty for a size.
    per : str
        ``"session"``: one such number for each session, passed to `evaluate` already spread over
        the trials.
    """

    name: str
    unit: str
    value: float
    bounds: tuple[float, float]
    prior: Prior
    meaning: str
    grid: tuple[float, ...] = ()
    per: Literal["", "session"] = ""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Where a formula came from, and every doubt about how it reached us."""

    citation: str
    equation: str = ""
    doi: str = ""
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A number that the declaration must reproduce: `evaluate(x, **arguments)` equals `expected`
    within `tolerance`.
    """

    x: float
    expected: float
    arguments: Mapping[str, Any] = field(default_factory=dict)
    tolerance: float = 5e-7
    quoted_by: str = ""


def keywords(evaluate: Evaluate) -> tuple[str, ...]:
    """Names of the keyword-only arguments of a function."""
    return tuple(
        p.name
        for p in inspect.signature(evaluate).parameters.values()
        if p.kind is inspect.Parameter.KEYWORD_ONLY
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Declaration:
    """What models and effects have in common; see `LiftModel` and `Effect`.

    Attributes
    ----------
    name, title : str
        Identifier, and what a legend says.
    formula : str
        LaTeX.
    evaluate : callable
        ``f(x, /, *, <needs>, <parameters>)``, broadcasting.
    parameters : tuple of Parameter
    needs : tuple of str
        Geometry (`spacing_hat`, ...) or trial covariates (`supply_V`, ...) that must be known.
    valid_z_hat : (float, float)
        Open at the lower end where a formula has a pole; trials outside are left out of its fit,
        with the reason.
    source : Source
    checks : tuple of Check
        At least one.
    """

    name: str
    title: str
    formula: str
    evaluate: Evaluate
    parameters: tuple[Parameter, ...] = ()
    needs: tuple[str, ...] = ()
    valid_z_hat: tuple[float, float] = (0.0, math.inf)
    source: Source
    checks: tuple[Check, ...]
    notes: str = ""

    def __post_init__(self) -> None:
        where = f"declaration {self.name}"
        if not self.name.isidentifier() or self.name != self.name.lower():
            raise DeclarationError(where, "the name is not a lower-case identifier")
        wanted = {*self.needs, *(p.name for p in self.parameters)}
        if len(wanted) != len(self.needs) + len(self.parameters):
            raise DeclarationError(where, "a name stands twice among parameters and needs")
        takes = set(keywords(self.evaluate))
        if takes != wanted:
            raise DeclarationError(
                where,
                f"evaluate takes {sorted(takes)} but parameters and needs are {sorted(wanted)}",
                "make its keyword-only names equal the table",
            )
        if not self.checks:
            raise DeclarationError(
                where,
                "has no numeric check",
                "give at least one number that it must reproduce, and who quoted it",
            )
        for check in self.checks:
            got = float(np.squeeze(self(check.x, **check.arguments)))
            if not abs(got - check.expected) <= check.tolerance:
                raise DeclarationError(
                    where,
                    f"gives {got!r} at {check.x} {dict(check.arguments)}, not {check.expected!r}"
                    f" ({check.quoted_by})",
                )

    def __call__(self, x: Any, /, **arguments: Any) -> Any:
        """Evaluate at `x`; parameters left out stand at their declared values."""
        known = {p.name: p.value for p in self.parameters}
        unknown = arguments.keys() - known.keys() - set(self.needs)
        if unknown:
            raise DeclarationError(
                f"declaration {self.name}",
                f"does not take {sorted(unknown)}",
                f"it takes {sorted({*known, *self.needs})}",
            )
        missing = [n for n in self.needs if n not in arguments]
        if missing:
            raise DeclarationError(
                f"declaration {self.name}", f"needs {missing}", "give them as keywords"
            )
        return self.evaluate(x, **(known | arguments))

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise DeclarationError(
            f"declaration {self.name}",
            f"has no parameter {name!r}",
            f"it has {[p.name for p in self.parameters]}",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LiftModel(Declaration):
    """Lift near a boundary over lift far away, as a function of `z_hat`.

    `evaluate(z_hat, /, *, ...)` is the ratio L / L_inf (1 far away). `downwash`, where a model has
    one, is the induced velocity at the disk over its value far away, with the same signature.
    `rotors` says whether the model describes an isolated rotor (``"one"``), a vehicle of several
    (``"several"``), or either.

    `gradient`, where a model has one, has that signature too and returns the derivatives of the
    ratio with respect to each parameter, a tuple in their order; it is compared with differences of
    `evaluate` at every check. Without it, fits take differences.
    """

    boundary: Boundary
    rotors: Literal["one", "several", "any"] = "any"
    downwash: Evaluate | None = None
    gradient: Evaluate | None = None
    tends_to_one: bool = True

    def __post_init__(self) -> None:
        super(LiftModel, self).__post_init__()
        if self.boundary not in BOUNDARIES:
            raise DeclarationError(
                f"declaration {self.name}",
                f"{self.boundary!r} is not a boundary",
                f"boundaries are {', '.join(BOUNDARIES)}",
            )
        for role, other in (("downwash", self.downwash), ("gradient", self.gradient)):
            if other is not None and set(keywords(other)) != set(keywords(self.evaluate)):
                raise DeclarationError(
                    f"declaration {self.name}",
                    f"{role} takes {sorted(keywords(other))} but evaluate takes"
                    f" {sorted(keywords(self.evaluate))}",
                    "give both the same keyword-only names",
                )
        if self.gradient is not None:
            for check in self.checks:
                self._compare_gradient(check, self.gradient)

    def _compare_gradient(self, check: Check, gradient: Evaluate) -> None:
        """Refuse derivatives that are not those of `evaluate`, by central differences."""
        at = {p.name: p.value for p in self.parameters} | dict(check.arguments)
        declared = gradient(check.x, **at)
        if len(declared) != len(self.parameters):
            raise DeclarationError(
                f"declaration {self.name}",
                f"gradient gives {len(declared)} derivatives for {len(self.parameters)} parameters",
            )
        for p, own in zip(self.parameters, declared, strict=True):
            h = 1e-5 * max(abs(at[p.name]), 0.1)
            up, down = (
                float(np.squeeze(self.evaluate(check.x, **(at | {p.name: at[p.name] + s}))))
                for s in (h, -h)
            )
            difference, given = (up - down) / (2 * h), float(np.squeeze(own))
            if not abs(given - difference) <= 1e-5 * (abs(difference) + 1e-3):
                raise DeclarationError(
                    f"declaration {self.name}",
                    f"gradient says d/d{p.name} = {given:.6g} at {check.x}, differences say"
                    f" {difference:.6g}",
                )

    def suits(self, rotors: int, geometry: Mapping[str, Any]) -> bool:
        """Whether the model describes a vehicle with so many rotors and this known geometry."""
        kind_fits = self.rotors == "any" or (self.rotors == "one") == (rotors == 1)
        return kind_fits and all(n in geometry for n in self.needs)


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect(Declaration):
    """Something that a model may lack; it does nothing at its declared parameter values.

    `acts_on` says what `evaluate` takes and returns: ``"height"`` z_hat, ``"ratio"`` L / L_inf,
    ``"force"`` lift in N. An `additive` force effect works in newtons, so a composed model then
    needs `lift_inf_N`; any other is a factor. `mechanism` is the physical cause in one sentence;
    `varies_with` the covariate along which its true shape may depart from the declared one;
    `log_next_time` what to record where its needs are not met; `boundaries` where it can occur at
    all; `belongs_to` whether a vehicle takes it along when it leaves the bench (then it flies in
    simulations).
    """

    acts_on: Literal["height", "ratio", "force"]
    mechanism: str
    additive: bool = False
    varies_with: str
    log_next_time: tuple[str, ...] = ()
    boundaries: tuple[Boundary, ...] = BOUNDARIES
    belongs_to: Literal["vehicle", "bench"] = "bench"

    def __post_init__(self) -> None:
        super(Effect, self).__post_init__()
        if not self.mechanism:
            raise DeclarationError(
                f"effect {self.name}",
                "names no mechanism",
                "only what has a physical cause may explain a residual",
            )


def compose(model: LiftModel, *effects: Effect) -> LiftModel:
    """A lift model with effects added; it is again a lift model, so nothing downstream learns that
    effects exist.

    Height effects act on z_hat before the model, ratio effects on its result, force effects on the
    product with L_inf. Their parameters keep their names; two effects with a parameter of the same
    name are refused. An effect's need of `z_hat` is met by the composition itself, with the height
    effects applied, and is no need of the result.
    """
    supplied = {"z_hat"}
    additive = any(e.additive for e in effects)
    parameters = model.parameters + tuple(p for e in effects for p in e.parameters)
    if len({p.name for p in parameters}) != len(parameters):
        raise DeclarationError(
            f"compose({model.name}, ...)", "two of the parts have a parameter of the same name"
        )
    needs = dict.fromkeys(model.needs)
    needs |= dict.fromkeys(n for e in effects for n in e.needs if n not in supplied)
    if additive:
        needs["lift_inf_N"] = None
    by_kind = {
        kind: [e for e in effects if e.acts_on == kind] for kind in ("height", "ratio", "force")
    }
    asked = {part.name: keywords(part.evaluate) for part in (model, *effects)}

    def arguments(part: Declaration, values: Mapping[str, Any], z_hat: Any) -> dict[str, Any]:
        known = {**values, "z_hat": z_hat}
        return {name: known[name] for name in asked[part.name]}

    def evaluate(z_hat: Any, /, **values: Any) -> Any:
        for effect in by_kind["height"]:
            z_hat = effect.evaluate(z_hat, **arguments(effect, values, z_hat))
        ratio = model.evaluate(z_hat, **arguments(model, values, z_hat))
        for effect in by_kind["ratio"]:
            ratio = effect.evaluate(ratio, **arguments(effect, values, z_hat))
        lift_inf = values["lift_inf_N"] if additive else 1.0
        lift = ratio * lift_inf
        for effect in by_kind["force"]:
            lift = effect.evaluate(lift, **arguments(effect, values, z_hat))
        return lift / lift_inf

    names = (*needs, *(p.name for p in parameters))
    evaluate.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter("z_hat", inspect.Parameter.POSITIONAL_ONLY),
            *(inspect.Parameter(n, inspect.Parameter.KEYWORD_ONLY) for n in names),
        ]
    )
    null = {p.name: p.value for e in effects for p in e.parameters}
    extra = {n: 1.0 for n in needs if n not in model.needs}
    checks = tuple(replace(c, arguments={**c.arguments, **null, **extra}) for c in model.checks)
    return LiftModel(
        name="_with_".join((model.name, *(e.name for e in effects))),
        title=" + ".join((model.title, *(e.title for e in effects))),
        formula=model.formula,
        evaluate=evaluate,
        parameters=parameters,
        needs=tuple(needs),
        valid_z_hat=model.valid_z_hat,
        source=model.source,
        checks=checks,
        boundary=model.boundary,
        rotors=model.rotors,
        downwash=None,
        tends_to_one=model.tends_to_one,
    )
