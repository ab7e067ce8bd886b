"""A campaign before it is run: its manifest and schedule as text that a form edits as well, what is
refused in them and at which key, and the records that were dropped.

The text is the manifest; a form's field replaces one value in it, and leaves every comment.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import re
import shutil
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.commands.inspect import Found, inspect
from nearlift.errors import InputRefused, ManifestError, NearliftError, UsageError
from nearlift.manifest import campaign as manifests
from nearlift.manifest import toml
from nearlift.manifest.flight_log import STANDARD_G
from nearlift.manifest.rig import DATUMS
from nearlift.readers.columns import BY_NAME
from nearlift.readers.files import inside
from nearlift.readers.schedule import parse_schedule
from nearlift.reduction import plausibility
from nearlift.run import store
from nearlift.serve.bench import MANIFEST, Bench, NotThere

SCHEDULE = "trials.csv"
#: Bytes of one dropped file, and what the disk keeps free.
MOST_BYTES, SPARE_BYTES = 2 << 30, 1 << 29
#: Points of a channel's picture.
DRAWN = 600
#: Choices of a key.
CHOICES = {
    "rig.held": ("throttle", "voltage", "rpm", "power"),
    "rig.distance_datum": DATUMS,
    "records.force.unit": ("mN", "N", "kN", "gf", "kgf", "ozf", "lbf", "count"),
    "records.force.sign": ("1", "-1"),
}
UNITS = "trials.units."
_NAME = re.compile(r"[^\s./\\\0][^/\\\0]{0,199}")
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
    found: dict[str, tuple[int, int]] = {}
    table, counts, at = "", dict[str, int](), 0
    while at < len(text):
        if head := _HEAD.match(text, at):
            table = head[2]
            if head[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = f"{table}.{counts[table]}"
        elif key := _KEY.match(text, at):
            end = _end(text, key.end(), ())
            _put(found, f"{table}.{_plain(key[1])}".lstrip("."), text, key.end(), end)
            at = end
        at = text.find("\n", at) + 1 or len(text)
    return found


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


def _put(found: dict[str, tuple[int, int]], key: str, text: str, begin: int, end: int) -> None:
    """A value, and those within it where it is an inline table."""
    found[key] = begin, end
    at = begin + 1
    while text[begin] == "{" and (inner := _KEY.match(text, at)) and inner.end() < end:
        stop = _end(text, inner.end(), (",", "}"))
        _put(found, f"{key}.{_plain(inner[1])}", text, inner.end(), stop)
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
    told = value if number else json.dumps(value, ensure_ascii=False)
    head = re.search(r"^[ \t]*\[trials\.units\][^\n]*\n", text, re.MULTILINE)
    if where is None and key.startswith(UNITS) and head:
        made = f"{text[: head.end()]}{key.removeprefix(UNITS)} = {told}\n{text[head.end() :]}"
        return _only(key, text, made)
    if where is None:
        raise ManifestError(key, "stands nowhere in the text", "write it there")
    begin, end = where
    first = text.rfind("\n", 0, begin) + 1
    if value or not re.fullmatch(r"[\w-]+\s*=\s*", text[first:begin].lstrip()):
        made = text[:begin] + told + text[end:]
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """What the form shows: every value by key with its choices, what is refused and at which key,
    how many trials there are, the first record, and whether the force can be this vehicle's.
    """

    fields: list[dict[str, object]]
    refusals: list[dict[str, str]]
    trials: int
    file: str
    reads: str


def check(root: Path, text: str, schedule: str) -> Checked:
    """What these texts say; nothing is written."""
    refusals: list[dict[str, str]] = []
    values: dict[str, object] = {}
    trials = 0
    try:
        raw = toml.loads(text.encode(), MANIFEST)
        values = dict(manifests.leaves(raw))
        values |= dict.fromkeys(_without_unit(values, schedule), "")
        campaign = manifests.parse(raw, MANIFEST)
        trials = len(parse_schedule(campaign, root / SCHEDULE, schedule))
    except NearliftError as refusal:
        refusals = list(_by_key(refusal, values))
    where = spans(text)
    fields: list[dict[str, object]] = [
        {
            "key": key,
            "value": _told(value),
            "choices": _choices(key),
            "remark": remark(text, where[key][1]) if key in where else "",
        }
        for key, value in values.items()
        if key != "schema"
    ]
    first = next(records(root, values), None)
    return Checked(
        fields=fields,
        refusals=refusals,
        trials=trials,
        file=first.relative_to(root).as_posix() if first else "",
        reads=reads(root, values),
    )


def _choices(key: str) -> tuple[str, ...]:
    """What a key may say, where that is a list; of a column's unit the usual ones."""
    column = BY_NAME.get(key.removeprefix(UNITS)) if key.startswith(UNITS) else None
    if column is None or column.kind != "quantity":
        return CHOICES.get(key, ())
    common = tuple(unit for unit, dimension in units.COMMON if dimension == column.dimension)
    return units.USUAL.get(column.dimension, common)


