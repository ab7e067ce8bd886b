"""A reader from a format: what turns one file into channels becomes what turns a campaign's files
into records.

Two layouts: a file for each trial (``files = "trials/{trial}.tdms"``), or one file for all, whose
channels carry the trial's id (``files = "all.h5"``, ``column = "/{trial}/force"``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift import units
from nearlift.errors import InputRefused, ManifestError, did_you_mean
from nearlift.readers import guarded
from nearlift.readers.channel import (
    AS_FORCE,
    UNITS,
    Channel,
    Contents,
    Malformed,
    Names,
    RecordsDialect,
    pick,
)
from nearlift.readers.files import files_per_trial, inside, pieces, plan_per_trial, source_of
from nearlift.readers.seam import MARK, ChannelSpec, Piece, Reader, ReadingPlan, Record

if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign

RATE_OPTION = {"ignore_rate": bool}
#: What reads a file: its path, the dialect, and the channels wanted, to the channels.
Reading = Callable[[Path, RecordsDialect, Names], Contents]


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One outside format.

    Attributes
    ----------
    name, title : str
        As the reader's.
    recognises : callable
        ``recognises(head, name)``: whether a file with these first bytes and this name is certainly
        of this format.
    contents : callable
        ``contents(path, dialect, names)``: the channels of one file, at least those that `names`
        may mean.
    options : mapping of str to type
        What ``[records] dialect`` may hold.
    child : bool
        Whether a library parses the file, which it then does in a process of its own
        (`readers.guarded`): `contents` has to be a function of a module.
    """

    name: str
    title: str
    recognises: Callable[[bytes, str], bool]
    contents: Reading
    options: Mapping[str, type] = field(default_factory=dict)
    child: bool = False

    def checked_dialect(self, dialect: RecordsDialect) -> RecordsDialect:
        """The manifest's dialect; `ManifestError` of a key that is unknown or of another type."""
        allowed = {**self.options, **RATE_OPTION}
        for key, value in dialect.items():
            if key not in allowed:
                listed = f"known to {self.name}: {', '.join(allowed)}"
                known = did_you_mean(key, allowed) or listed
                raise ManifestError(f"records.dialect.{key}", "unknown key", known)
            if not isinstance(value, allowed[key]) or (
                allowed[key] is int and isinstance(value, bool)
            ):
                raise ManifestError(
                    f"records.dialect.{key}",
                    f"{value!r} is no {allowed[key].__name__}",
                    "see docs/formats.md",
                )
        return dialect


def reader_of(form: Format) -> Reader:
    """The reader of a format."""

    def files(campaign: Campaign, root: Path, trials: Sequence[str]) -> list[Path]:
        if _one_for_all(campaign):
            path = inside(root, campaign.records.pattern, "records.files")
            return [path] if path.is_file() else []
        return files_per_trial(campaign, root, trials)

    def plan(campaign: Campaign, root: Path, trials: Sequence[str]) -> ReadingPlan:
        form.checked_dialect(campaign.records.dialect)
        if not _one_for_all(campaign):
            return plan_per_trial(campaign, root, trials)
        path = inside(root, campaign.records.pattern, "records.files")
        there = dict.fromkeys(trials, (path, 0)) if path.is_file() else {}
        return ReadingPlan(pieces=tuple(pieces(there)))

    def read_piece(campaign: Campaign, root: Path, piece: Piece) -> Iterator[Record]:
        spec = ChannelSpec.from_manifest(campaign)
        for trial, path in zip(piece.trials, piece.paths, strict=True):
            yield record(form, spec, trial, path, source_of(root, path))

    return Reader(
        name=form.name,
        title=form.title,
        files=files,
        plan=plan,
        read_piece=read_piece,
        format=form,
    )


