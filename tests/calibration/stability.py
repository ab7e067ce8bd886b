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
import pandas as pd
from tests.calibration import forms, oracle, spread
from tests.calibration.assess import engine
from tests.calibration.kinds import REPORTED, draw
from tests.calibration.simulator import Campaign

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
    return {
        "kind": kind,
        "boundary": boundary,
        "seed": seed,
        "verdict": whole.verdict,
        "moves": sum(abs(shift) > 1 for shift, _ in moves.values()),
        "turns": sum(verdict != whole.verdict for _, verdict in moves.values()),
        "rests_on": rests.trial if rests else "",
        "tried": moves,
    }


def _assess(job: Job) -> Row:
    return assess(*job)


def counts(rows: pd.DataFrame) -> pd.Series:
    """How many campaigns moved or turned without one trial, and how many did so unreported."""
    moved, turned = rows["moves"] > 0, (rows["turns"] > 0) & (rows["moves"] == 0)
    reported = rows["rests_on"] != ""
    return pd.Series(
        {
            "campaigns": len(rows),
            "moves by more than u": moved.sum(),
            "of these not reported": (moved & ~reported).sum(),
            "verdict alone turns": turned.sum(),
            "of these not reported ": (turned & ~reported).sum(),
        }
    )


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
        for row in spread.unordered(executor, _assess, jobs):
            rows.append(row)
            if given.out:
                with given.out.open("a") as stream:
                    stream.write(json.dumps(row) + "\n")
    data = pd.DataFrame(rows)
    print(pd.concat([data, data.assign(kind="all")]).groupby("kind").apply(counts).to_string())


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.stability import main as run_main

    run_main()
