"""run: all stages of one campaign or several, once or while it is being recorded; or what such a
run would do, or whether files are what they were.
"""

from __future__ import annotations

import functools
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from nearlift.commands.common import Call, declared, end_politely
from nearlift.commands.stage import execute, execute_many
from nearlift.errors import ProductError, UsageError
from nearlift.printing import say
from nearlift.stages import ORDER, STAGES
from nearlift.stages.asked import ROUNDS, AskedQuestion


@declared("run")
@click.argument(
    "campaigns", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="CAMPAIGN..."
)
@click.option(
    "--only",
    type=click.Choice(ORDER),
    metavar="STAGE",
    help=f"Run this stage alone, even if it is up to date: {', '.join(ORDER)}.",
)
@click.option("--dry-run", is_flag=True, help="Run nothing; say which stages are stale, and why.")
@click.option(
    "--check",
    is_flag=True,
    help=(
        "Run nothing; hash inputs and products, list those that differ from provenance.json,"
        " and end with 4 if any does."
    ),
)
@click.option(
    "--watch",
    is_flag=True,
    help="Go on: run again whenever CAMPAIGN's folder has changed, until Ctrl-C.",
)
@click.option(
    "--every",
    type=click.FloatRange(min=0.1),
    default=5.0,
    show_default=True,
    metavar="SECONDS",
    help="How often --watch looks.",
)
@click.option(
    "--next",
    "question",
    metavar="QUESTION",
    help="With --watch: say after each look what to visit next, as `nearlift next --for` does.",
)
@click.option(
    "--until",
    type=click.FloatRange(min=0, min_open=True),
    metavar="U",
    help="With --next: the coefficient's standard uncertainty at which to stop.",
)
@click.option(
    "--rounds",
    type=click.FloatRange(0, 1),
    show_default=str(ROUNDS),
    metavar="SHARE",
    help="With --next: of the visits, how many go round all stations.",
)
def command(
    call: Call,
    campaigns: tuple[Path, ...],
    only: str | None,
    dry_run: bool,
    check: bool,
    watch: bool,
    every: float,
    **visits: Any,
) -> None:
    """Run, watch, plan or check the campaigns."""
    modes = {"--only": bool(only), "--dry-run": dry_run, "--check": check, "--watch": watch}
    chosen = [mode for mode, asked in modes.items() if asked]
    if len(chosen) > 1:
        raise UsageError(chosen[0], f"was given with {chosen[1]}", "choose one of them")
    question, until, rounds = visits["question"], visits["until"], visits["rounds"]
    given = {"--next": question, "--until": until, "--rounds": rounds}
    first = next((name for name, value in given.items() if value is not None), None)
    if first and not (watch and question):
        raise UsageError(
            first,
            f"needs {'--watch' if question else '--next'}",
            "`nearlift next` plans the visits of a finished campaign",
        )
    if dry_run:
        call.answers("campaigns", [planned(call, campaign) for campaign in campaigns])
    elif check:
        check_files(call, campaigns)
    elif watch:
        if len(campaigns) > 1:
            raise UsageError(
                "--watch",
                f"was given {len(campaigns)} campaigns",
                "watch one; run the others in terminals of their own",
            )
        share = ROUNDS if rounds is None else rounds
        asked = AskedQuestion.parsed(question, until, share) if question else None
        follow(call, campaigns[0], every, asked)
    elif len(campaigns) == 1:
        execute(call, campaigns[0], only)
    else:
        execute_many(call, campaigns, only)


def planned(call: Call, campaign: Path) -> tuple[dict[str, Any], str]:
    """Each stage with the reason why it is stale, for machines and in words."""
    from nearlift.run import engine

    with call.job(campaign) as job:
        steps = [(stage.name, why) for stage, why in engine.plan(job)]
    stages = [{"stage": name, "stale": bool(why), "why": why} for name, why in steps]
    lines = (f"{name:<8} {'run: ' + why if why else 'up to date'}" for name, why in steps)
    return {"campaign": job.campaign.name, "stages": stages}, "\n".join(lines)


def check_files(call: Call, campaigns: tuple[Path, ...]) -> None:
    """List the files that differ from provenance.json; ends with 4 if any does."""
    from nearlift.campaign import manifest as manifests
    from nearlift.run.engine import differences

    answers, any_differs = [], False
    for campaign in campaigns:
        given = manifests.load(campaign)
        checked, differing = differences(campaign, call.out, given, STAGES)
        same = f"{checked - len(differing)} of {checked} files are what they were"
        content = {"campaign": given.name, "checked": checked, "differing": differing}
        answers.append((content, "\n".join([*differing, same])))
        any_differs |= bool(differing)
    call.answers("campaigns", answers)
    if any_differs:
        sys.exit(ProductError.exit_code)


def follow(call: Call, campaign: Path, period_s: float, asked: AskedQuestion | None) -> None:
    """Run a campaign that is being recorded until interrupted; with --json, one object a round."""
    from nearlift.run.watch import watch
    from nearlift.stages import looks

    end_politely()
    call.line(f"watching {campaign} every {period_s:g} s; Ctrl-C ends it")
    rounds = watch(
        campaign,
        call.out,
        STAGES,
        call.executor,
        call.seed,
        functools.partial(looks.look, asked),
        period_s,
        call.progress,
    )
    for latest in rounds:
        for line in (latest.words, *latest.next):
            call.line(line)
        if call.as_json:
            say(json.dumps(asdict(latest)))
