"""A campaign folder to fill in: a commented manifest and a schedule, empty or from files."""

from __future__ import annotations

import shlex
import shutil
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np
import pandas as pd
from tomlkit import TOMLDocument

from nearlift.campaign.manifest import BLANK
from nearlift.errors import InputRefused, UsageError
from nearlift.onboarding import proposal
from nearlift.onboarding.inspection import COVARIATES, Inspection, inspect
from nearlift.onboarding.tables import InputTable, ProposedSchedule, table_of, trial_of
from nearlift.readers import parquet
from nearlift.readers.base import RecordsDialect
from nearlift.readers.files import head_of
from nearlift.readers.text import CSV, TEXT
from nearlift.run import tables

SCHEDULE_COLUMNS = ["trial", "boundary", "distance", "throttle"]
#: Suffixes and first letters of files in a folder that are no records.
NO_RECORDS, NO_RECORD = (".md", ".pdf", ".png", ".jpg", ".docx", ".py", ".m", ".toml"), "readme"
KEPT = "name a new folder; nothing is ever overwritten"


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """Files written, values that are still to be filled in, and remarks."""

    written: tuple[Path, ...]
    fill_in: tuple[str, ...]
    notes: tuple[str, ...] = ()


def write_template(folder: Path) -> Made:
    """Write campaign.toml, trials.csv and an empty trials/ into a new folder."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        what = "is not empty" if folder.is_dir() else "is a file"
        raise UsageError(str(folder), what, KEPT)
    (folder / "trials").mkdir(parents=True)
    records = proposal.template()
    for key in records.keys() - {"load_cell", "records"}:
        del records[key]
    schedule = _blank(SCHEDULE_COLUMNS, [])
    made = _write(folder, records, schedule, ["trials.csv: a line for each trial"])
    return replace(made, written=(*made.written, folder / "trials"))


def write_from(folder: Path, files: Sequence[Path], dialect: RecordsDialect | None = None) -> Made:
    """Write a campaign for files: their manifest, and a schedule with a line for each trial.

    `files` are records, and perhaps a table of which a column holds their names; or one long table
    of Parquet; or one table of means. A folder means the files in it. Files outside the campaign's
    folder are copied into it.

    Raises
    ------
    UsageError
        The folder has a manifest or a schedule already, a folder of records is empty, or two files
        would be one trial.
    InputRefused
        A file cannot be read, or the files are not of one kind.
    """
    _refuse_existing(folder / "campaign.toml")
    notes: list[str] = []
    files = [f for path in files for f in (_within(path, notes) if path.is_dir() else (path,))]
    listing = folder / "trials.csv"
    is_other = listing.exists() and listing not in files
    paths, table = _parted([*files, listing] if is_other else files, dialect or {})
    if is_other and listing in paths:
        _refuse_existing(listing)
    # a record with one throttle is no sweep
    one_lift = table is not None and "throttle" in table.units
    inspected = [inspect(p, dialect, record=i > 0, one_lift=one_lift) for i, p in enumerate(paths)]
    first = inspected[0]
    if first.grid is not None:
        raise UsageError(
            str(first.path),
            f"is a {first.contents.kind}, and no record of force",
            f"`nearlift inspect {shlex.quote(str(first.path))}` prints its [piv] section, for the"
            " manifest of a campaign of forces",
        )
    if len(inspected) == 1 and first.table is not None and first.table.means:
        made = _write(folder, proposal.for_means(), first.table.schedule(), ())
        return replace(made, notes=(*notes, *first.table.notes))
    if listing in paths:
        raise UsageError(
            str(listing),
            "lists trials, and neither lifts nor the names of the files next to it",
            "name the records, or the folder that they are in: nearlift new DIR --from FILES",
        )
    inspected = _of_one_kind(inspected)
    pattern, trials, copies = _places(folder, inspected)
    schedule, more = _schedule(inspected, trials, table, notes)
    made = _write(folder, proposal.for_records(inspected, pattern), schedule, more)
    for copy, path in copies.items():
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
    return replace(made, written=(*made.written, *copies), notes=tuple(notes))


def _write(
    folder: Path, records: TOMLDocument, schedule: ProposedSchedule, more: Sequence[str]
) -> Made:
    """Write the manifest, and the schedule unless it exists; `more` is left to fill in.

    Raises the schedule's first refusal.
    """
    for refusal in schedule.refusals:
        raise refusal
    path, manifest = folder / "trials.csv", folder / "campaign.toml"
    written = [manifest]
    if path.exists():
        header = path.read_text(encoding="utf-8-sig", errors="replace").partition("\n")[0].strip()
        if sorted(header.split(",")) != sorted(schedule.trials.columns):
            _refuse_existing(path)
    else:
        written.append(path)
        tables.write_whole(path, schedule.trials.to_csv(index=False, lineterminator="\n").encode())
    records.update(proposal.for_trials(schedule))
    text = proposal.document(_slug(folder), records)
    # last: a folder with a manifest is a campaign
    tables.write_whole(manifest, text.encode())
    left = (f"campaign.toml, {line}" for line in proposal.blanks(text))
    return Made(written=tuple(written), fill_in=(*left, *more, proposal.ASKED))


def _slug(folder: Path) -> str:
    """Name of a campaign, from its folder's."""
    name = unicodedata.normalize("NFKD", folder.resolve().name.lower())
    plain = name.encode("ascii", "ignore").decode()
    return "".join(c if c.isalnum() else "-" for c in plain).strip("-") or "campaign"


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise UsageError(str(path), "is there already", KEPT)


