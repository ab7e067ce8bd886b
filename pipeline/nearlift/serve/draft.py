"""A campaign before it is run: its manifest and schedule as text that a form edits as well, what is
refused in them and where, and the records that were dropped.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shutil
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nearlift import units
from nearlift.commands.inspection import Inspection, inspect
from nearlift.errors import InputRefused, NearliftError, UsageError
from nearlift.manifest import campaign as manifests
from nearlift.manifest import toml
from nearlift.manifest.flight_log import STANDARD_G
from nearlift.manifest.rig import DATUMS
from nearlift.readers.columns import BY_NAME
from nearlift.readers.files import inside
from nearlift.readers.schedule import parse_schedule
from nearlift.reduction import plausibility
from nearlift.run import store
from nearlift.serve.bench import MANIFEST, NotThere, ServedWorkspace
from nearlift.serve.manifest_text import UNITS, remark, spans

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
#: Where a fault of the schedule stands.
_PLACE = re.compile(r"trials\.csv(?:, line (\d+))?(?:, column '(.+)')?$")
_NAME = re.compile(r"[^\s./\\\0][^/\\\0]{0,199}")


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftFault:
    """A fault, and where it is: a key of the manifest, or a line and column of the schedule; empty
    and 0 where that is not known.
    """

    key: str
    text: str
    line: int = 0
    column: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftCheck:
    """What the form shows: every value by key with its choices, what is refused and where, how many
    trials there are, the first record, and whether the force can be this vehicle's.
    """

    fields: list[dict[str, object]]
    refusals: list[DraftFault]
    trials: int
    file: str
    reads: str


def check(root: Path, text: str, schedule: str) -> DraftCheck:
    """What these texts say; nothing is written."""
    refusals: list[DraftFault] = []
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
            "value": _typed(value),
            "choices": _choices(key),
            "remark": remark(text, where[key][1]) if key in where else "",
        }
        for key, value in values.items()
        if key != "schema"
    ]
    first = next(records(root, values), None)
    return DraftCheck(
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


def _typed(value: object) -> str:
    """A value as it is typed into a field."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _by_key(refusal: NearliftError, values: dict[str, object]) -> Iterator[DraftFault]:
    """Each fault with the key or the cell at which it is."""
    lines = refusal.what.split("\n  ")
    place = _PLACE.search(refusal.where)
    line, column = (int(place[1] or 0), place[2] or "") if place else (0, "")
    unit = f"{UNITS}{column}"
    where = unit if values.get(unit) == "" else refusal.where if refusal.where in values else ""
    for fault in lines:
        key, _, said = fault.partition(": ")
        known = bool(said) and (key in values or any(k.startswith(f"{key}.") for k in values))
        at_key = key if known else where
        reason = said if known else fault if at_key or line else f"{refusal.where}: {fault}"
        more = f"; {refusal.remedy}" if refusal.remedy and len(lines) == 1 else ""
        at_cell = line and not at_key
        yield DraftFault(
            key=at_key,
            text=reason + more,
            line=line if at_cell else 0,
            column=column if at_cell else "",
        )


def records(root: Path, values: dict[str, object]) -> Iterator[Path]:
    """The files that the manifest's pattern names, the first first."""
    pattern = str(values.get("records.files", ""))
    plain = re.sub(r"\{(trial|record)\}", "*", pattern)
    if plain and ".." not in plain and not plain.startswith("/"):
        for path in sorted(root.glob(plain)):
            if path.is_file() and path.resolve().is_relative_to(root):
                yield path


@functools.lru_cache(maxsize=2)
def _inspected(path: Path, stamp: tuple[int, int]) -> Inspection:
    return inspect(path, record=True)


def inspected(path: Path) -> Inspection:
    """What a record holds; the last ones are remembered."""
    status = path.stat()
    return _inspected(path, (status.st_size, status.st_mtime_ns))


def reads(root: Path, values: dict[str, object]) -> str:
    """What the first record says against the hover weight, by the values as they stand; empty where
    they do not say enough.
    """
    try:
        path = next(records(root, values))
        record = inspected(path)
        force = next(
            c for c in record.contents.channels if c.name == values["records.force.column"]
        )
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
    comparison = (
        f"hover weight {values['vehicle.mass']}: {path.name} reads {lift_N:.4g} N,"
        f" {ratio:.3g} times it"
    )
    if ratio < 0:
        return f"{comparison}. Lift pulls the cell the other way: change the sign"
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
        return f"{comparison}: {refusal.remedy}"
    return comparison


def channels(path: Path) -> list[dict[str, object]]:
    """Each channel of a record, thinned to the lowest and highest of each stretch."""
    drawn: list[dict[str, object]] = []
    for c in inspected(path).contents.channels:
        n = len(c.values)
        if not n or not np.isfinite(c.values).any():
            continue
        size = max(1, 2 * n // DRAWN)
        points: list[list[float]] = []
        for begin in range(0, n, size):
            stretch = c.values[begin : begin + size]
            stretch = stretch[np.isfinite(stretch)]
            if len(stretch):
                points += [[begin, float(stretch.min())], [begin, float(stretch.max())]]
        drawn.append({"name": c.name, "unit": c.unit, "rate": c.rate_Hz, "points": points})
    return drawn


def folder_of(workspace: ServedWorkspace, name: str) -> Path:
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
    root = workspace.inside(f"raw/{name}")
    if (root / MANIFEST).exists():
        raise UsageError(name, "is a campaign already", "choose another name")
    return root


async def receive(
    workspace: ServedWorkspace, name: str, file: str, content: AsyncIterator[bytes]
) -> Path:
    """A dropped record, in its place once all of it is there; nothing is ever overwritten.

    Raises
    ------
    NearliftError
        No such name, a file of that name is there, or it is too large for a file or for the disk.
    """
    if not _NAME.fullmatch(file):
        raise UsageError(f"file {file[:80]!r}", "cannot be called so", "a plain name, no folder")
    folder = folder_of(workspace, name) / "trials"
    folder.mkdir(parents=True, exist_ok=True)
    place = workspace.inside(folder.relative_to(workspace.root).as_posix()) / file
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
