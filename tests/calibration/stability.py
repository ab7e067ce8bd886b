"""How often an answer turns on a single trial, and whether the answer says so.

    python -m tests.calibration.stability --count 200 --seed 760000

Each campaign is diagnosed, and again without each of its trials that could matter: those that move
the base fit's headline most, those whose residuals are largest, and some at random. An answer that
moves by more than its standard uncertainty, or whose verdict changes, without one trial must say
that it rests on it.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from tests.calibration import forms, oracle, spread
from tests.calibration.assess import engine
from tests.calibration.kinds import REPORTED, draw
from tests.calibration.simulator import Campaign
from tests.calibration.streams import unordered

from nearlift.loop import stability

KINDS = ("null", "one", "two", "outside", "outliers", "bad_visit", "t3", "noisier_near")
MOST, AT_RANDOM = 3, 1
LOOK, TRIES = stability.LOOK, stability.TRIES

Row = dict[str, Any]
Job = tuple[str, str, int]


def suspects(campaign: Campaign) -> list[int]:
    """The trials to leave out: of the largest pull on the headline, of the largest residuals, and
    some at random. By the referee's own fit of the base model; nothing is asked of the library.
    """
    data = campaign.data
    fit = oracle.fit(campaign, ())
    left = campaign.whitener(np.log(data.lift_N) - fit.predicted)
    columns = campaign.whitener(np.hstack([campaign.jacobian[:, :1], campaign.indicator]))
    pull = left * np.linalg.pinv(columns)[0]
    drawn = np.random.default_rng(campaign.seed).choice(data.n, AT_RANDOM, replace=False)
    most = [np.argsort(-np.abs(x))[:MOST] for x in (pull, left)]
    return sorted({int(i) for i in np.concatenate([*most, drawn])})


def without(campaign: Campaign, trial: int) -> Campaign:
    """The campaign as if that trial had been rejected."""
    keep = np.ones(campaign.data.n, dtype=bool)
    keep[trial] = False
    return replace(campaign, data=campaign.data.take(keep))


def assess(kind: str, boundary: str, seed: int) -> Row:
    """The largest move of the headline by one trial, in standard uncertainties, and what is said."""
    campaign = draw(kind, boundary, seed)
    name = forms.HEADLINE[boundary]
    whole = engine(campaign)["result"]
    headline, rests = whole.coefficients[name], whole.rests_on
    moves = {}
    # whether the rest in turn hangs on a trial is not asked
    stability.LOOK, stability.TRIES = inf, 0
    for i in suspects(campaign):
        # visits left out have their say only where the search does not find the same again
        for confirm in (False, True):
            again = engine(without(campaign, i), confirm=confirm)["result"]
            shift = (again.coefficients[name].value - headline.value) / headline.u
            moves[str(campaign.data.trial[i])] = (float(shift), again.verdict)
            if abs(shift) <= 1 and again.verdict == whole.verdict:
                break
    stability.LOOK, stability.TRIES = LOOK, TRIES
    far = {t: m for t, m in moves.items() if abs(m[0]) > 1 or m[1] != whole.verdict}
    return {
        "kind": kind,
        "boundary": boundary,
        "seed": seed,
        "verdict": whole.verdict,
        "tried": len(moves),
        "largest": max(abs(m[0]) for m in moves.values()),
        "moves": sum(abs(m[0]) > 1 for m in moves.values()),
        "turns": sum(m[1] != whole.verdict for m in moves.values()),
        "rests_on": rests.trial if rests else "",
        "untold_move": bool(not rests and any(abs(m[0]) > 1 for m in far.values())),
        "untold_turn": bool(not rests and far and not any(abs(m[0]) > 1 for m in far.values())),
        "far": {t: list(m) for t, m in far.items()},
    }


def _assess(job: Job) -> Row:
    return assess(*job)


def table(rows: list[Row]) -> str:
    """A line for each kind of campaign."""
    text = (
        "| kind | campaigns | moves by more than u | untold | verdict alone turns | untold |\n"
        "|---|---|---|---|---|---|\n"
    )
    for kind in (*dict.fromkeys(r["kind"] for r in rows), "all"):
        mine = [r for r in rows if kind in (r["kind"], "all")]
        moved = [r for r in mine if r["moves"]]
        turned = [r for r in mine if r["turns"] and not r["moves"]]
        counts = (
            len(mine),
            len(moved),
            sum(r["untold_move"] for r in mine),
            len(turned),
            sum(r["untold_turn"] for r in mine),
        )
        text += f"| {kind} | {' | '.join(map(str, counts))} |\n"
    return text


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=REPORTED)
    parser.add_argument("--out", type=Path)
    spread.add_option(parser)
    given = parser.parse_args()
    jobs: list[Job] = [
        (KINDS[i % len(KINDS)], forms.BOUNDARIES[i // len(KINDS) % 3], given.seed + i)
        for i in range(given.count)
    ]
    rows = []
    with spread.opened(given.executor) as executor:
        for row in unordered(executor, _assess, jobs):
            rows.append(row)
            if given.out:
                with given.out.open("a") as stream:
                    stream.write(json.dumps(row) + "\n")
    print(table(sorted(rows, key=lambda r: r["seed"])))


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.stability import main as run_main

    run_main()
