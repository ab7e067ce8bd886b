"""A campaign folder to fill in: a commented manifest and a schedule with its header."""

from __future__ import annotations

import shlex
import shutil
import unicodedata
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import click

from nearlift.campaign.manifest import BLANK
from nearlift.commands.common import DIALECT, Call, declared, dialect_of
from nearlift.commands.inspection import Inspection, inspect
from nearlift.commands.manifest_tables import MEANS, records_block
from nearlift.commands.tables import Table, table_of, trials_section
from nearlift.errors import InputRefused, UsageError
from nearlift.readers import csv_trial, parquet
from nearlift.readers.channel import RecordsDialect
from nearlift.readers.text import TEXT
from nearlift.run import store

MANIFEST = """\
# Facts about the rig and choices. Quantities are texts with a unit; nothing physical has a default.
schema = "nearlift.campaign/1"
name   = "{name}"                    # a slug; names the folders under processed/ and reports/

[vehicle]
name          = "FILL IN"
rotors        = "FILL IN"            # a number, without quotes; 1 for an isolated rotor
rotor_radius  = "FILL IN mm"
rotor_spacing = "FILL IN mm"         # ADJACENT axes; the opposite spacing is sqrt(2) times it unless rotor_diagonal is given; one rotor: delete
mass          = "FILL IN g"
contact       = {{ ground = "FILL IN mm", ceiling = "FILL IN mm" }}   # from the datum of `distance` to the boundary where the vehicle first touches it: what counts as a crash; not flown: delete
# motor_lag = "60 ms"                # of its flights: how thrust follows the command; thrust_limit = "0.55 N", else the largest lift measured
# throttle_map = {{ points = [["25 percent", "10885 rpm"], ["92 percent", "23500 rpm"]] }}   # for C_L, where no rpm is logged

[rig]
held            = "FILL IN"          # throttle | voltage | rpm | power: what a trial holds constant
distance_datum  = "FILL IN"          # rotor plane | airframe | blade tip | rotor axis: what `distance` is measured from
distance_offset = "FILL IN mm"       # datum to rotor plane, ADDED to every recorded distance
gravity         = "FILL IN m/s^2"    # 9.80665 m/s^2 is the standard one
arena           = "FILL IN m"        # largest room dimension; bounds every distance; unknown: delete

{records}{trials}# Further columns, all optional, each with its unit: start, session, approach, supply, current, rpm, power, temperature,
# pressure, humidity, tilt, orientation, turn, propeller, fountain. What is logged can be found guilty; what is not is listed as untestable.

# A plan to weigh before it is run: `nearlift design` says what it could see, and draws a schedule.
# [design]
# distances = {{ ground = ["26 mm", "30 mm", "40 mm", "60 mm", "120 mm", "260 mm"] }}
# throttles = ["25 percent", "50 percent", "75 percent", "92 percent"]
# visits    = 15
# sessions  = 5
# noise     = {{ relative = "0.5 percent", force = "0.3 mN", height = "0.05 mm" }}

# What repeats do not show. One table per component; `scope` says what shares it.
# [[uncertainty]]
# name  = "distance datum"
# on    = "height"                   # height | force | gain | rotor_radius | rotor_spacing | exponent | mass | air_density
# value = "0.2 mm"                   # standard uncertainty
# scope = "boundary"                 # sample | trial | distance | throttle | session | boundary | campaign
"""
CELL = """\
# settle    = "0.5 s"                # discarded after the tare
range       = "FILL IN kgf"          # where the cell saturates; unknown: delete
accuracy    = "FILL IN gf"           # half-width of the cell's departure from a straight line; never averages down; unknown: delete
"""
RECORDS = """\
[load_cell]
sample_rate = "FILL IN Hz"
tare        = "FILL IN s"            # rotors-stopped head of every record; "0 s": already tared; "none": nobody knows
{cell}
[records]
reader = "csv"                       # csv: one file per trial | parquet: one long table with a `trial` column | means: no records
files  = "trials/{{trial}}.csv"
force  = {{ column = "FILL IN", unit = "FILL IN", sign = 1 }}   # sign = -1 where lift pulls the cell negative
"""
SCHEDULE = "trial,boundary,distance,throttle"
BLANK_TRIALS = trials_section({"distance": "", "throttle": ""}, (), ordered=True)


def write_template(folder: Path) -> tuple[list[Path], list[str]]:
    """Write campaign.toml, trials.csv and an empty trials/ into a new folder; returns what was
    written, and what is left to fill in.
    """
    (folder / "trials").mkdir(parents=True)
    written, left = _written(folder, RECORDS.format(cell=CELL), BLANK_TRIALS, SCHEDULE)
    return [*written, folder / "trials"], [*left, "trials.csv: a line for each trial"]


