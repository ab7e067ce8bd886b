"""A campaign folder to fill in: a commented manifest and a schedule with its header."""

from __future__ import annotations

import shutil
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import click

from nearlift.commands.common import DIALECT, Call, declared
from nearlift.commands.inspect import dialect_of, inspect, records_block
from nearlift.errors import InputRefused, UsageError
from nearlift.readers import csv_trial
from nearlift.readers.text import TEXT

MANIFEST = """\
# Facts about the rig and choices. Quantities are texts with a unit; nothing physical has a default.
schema = "nearlift.campaign/1"
name   = "{name}"                    # a slug; names the folders under processed/ and reports/

[vehicle]
name          = "FILL IN"
rotors        = 4                    # 1 for an isolated rotor
rotor_radius  = "FILL IN mm"
rotor_spacing = "FILL IN mm"         # ADJACENT axes; the opposite spacing is sqrt(2) times it unless rotor_diagonal is given
# throttle_map = {{ points = [["25 percent", "10885 rpm"], ["92 percent", "23500 rpm"]] }}   # for C_L, where no rpm is logged
mass          = "FILL IN g"

[rig]
held            = "throttle"         # throttle | voltage | rpm | power: what a trial holds constant
distance_datum  = "rotor plane"      # rotor plane | airframe | blade tip | rotor axis: what `distance` is measured from
distance_offset = "0 mm"             # datum to rotor plane, ADDED to every recorded distance
arena           = "FILL IN m"        # largest room dimension; bounds every distance
gravity         = "9.80665 m/s^2"

{records}[trials]
file = "trials.csv"                  # one row per trial, in the order in which they were run
[trials.units]
distance = "mm"
throttle = "percent"
start    = "s"

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
RECORDS = """\
[load_cell]
sample_rate = "1000 Hz"
tare        = "2 s"                  # rotors-stopped head of every record; "0 s": already tared; "none": nobody knows
settle      = "0 s"                  # discarded after the tare
range       = "FILL IN kgf"
accuracy    = "FILL IN gf"           # half-width of the cell's departure from a straight line; never averages down

[records]
reader = "csv"                       # csv: one file per trial | parquet: one long table with a `trial` column | means: no records
files  = "trials/{trial}.csv"
force  = { column = "force", unit = "mN", sign = 1 }   # sign = -1 where lift pulls the cell negative

