"""Faults of a manifest in the user's terms: each with its key, its value, and the nearest thing
that would have been right.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from nearlift.errors import ManifestError, brief, did_you_mean
from nearlift.manifest.quantities import Section

Kind = TypeVar("Kind", bound=BaseModel)
#: As many faults of one manifest are told.
MOST_FAULTS = 50


def validated(kind: type[Kind], raw: dict[str, object], where: str) -> Kind:
    """A table of the manifest from plain values; raises `ManifestError` that lists every fault with
    its key.
    """
    try:
        return kind.model_validate(raw)
    except ValidationError as fault:
        errors = fault.errors(include_url=False)
        lines = first_of(
            dict.fromkeys(_explain(error, kind) for error in errors[:MOST_FAULTS]), len(errors)
        )
        if any(error["type"] == "missing" for error in errors):
            lines.append("`nearlift new DIR` writes a manifest that says what each key is")
        raise ManifestError(where, "\n  ".join(lines)) from None


def first_of(faults: Iterable[str], count: int) -> list[str]:
    """The first of so many faults, each cut to a line that can be read."""
    shown = [brief(fault) for fault in itertools.islice(faults, MOST_FAULTS)]
    return [*shown, f"and {count - MOST_FAULTS} more"] if count > MOST_FAULTS else shown


def _explain(error: Any, kind: type[BaseModel]) -> str:
    """One fault in the user's terms: key, value, and the nearest thing that would have
    been right.
    """
    location = [
        part
        for part in error["loc"]
        if not (
            isinstance(part, str)
            and ("function" in part or "[" in part or part in ("float", "str"))
        )
    ]
    key = ".".join(str(part) for part in location) or "manifest"
    if error["type"] == "extra_forbidden":
        known = _keys_beside(kind, location)
        hint = did_you_mean(str(location[-1]), known) or f"known here: {', '.join(known)}"
        return f"{key}: unknown key; {hint}"
    if error["type"] == "missing":
        return f"{key}: is missing"
    if error["type"] == "literal_error" and key == "schema":
        return (
            f"schema: is {error['input']!r}, and this nearlift reads {error['ctx']['expected']}:"
            " mend it, or take the version that wrote it"
        )
    message = error["msg"].removeprefix("Value error, ").replace("\n", "; ")
    shown = (
        ""
        if isinstance(error["input"], dict | list) or str(error["input"]) in message
        else f" (found {error['input']!r})"
    )
    return f"{key}: {message}{shown}"


def _keys_beside(kind: type[BaseModel], location: list[Any]) -> list[str]:
    """Keys allowed in the table that holds the last part of `location`."""
    known = {f.alias or n: f for n, f in kind.model_fields.items()}
    for part in location[:-1]:
        if part in known and (section := _section_in(known[part].annotation)):
            known = {f.alias or n: f for n, f in section.model_fields.items()}
    return list(known)


def _section_in(annotation: Any) -> Any:
    """The Section class inside an annotation such as `list[Overlay] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        section = _section_in(inner)
        if section is not None:
            return section
    return None
