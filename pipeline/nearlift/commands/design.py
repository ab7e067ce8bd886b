"""design: what a planned campaign could see."""

from __future__ import annotations

from pathlib import Path

import click

from nearlift.commands.common import CAMPAIGN, Call, declared


@declared("design")
@CAMPAIGN
@click.option(
    "--noise-from",
    metavar="NAME",
    help="An earlier campaign under processed/ whose noise floor is expected.",
)
@click.option(
    "--write",
    type=click.Path(path_type=Path),
    metavar="PATH",
    help="Where the random schedule goes; never over a file.",
)
def command(call: Call, campaign: Path, noise_from: str | None, write: Path | None) -> None:
    """Weigh the plan."""
    from nearlift.report.figures.design import text
    from nearlift.results.serial import encode
    from nearlift.stages import design

    earlier = None if noise_from is None else call.out / "processed" / noise_from
    with call.job(campaign, planned=True) as job, call.busy(f"nearlift: {job.campaign.name}"):
        answer = design.run(job, earlier=earlier, write=write)
    call.answer(encode(answer), text(answer))
