"""export: what was fitted, for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from nearlift.commands.common import CAMPAIGN, Call, declared
from nearlift.errors import UsageError
from nearlift.stages.export import FORMATS, export


def _export(call: Call, campaign: Path, **formats: bool) -> None:
    wanted = tuple(name for name, asked in formats.items() if asked)
    if not wanted:
        raise UsageError(
            "export", "no format was asked for", f"add {', '.join(f'--{name}' for name in formats)}"
        )
    with call.job(campaign) as job:
        written = export(job, wanted)
    call.answer({"campaign": job.campaign.name, "written": written}, "\n".join(written))


for _form in reversed(FORMATS):
    _export = click.option(f"--{_form.name}", is_flag=True, help=f"{_form.meaning}.")(_export)
command = declared("export")(CAMPAIGN(_export))