def _written(
    folder: Path, records: str, trials: str, schedule: str
) -> tuple[list[Path], list[str]]:
    """Write the manifest, and the schedule unless it is there (another one there is refused); what
    was written, and what is left to fill in.
    """
    made = schedule.rstrip("\n") + "\n"
    path = folder / "trials.csv"
    if path.exists():
        header = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()[:1]
        if sorted(",".join(header).split(",")) != sorted(made.splitlines()[0].split(",")):
            raise _there(path)
    tables = {"records": records + "\n", "trials": trials + "\n"}
    text = MANIFEST.format(name=slug(folder), **tables)
    written = [folder / "campaign.toml"]
    if not path.exists():
        store.write_bytes(path, made.encode())
        written.append(path)
    # last: a folder with a manifest is a campaign
    store.write_bytes(written[0], text.encode())
    left = [
        f"campaign.toml, line {i}: {line.split('#')[0].strip()}"
        for i, line in enumerate(text.splitlines(), 1)
        if BLANK in line
    ]
    return written, left


def slug(folder: Path) -> str:
    """A campaign's name from its folder's."""
    name = unicodedata.normalize("NFKD", folder.resolve().name.lower())
    plain = name.encode("ascii", "ignore").decode()
    return "".join(c if c.isalnum() else "-" for c in plain).strip("-") or "campaign"


def write_from(
    folder: Path, files: Sequence[Path], dialect: RecordsDialect | None = None
) -> tuple[list[Path], list[str]]:
    """Write a campaign for what is there: the manifest with what the files say, a schedule with a
    line for each trial.

    `files` are records, one for each trial, and perhaps the schedule: a table of which a column
    holds their names; or one long table of Parquet; or one table of means. A folder among them
    stands for all plain files in it, hidden ones aside. `dialect` is how to read them, as
    ``[records] dialect`` takes it. Files inside the folder stay where they are; others are copied
    into it. Returns what was written, and what is left to fill in.

    Raises
    ------
    UsageError
        The folder has a manifest or a schedule already, a folder of records is empty, or two files
        would be one trial.
    InputRefused
        A file cannot be read, or the files are not of one kind.
    """
    if (folder / "campaign.toml").exists():
        raise _there(folder / "campaign.toml")
    files = [file for path in files for file in (_within(path) if path.is_dir() else (path,))]
    listing = folder / "trials.csv"
    has_listing = listing.exists() and listing not in files
    records, table = _parted([*files, listing] if has_listing else files, dialect or {})
    if has_listing and listing in records:
        raise _there(listing)
    inspected = [inspect(path, dialect, record=i > 0) for i, path in enumerate(records)]
    first = inspected[0]
    if first.grid is not None:
        raise UsageError(
            str(first.path),
            f"is a {first.contents.kind}, and no record of force",
            f"`nearlift inspect {shlex.quote(str(first.path))}` prints its [piv] section, for the"
            " manifest of a campaign of forces",
        )
    alone = len(inspected) == 1 and first.table is not None and first.table.means
    means = first.table if alone else None
    if means is None and listing in records:
        raise UsageError(
            str(listing),
            "lists trials, and neither lifts nor the names of the files beside it",
            "name the records, or the folder that they are in: nearlift new DIR --from FILES",
        )
    copies: dict[Path, Path] = {}
    if means is not None:
        block, trials, table = MEANS, means.row_ids(), means
    else:
        _of_one_kind(inspected)
        block, trials, copies = _records(folder, inspected)
    if table is None and means is None and _swept(inspected):
        # the throttle is what the pieces say
        lines = [f"{cell(record)},FILL IN,FILL IN" for record in trials]
        schedule = "\n".join(["record,boundary,distance", *lines])
        section = trials_section({"distance": ""}, (), ordered=True)
        more = [f"trials.csv: boundary and distance of {len(trials)} records"]
    elif table is None:
        lines = [f"{cell(trial)},FILL IN,FILL IN,FILL IN" for trial in trials]
        schedule, section = "\n".join([SCHEDULE, *lines]), BLANK_TRIALS
        more = [f"trials.csv: boundary, distance and throttle of {len(trials)} trials"]
    else:
        ids = trials if means is not None else table.ids(trials) or trials
        of_records = means is None and bool(_swept(inspected))
        schedule, section = table.schedule(ids, means=means is not None, of_records=of_records)
        more = table.wanted(means=means is not None)
    written, left = _written(folder, block, section, schedule)
    for copy, path in copies.items():
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copy)
    return [*written, *copies], [*left, *more]


def _there(path: Path) -> UsageError:
    return UsageError(
        str(path), "is there already", "name a new folder; nothing is ever overwritten"
    )


def _parted(files: Sequence[Path], dialect: RecordsDialect) -> tuple[list[Path], Table | None]:
    """The records, and the table that lists them where one of the files is that."""
    for path in files:
        others = [other for other in files if other is not path]
        table = table_of(path, dialect) if others and path.is_file() else None
        if table is not None and table.ids({trial_of(other.name) for other in others}):
            return others, table
    return list(files), None


