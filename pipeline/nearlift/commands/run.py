"""run: all stages of one campaign or several, once or for as long as it is being recorded."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

import click

from nearlift.commands.common import Call, declared, end_politely
from nearlift.commands.stage import execute
from nearlift.errors import UsageError
from nearlift.stages.asked import ROUNDS, AskedQuestion


@declared("run")
@click.argument(
    "campaigns", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="CAMPAIGN..."
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
    watch: bool,
    every: float,
    question: str | None,
    until: float | None,
    rounds: float | None,
) -> None:
    """Once, again and again, or for each of them."""
    given = {"--next": question, "--until": until, "--rounds": rounds}
    first = next((name for name, value in given.items() if value is not None), None)
    if first and not (watch and question):
        raise UsageError(
            first,
            f"needs {'--watch' if question else '--next'}",
            "`nearlift next` plans the visits of a campaign that nobody watches",
        )
    if watch:
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
        execute(call, campaigns[0])
    else:
        execute_many(call, campaigns)


def execute_many(call: Call, campaigns: tuple[Path, ...]) -> None:
    """Run several campaigns, the others where one is refused; ends with the gravest exit code."""
    from nearlift.run import many

    ends = []
    with call.busy(f"nearlift: {len(campaigns)} campaigns"):
        for end in many.run(campaigns, call.out, call.executor, call.seed):
            call.line(f"{end.campaign:<24}{end.words}")
            ends.append(end)
            call.progress(
                f"nearlift: {len(ends)} of {len(campaigns)} campaigns", len(ends) / len(campaigns)
            )
    if call.as_json:
        click.echo(json.dumps({"campaigns": [asdict(end) for end in ends]}))
    sys.exit(many.gravest(ends))


def follow(call: Call, campaign: Path, period_s: float, asked: AskedQuestion | None) -> None:
    """Run a campaign that is being recorded until interrupted; with --json, one object a round."""
    from nearlift.run.graph import STAGES
    from nearlift.run.watch import watch

    end_politely()
    call.line(f"watching {campaign} every {period_s:g} s; Ctrl-C ends it")
    looks = watch(
        campaign, call.out, call.executor, call.seed, period_s, call.progress, STAGES, asked
    )
    for latest in looks:
        for line in (latest.words, *latest.next):
            call.line(line)
        if call.as_json:
            click.echo(json.dumps(asdict(latest)))
