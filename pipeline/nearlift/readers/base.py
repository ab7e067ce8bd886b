"""Base of all readers: a file as channels, a record as lift in N, and `Reader`, one outside format.

A new format is one file with one `Reader` in it: a function from a file to its channels. The reader
plans which trials are in which files, without reading samples, then reads one `Piece` of the plan
at a time, in any process. Whatever a file holds, its trial has a record.

One file holds one trial (``files = "trials/{trial}.tdms"``), or all trials, in channels that carry
the trial's id (``files = "all.h5"``, ``column = "/{trial}/force"``).
"""

from __future__ import annotations

import difflib
import functools
import importlib
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nearlift import units
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused, ManifestError, NearliftError, did_you_mean
from nearlift.readers import files, guarded
from nearlift.readers.clock import joined, same_clock, two_columns
from nearlift.readers.files import MARK, Piece
from nearlift.readers.guarded import Malformed
from nearlift.reduction.start import wrap_of
from nearlift.reduction.stretch import usual_step

if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign

#: ``[records] dialect`` of a manifest: keys and types are those of the reader's options.
RecordsDialect = Mapping[str, object]
#: Characters of a fault that are kept.
LONGEST_FAULT = 300
_NOT_IN_NAMES = re.compile(r"[/\\\0]")
#: Fewest and most files of one task, and tasks in between.
FEWEST_FILES, MOST_FILES, TASKS = 8, 32, 64
#: Names of the channels wanted; None for all.
Names = tuple[str, ...] | None
#: Units by their own names, in letters of any size.
_UNITS = (
    *("N", "mN", "kN", "gf", "kgf", "lbf", "ozf", "g", "kg", "lb", "oz", "count", "percent"),
    *("s", "ms", "us", "ns", "Hz", "kHz", "rpm", "m", "mm", "cm", "m/s", "m/s^2", "deg", "rad"),
    *("V", "mV", "A", "mA", "W", "degC", "K", "Pa", "hPa", "kPa", "N m"),
)
#: Other spellings of instruments, folded.
_SPELLINGS = {
    "N": ("newton", "newtons", "н", "牛", "牛顿"),
    "g": ("gram", "grams", "г", "克"),
    "kg": ("kgs", "кг", "千克"),
    "kgf": ("кгс",),
    "lb": ("lbs", "pounds"),
    "oz": ("ounces",),
    "count": ("counts",),
    "s": ("sec", "second", "seconds", "с", "秒"),
    "ms": ("мс", "毫秒"),
    "us": ("μs", "microseconds"),
    "V": ("volt", "volts"),
    "A": ("amps",),
    "percent": ("%",),
    "degC": ("°c", "c"),
    "rpm": ("u/min", "1/min", "rev/min", "r/min", "tr/min"),
    "m/s^2": ("m/s2",),
    "N m": ("nm", "n·m"),
    "": ("-", "1"),
}
UNITS = {unit.casefold(): unit for unit in _UNITS} | {
    word: unit for unit, words in _SPELLINGS.items() for word in words
}
#: Units of mass as those of the force that a load cell means.
AS_FORCE = {"g": "gf", "kg": "kgf", "lb": "lbf", "oz": "ozf"}
FORCE_UNITS = ("N", "mN", "kN", "gf", "kgf", "lbf", "ozf")
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "day": 86400.0}
_PRODUCT = str.maketrans(dict.fromkeys("⋅∙*•", "·"))
_BRACKETS = str.maketrans("（）［］", "()[]")