def _of_one_kind(inspected: list[Inspection]) -> None:
    """See that one reader reads all, with the same channels."""
    if {f.reader for f in inspected} == {csv_trial.READER.name, TEXT.name}:
        # the one that reads plain CSV as well
        inspected[:] = [replace(f, reader=TEXT.name) for f in inspected]
    for other in inspected[1:]:
        if other.reader != inspected[0].reader or {c.name for c in other.contents.channels} != {
            c.name for c in inspected[0].contents.channels
        }:
            raise InputRefused(
                str(other.path),
                f"is {other.contents.kind} with other channels than {inspected[0].path.name}",
                "make a campaign of files of one kind, and of one table that lists them in a column",
            )
    if inspected[0].reader == parquet.READER.name and len(inspected) > 1:
        raise UsageError(
            "--from", f"names {len(inspected)} tables", "a campaign takes one long table of Parquet"
        )


def _records(
    folder: Path, inspected: Sequence[Inspection]
) -> tuple[str, list[str], dict[Path, Path]]:
    """[load_cell] and [records] of the records, their trials, and where which is to be copied."""
    root = folder.resolve()
    paths = [f.path for f in inspected]
    inside = all(path.resolve().is_relative_to(root) for path in paths)
    long = inspected[0].reader == parquet.READER.name
    cut = _swept(inspected)
    targets = [
        path.resolve().relative_to(root).as_posix()
        if inside
        else path.name
        if long
        else f"trials/{path.name}"
        for path in paths
    ]
    if len(set(targets)) != len(targets):
        raise UsageError("--from", "two files have one name", "rename one of them")
    if long:
        files, trials = targets[0], parquet.trials(paths[0])
    else:
        before, after = _around(targets)
        files = f"{before}{{{'record' if cut else 'trial'}}}{after}"
        trials = [target[len(before) : len(target) - len(after)] for target in targets]
    block = records_block(inspected[0], files).replace("\n[records]", CELL + "\n[records]")
    block += f"\n{cut}" if cut else ""
    copies = {} if inside else {folder / t: p for t, p in zip(targets, paths, strict=True)}
    return block, trials, copies


def _swept(inspected: Sequence[Inspection]) -> str:
    """The [segments] of records that are all sweeps of the throttle; empty of others."""
    ramps = [f.ramp for f in inspected]
    return ramps[0].segments if ramps[0] is not None and all(ramps) else ""


def _within(folder: Path) -> list[Path]:
    files = sorted(
        path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")
    )
    if not files:
        raise UsageError(
            str(folder), "holds no files", "name the folder that the records are in, or the records"
        )
    return files


def _around(targets: Sequence[str]) -> tuple[str, str]:
    """What stands before and behind the trial's id in every name: a folder, and a suffix."""
    name = PurePosixPath(targets[0]).name
    before, after = targets[0].removesuffix(name), name.removeprefix(trial_of(name))
    if all(
        t.startswith(before) and t.endswith(after) and "/" not in t[len(before) :] for t in targets
    ):
        return before, after
    raise UsageError(
        "--from",
        "the files lie in different folders, or have different suffixes",
        "put them into one folder",
    )


def trial_of(name: str) -> str:
    """A file's name without its suffix, and without that of its compression."""
    plain = name.removesuffix(".gz")
    return plain.removesuffix(PurePosixPath(plain).suffix)


def cell(text: str) -> str:
    """A cell of a CSV."""
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"') else text


@declared("new")
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--from",
    "given",
    is_flag=True,
    help=(
        "FILES follow, or their folders: records that are there already, and the table that lists"
        " them; or one table of means. The manifest says what they say."
    ),
)
@DIALECT
def command(call: Call, folder: Path, files: tuple[Path, ...], given: bool, dialect: str) -> None:
    """An empty template, or one filled in from records."""
    if given != bool(files):
        raise UsageError(
            "--from",
            "names no files" if given else "is missing before the files",
            "nearlift new DIR --from FILES",
        )
    if given:
        made, left = write_from(folder, files, dialect_of(dialect))
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            str(folder),
            "is not empty" if folder.is_dir() else "is a file",
            "name a new folder; nothing is ever overwritten",
        )
    else:
        made, left = write_template(folder)
    copied = [path for path in made if path.parent != folder]
    lines = [str(path) for path in made if path.parent == folder]
    if copied:
        lines.append(f"{copied[0].parent}: {len(copied)} file{'s' * (len(copied) > 1)}")
    lines += ["still to fill in:", *(f"  {item}" for item in left)]
    lines.append(f"then: nearlift run {shlex.quote(str(folder))}")
    call.answer({"written": [str(path) for path in made], "fill_in": left}, "\n".join(lines))
