"""serve: the workspace in a browser of this machine."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import click

from nearlift.commands.common import Call, declared
from nearlift.errors import UsageError

#: What the extra brings.
PACKAGES = ("starlette", "uvicorn")


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
    """Serve it until Ctrl-C."""
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise UsageError(
            "nearlift serve",
            f"needs {' and '.join(missing)}",
            'pip install "nearlift[serve]"',
        )
    if not workspace.is_dir():
        raise UsageError(
            str(workspace),
            "is no folder",
            "name one, new or with campaigns in it; without a name it is the current one",
        )
    from nearlift.serve.app import serve
    from nearlift.serve.bench import ServedWorkspace

    bench = ServedWorkspace(workspace)

    def announce(link: str) -> None:
        call.answer(
            {"workspace": str(bench.root), "link": link},
            f"{bench.root}: open {link}\nthe link is good for one browser; Ctrl-C ends it",
        )

    serve(bench, port, announce)
