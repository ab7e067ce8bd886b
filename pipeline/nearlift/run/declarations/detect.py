"""Stage detect: how far away a boundary shows in lift, and where it is."""

from __future__ import annotations

from nearlift.run.declarations.diagnose import DIAGNOSIS
from nearlift.run.declarations.fit import FIT, RESULTS
from nearlift.run.declarations.ingest import TRIALS
from nearlift.run.schema import Column, Product
from nearlift.run.stage import Option, Question, Stage

DETECTION = Product(
    file="detection.parquet",
    title="Detection range",
    row="a boundary, an averaging time, an uncertainty of payload and one of the supply",
    columns=(
        Column(name="boundary", kind="text", meaning="ground, ceiling or sidewall"),
        Column(name="model", kind="text", meaning="name of the lift model"),
        Column(
            name="averaging_s",
            unit="s",
            meaning="time over which lift (or the throttle to hover) is averaged",
        ),
        Column(name="payload", unit="1", meaning="relative standard uncertainty of the weight"),
        Column(
            name="voltage", unit="1", meaning="relative standard uncertainty of the supply voltage"
        ),
        Column(
            name="supply",
            unit="1",
            meaning="relative standard uncertainty of lift from that of the supply voltage",
        ),
        Column(name="sigma", unit="1", meaning="standard deviation of the ratio's estimate"),
        Column(
            name="needed",
            unit="1",
            meaning="change of lift noticed at the rates of false alarms and misses",
        ),
        Column(
            name="range_z_hat",
            unit="1",
            meaning=(
                "farthest distance at which lift changes so much; nan: nowhere that was measured"
            ),
        ),
        Column(
            name="lo90",
            unit="1",
            meaning=(
                "lower end of its 90 % interval over the model's uncertainty; 0: perhaps nowhere"
            ),
        ),
        Column(name="hi90", unit="1", meaning="upper end"),
        Column(name="range_m", unit="m", meaning="the same distance"),
    ),
)
PROXIMITY = Product(file="proximity.json", title="Where the boundary is, from lift", row="boundary")
PROXIMITY_PRODUCTS = (DETECTION, PROXIMITY)
STAGE = Stage(
    name="detect",
    summary="how far away a boundary shows in lift",
    help="Only where the manifest has [detect].",
    reads=(TRIALS, FIT, DIAGNOSIS, RESULTS),
    writes=PROXIMITY_PRODUCTS,
    sections=("vehicle", "rig", "detect"),
    where="detect",
    question=Question(
        module="nearlift.commands.reading",
        example="--boundary ground --ratio 1.12 --u '1 percent'",
        options=(
            Option(
                flag="--boundary",
                choices=("ground", "ceiling", "sidewall"),
                help="Instead of the stage: where is it, by this reading?",
            ),
            Option(flag="--ratio", real=True, help="Lift over lift far away."),
            Option(
                flag="--throttle", help='Throttle at which the vehicle hovers, e.g. "55 percent".'
            ),
            Option(
                flag="--u",
                help='Standard uncertainty of the ratio or the throttle, e.g. "1 percent".',
            ),
            Option(flag="--weight-u", help="Relative standard uncertainty of the weight."),
            Option(flag="--supply-u", help="Relative standard uncertainty of the supply voltage."),
            Option(
                flag="--mass",
                help='Mass with payload, e.g. "29 g"; the vehicle\'s if not given.',
            ),
        ),
    ),
)
