"""detect --boundary: one reading as a distance."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from nearlift.commands.common import Call
from nearlift.errors import UsageError


def answer(campaign: Path, given: Mapping[str, object], call: Call) -> None:
    """Where the boundary is by this reading; quantities are texts, as the manifest has them."""
    from nearlift.campaign.forecasts import LiftReading
    from nearlift.campaign.parsing import validated
    from nearlift.results.serial import encode
    from nearlift.stages.proximity import read

    for flag, example, why in (
        ("boundary", "ground", "a reading is one of ground, ceiling or sidewall"),
        ("u", "'1 percent'", "a reading has a standard uncertainty"),
    ):
        if flag not in given:
            raise UsageError(f"--{flag}", f"is missing: {why}", f"add --{flag} {example}")
    fields = {name.removesuffix("_u"): value for name, value in given.items()}
    reading = validated(LiftReading, fields, "nearlift detect")
    with call.job(campaign) as job:
        result = read(job, reading)
    call.answer(encode(result), result.text)
