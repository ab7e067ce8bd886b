"""Declarations of models and effects: evaluation, parameters, needs and checks.

They are compared with each other when a declaration is made.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nearlift.declare.parameter import Check, Parameter, Source
from nearlift.errors import DeclarationError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Evaluate = Callable[..., Any]
Boundary = Literal["ground", "ceiling", "sidewall"]
BOUNDARIES: tuple[Boundary, ...] = get_args(Boundary)


def keywords(evaluate: Evaluate) -> tuple[str, ...]:
    """Names of the keyword-only arguments of a function."""
    return tuple(
        p.name
        for p in inspect.signature(evaluate).parameters.values()
        if p.kind is inspect.Parameter.KEYWORD_ONLY
    )


def with_keywords(function: Evaluate, names: Iterable[str]) -> Evaluate:
    """Function of z_hat that states these keyword-only arguments, which declarations compare."""
    kinds = inspect.Parameter
    function.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            kinds("z_hat", kinds.POSITIONAL_ONLY),
            *(kinds(name, kinds.KEYWORD_ONLY) for name in names),
        ]
    )
    return function


@dataclass(frozen=True, slots=True, eq=False)
class Declaration:
    """Common base of `LiftModel` and `Effect`. Each declaration is equal only to itself.

    Attributes
    ----------
    name, title : str
        Identifier, and label of a legend.
    formula : str
        LaTeX.
    evaluate : callable
        ``f(x, /, *, <needs>, <parameters>)``, broadcasting.
    parameters : tuple of Parameter
    needs : tuple of str
        Geometry (`spacing_hat`, ...) or trial covariates (`supply_V`, ...) that must be known.
    valid_z_hat : (float, float)
        Open at the lower end where a formula has a pole. Trials outside are left out of its fit,
        with the reason.
    source : Source
    checks : tuple of Check
        At least one.
    notes : str
        Mechanism, convention, approximation and traps; the docstring of `evaluate` where empty.
    """

    name: str
    title: str
    formula: str
    evaluate: Evaluate
    _: KW_ONLY
    parameters: tuple[Parameter, ...] = ()
    needs: tuple[str, ...] = ()
    valid_z_hat: tuple[float, float] = (0.0, math.inf)
    source: Source
    checks: tuple[Check, ...]
    notes: str = ""

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or self.name != self.name.lower():
            raise self.refusal("the name is not a lower-case identifier")
        wanted = {*self.needs, *(p.name for p in self.parameters)}
        if len(wanted) != len(self.needs) + len(self.parameters):
            raise self.refusal("a name occurs twice among parameters and needs")
        takes = set(keywords(self.evaluate))
        if takes != wanted:
            raise self.refusal(
                f"evaluate takes {sorted(takes)} but parameters and needs are {sorted(wanted)}",
                "name its keyword-only arguments as its parameters and needs",
            )
        if not self.checks:
            raise self.refusal(
                "has no numeric check",
                "give at least one number that it must reproduce, and who quoted it",
            )
        if not (self.source.doi or self.source.doubts):
            raise self.refusal(
                "its source has no doi and no doubts",
                "give its doi, or write into doubts what was not verified",
            )
        for check in self.checks:
            got = float(np.squeeze(self(check.x, **check.arguments)))
            if not abs(got - check.expected) <= check.tolerance:
                at = ", ".join(f"{n} = {v}" for n, v in {"x": check.x, **check.arguments}.items())
                raise self.refusal(
                    f"gives {got!r} at {at}, not {check.expected!r} ({check.quoted_by})",
                    "correct the function, its parameters' values, or the check",
                )
        self._refuse_scalar_function(self.checks[0])
        notes = self.notes or self.evaluate.__doc__ or ""
        object.__setattr__(self, "notes", inspect.cleandoc(notes))

    def _refuse_scalar_function(self, check: Check) -> None:
        """Refuse a function that takes one number at a time, or mixes rows of parameters."""
        known = {**{p.name: p.value for p in self.parameters}, **check.arguments}
        rows = {p.name: np.array([[known[p.name]], [np.mean(p.bounds)]]) for p in self.parameters}
        fault, got = "rows are mixed", np.full((2, 3), np.nan)
        try:
            with np.errstate(all="ignore"):
                x = np.stack([check.x] * 3, axis=-1)
                got = np.broadcast_to(self.evaluate(x, **known | rows), (2, 3))
        except (TypeError, ValueError) as raised:
            fault = str(raised)
        if not np.all(np.abs(got[0] - check.expected) <= check.tolerance):
            raise self.refusal(
                f"evaluate does not take x of shape (n,) with parameters of shape (m, 1): {fault}",
                "use functions of numpy, and np.where instead of if",
            )

    def refusal(self, what: str, remedy: str = "") -> DeclarationError:
        """Faults of this declaration."""
        return DeclarationError(f"declaration {self.name}", what, remedy)

    def __call__(self, x: Any, /, **arguments: Any) -> Any:
        """Evaluate at `x`; parameters left out have their declared values."""
        known = {p.name: p.value for p in self.parameters}
        unknown = arguments.keys() - known.keys() - set(self.needs)
        if unknown:
            raise self.refusal(
                f"does not take {sorted(unknown)}",
                f"it takes {sorted({*known, *self.needs})}",
            )
        missing = [n for n in self.needs if n not in arguments]
        if missing:
            raise self.refusal(f"needs {missing}", "give them as keywords")
        return self.evaluate(x, **(known | arguments))

    def named(self, values: Iterable[float]) -> dict[str, float]:
        """Values of the parameters, in their order, by name."""
        return dict(zip((p.name for p in self.parameters), values, strict=True))

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise self.refusal(
            f"has no parameter {name!r}",
            f"it has {[p.name for p in self.parameters]}",
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LiftModel(Declaration):
    """Lift near a boundary over lift far away, as a function of `z_hat`.

    `evaluate(z_hat, /, *, ...)` is the ratio L / L_inf (1 far away). `downwash`, where a model has
    one, is the induced velocity at the disk over its value far away, with the same signature.
    `rotors` says whether the model describes an isolated rotor (``"one"``), a vehicle of several
    (``"several"``), or either.
    """

    boundary: Boundary
    rotors: Literal["one", "several", "any"] = "any"
    downwash: Evaluate | None = None
    tends_to_one: bool = True

    def __post_init__(self) -> None:
        super(LiftModel, self).__post_init__()
        if self.boundary not in BOUNDARIES:
            raise self.refusal(
                f"{self.boundary!r} is not a boundary",
                f"boundaries are {', '.join(BOUNDARIES)}",
            )
        downwash, ratio = (keywords(f) for f in (self.downwash or self.evaluate, self.evaluate))
        if set(downwash) != set(ratio):
            raise self.refusal(
                f"downwash takes {sorted(downwash)} but evaluate takes {sorted(ratio)}",
                "give both the same keyword-only names",
            )

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the parameters, (p,) each."""
        low, high = (np.array([p.bounds[end] for p in self.parameters]) for end in (0, 1))
        return low, high

    def suits(self, rotors: int, geometry: Mapping[str, object]) -> bool:
        """Whether the model describes a vehicle with so many rotors and this known geometry."""
        kind_fits = self.rotors == "any" or (self.rotors == "one") == (rotors == 1)
        return kind_fits and all(n in geometry for n in self.needs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Effect(Declaration):
    """An effect that a model may lack; it vanishes at its declared parameter values.

    Attributes
    ----------
    acts_on : str
        Argument and result of `evaluate`: ``"height"`` z_hat, ``"ratio"`` L / L_inf, ``"force"``
        lift in N.
    inflow : bool
        Whether the inflow at the disk changes with it as lift does. Downwash is then divided by the
        change of the ratio, or is that at the corrected height. Any other leaves downwash as it is.
    additive : bool
        A force effect in newtons: a composed model then needs `lift_inf_N`. Any other is a factor.
    mechanism : str
        The physical cause in one sentence.
    varies_with : str
        Covariate along which its true shape may depart from the declared one.
    separated_by : str
        Measurement that distinguishes it from confounded effects.
    log_next_time : tuple of str
        Quantities to record where its needs are not met.
    boundaries : tuple of str
        Boundaries near which it can occur.
    belongs_to : str
        Bench or vehicle; an effect of the vehicle is also in simulated flights.
    by_experiment : bool
        Its needs are met by running trials in two ways on purpose, not by logging. Only campaigns
        that did so report it.
    error_of : str
        Input of a budget whose unknown error it is, as in ``on = "height"``.
    loaded : bool
        An additive effect that is absent while the rotors are at rest.
    within_trial : bool
        Its signature is a change during a record, which the mean of a trial does not show.
    form : str
        Name of its form, where it has several.
    other_forms : tuple of Effect
        The same effect in other forms, each with its own function and shapes. The search weighs all
        of them; forecasts use the first.
    """

    acts_on: Literal["height", "ratio", "force"]
    mechanism: str
    inflow: bool = False
    additive: bool = False
    varies_with: str
    separated_by: str = ""
    log_next_time: tuple[str, ...] = ()
    boundaries: tuple[Boundary, ...] = BOUNDARIES
    belongs_to: Literal["vehicle", "bench"] = "bench"
    by_experiment: bool = False
    error_of: str = ""
    loaded: bool = False
    within_trial: bool = False
    form: str = ""
    other_forms: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        super(Effect, self).__post_init__()
        if not self.mechanism:
            raise DeclarationError(
                f"effect {self.name}",
                "names no mechanism",
                "only what has a physical cause may explain a residual",
            )
        sizes = {p.name for p in self.parameters}
        if not any(c.expected == c.x and sizes.isdisjoint(c.arguments) for c in self.checks):
            raise DeclarationError(
                f"effect {self.name}",
                "has no check that it does nothing at its declared values",
                "add null(x, ...) of nearlift.declare to its checks",
            )

    def or_form(self, form: str, formula: str, evaluate: Evaluate, **declared: Any) -> Effect:
        """The effect with another form; `declared` are parameters, source, checks and other fields
        that differ.
        """
        other = replace(
            self,
            form=form,
            formula=formula,
            evaluate=evaluate,
            notes="",
            other_forms=(),
            **declared,
        )
        return replace(self, other_forms=(*self.other_forms, other))

    @property
    def forms(self) -> tuple[Effect, ...]:
        """Its forms, itself the first."""
        return (self, *self.other_forms)

    def at_lift(self, lift_N: float) -> Effect:
        """The effect with the bounds and priors of a campaign of this median lift, N."""
        parameters = tuple(p.at_lift(lift_N) for p in self.parameters)
        return self if parameters == self.parameters else replace(self, parameters=parameters)
