"""explain: one effect in one campaign; also diagnose --explain."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from nearlift.commands.common import CAMPAIGN, Call, declared


@declared("explain")
@CAMPAIGN
@click.argument("effect")
def command(call: Call, campaign: Path, effect: str) -> None:
    """Print the explanation."""
    answer(campaign, {"explain": effect}, call)


def answer(campaign: Path, given: Mapping[str, object], call: Call) -> None:
    """Say what the effect is, whether it is detectable, and what is confounded with it."""
    from nearlift.report.figures.explain import text
    from nearlift.results.serial import encode
    from nearlift.stages import explain

    name = str(given["explain"])
    with call.job(campaign, keep=True) as job, call.busy(f"nearlift: {name}"):
        explanation = explain.run(job, name)
    call.answer(encode(explanation), text(explanation))
