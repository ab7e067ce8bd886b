"""new: a campaign folder to fill in, empty or from files."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from nearlift.commands.common import DIALECT, Call, declared, dialect_of
from nearlift.errors import UsageError


@declared("new")
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--from",
    "given",
    is_flag=True,
    help=(
        "Build the campaign from these files or folders: records and the table that lists them, or"
        " one table of mean lifts."
    ),
)
@DIALECT
def command(call: Call, folder: Path, files: tuple[Path, ...], given: bool, dialect: str) -> None:
    """An empty template, or one filled in from records."""
    from nearlift.onboarding.new import write_from, write_template

    if given != bool(files):
        raise UsageError(
            "--from",
            "names no files" if given else "is missing before the files",
            "nearlift new DIR --from FILES",
        )
    made = write_from(folder, files, dialect_of(dialect)) if given else write_template(folder)
    copied = [path for path in made.written if path.parent != folder]
    lines = [str(path) for path in made.written if path.parent == folder]
    if copied:
        lines.append(f"{copied[0].parent}: {len(copied)} file{'s' * (len(copied) > 1)}")
    lines += [f"note: {note}" for note in made.notes]
    lines += ["still to fill in:", *(f"  {item}" for item in made.fill_in)]
    lines.append(f"then: nearlift run {shlex.quote(str(folder))}")
    content = {
        "written": [str(path) for path in made.written],
        "fill_in": list(made.fill_in),
        "notes": list(made.notes),
    }
    call.answer(content, "\n".join(lines))
