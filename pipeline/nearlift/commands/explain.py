"""diagnose --explain: one effect in one campaign."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from nearlift.commands.common import Call


def answer(campaign: Path, given: Mapping[str, object], call: Call) -> None:
    """What the effect is, what the campaign could see of it, and what it is confused with."""
    from nearlift.report.figures.explain import text
    from nearlift.results.serial import encode
    from nearlift.stages import explain

    name = str(given["explain"])
    with call.job(campaign, keep=True) as job, call.busy(f"nearlift: {name}"):
        explanation = explain.run(job, name)
    call.answer(encode(explanation), text(explanation))