def _some(names: Sequence[str]) -> str:
    """The first of some names."""
    return f"{', '.join(names[:5])}{' ...' * (len(names) > 5)}"


# ---- files


def _within(folder: Path, notes: list[str]) -> list[Path]:
    """Plain files of a folder that may be records; the others are noted."""
    files = sorted(f for f in folder.iterdir() if f.is_file() and not f.name.startswith("."))
    other = [
        f for f in files if f.suffix.lower() in NO_RECORDS or f.name.lower().startswith(NO_RECORD)
    ]
    if other:
        notes.append(f"not taken as records: {', '.join(f.name for f in other)}")
    if len(other) == len(files):
        remedy = "name the folder that the records are in, or the records"
        raise UsageError(str(folder), "holds no files", remedy)
    return [f for f in files if f not in other]


def _parted(files: Sequence[Path], dialect: RecordsDialect) -> tuple[list[Path], InputTable | None]:
    """Records, and the table that lists them where one of the files is that."""
    for path in files:
        others = [other for other in files if other is not path]
        table = table_of(path, dialect) if others and path.is_file() else None
        if table is None:
            continue
        records = {trial for other in others for trial in _trials_in(other)}
        _, lacking = table.ids(records)
        if not lacking:
            return others, table
        if 2 * len(lacking) < len(records):
            listed = f"lists {len(records) - len(lacking)} of {len(records)} records, and not"
            remedy = "add a row for each of them, or take their files away"
            raise InputRefused(str(path), f"{listed} {_some(lacking)}", remedy)
    return list(files), None


def _trials_in(path: Path) -> Sequence[str]:
    """Trials of a long table; of any other file its name."""
    is_long = path.is_file() and parquet.READER.recognises(head_of(path, 4), path.name)
    return [*parquet.trials(path)] if is_long else [trial_of(path)]


def _of_one_kind(inspected: list[Inspection]) -> list[Inspection]:
    """Files by one reader that reads them all; refuses files with other channels."""
    if {f.reader for f in inspected} == {CSV.name, TEXT.name}:
        # the one that reads plain CSV as well
        inspected = [replace(f, reader=TEXT.name) for f in inspected]
    first = inspected[0]
    channels = {c.name for c in first.contents.channels}
    for other in inspected[1:]:
        if other.reader != first.reader or {c.name for c in other.contents.channels} != channels:
            raise InputRefused(
                str(other.path),
                f"is {other.contents.kind} with other channels than {first.path.name}",
                "take files of one kind, and one table that lists them in a column",
            )
    if first.reader == parquet.READER.name and len(inspected) > 1:
        raise UsageError(
            "--from", f"names {len(inspected)} tables", "a campaign takes one long table of Parquet"
        )
    return inspected


