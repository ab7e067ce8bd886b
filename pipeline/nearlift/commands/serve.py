"""serve: a read-only page of the workspace in a browser of this machine."""

from __future__ import annotations

import contextlib
from pathlib import Path

import click

from nearlift.commands.common import Call, declared
from nearlift.errors import UsageError


@declared("serve")
@click.argument("workspace", type=click.Path(path_type=Path), default=Path())
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    metavar="PORT",
    help="Port of 127.0.0.1; without it, any free one.",
)
def command(call: Call, workspace: Path, port: int) -> None:
    """Serve until Ctrl-C."""
    if not workspace.is_dir():
        raise UsageError(str(workspace), "is no folder", "name the folder that holds processed/")
    from nearlift.serve.pages import responder
    from nearlift.serve.server import Server

    # Ctrl-C is the way to end: it may come as soon as the link is read
    with contextlib.suppress(KeyboardInterrupt), Server(port, responder(workspace)) as server:
        call.answer(
            {"workspace": str(workspace.resolve()), "link": server.link},
            f"{workspace.resolve()}: open {server.link}\n"
            "the link is good for one browser; Ctrl-C ends the page",
        )
        server.serve_forever()
