"""Bounded TOML, and the faults of a manifest with key, value and nearest known key."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Iterable
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from nearlift.campaign.quantities import Section
from nearlift.errors import ManifestError, brief, did_you_mean

#: A manifest of five hundred velocity cases has 150 kB.
MOST_BYTES = 1 << 19
#: Brackets within brackets, and parts of a dotted key; a manifest needs four.
DEEPEST = 8
#: Of one number; a double precision one is exact with 17.
MOST_DIGITS = 60
#: Strings and comments are skipped whole; a quote that opens and never closes is left to the
#: parser, which ends there.
_TOKEN = re.compile(
    r'"""(?:[^"\\]|\\[\s\S]|"(?!""))*+"{3,5}'
    r"|'''(?:[^']|'(?!''))*+'{3,5}"
    r'|"(?:[^"\\\n]|\\.)*+"(?!")'
    r"|'[^'\n]*+'(?!')"
    r"|\#[^\n]*+|[\w+-]++|[^\w+-]"
)


def loads(content: bytes, where: str) -> dict[str, Any]:
    """The tables of a TOML file, with or without a byte order mark.

    Raises
    ------
    ManifestError
        It is too large, too deep, no UTF-8, or no TOML.
    """
    if len(content) > MOST_BYTES:
        raise ManifestError(
            where,
            f"has {len(content)} bytes",
            f"a manifest has at most {MOST_BYTES}; trials belong into the schedule",
        )
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as fault:
        raise ManifestError(
            where, f"is not UTF-8 text ({fault.reason} at byte {fault.start})", "save it as UTF-8"
        ) from None
    _bounded(text, where)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as fault:
        raise ManifestError(where, f"is not valid TOML: {fault}", "mend that line") from None


def _bounded(text: str, where: str) -> None:
    """Refuse brackets, dotted keys and numbers beyond what any manifest has."""
    line, brackets, dots = 1, 0, 0
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token in "\"'":
            return
        if token in "[{":
            brackets, dots = brackets + 1, 0
        elif token in "]}":
            brackets -= 1
        elif token == ".":
            dots += 1
        elif token in "\n=,":
            dots = 0
        if max(brackets, dots) >= DEEPEST:
            raise ManifestError(
                f"{where}, line {line}",
                f"is nested more than {DEEPEST} deep",
                "no key of a manifest is",
            )
        if len(token) > MOST_DIGITS and token.lstrip("+-")[:1].isdigit():
            raise ManifestError(
                f"{where}, line {line}",
                f"holds a number of {len(token)} digits",
                "17 digits say all that there is to say",
            )
        line += token.count("\n")


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
