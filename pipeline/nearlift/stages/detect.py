"""Stage detect: how far away a boundary shows in lift, and where it is."""

from __future__ import annotations

import click

from nearlift.run.engine import Job, Outcome, Stage
from nearlift.run.tables import Product, real, text
from nearlift.stages.diagnose import DIAGNOSIS, quoted_lifts
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.ingest import TRIALS

DETECTION = Product(
    file="detection.parquet",
    title="Detection range",
    row="a boundary, an averaging time, an uncertainty of payload and one of the supply",
    columns=(
        text("boundary", "ground, ceiling or sidewall"),
        text("model", "name of the lift model"),
        real("averaging_s", "s", "time over which lift (or the throttle to hover) is averaged"),
        real("payload", "1", "relative standard uncertainty of the weight"),
        real("voltage", "1", "relative standard uncertainty of the supply voltage"),
        real(
            "supply", "1", "relative standard uncertainty of lift from that of the supply voltage"
        ),
        real("sigma", "1", "standard deviation of the ratio's estimate"),
        real(
            "false_alarms_per_hour",
            "1/h",
            "of decisions at the rate of false alarms, one after each averaging time",
        ),
        real("needed", "1", "change of lift noticed at the rates of false alarms and misses"),
        real(
            "range_z_hat",
            "1",
            "farthest distance at which lift changes so much; nan: at no measured distance",
        ),
        real(
            "lo90",
            "1",
            "lower end of its 90 % interval over the model's uncertainty; 0: perhaps at none",
        ),
        real("hi90", "1", "upper end"),
        real("range_m", "m", "the same distance"),
    ),
)
PROXIMITY = Product(
    file="proximity.json", title="Where the boundary is, from lift", row="boundary", version=2
)
PROXIMITY_PRODUCTS = (DETECTION, PROXIMITY)


def run(job: Job) -> Outcome:
    """Write detection.parquet and proximity.json."""
    from nearlift.flight.proximity import proximity

    rows, content, notes = proximity(quoted_lifts(job), job.say)
    job.write(DETECTION, DETECTION.columns_of(rows))
    job.write(PROXIMITY, {"schema": PROXIMITY.schema, **content})
    return Outcome(notes=notes)


STAGE = Stage(
    name="detect",
    run=run,
    summary="find how far away lift reveals a boundary",
    help="Only where the manifest has [detect].",
    reads=(TRIALS, FIT, DIAGNOSIS, RESULTS),
    writes=PROXIMITY_PRODUCTS,
    sections=("vehicle", "rig", "detect"),
    where="detect",
    question=(
        click.Option(
            ["--boundary"],
            type=click.Choice(("ground", "ceiling", "sidewall")),
            help="Instead of the stage: where is it, by this reading?",
        ),
        click.Option(["--ratio"], type=float, help="Lift over lift far away."),
        click.Option(
            ["--throttle"], help='Throttle at which the vehicle hovers, e.g. "55 percent".'
        ),
        click.Option(
            ["--u"], help='Standard uncertainty of the ratio or the throttle, e.g. "1 percent".'
        ),
        click.Option(["--weight-u"], help="Relative standard uncertainty of the weight."),
        click.Option(["--supply-u"], help="Relative standard uncertainty of the supply voltage."),
        click.Option(
            ["--mass"], help='Mass with payload, e.g. "29 g"; the vehicle\'s if not given.'
        ),
    ),
    example="--boundary ground --ratio 1.12 --u '1 percent'",
)
