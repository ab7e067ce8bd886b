"""Everything declared: what nearlift brings, then what installed packages add by entry point.

Entry points (`nearlift.plugins`) are loaded when the catalogue is first asked, not when it is
imported.
"""

from __future__ import annotations

import difflib
import functools
import re
from collections.abc import Iterable, Mapping
from typing import TypeVar

from nearlift.declare import BOUNDARIES, Boundary, Effect, LiftModel
from nearlift.effects import EFFECTS
from nearlift.errors import DeclarationError, UsageError
from nearlift.models import MODELS
from nearlift.plugins import Named, gather

T = TypeVar("T", bound=Named)
#: Begins a title with a capital everywhere.
PROPER = ("Reynolds",)
#: What may be a name in a text: no part of a path, of an address or of a longer word.
NAME = re.compile(r"(?<![\w/#.])[A-Za-z]\w*")


def models(boundary: Boundary | None = None) -> tuple[LiftModel, ...]:
    """Every lift model, or those of one boundary; built-in ones first.

    Raises
    ------
    DeclarationError
        A package cannot be loaded, or a parameter has the name of an effect's parameter.
    """
    return tuple(m for m in _models() if boundary in (None, m.boundary))


def model(name: str) -> LiftModel:
    """The lift model of that name; `UsageError` with the nearest names if there is none."""
    return find(name, models(), "model")


@functools.cache
def effects() -> tuple[Effect, ...]:
    """Every candidate effect; built-in ones first."""
    return gather("nearlift.effects", Effect, EFFECTS)


def effect(name: str, form: str = "") -> Effect:
    """The effect of that name in the given form, else its first one.

    Raises
    ------
    UsageError
        There is none; the nearest names, or its forms, are proposed.
    """
    first = find(name, effects(), "effect")
    for each in first.forms:
        if form in ("", each.form):
            return each
    forms = ", ".join(each.form for each in first.forms)
    raise UsageError("effect", f"{name} has no form {form!r}", f"it has {forms}")


def titled(text: str) -> str:
    """A text with every effect and model that it names by its title, as within a sentence."""
    known = _titles()
    return NAME.sub(lambda match: known.get(match[0], match[0]), text)


@functools.cache
def _titles() -> dict[str, str]:
    known = {m.name: m.title for m in models() if "_" in m.name}
    return known | {
        e.name: e.title if e.title.startswith(PROPER) else e.title[:1].lower() + e.title[1:]
        for e in effects()
    }


def default_base(boundary: Boundary, rotors: int) -> str:
    """Name of the model that a boundary is fitted with unless the manifest says otherwise."""
    if boundary not in BOUNDARIES:
        raise UsageError(
            "boundary", f"{boundary!r} is not one", f"boundaries are {', '.join(BOUNDARIES)}"
        )
    ground = "cheeseman_bennett" if rotors == 1 else "sanchez_cuevas"
    return {"ground": ground, "ceiling": "hsiao_chirarattananon", "sidewall": "sidewall_decay"}[
        boundary
    ]


def default_rivals(
    boundary: Boundary, rotors: int, geometry: Mapping[str, object]
) -> tuple[str, ...]:
    """Names of all further models of a boundary that suit the vehicle and whose geometry is known,
    in catalogue order.
    """
    base = default_base(boundary, rotors)
    return tuple(m.name for m in models(boundary) if m.name != base and m.suits(rotors, geometry))


def find(name: str, among: Iterable[T], kind: str) -> T:
    """The item of that name.

    Raises
    ------
    UsageError
        There is none; the nearest names are proposed.
    """
    known = {item.name: item for item in among}
    if name in known:
        return known[name]
    near = difflib.get_close_matches(name, known, n=3)
    remedy = f"did you mean {' or '.join(near)}?" if near else "`nearlift describe` lists them"
    raise UsageError(kind, f"there is no {kind} {name!r}", remedy)


@functools.cache
def _models() -> tuple[LiftModel, ...]:
    known = gather("nearlift.models", LiftModel, MODELS)
    owner: dict[str, str] = {}
    for effect in effects():
        for name in {p.name for form in effect.forms for p in form.parameters}:
            _refuse_shared(f"effect {effect.name}", name, owner)
            owner[name] = effect.name
    for each in known:
        for parameter in each.parameters:
            _refuse_shared(f"model {each.name}", parameter.name, owner)
    return known


def _refuse_shared(where: str, parameter: str, owner: Mapping[str, str]) -> None:
    """Refuse the name of an effect's parameter: the search could not add that effect."""
    if parameter in owner:
        what = f"its parameter {parameter!r} is also one of effect {owner[parameter]}"
        raise DeclarationError(where, what, "rename it")