# ---- channels


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One series: its name, the unit that the file states (empty: none), samples, stated rate."""

    name: str
    unit: str = ""
    values: FloatArray
    rate_Hz: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """The channels of a file, the name of its format, quality codes, and remarks for the user."""

    channels: tuple[Channel, ...] = ()
    kind: str = ""
    codes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@functools.lru_cache(maxsize=1024)
def fold(text: str) -> str:
    """The form in which names are compared: compatible letters folded (both micro signs, all
    product signs), lower case, single blanks.
    """
    plain = unicodedata.normalize("NFKC", text).translate(_PRODUCT).casefold()
    return " ".join(plain.split())


@functools.lru_cache(maxsize=1024)
def split_unit(name: str) -> tuple[str, str]:
    """Name and unit of ``Thrust (gf)`` or ``weight[g]``; the unit is empty where there is none."""
    plain = name.rstrip().translate(_BRACKETS)
    start = max(plain.rfind("("), plain.rfind("["))
    bare, unit = plain[:start].rstrip(), plain[start + 1 : -1]
    if start < 0 or not bare or not plain.endswith((")", "]")) or ")" in unit or "]" in unit:
        return name, ""
    return bare, unit_word(unit) or unit.strip()


def unit_word(cell: str) -> str | None:
    """The unit in a cell, brackets aside, as nearlift writes it; None where it is no unit, empty
    where the cell is blank.
    """
    plain = fold(cell.strip().strip("()[]"))
    return UNITS.get(plain) if plain else ""


def parted(cell: str) -> tuple[str, str]:
    """Number and unit of a cell such as ``0.123 N``; the cell and no unit of any other."""
    if cell[-1:].isdecimal():
        # most cells are bare numbers
        return cell, ""
    tail = re.split(r"^nan|\d", cell, flags=re.IGNORECASE)[-1]
    unit = unit_word(tail.strip(" .,")) if tail != cell else ""
    return (cell[: len(cell) - len(tail)], unit) if unit else (cell, "")


def pick(channels: Sequence[Channel], column: str, key: str, where: str) -> Channel:
    """The channel of that name: as written, else folded, else folded without its unit or its group.

    `InputRefused` where there is none, or the name fits several.
    """
    names = tuple(c.name for c in channels)
    places = fitting(names, column)
    if len(places) == 1:
        return channels[places[0]]
    if places:
        several = ", ".join(repr(names[i]) for i in places)
        what = f"has more than one column {column!r}: {several}"
        raise InputRefused(where, what, f"{key} names one of them")
    close = difflib.get_close_matches(column, names, n=1, cutoff=0.5)
    more = f" and {len(names) - 12} more" if len(names) > 12 else ""
    listed = ", ".join(repr(n) for n in names[:12]) + more
    remedy = f'{key} = "{close[0]}"?' if close else f"it has {listed or 'none'}; {key} names it"
    raise InputRefused(where, f"has no column {column!r}", remedy)


# the records of a campaign have the same names
@functools.lru_cache(maxsize=256)
def fitting(names: tuple[str, ...], column: str) -> tuple[int, ...]:
    """Indices of the names that `pick` may mean by a column, by the first kind of match of any."""
    folded = fold(column)
    for same in (
        lambda name: name == column,
        lambda name: fold(name) == folded,
        lambda name: fold(split_unit(name)[0]) == folded,
        lambda name: fold(name).endswith((f".{folded}", f"/{folded}")),
    ):
        if places := tuple(i for i, name in enumerate(names) if same(name)):
            return places
    return ()


def wanted(name: str, names: Names) -> bool:
    """Whether a reader must read this channel, since `pick` may choose it for one of these names.

    It may also be the other part of a clock in two columns. Without names every channel is read.
    """
    if names is None:
        return True
    return any(fitting((name,), column) or same_clock(name, column) for column in names)


def one_clock(contents: Contents) -> Contents:
    """The channels, clocks of whole seconds and their fractions in two of them joined in the
    first.
    """
    channels, notes = {c.name: c for c in contents.channels}, contents.notes
    for whole, rest, unit_s in two_columns(tuple(channels)):
        seconds = joined(channels[whole].values, channels[rest].values, unit_s)
        if seconds is not None:
            channels[whole] = replace(channels[whole], unit="s", values=seconds)
            del channels[rest]
            pair = f"{whole!r} and {rest!r}"
            notes = (*notes, f"columns {pair} are one clock: read as seconds from its first")
    joins = len(notes) > len(contents.notes)
    return replace(contents, channels=tuple(channels.values()), notes=notes) if joins else contents


def rate_of(clock: FloatArray) -> float | None:
    """The steady rate of a clock in s, Hz: the inverse of its usual step; None if it has none."""
    usual = usual_step(np.diff(clock[np.isfinite(clock)]))
    return 1 / usual if usual > 0 else None


def library(name: str, extra: str) -> Any:
    """The module of that name, which an extra installs; `InputRefused` where it is not there."""
    try:
        return importlib.import_module(name)
    except ImportError:
        remedy = f'pip install "nearlift[{extra}]"'
        raise InputRefused(f"reader {extra!r}", f"needs the package {name}", remedy) from None


# ---- records


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The load-cell series of one trial.

    `force_N` (n,) is lift in N, up positive: sign and calibration applied, tare *not* removed, NaN
    where the file holds no number. `time_s` (n,) is the clock, where the manifest names one.
    `source` is the file, relative to the campaign's folder. `codes` are quality codes that the
    reader gives (names in `reduction.quality.CODES`). `notes` leave out the file's name, so that
    equal ones of many records are printed once. `fault` is the reason of a MALFORMED record.
    `refusal` is given if the file cannot be read in the way that the manifest asks for. `contents`
    are all channels of the file, if they were asked for.
    """

    trial: str
    force_N: FloatArray = field(default_factory=lambda: np.empty(0))
    source: str
    time_s: FloatArray | None = None
    codes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    fault: str = ""
    refusal: InputRefused | None = None
    contents: Contents | None = None


