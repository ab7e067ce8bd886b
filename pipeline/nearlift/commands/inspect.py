"""inspect: what a file holds, with the tables of a manifest for it; or the cuts of records."""

from __future__ import annotations

from pathlib import Path

import click

from nearlift.commands.common import DIALECT, Call, declared, dialect_of, padded
from nearlift.errors import UsageError


@declared("inspect")
@click.argument(
    "files", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="FILE..."
)
@DIALECT
@click.option(
    "--cuts",
    is_flag=True,
    help=(
        "Instead: cut records by [segments] of the manifest and draw them to"
        " reports/NAME/segments.png. FILE is a campaign's folder or one of its records."
    ),
)
def command(call: Call, files: tuple[Path, ...], dialect: str, cuts: bool) -> None:
    """Print channels, sparklines and the block to paste; or draw the cuts."""
    if cuts:
        from nearlift.commands.cuts import answer

        if dialect:
            raise UsageError(
                "--dialect", "was given with --cuts", "write it under [records] of the manifest"
            )
        answer(call, files)
        return
    from nearlift.onboarding import shown
    from nearlift.onboarding.inspection import inspect

    inspected = [inspect(file, dialect_of(dialect)) for file in files]
    answers = [
        (shown.as_json(one), shown.described(one, padded(shown.channel_rows(one))))
        for one in inspected
    ]
    call.answers("files", answers)