def _places(
    folder: Path, inspected: Sequence[Inspection]
) -> tuple[str, list[str], dict[Path, Path]]:
    """Manifest's pattern of the files, their trials, and the copies to make."""
    root, paths = folder.resolve(), [f.path.resolve() for f in inspected]
    inside = all(path.is_relative_to(root) for path in paths)
    is_long = inspected[0].reader == parquet.READER.name
    copied = PurePosixPath("." if is_long else "trials")
    places = [
        PurePosixPath(path.relative_to(root)) if inside else copied / path.name for path in paths
    ]
    if len({str(place).casefold() for place in places}) != len(places):
        raise UsageError(
            "--from", "two files have one name, or differ only in case", "rename one of them"
        )
    copies = {} if inside else {folder / to: path for to, path in zip(places, paths, strict=True)}
    if is_long:
        return str(places[0]), [*parquet.trials(paths[0])], copies
    trials = [trial_of(Path(place)) for place in places]
    kinds = {(p.parent, p.name.removeprefix(t)) for p, t in zip(places, trials, strict=True)}
    if len(kinds) > 1:
        what = "the files lie in different folders, or have different suffixes"
        raise UsageError("--from", what, "put them into one folder")
    parent, suffix = kinds.pop()
    mark = "{record}" if proposal.are_swept(inspected) else "{trial}"
    return str(parent / f"{mark}{suffix}"), trials, copies


# ---- the schedule


def _blank(header: list[str], trials: Sequence[str]) -> ProposedSchedule:
    """Schedule of these trials, with all other cells to fill in."""
    blank = pd.DataFrame(BLANK, index=range(len(trials)), columns=header)
    settings = [name for name in header if name in ("distance", "throttle")]
    return ProposedSchedule(blank.assign(**{header[0]: trials}), dict.fromkeys(settings, ""))


def _schedule(
    inspected: Sequence[Inspection],
    trials: Sequence[str],
    table: InputTable | None,
    notes: list[str],
) -> tuple[ProposedSchedule, list[str]]:
    """Schedule of these records, and what else it needs; adds `notes`."""
    wrapped = [f.path.name for f in inspected if f.wraps]
    swept, more = proposal.are_swept(inspected), []
    if table is not None:
        ids = table.ids(trials)[0] or trials
        schedule = table.schedule(ids, "record" if swept else "trial")
    elif swept:
        schedule = _blank(["record", "boundary", "distance"], trials)
        more = [f"trials.csv: boundary and distance of {len(trials)} records"]
    else:
        schedule = _blank(SCHEDULE_COLUMNS, trials)
        more = [f"trials.csv: boundary, distance and throttle of {len(trials)} trials"]
    if not swept and len(inspected) == len(trials):
        # further channels of the records become columns, unless the table has them
        means = pd.DataFrame(map(_means, inspected), index=list(trials)).dropna(axis="columns")
        taken = [name for name in COVARIATES if name in means and name not in schedule.units]
        cells = means[taken].map("{:.6g}".format).reindex(schedule.trials["trial"]).fillna("")
        further = inspected[0].further
        schedule = schedule._replace(
            trials=schedule.trials.assign(**{name: cells[name].to_numpy() for name in taken}),
            units=schedule.units | {name: further[name][1] for name in taken},
        )
        words = [f"{name}, the mean of {further[name][0].name!r}" for name in taken]
        notes += [f"trials.csv has from each record: {'; '.join(words)}"] if words else []
    if wrapped:
        notes.append(
            f"{_some(wrapped)}: the force jumps from one sample to the next. A"
            " converter's counter may have wrapped: correct the counts, or leave the trial out"
        )
    return schedule, more


def _means(inspected: Inspection) -> dict[str, float]:
    """Mean of each channel that is a covariate, once the lift is steady."""
    n = 0 if inspected.force is None else len(inspected.force.values)
    start = next(iter(inspected.starts), None)
    first = 0 if start is None else start.steady_from
    return {
        name: float(np.mean(c.values[first if len(c.values) == n else 0 :]))
        for name, (c, _) in inspected.further.items()
    }
