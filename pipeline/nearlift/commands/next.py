"""next: the visits that a campaign had best make next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from nearlift.commands.common import CAMPAIGN, Call, declared
from nearlift.errors import UsageError
from nearlift.stages.asked import ROUNDS, AskedQuestion

if TYPE_CHECKING:
    from nearlift.results.next_visits import NextVisits


@declared("next")
@CAMPAIGN
@click.option(
    "--for",
    "question",
    required=True,
    metavar="QUESTION",
    help=(
        "A coefficient, such as K_b; separate=A,B for two effects, separate alone for those that"
        " the diagnosis could not distinguish; drift for the supply against time."
    ),
)
@click.option(
    "--until",
    type=click.FloatRange(min=0, min_open=True),
    metavar="U",
    help="Say how many more trials bring the coefficient's standard uncertainty to U.",
)
@click.option(
    "--count",
    type=click.IntRange(1, 1000),
    default=10,
    show_default=True,
    help="Visits at each boundary.",
)
@click.option(
    "--rounds",
    type=click.FloatRange(0, 1),
    default=ROUNDS,
    show_default=True,
    metavar="SHARE",
    help="Of the visits, how many go round all stations, whatever the question.",
)
@click.option("--csv", "as_csv", is_flag=True, help="Rows for the campaign's schedule instead.")
def command(
    call: Call,
    campaign: Path,
    question: str,
    until: float | None,
    count: int,
    rounds: float,
    as_csv: bool,
) -> None:
    """Plan a batch of visits."""
    from nearlift.stages import next_rows, next_visits

    asked = AskedQuestion.parsed(question, until, rounds)
    if as_csv and call.as_json:
        raise UsageError("--csv", "was asked for with --json", "choose one of them")
    with call.job(campaign, keep=True) as job, call.busy(f"nearlift: {job.campaign.name}"):
        batches, elsewhere = next_visits.run(job, asked, count)
        rows = next_rows.as_schedule(job, batches) if as_csv else ""
    boundaries = {batch.boundary: batch.content for batch in batches}
    call.answer(
        {"campaign": job.campaign.name, "boundaries": boundaries, "notes": elsewhere},
        rows or "\n\n".join([*map(_text, batches), *elsewhere]),
    )


def _text(batch: NextVisits) -> str:
    """The visits as a short table, and what they bring."""
    moved = any(v.supply_V is not None for v in batch.visits)
    lines = [
        f"{batch.boundary}, {batch.trials} trials, {batch.base_model}",
        "",
        "visit   distance     z/R" + ("  supply" if moved else "") + "   throttles",
    ]
    for i, v in enumerate(batch.visits):
        free = v.z_hat == float("inf")
        where = f"{'free air':>11}" if free else f"{1e3 * v.distance_m:8.2f} mm"
        supply = f"{v.supply_V:6.2f} V" if v.supply_V is not None else ""
        throttles = " ".join(f"{100 * t:.3g}" for t in v.throttles)
        ratio = "" if free else f"{v.z_hat:.3g}"
        via = f", from {1e3 * v.via_m:.2f} mm" if v.via_m is not None else ""
        lines.append(f"{i + 1:>5}{where}{ratio:>8}{supply}   {throttles} %{via}")
    return "\n".join([*lines, "", *batch.lines, *(f"note: {note}" for note in batch.notes)])
