"""plan: what is stale."""

from __future__ import annotations

from pathlib import Path

from nearlift.cli import no_garbage
from nearlift.commands.common import CAMPAIGN, Call, declared


@declared("plan")
@CAMPAIGN
def command(call: Call, campaign: Path) -> None:
    """Each stage with the reason for which it must run."""
    with no_garbage():
        from nearlift.run import graph, opening  # noqa: F401 - what opens the campaign

    with call.job(campaign) as job:
        steps = [(stage.name, why) for stage, why in graph.plan(job)]
    stages = [{"stage": name, "stale": bool(why), "why": why} for name, why in steps]
    lines = (f"{name:<8} {'run: ' + why if why else 'up to date'}" for name, why in steps)
    call.answer({"campaign": job.campaign.name, "stages": stages}, "\n".join(lines))
