"""Models, effects and readers of installed packages, by entry point.

A package adds a model by an entry point in the group `nearlift.models` that names one `LiftModel`
value. An entry point in `nearlift.effects` names one `Effect`, one in `nearlift.readers` one
`Reader`. Names are unique; nothing is overridden. A package that cannot be loaded, or offers
something else, is refused by its name. It is not left out silently, since the results of a run
depend on it. A change of its code makes them stale.
"""

from __future__ import annotations

import functools
import hashlib
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
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
GROUPS = ("nearlift.models", "nearlift.effects", "nearlift.readers")


def gather(group: str, wanted: type[T], built_in: Iterable[T]) -> tuple[T, ...]:
    """The built-in declarations followed by those that installed packages add to an entry-point
    group, in the order of the packages' names.

    Raises
    ------
    DeclarationError
        A package cannot be loaded, offers something that is not a `wanted`, or a name that is
        taken.
    """
    from importlib.metadata import entry_points

    points = [(p.dist.name if p.dist else p.value, p) for p in entry_points(group=group)]
    points.sort(key=lambda point: (point[0], point[1].name))
    offered = [("nearlift", item) for item in built_in]
    offered += [(package, _loaded(point, package, wanted)) for package, point in points]
    gathered: dict[str, T] = {}
    owner: dict[str, str] = {}
    for package, item in offered:
        if item.name in gathered:
            what = f"declares {item.name!r}, a name that {owner[item.name]} declares already"
            raise DeclarationError(f"package {package}", what, "rename one of the two")
        gathered[item.name], owner[item.name] = item, package
    return tuple(gathered.values())


@functools.cache
def digests() -> dict[str, str]:
    """Digest of the code of each installed package that adds a declaration, by the package's name.

    Nothing is imported.
    """
    from importlib.metadata import entry_points
    from importlib.util import find_spec

    known, installed = defaultdict[str, list[str]](list), entry_points()
    for point in (p for group in GROUPS for p in installed.select(group=group)):
        spec = find_spec(point.module.partition(".")[0])
        if spec is not None and point.dist is not None:
            roots = spec.submodule_search_locations or [spec.origin or ""]
            known[point.dist.name] += [digest_of_code(Path(root)) for root in roots]
    return {name: " ".join(dict.fromkeys(digests)) for name, digests in known.items()}


def digest_of_code(root: Path) -> str:
    """SHA-256 of a module, or of every file of a package."""
    digest = hashlib.sha256()
    for file in [root] if root.is_file() else sorted(root.rglob("*")):
        if file.is_file() and "__pycache__" not in file.parts:
            digest.update(str(file.relative_to(root)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def _loaded(point: EntryPoint, package: str, wanted: type[T]) -> T:
    """The value that an entry point names."""
    where = f"its entry point {point.name!r} in {point.group}"
    remedy = f"fix or uninstall {package}"
    try:
        offered = point.load()
    except (Exception, SystemExit) as fault:  # whatever a foreign module raises on import
        what = f"{where} breaks: {type(fault).__name__}: {fault}"
        raise DeclarationError(f"package {package}", what, remedy) from fault
    if not isinstance(offered, wanted):
        what = f"{where} is of type {type(offered).__name__}, not {wanted.__name__}"
        raise DeclarationError(f"package {package}", what, remedy)
    return offered
