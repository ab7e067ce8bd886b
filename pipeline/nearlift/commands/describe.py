"""describe: one declaration, or the list of them."""

from __future__ import annotations

import click

from nearlift.commands.common import Call, declared


@declared("describe")
@click.argument("name", required=False)
def command(call: Call, name: str | None) -> None:
    """Print a model, effect, product or symbol; without NAME, the catalogue."""
    from nearlift.describe import describe

    text = describe(name)
    call.answer({"name": name, "text": text}, text)
