"""The text of a manifest, in which one value can be replaced: every comment stays."""

from __future__ import annotations

import json
import re

from nearlift.errors import ManifestError
from nearlift.manifest import campaign as manifests
from nearlift.manifest import toml
from nearlift.serve.bench import MANIFEST

UNITS = "trials.units."
# what stands before is looked at so that no place within blanks or a word is tried again
_KEY = re.compile(
    r"""(?<![\w.\- \t])[ \t]*+((?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
    r"""(?:[ \t]*+\.[ \t]*+[\w-]++)*+)[ \t]*+=[ \t]*+"""
)
_HEAD = re.compile(r"(?<![ \t])[ \t]*+(\[\[?)[ \t]*+([\w.-]++)[ \t]*+\]\]?")
_PART = re.compile(
    r'"""(?:[^"\\]|\\[\s\S]|"(?!""))*"{3,5}'
    r"|'''(?:[^']|'(?!''))*'{3,5}"
    r'|"(?:[^"\\\n]|\\.)*"'
    r"|'[^'\n]*'|\#[^\n]*|[\[\]{},\n]|[^\[\]{},\n\"'#]+"
)


def spans(text: str) -> dict[str, tuple[int, int]]:
    """Where the value of each key stands, by its dotted name; tables in arrays count from 0."""
    places: dict[str, tuple[int, int]] = {}
    table, counts, at = "", dict[str, int](), 0
    while at < len(text):
        if head := _HEAD.match(text, at):
            table = head[2]
            if head[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = f"{table}.{counts[table]}"
        elif key := _KEY.match(text, at):
            end = _end(text, key.end(), ())
            _put(places, f"{table}.{_plain(key[1])}".lstrip("."), text, key.end(), end)
            at = end
        at = text.find("\n", at) + 1 or len(text)
    return places


def _plain(key: str) -> str:
    return ".".join(part.strip() for part in key.split(".")).strip("\"'")


def remark(text: str, end: int) -> str:
    """What stands behind a value on its line, or behind the table that it is in."""
    for part in _PART.finditer(text, end):
        if part[0] == "\n":
            break
        if part[0].startswith("#"):
            return part[0].lstrip("# ")
    return ""


def _put(places: dict[str, tuple[int, int]], key: str, text: str, begin: int, end: int) -> None:
    """A value, and those within it where it is an inline table."""
    places[key] = begin, end
    at = begin + 1
    while text[begin] == "{" and (inner := _KEY.match(text, at)) and inner.end() < end:
        stop = _end(text, inner.end(), (",", "}"))
        _put(places, f"{key}.{_plain(inner[1])}", text, inner.end(), stop)
        at = stop + 1


def _end(text: str, begin: int, stops: tuple[str, ...]) -> int:
    """Where a value ends that begins there: without the blanks and the remark behind it."""
    deep, end = 0, begin
    for part in _PART.finditer(text, begin):
        token = part[0]
        if deep == 0 and (token in stops or token == "\n" or token.startswith("#")):
            break
        deep += (token in "[{") - (token in "]}")
        end = part.start() + len(token.rstrip())
    return end


def with_value(text: str, key: str, value: str) -> str:
    """The manifest with another value of a key; a line's is taken out by an empty one, and a unit
    that is not there is put under its table's head.

    Raises
    ------
    ManifestError
        The text has no such key, or would say something else elsewhere.
    """
    where = spans(text).get(key)
    number = re.fullmatch(r"-?\d+(\.\d+)?|true|false", value) and not key.endswith("name")
    written = value if number else json.dumps(value, ensure_ascii=False)
    head = re.search(r"^[ \t]*\[trials\.units\][^\n]*\n", text, re.MULTILINE)
    if where is None and key.startswith(UNITS) and head:
        made = f"{text[: head.end()]}{key.removeprefix(UNITS)} = {written}\n{text[head.end() :]}"
        return _only(key, text, made)
    if where is None:
        raise ManifestError(key, "stands nowhere in the text", "write it there")
    begin, end = where
    first = text.rfind("\n", 0, begin) + 1
    if value or not re.fullmatch(r"[\w-]+\s*=\s*", text[first:begin].lstrip()):
        made = text[:begin] + written + text[end:]
    else:
        last = text.find("\n", end) + 1 or len(text)
        made = text[:first] + text[last:]
    return _only(key, text, made)


def _only(key: str, text: str, made: str) -> str:
    """The text as it was `made`, if it differs in that key alone."""
    before, after = (dict(manifests.leaves(toml.loads(t.encode(), MANIFEST))) for t in (text, made))
    if {k for k in before | after if before.get(k) != after.get(k)} - {key}:
        raise ManifestError(key, "cannot be set from here", "write it in the text")
    return made
