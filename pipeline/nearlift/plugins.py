"""Models, effects and readers of installed packages, by entry point.

A package adds a model by an entry point in the group `nearlift.models` that names one `LiftModel`
value. An entry point in `nearlift.effects` names one `Effect`, one in `nearlift.readers` one
`Reader`. Names are unique; nothing is overridden. A package that cannot be loaded, or offers
something else, is refused by its name. It is not left out silently, since the results of a run
depend on it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Protocol, TypeVar

from nearlift.errors import DeclarationError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


class Named(Protocol):
    """Anything that a catalogue holds."""

    @property
    def name(self) -> str:
        """Unique identifier."""


T = TypeVar("T", bound=Named)


def points(group: str) -> list[EntryPoint]:
    """The entry points of a group, in the order of their packages' names."""
    from importlib.metadata import entry_points

    return sorted(entry_points(group=group), key=lambda p: (_package(p), p.name))


def gather(group: str, wanted: type[T], built_in: Iterable[T]) -> tuple[T, ...]:
    """The built-in declarations followed by those that installed packages add to an entry-point
    group.

    Raises
    ------
    DeclarationError
        A package cannot be loaded, offers something that is not a `wanted`, or a name that is
        taken.
    """
    gathered: dict[str, T] = {}
    owner: dict[str, str] = {}

    def add(item: T, package: str) -> None:
        if item.name in gathered:
            raise DeclarationError(
                f"package {package}",
                f"declares {item.name!r}, a name that {owner[item.name]} declares already",
                "rename one of the two",
            )
        gathered[item.name], owner[item.name] = item, package

    for item in built_in:
        add(item, "nearlift")
    for point in points(group):
        package = _package(point)
        remedy = f"fix or uninstall {package}"
        try:
            offered = point.load()
        except (Exception, SystemExit) as fault:  # whatever a foreign module raises on import
            raise DeclarationError(
                f"package {package}",
                f"its entry point {point.name!r} in {group} breaks: {type(fault).__name__}:"
                f" {fault}",
                remedy,
            ) from fault
        if not isinstance(offered, wanted):
            raise DeclarationError(
                f"package {package}",
                f"its entry point {point.name!r} in {group} is of type {type(offered).__name__},"
                f" not {wanted.__name__}",
                remedy,
            )
        add(offered, package)
    return tuple(gathered.values())


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.value