def _without_unit(values: dict[str, object], schedule: str) -> Iterator[str]:
    """Keys of the units that columns of the schedule still want."""
    header = schedule.split("\n", 1)[0].strip("\ufeff\r ").split(",")
    for name in header:
        column = BY_NAME.get(name.strip())
        key = f"{UNITS}{name.strip()}"
        wants = column is not None and column.kind == "quantity" and not column.own_unit
        if wants and key not in values:
            yield key


def _told(value: object) -> str:
    """A value as it is typed into a field."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _by_key(refusal: NearliftError, values: dict[str, object]) -> Iterator[dict[str, str]]:
    """Each fault with the key at which it is, empty where there is none."""
    lines = refusal.what.split("\n  ")
    column = re.search(r", column '(\w+)'$", refusal.where)
    unit = f"{UNITS}{column[1]}" if column else ""
    where = unit if values.get(unit) == "" else refusal.where if refusal.where in values else ""
    for line in lines:
        key, _, said = line.partition(": ")
        known = bool(said) and (key in values or any(k.startswith(f"{key}.") for k in values))
        told = said if known else line if where else f"{refusal.where}: {line}"
        more = f"; {refusal.remedy}" if refusal.remedy and len(lines) == 1 else ""
        yield {"key": key if known else where, "text": told + more}


def records(root: Path, values: dict[str, object]) -> Iterator[Path]:
    """The files that the manifest's pattern names, the first first."""
    pattern = str(values.get("records.files", ""))
    plain = re.sub(r"\{(trial|record)\}", "*", pattern)
    if plain and ".." not in plain and not plain.startswith("/"):
        for path in sorted(root.glob(plain)):
            if path.is_file() and path.resolve().is_relative_to(root):
                yield path


@functools.lru_cache(maxsize=2)
def _inspected(path: Path, stamp: tuple[int, int]) -> Found:
    return inspect(path, record=True)


def inspected(path: Path) -> Found:
    """What a record holds; the last ones are remembered."""
    status = path.stat()
    return _inspected(path, (status.st_size, status.st_mtime_ns))


def reads(root: Path, values: dict[str, object]) -> str:
    """What the first record says against the hover weight, by the values as they stand; empty where
    they do not say enough.
    """
    try:
        path = next(records(root, values))
        found = inspected(path)
        force = next(c for c in found.contents.channels if c.name == values["records.force.column"])
        scale, _ = units.to_si(str(values["records.force.unit"]), "force", "records.force.unit")
        rate = float(str(values["load_cell.sample_rate"]).split()[0])
        head = str(values["load_cell.tare"]).split()[0]
        tare = round(float(head) * rate) if head != "none" else 0
        lift = force.values * scale * float(str(values["records.force.sign"]))
        zero = float(np.nanmean(lift[:tare])) if tare else 0.0
        lift_N = float(np.nanmedian(lift[tare:])) - zero
        kg = units.quantity(values["vehicle.mass"], "mass", "vehicle.mass")
    except (StopIteration, KeyError, ValueError, IndexError, NearliftError):
        return ""
    weight = STANDARD_G * kg
    ratio = lift_N / weight
    told = (
        f"hover weight {values['vehicle.mass']}: {path.name} reads {lift_N:.4g} N,"
        f" {ratio:.3g} times it"
    )
    if ratio < 0:
        return f"{told}. Lift pulls the cell the other way: change the sign"
    try:
        table = {
            "boundary": np.array(["none"], dtype=object),
            "throttle": np.array([0.5]),
            "z_hat": np.array([np.inf]),
            "lift_N": np.array([lift_N]),
            "quality": np.array([""], dtype=object),
        }
        plausibility.against_weight(
            table, weight, str(values["records.force.unit"]), "records.force.unit"
        )
    except NearliftError as refusal:
        return f"{told}: {refusal.remedy}"
    return told


