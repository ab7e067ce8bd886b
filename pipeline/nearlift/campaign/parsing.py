"""Bounded TOML, and the faults of a manifest with key, value and nearest known key.

Size, depth and digits are judged before TOML is parsed. The parser recurses over brackets, takes
quadratic time over dotted keys, and computes whole numbers of any length.
"""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from nearlift.campaign.quantities import Section
from nearlift.errors import ManifestError, brief, did_you_mean

#: Largest manifest, bytes; five hundred velocity cases take 150 kB.
MOST_BYTES = 1 << 19
#: Brackets within brackets, and parts of a dotted key; a manifest needs four.
DEEPEST = 8
#: Digits of one number; 17 are exact in double precision.
MOST_DIGITS = 60
#: Faults listed of one manifest.
MOST_FAULTS = 50
# strings and comments are skipped whole; a quote that never closes is left to the parser
_TOKEN = re.compile(
    r'"""(?:[^"\\]|\\[\s\S]|"(?!""))*+"{3,5}'
    r"|'''(?:[^']|'(?!''))*+'{3,5}"
    r'|"(?:[^"\\\n]|\\.)*+"(?!")'
    r"|'[^'\n]*+'(?!')"
    r"|\#[^\n]*+|[\w+-]++|[^\w+-]"
)
Kind = TypeVar("Kind", bound=BaseModel)


def loads(content: bytes, where: str) -> dict[str, Any]:
    """The tables of a TOML file, with or without a byte order mark.

    `ManifestError` if the file is too large or too deep, or is no UTF-8 or no TOML.
    """
    if len(content) > MOST_BYTES:
        raise ManifestError(
            where,
            f"has {len(content)} bytes",
            f"a manifest has at most {MOST_BYTES}; trials belong into the schedule",
        )
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
        _check_bounds(text, where)
        return tomllib.loads(text)
    except UnicodeDecodeError as fault:
        raise ManifestError(
            where, f"is not UTF-8 text ({fault.reason} at byte {fault.start})", "save it as UTF-8"
        ) from None
    except tomllib.TOMLDecodeError as fault:
        raise ManifestError(where, f"is not valid TOML: {fault}", "correct that line") from None


def _check_bounds(text: str, where: str) -> None:
    """Refuse brackets, dotted keys and numbers beyond those of any manifest."""
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
        place = f"{where}, line {line}"
        if max(brackets, dots) >= DEEPEST:
            what = f"is nested more than {DEEPEST} deep"
            raise ManifestError(place, what, "no key of a manifest is")
        if len(token) > MOST_DIGITS and token.lstrip("+-")[:1].isdigit():
            what = f"holds a number of {len(token)} digits"
            raise ManifestError(place, what, "17 digits are exact in double precision")
        line += token.count("\n")


def validated(kind: type[Kind], raw: dict[str, object], where: str) -> Kind:
    """A table of the manifest from plain values; raises `ManifestError` that lists every fault with
    its key.
    """
    try:
        return kind.model_validate(raw)
    except ValidationError as fault:
        errors = fault.errors(include_url=False)
        shown = dict.fromkeys(_explain(error, kind) for error in errors[:MOST_FAULTS])
        lines = first_of(shown, len(errors))
        if any(error["type"] == "missing" for error in errors):
            lines.append("`nearlift new DIR` writes a manifest that explains each key")
        raise ManifestError(where, "\n  ".join(lines)) from None


def first_of(faults: Iterable[str], count: int) -> list[str]:
    """The first `MOST_FAULTS` of `count` faults, each cut to a readable line."""
    shown = [brief(fault) for fault in itertools.islice(faults, MOST_FAULTS)]
    return [*shown, f"and {count - MOST_FAULTS} more"] if count > MOST_FAULTS else shown


def _explain(error: Any, kind: type[BaseModel]) -> str:
    """One fault: key, value, and the nearest known key."""
    # pydantic adds the branch of a union to the place
    location = [
        part
        for part in error["loc"]
        if not re.fullmatch(r"float|str|.*(?:function|\[).*", str(part))
    ]
    key = ".".join(map(str, location)) or "manifest"
    if error["type"] == "extra_forbidden":
        known, old = _known_keys(kind, location)
        if replacement := old.get(str(location[-1])):
            return f"{key}: was renamed; write {replacement}"
        hint = did_you_mean(str(location[-1]), known) or f"known here: {', '.join(known)}"
        return f"{key}: unknown key; {hint}"
    if error["type"] == "missing":
        return f"{key}: is missing"
    if error["type"] == "literal_error" and key == "schema":
        return (
            f"schema: is {error['input']!r}, and this nearlift reads {error['ctx']['expected']}:"
            " correct it, or take the version that wrote it"
        )
    message, value = error["msg"].removeprefix("Value error, ").replace("\n", "; "), error["input"]
    known_value = isinstance(value, dict | list) or str(value) in message
    return f"{key}: {message}" + ("" if known_value else f" (found {value!r})")


def _known_keys(kind: type[BaseModel], location: list[Any]) -> tuple[list[str], Mapping[str, str]]:
    """Keys allowed in the table that holds the last part of `location`, and its old keys."""
    old = getattr(kind, "OLD_KEYS", {})
    known = {f.alias or n: f for n, f in kind.model_fields.items()}
    for part in location[:-1]:
        if part in known and (section := _section_in(known[part].annotation)):
            known = {f.alias or n: f for n, f in section.model_fields.items()}
            old = section.OLD_KEYS
    return list(known), old


def _section_in(annotation: Any) -> Any:
    """The Section class inside an annotation such as `list[Overlay] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    inner = map(_section_in, getattr(annotation, "__args__", ()))
    return next((section for section in inner if section is not None), None)