"""
CELL = """\
settle      = "0 s"                  # discarded after the tare
range       = "FILL IN kgf"
accuracy    = "FILL IN gf"           # half-width of the cell's departure from a straight line; never averages down
"""
SCHEDULE = "trial,boundary,distance,throttle,start,session,approach\n"


def write_template(folder: Path) -> list[Path]:
    """Write campaign.toml, trials.csv and an empty trials/ into a new folder; returns what was
    written.
    """
    (folder / "trials").mkdir(parents=True)
    (folder / "campaign.toml").write_text(
        MANIFEST.format(name=slug(folder), records=RECORDS), encoding="utf-8"
    )
    (folder / "trials.csv").write_text(SCHEDULE, encoding="utf-8")
    return [folder / "campaign.toml", folder / "trials.csv", folder / "trials"]


def slug(folder: Path) -> str:
    """A campaign's name from its folder's."""
    plain = (
        unicodedata.normalize("NFKD", folder.resolve().name.lower())
        .encode("ascii", "ignore")
        .decode()
    )
    return "".join(c if c.isalnum() else "-" for c in plain).strip("-") or "campaign"


def write_from(
    folder: Path, files: Sequence[Path], dialect: Mapping[str, Any] | None = None
) -> tuple[list[Path], list[str]]:
    """Write a campaign for records that are there: the manifest with what the files say, a schedule
    with a line for each.

    A folder among `files` stands for all plain files in it, hidden ones aside.
    `dialect` is how to read them, as ``[records] dialect`` takes it. Files inside the folder stay
    where they are; others are copied into ``trials/``. Returns what was written, and what is left
    to fill in.

    Raises
    ------
    UsageError
        The folder has a manifest or a schedule already, a folder of records is empty, or two files
        would be one trial.
    InputRefused
        A file cannot be read, or the files are not of one kind.
    """
    for name in ("campaign.toml", "trials.csv"):
        if (folder / name).exists():
            raise UsageError(
                str(folder / name),
                "is there already",
                "name a new folder; nothing is ever overwritten",
            )
    files = [file for path in files for file in (_within(path) if path.is_dir() else (path,))]
    found = [inspect(path, dialect) for path in files]
    if {f.reader for f in found} == {csv_trial.READER.name, TEXT.name}:
        # one reader for all: the one that reads plain CSV as well
        found = [replace(f, reader=TEXT.name) for f in found]
    for other in found[1:]:
        if other.reader != found[0].reader or {c.name for c in other.contents.channels} != {
            c.name for c in found[0].contents.channels
        }:
            raise InputRefused(
                str(other.path),
                f"is {other.contents.kind} with other channels than {found[0].path.name}",
                "make a campaign of files of one kind",
            )
    root = folder.resolve()
    inside = all(path.resolve().is_relative_to(root) for path in files)
    targets = [
        path.resolve().relative_to(root).as_posix() if inside else f"trials/{path.name}"
        for path in files
    ]
    before, after = _around(targets)
    trials = [
        target[len(before) : len(target) - len(after) if after else None] for target in targets
    ]
    if len(set(targets)) != len(targets) or found[0].reader == "parquet":
        what = (
            "takes one long table: write the manifest by hand"
            if found[0].reader == "parquet"
            else "two files have one name"
        )
        raise UsageError("--from", what, "`nearlift inspect FILE` prints its [records] block")
    written = [folder / "campaign.toml", folder / "trials.csv"]
    if not inside:
        (folder / "trials").mkdir(parents=True, exist_ok=True)
        for path, target in zip(files, targets, strict=True):
            shutil.copyfile(path, folder / target)
            written.append(folder / target)
    block = records_block(found[0], f"{before}{{trial}}{after}")
    text = MANIFEST.format(
        name=slug(folder), records=block.replace("\n[records]", CELL + "\n[records]") + "\n"
    )
    for known in ('= "throttle"    ', '= "rotor plane" ', '"0 mm"   ', '"9.80665 m/s^2"'):
        # no file says how the rig stood
        unit = known.split()[-1].strip('"') if known[0] == '"' else ""
        marked = f'"FILL IN{" " + unit if unit else ""}"' if known[0] == '"' else '= "FILL IN" '
        text = text.replace(known, marked.ljust(len(known)), 1)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    lines = SCHEDULE + "".join(f"{cell(trial)},FILL IN,FILL IN,FILL IN,,,\n" for trial in trials)
    (folder / "trials.csv").write_text(lines, encoding="utf-8")
    left = [
        f"campaign.toml, line {i}: {line.split('#')[0].strip()}"
        for i, line in enumerate(text.splitlines(), 1)
        if "FILL IN" in line
    ]
    return written, [*left, f"trials.csv: boundary, distance and throttle of {len(trials)} trials"]


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
    """What stands before and behind the trial's id in every name: the folder, and the suffix; more
    only if all names agree in it.
    """
    folder = PurePosixPath(targets[0]).parent.as_posix()
    before = "" if folder == "." else folder + "/"
    suffix = PurePosixPath(targets[0]).suffix
    if all(
        t.startswith(before) and t.endswith(suffix) and "/" not in t[len(before) :] for t in targets
    ):
        return before, suffix
    raise UsageError(
        "--from",
        "the files lie in different folders, or have different suffixes",
        "put them into one folder",
    )


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
        "FILES follow: records that are there already, or their folders. The manifest says what"
        " they say."
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
        lines = [*map(str, made[:2]), "still to fill in:", *(f"  {item}" for item in left)]
        content = {"written": [str(path) for path in made], "fill_in": left}
        call.answer(content, "\n".join(lines))
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            str(folder),
            "is not empty" if folder.is_dir() else "is a file",
            "name a new folder; nothing is ever overwritten",
        )
    written = [str(path) for path in write_template(folder)]
    call.answer({"written": written}, "\n".join(written))
