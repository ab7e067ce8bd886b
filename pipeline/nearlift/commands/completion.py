"""completion: the script of a shell."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from nearlift.commands import ABOUT


@click.command("completion", help=ABOUT["completion"].page, epilog=ABOUT["completion"].epilog)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(shell: str) -> None:
    """Print it."""
    from nearlift.cli import main

    kind = get_completion_class(shell)
    assert kind is not None
    click.echo(kind(main, {}, "nearlift", "_NEARLIFT_COMPLETE").source())
