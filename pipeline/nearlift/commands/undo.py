"""undo: the manifest of an earlier run, back in its place."""

from __future__ import annotations

from pathlib import Path

import click

from nearlift.commands.common import CAMPAIGN, Call, declared


@declared("undo")
@CAMPAIGN
@click.option(
    "--to",
    default="",
    metavar="DIGEST",
    help="The run that `nearlift history` lists with a digest that begins so.",
)
def command(call: Call, campaign: Path, to: str) -> None:
    """Put it back, and say what that means."""
    from nearlift.run import history

    done = history.undo(campaign, call.out, to)
    run, aside = done.restored, done.put_aside
    path = campaign / history.MANIFEST
    text = [
        f"{path} is that of {run.digest} ({run.time:%Y-%m-%d %H:%M:%S}Z) again:",
        *(f"  {line}" for line in run.headlines),
        "what differs:",
        *(history.lines(done.changes) or ["  comments and order only"]),
        (
            f"what stood there is kept as {aside.digest}"
            if aside
            else "what stood there was kept before"
        )
        + ": `nearlift undo` brings it back",
        (
            "nothing else was restored: products that hang on these values are stale, and"
            f" `nearlift run {campaign}` makes them again"
        ),
    ]
    content = {
        "manifest": str(path),
        "restored": run.digest,
        "put_aside": aside.digest if aside else None,
        "changes": [{"key": key, "old": old, "new": new} for key, old, new in done.changes],
    }
    call.answer(content, "\n".join(text))