def malformed(trial: str, root: Path, source: str, fault: Exception) -> Record:
    """The record of a trial over whose file `fault` was raised.

    `fault` itself, where it is the manifest's or the machine's (libraries call damage an OSError
    without a number).
    """
    refusal = fault if isinstance(fault, InputRefused) else None
    of_the_machine = isinstance(fault, OSError) and fault.errno is not None
    if of_the_machine or (isinstance(fault, (MemoryError, NearliftError)) and refusal is None):
        raise fault
    kind = "" if isinstance(fault, Malformed) else f"{type(fault).__name__}: "
    what = f"{refusal.where}: {refusal.what}" if refusal else f"{source}: {kind}{fault}"
    text = " ".join(what.replace(f"{root}/", "").split())[:LONGEST_FAULT]
    return Record(
        trial=trial,
        source=source,
        codes=("MALFORMED",),
        fault="".join(c if c.isprintable() else "?" for c in text),
        refusal=refusal,
    )


def names_of(campaign: Campaign, trial: str) -> tuple[str, ...]:
    """Columns of force and clock (if any) of one trial, whose id may be part of them."""
    channels = campaign.records.force, campaign.records.time
    return tuple(c.column.replace(MARK, trial) for c in channels if c is not None)


def record_of(
    campaign: Campaign, contents: Contents, trial: str, where: str, source: str
) -> Record:
    """The record of one trial from the channels of its file; `InputRefused` where one is not there,
    or contradicts the manifest's unit or rate.
    """
    codes, notes = contents.codes, contents.notes
    if not contents.channels and {"EMPTY", "NO_DATA"} & set(codes):
        return Record(trial=trial, source=source, codes=codes, notes=notes)
    force, clock, stated = campaign.records.force, campaign.records.time, campaign.load_cell
    # by the manifest's own check
    assert force is not None
    column, *clocks = names_of(campaign, trial)
    channel = _channel(contents, "force", column, force.unit, where)
    rate = None if campaign.records.dialect.get("ignore_rate") else channel.rate_Hz
    if rate and stated.sample_rate and abs(rate / stated.sample_rate - 1) > 0.01:
        raise InputRefused(
            where,
            f"states that {channel.name!r} has {rate:.6g} Hz, the manifest says"
            f" {stated.sample_rate:g} Hz",
            "correct [load_cell] sample_rate; where the file is known to be wrong: dialect = {"
            " ignore_rate = true } under [records]",
        )
    if force.unit == "count" and (jump := wrap_of(channel.values, certain=True)):
        what = f"{channel.name!r} jumps by {jump:.6g} counts from one sample to the next:"
        remedy = "add its codes to the counts past the jump, or take the trial out of the schedule"
        raise InputRefused(where, f"{what} the converter's counter wraps", remedy)
    factor, zero = force.linear()
    # damaged numbers may be anything
    with np.errstate(over="ignore", invalid="ignore"):
        lift = factor * (channel.values - zero if zero else channel.values)
    time_s = None
    if clock is not None:
        times = _channel(contents, "time", clocks[0], clock.unit, where)
        if len(times.values) != len(lift):
            what = f"has {len(lift)} samples of {channel.name!r} and {len(times.values)} of"
            remedy = "under [records] time, name the clock of the force, or none"
            raise InputRefused(where, f"{what} {times.name!r}", remedy)
        tick = units.to_si(clock.unit, "time", "records.time.unit")[0]
        # a clock in seconds is not copied
        time_s = times.values if tick == 1.0 else tick * times.values
    codes = codes if len(lift) else (*codes, "NO_DATA")
    return Record(trial=trial, force_N=lift, time_s=time_s, source=source, codes=codes, notes=notes)


def _channel(contents: Contents, quantity: str, column: str, unit: str, where: str) -> Channel:
    """The channel of force or time; refuses a manifest that contradicts the unit in the file."""
    key = f"records.{quantity}"
    channel = pick(contents.channels, column, f"{key}.column", where)
    if not channel.unit or unit == "count":
        return channel
    written = AS_FORCE.get(channel.unit, channel.unit) if quantity == "force" else channel.unit
    says = f"states {channel.name!r} in {channel.unit}, the manifest says {unit}"
    try:
        stated, given = (units.to_si(u, quantity, f"{key}.unit")[0] for u in (written, unit))
    except ManifestError:
        if channel.unit not in UNITS.values():
            return channel
        remedy = f"name another column, or correct {key}.unit"
        raise InputRefused(where, says, remedy) from None
    if abs(stated - given) > 1e-6 * abs(given):
        factor = f"{says}: a factor of {stated / given:.4g}"
        raise InputRefused(where, factor, f'{key}.unit = "{written}"?')
    return channel


