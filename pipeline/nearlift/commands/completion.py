"""completion: the script of a shell."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from nearlift.commands import HELP


@click.command("completion", help=HELP["completion"])
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(shell: str) -> None:
    """Print it."""
    from nearlift.cli import main

    kind = get_completion_class(shell)
    assert kind is not None
    click.echo(kind(main, {}, "nearlift", "_NEARLIFT_COMPLETE").source())