def _one_for_all(campaign: Campaign) -> bool:
    """Whether one file holds every trial; refuses what says twice or never where its id stands."""
    in_files = MARK in campaign.records.pattern
    in_column = MARK in ChannelSpec.from_manifest(campaign).column
    if in_files == in_column:
        raise ManifestError(
            "records.files",
            f"{campaign.records.pattern!r}"
            f" {'and the column both say' if in_files else 'does not say'} where the trial's id"
            " stands",
            'write {trial} in it, as in "trials/{trial}.csv", or, where one file holds all trials,'
            " in force.column",
        )
    return in_column


def record(form: Format, spec: ChannelSpec, trial: str, path: Path, source: str) -> Record:
    """The record of one trial from its file."""
    if path.stat().st_size == 0:
        return Record(trial=trial, source=source, codes=("EMPTY",))
    column, tick = spec.of_trial(trial)
    try:
        names = (column,) if tick is None else (column, tick)
        contents = guarded.contents(form, path, spec.dialect, names)
    except Malformed as fault:
        return Record(trial=trial, source=source, codes=("MALFORMED",), fault=f"{source}: {fault}")
    return record_of(contents, spec, trial, str(path), source)


def record_of(contents: Contents, spec: ChannelSpec, trial: str, where: str, source: str) -> Record:
    """The record of one trial from the channels of its file; `InputRefused` where one is not there,
    or contradicts the manifest's unit or rate.
    """
    if not contents.channels and {"EMPTY", "NO_DATA"} & set(contents.codes):
        return Record(trial=trial, source=source, codes=contents.codes, notes=contents.notes)
    column, tick = spec.of_trial(trial)
    channel = pick(contents.channels, column, "records.force.column", where)
    _same_unit(channel, spec.unit, "force", "records.force.unit", where)
    rate, said = channel.rate_Hz, spec.rate_Hz
    if rate is not None and said is not None and abs(rate / said - 1) > 0.01:
        raise InputRefused(
            where,
            f"says that {channel.name!r} has {rate:.6g} Hz, the manifest says {said:g} Hz",
            "mend [load_cell] sample_rate; where the file is known to be wrong: dialect = {"
            " ignore_rate = true } under [records]",
        )
    time_s = None
    if tick is not None:
        clock = pick(contents.channels, tick, "records.time.column", where)
        _same_unit(clock, spec.clock_unit, "time", "records.time.unit", where)
        if len(clock.values) != len(channel.values):
            raise InputRefused(
                where,
                f"has {len(channel.values)} samples of {channel.name!r} and {len(clock.values)} of"
                f" {clock.name!r}",
                "under [records] time, name the clock of the force, or none",
            )
        # a clock in seconds is not copied
        time_s = clock.values if spec.tick == 1.0 else spec.tick * clock.values
    codes = contents.codes if len(channel.values) else (*contents.codes, "NO_DATA")
    return Record(
        trial=trial,
        force_N=spec.lift_N(channel.values),
        time_s=time_s,
        source=source,
        codes=codes,
        notes=contents.notes,
    )


def _same_unit(channel: Channel, unit: str, dimension: str, key: str, where: str) -> None:
    """Refuse a manifest that contradicts the unit in the file, if that is one known."""
    if not channel.unit or unit == "count":
        return
    written = AS_FORCE.get(channel.unit, channel.unit) if dimension == "force" else channel.unit
    try:
        stated, said = units.to_si(written, dimension, key), units.to_si(unit, dimension, key)
    except ManifestError:
        if channel.unit in UNITS.values():
            raise InputRefused(
                where,
                f"states {channel.name!r} in {channel.unit}, the manifest says {unit}",
                f"name another column, or mend {key}",
            ) from None
        return
    if abs(stated[0] - said[0]) > 1e-6 * abs(said[0]):
        raise InputRefused(
            where,
            f"states {channel.name!r} in {channel.unit}, the manifest says {unit}: a factor of"
            f" {stated[0] / said[0]:.4g}",
            f'{key} = "{written}"?',
        )
