"""The command of a stage, made of its declaration; and the run of stages that it begins."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

import click

from nearlift.commands import about_stage
from nearlift.commands.common import CAMPAIGN, Call, command, end_politely
from nearlift.errors import SOME_TRIALS_REJECTED
from nearlift.printing import say
from nearlift.rounding import bytes_text
from nearlift.run.engine import Option, Stage
from nearlift.stages import STAGES

#: Rejected trials that are listed without -v.
LISTED = 10


def command_of(stage: Stage) -> click.Command:
    """The stage's command: it runs the stage, up to date or not, or answers its question."""
    asked = stage.question.options if stage.question else ()

    def run(call: Call, campaign: Path, **given: Any) -> None:
        known = {name: value for name, value in given.items() if value is not None}
        if stage.question and known.keys() & {option.name for option in asked}:
            importlib.import_module(stage.question.module).answer(campaign, known, call)
        else:
            execute(call, campaign, stage.name, overrides=known)

    for option in reversed((*stage.options, *asked)):
        run = _click_option(option)(run)
    return command(CAMPAIGN(run), stage.name, about_stage(stage))


def _click_option(option: Option) -> Any:
    kind: Any = (
        click.Choice(option.choices)
        if option.choices
        else click.IntRange(*option.limits)
        if option.limits
        else float
        if option.real
        else None
    )
    return click.option(option.flag, type=kind, metavar=option.metavar, help=option.help)


def execute(
    call: Call,
    campaign: Path,
    only: str | None = None,
    overrides: Mapping[str, object] | None = None,
) -> None:
    """Run what is stale, or one stage, and end with the contract's exit code; `overrides` of the
    section of the manifest that has that stage's name.
    """
    from nearlift.run import engine

    end_politely()
    if call.executor.startswith("dask"):
        # a cluster takes whole campaigns
        execute_many(call, (campaign,), only, overrides)
    wanted = STAGES if only is None else (engine.stage_of(STAGES, only),)
    steps: list[engine.Step] = []
    with call.job(campaign, call.executor, keep=True) as job:
        if only is not None and overrides:
            job = job.overriding(only, overrides)

        def begin(stage: Stage, why: str) -> None:
            # what is to be read is told before it is read
            held = (
                f"; {len(job.stamps)} files with"
                f" {bytes_text(sum(size for size, _ in job.stamps.values()))}"
                if stage.name == "ingest"
                else ""
            )
            call.line(f"{stage.name:<8} {stage.summary} ({why}{held})")
            if call.bar is not None:
                call.bar.show(stage.name)

        with call.busy(f"nearlift: {job.campaign.name}"):
            for step in engine.run(job, wanted, begin=begin, force=only is not None):
                if not step.why:
                    call.line(f"{step.stage.name:<8} up to date")
                for note in step.outcome.notes:
                    call.line(f"  note: {note}")
                steps.append(step)
        report = job.reports / "index.html"
    rejected = [trial for step in steps for trial in step.outcome.rejected]
    if rejected:
        call.line(f"{len(rejected)} trial{'s' * (len(rejected) > 1)} rejected:")
        for trial, reason in rejected if call.verbose else rejected[:LISTED]:
            call.line(f"  {trial}: {reason}")
        if len(rejected) > LISTED and not call.verbose:
            call.line(f"  ... and {len(rejected) - LISTED} more (-v lists all)")
    code = SOME_TRIALS_REJECTED if rejected else 0
    if call.as_json:
        stages = [
            {
                "stage": step.stage.name,
                "why": step.why,
                "notes": step.outcome.notes,
                "rejected": step.outcome.rejected,
                "wall_s": step.wall_s,
            }
            for step in steps
        ]
        content = {
            "campaign": job.campaign.name,
            "exit_code": code,
            "report": str(report) if report.is_file() else None,
            "stages": stages,
        }
        say(json.dumps(content))
    elif report.is_file() and not call.quiet and wanted[-1].report:
        if (summary := report.with_name("summary.txt")).is_file():
            call.line("\n" + summary.read_text(encoding="utf-8"))
        say(str(report))
    sys.exit(code)


def execute_many(
    call: Call,
    campaigns: Sequence[Path],
    only: str | None = None,
    overrides: Mapping[str, object] | None = None,
) -> NoReturn:
    """Run several campaigns, the others where one is refused; ends with the most serious code."""
    from nearlift.run.workers import gravest, run_campaigns
    from nearlift.stages import looks

    ends = []
    with call.busy(f"nearlift: {len(campaigns)} campaigns"):
        for end in run_campaigns(
            campaigns,
            call.out,
            STAGES,
            call.executor,
            call.seed,
            looks.verdicts,
            only,
            overrides,
        ):
            call.line(f"{end.campaign:<24}{end.words}")
            ends.append(end)
            call.progress(
                f"nearlift: {len(ends)} of {len(campaigns)} campaigns", len(ends) / len(campaigns)
            )
    if call.as_json:
        say(json.dumps({"campaigns": [asdict(end) for end in ends]}))
    sys.exit(gravest(ends))
