"""Everything declared: what nearlift brings, then what installed packages add by entry point.

A package adds a model by an entry point in the group `nearlift.models` that names one `LiftModel` value (`nearlift.effects`:
one `Effect`; `nearlift.readers`: see `nearlift.readers`). Names are unique; nothing is overridden. A package that cannot be
loaded, or offers something else, is refused by its name rather than left out: a run must not depend on what failed silently.

Entry points are loaded when the catalogue is first asked, not when it is imported.
"""

from __future__ import annotations

import difflib
import functools
from collections.abc import Iterable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Protocol, TypeVar

from nearlift.declare import BOUNDARIES, Boundary, Effect, LiftModel
from nearlift.effects import EFFECTS
from nearlift.errors import DeclarationError, UsageError
from nearlift.models import MODELS


class Named(Protocol):
    """Anything that a catalogue holds."""

    @property
    def name(self) -> str:
        """Unique identifier."""


T = TypeVar("T", bound=Named)


def models(boundary: Boundary | None = None) -> tuple[LiftModel, ...]:
    """Every lift model, or those of one boundary; built-in ones first."""
    return tuple(m for m in _models() if boundary in (None, m.boundary))


def model(name: str) -> LiftModel:
    """The lift model of that name; `UsageError` with the nearest names if there is none."""
    return find(name, models(), "model")


def effects() -> tuple[Effect, ...]:
    """Every candidate effect; built-in ones first."""
    return _effects()


def effect(name: str) -> Effect:
    """The effect of that name; `UsageError` with the nearest names if there is none."""
    return find(name, effects(), "effect")


def default_base(boundary: Boundary, rotors: int) -> str:
    """Name of the model that a boundary is fitted with unless the manifest says otherwise."""
    if boundary not in BOUNDARIES:
        raise UsageError("boundary", f"{boundary!r} is not one", f"boundaries are {', '.join(BOUNDARIES)}")
    ground = "cheeseman_bennett" if rotors == 1 else "sanchez_cuevas"
    return {"ground": ground, "ceiling": "hsiao_chirarattananon", "sidewall": "sidewall_decay"}[boundary]


def default_rivals(boundary: Boundary, rotors: int, geometry: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of all further models of a boundary that suit the vehicle and whose geometry is known, in catalogue order."""
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
    remedy = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(known)}"
    raise UsageError(kind, f"there is no {kind} {name!r}", remedy)


def gather(group: str, wanted: type[T], built_in: Iterable[T]) -> tuple[T, ...]:
    """The built-in declarations followed by those that installed packages add to an entry-point group.

    Raises
    ------
    DeclarationError
        A package cannot be loaded, offers something that is not a `wanted`, or a name that is taken.
    """
    found: dict[str, T] = {}
    owner: dict[str, str] = {}

    def add(item: T, package: str) -> None:
        if item.name in found:
            raise DeclarationError(
                f"package {package}", f"declares {item.name!r}, a name that {owner[item.name]} declares already", "rename one of the two"
            )
        found[item.name], owner[item.name] = item, package

    for item in built_in:
        add(item, "nearlift")
    for point in sorted(entry_points(group=group), key=lambda p: (_package(p), p.name)):
        package = _package(point)
        remedy = f"mend or uninstall {package}"
        try:
            offered = point.load()
        except Exception as fault:  # whatever a foreign module raises on import
            raise DeclarationError(
                f"package {package}", f"its entry point {point.name!r} in {group} breaks: {type(fault).__name__}: {fault}", remedy
            ) from fault
        if not isinstance(offered, wanted):
            raise DeclarationError(
                f"package {package}", f"its entry point {point.name!r} in {group} is of type {type(offered).__name__}, not {wanted.__name__}", remedy
            )
        add(offered, package)
    return tuple(found.values())


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.value


@functools.cache
def _models() -> tuple[LiftModel, ...]:
    return gather("nearlift.models", LiftModel, MODELS)


@functools.cache
def _effects() -> tuple[Effect, ...]:
    return gather("nearlift.effects", Effect, EFFECTS)