def channels(path: Path) -> list[dict[str, object]]:
    """Each channel of a record, thinned to the lowest and highest of each stretch."""
    found: list[dict[str, object]] = []
    for c in inspected(path).contents.channels:
        n = len(c.values)
        if not n or not np.isfinite(c.values).any():
            continue
        size = max(1, 2 * n // DRAWN)
        points: list[list[float]] = []
        for begin in range(0, n, size):
            own = c.values[begin : begin + size]
            own = own[np.isfinite(own)]
            if len(own):
                points += [[begin, float(own.min())], [begin, float(own.max())]]
        found.append({"name": c.name, "unit": c.unit, "rate": c.rate_Hz, "points": points})
    return found


def folder_of(bench: Bench, name: str) -> Path:
    """The folder of a campaign of that name that is still to be made, under ``raw/``.

    Raises
    ------
    UsageError
        It is no slug, or is a campaign already.
    """
    if not re.fullmatch(r"[a-z0-9][a-z0-9._-]{0,60}", name):
        raise UsageError(
            f"name {name!r}", "is not a slug", "lower-case letters, digits, '-', '_' and '.'"
        )
    root = bench.inside(f"raw/{name}")
    if (root / MANIFEST).exists():
        raise UsageError(name, "is a campaign already", "choose another name")
    return root


async def receive(bench: Bench, name: str, file: str, content: AsyncIterator[bytes]) -> Path:
    """A dropped record, in its place once all of it is there; nothing is ever overwritten.

    Raises
    ------
    NearliftError
        No such name, a file of that name is there, or it is too large for a file or for the disk.
    """
    if not _NAME.fullmatch(file):
        raise UsageError(f"file {file[:80]!r}", "cannot be called so", "a plain name, no folder")
    folder = folder_of(bench, name) / "trials"
    folder.mkdir(parents=True, exist_ok=True)
    place = bench.inside(folder.relative_to(bench.root).as_posix()) / file
    if os.path.lexists(place):
        raise UsageError(file, "is there already", "nothing is ever overwritten")
    temporary = place.with_name(f".{file}.{os.getpid()}.tmp")
    most = min(MOST_BYTES, shutil.disk_usage(folder).free - SPARE_BYTES)
    taken = 0
    try:
        with temporary.open("xb") as sink:
            async for part in content:
                taken += len(part)
                if taken > most:
                    raise InputRefused(
                        file, f"has more than {most} bytes", "copy it into the folder yourself"
                    )
                sink.write(part)
            sink.flush()
            os.fsync(sink.fileno())
        # a link fails where a rename would overwrite
        os.link(temporary, place)
    except FileExistsError:
        raise UsageError(file, "is there already", "nothing is ever overwritten") from None
    finally:
        temporary.unlink(missing_ok=True)
    store.sync_folder(folder)
    return place


def digest(path: Path) -> str:
    """Of a file as it stands; empty where there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def save(root: Path, wanted: dict[str, str], known: dict[str, str]) -> None:
    """Manifest and schedule, each replaced in one step, if they are still what was `known`.

    Raises
    ------
    UsageError
        One was changed meanwhile.
    NotThere
        It is another file than these two, or leads elsewhere.
    """
    for name in wanted:
        if name not in (MANIFEST, SCHEDULE) or (root / name).is_symlink():
            raise NotThere(name, "is not written from here", "edit it yourself")
        inside(root, name, name)
        if digest(root / name) != known.get(name, ""):
            raise UsageError(name, "was changed by somebody else meanwhile", "reload the page")
    for name in (SCHEDULE, MANIFEST):
        if name in wanted and hashlib.sha256(wanted[name].encode()).hexdigest() != known[name]:
            store.write_bytes(root / name, wanted[name].encode())