# ---- readers


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """One outside format: its name in ``[records] reader``, and a title for the catalogue.

    ``contents(path, dialect, names)`` is a function of a module. It returns the channels of one
    file, at least those that `names` may mean. It is None for `means`, a format without samples.
    ``recognises(head, name)`` tests whether a file with these first bytes and this name is
    certainly of this format. `options` are the keys of ``[records] dialect`` and their types. If
    `guarded`, a library parses the file, in a process of its own (`readers.guarded`).
    """

    name: str
    title: str
    contents: Callable[[Path, RecordsDialect, Names], Contents] | None = None
    recognises: Callable[[bytes, str], bool] = lambda head, name: False
    options: Mapping[str, type] = field(default_factory=dict)
    guarded: bool = False

    def checked_dialect(self, dialect: RecordsDialect) -> RecordsDialect:
        """The manifest's dialect; `ManifestError` of a key that is unknown or of another type."""
        allowed = {**self.options, "ignore_rate": bool}
        for key, value in dialect.items():
            at, kind = f"records.dialect.{key}", allowed.get(key)
            if kind is None:
                listed = f"known to {self.name}: {', '.join(allowed)}"
                raise ManifestError(at, "unknown key", did_you_mean(key, allowed) or listed)
            if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
                raise ManifestError(at, f"{value!r} is no {kind.__name__}", "see docs/formats.md")
        return dialect

    def open(self, path: Path, dialect: RecordsDialect, names: Names = None) -> Contents:
        """The channels of one file, read in the guarded process where a library parses it, or
        where it is compressed.
        """
        if self.contents is None:
            raise InputRefused(str(path), f"is no record: {self.name!r} has none", "")
        if self.guarded or files.packing(path):
            return one_clock(guarded.run(self.contents, path, dict(dialect), names))
        return one_clock(self.contents(path, dialect, names))

    def places(self, campaign: Campaign, root: Path, trials: Sequence[str]) -> dict[str, Path]:
        """The file of each trial that has one, a regular file under `root`.

        `ManifestError` where a trial's id is in both files and column, in neither, or no part of a
        file's name can be it.
        """
        if self.contents is None:
            return {}
        pattern, force = campaign.records.pattern, campaign.records.force
        in_files = MARK in pattern
        in_column = not campaign.cuts_records and force is not None and MARK in force.column
        if in_files == in_column:
            both = "and the column both say" if in_files else "does not say"
            raise ManifestError(
                "records.files",
                f"{pattern!r} {both} where the trial's id is",
                'write {trial} in it, as in "trials/{trial}.csv", or, where one file holds all'
                " trials, in force.column",
            )
        if in_column:
            path, is_there = files.inside(root, pattern, "records.files")
            return dict.fromkeys(trials, path) if is_there else {}
        there: dict[str, Path] = {}
        for trial in trials:
            if _NOT_IN_NAMES.search(trial) or trial in (".", ".."):
                remedy = "use letters, digits, '-', '_' and '.'"
                what = "has an id that cannot be part of a file name"
                raise ManifestError(f"trial {trial!r}", what, remedy)
            path, is_there = files.inside(root, pattern.replace(MARK, trial), "records.files")
            if is_there:
                there[trial] = path
        return there

    def plan(
        self, campaign: Campaign, root: Path, trials: Sequence[str]
    ) -> tuple[list[Piece], list[str]]:
        """The pieces to read, and notes on the files; reads no samples. Trials in no piece have no
        record.
        """
        self.checked_dialect(campaign.records.dialect)
        there, pattern = self.places(campaign, root, trials), campaign.records.pattern
        names, paths = tuple(there), tuple(there.values())
        files_each = min(max(len(names) // TASKS, FEWEST_FILES), MOST_FILES)
        stretches = [slice(i, i + files_each) for i in range(0, len(names), files_each)]
        pieces = [Piece(trials=names[part], paths=paths[part]) for part in stretches]
        marked = MARK in pattern
        notes = files.unlisted(root, pattern, trials, campaign.trials.file) if marked else []
        return pieces, notes

    def read_piece(
        self, campaign: Campaign, root: Path, piece: Piece, *, whole: bool = False
    ) -> Iterator[Record]:
        """The piece's records in the plan's order, one in memory at a time; `whole`: with all
        channels of their files.
        """
        for trial, path in zip(piece.trials, piece.paths, strict=True):
            source, contents = files.source_of(root, path), Contents(codes=("EMPTY",))
            try:
                if path.stat().st_size:
                    names = None if whole else names_of(campaign, trial)
                    contents = self.open(path, campaign.records.dialect, names)
                record = record_of(campaign, contents, trial, str(path), source)
            except Exception as fault:
                record = malformed(trial, root, source, fault)
            else:
                record = replace(record, contents=contents) if whole else record
            yield record
