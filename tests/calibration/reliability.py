"""Reliability of the stated probabilities: of explanations given 70 to 80 %, as many are true.

    python -m tests.calibration.reliability --seed 9720000 --count 675 --out out/reliability.jsonl \
        --figure docs/figures/reliability.png

Rows that `--out` holds already are not run again. Every campaign has 400 trials or fewer. Curve and
decomposition are CORP (Dimitriadis, Gneiting and Jordan 2021, PNAS 118, e2016191118): the isotonic
regression of truth on probability. Band and test draw the true explanation of every campaign from
its own probabilities.

An effect that the test would show in fewer than 80 % of repeats is below the detection limit. Where
the test is silent, "nothing" is then the true explanation: it claims no detectable effect.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import isotonic_regression
from scipy.stats import chi2, ncx2
from tests.calibration import forms, programs
from tests.calibration.assess import headline
from tests.calibration.bench import stream
from tests.calibration.kinds import Kind, Make, random_gain, trials, two_effects
from tests.calibration.programs import Row
from tests.calibration.simulator import Campaign, Errors, Spec, Unreachable, log_lift, simulate

DRAWS = 999
DETECTABLE = 0.8
EDGES = np.array([0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0 + 1e-9])
VISITS = {"visits": 5}
NEAR = (
    "height_offset",
    "held_quantity",
    "image_strength",
    "near_wall_saturation",
    "fountain_shape",
    "airframe_stagnation",
    "plate_edge",
    "tilt",
)
Array = np.ndarray


def _alone(kind: Kind, boundary: str, seed: int) -> Campaign:
    own = int(stream(seed, "draw", kind.name, boundary).integers(2**40))
    spec = Spec(boundary=boundary, realism=bool(seed // 3 % 2), errors=Errors(), **VISITS)
    return simulate(spec, own)


def _two(kind: Kind, boundary: str, seed: int) -> Campaign:
    """Two effects, the weaker of rho 0.26 to 0.52, either visible next to the other."""
    rng = stream(seed, "draw", kind.name, boundary)
    own = int(rng.integers(2**40))
    fields = {"boundary": boundary, "realism": bool(seed // 3 % 2), "errors": Errors(), **VISITS}
    fields["foreign"] = seed // 3 % 3 == 2
    return two_effects(rng, fields, own, scale=1.3, least=0.17)


def _one(rho: tuple[float, float], among: tuple[str, ...] | None = None) -> Make:
    return partial(trials, VISITS, rho=rho, among=among, always=True)


MAKE: dict[str, Make] = {
    "null": _alone,
    "one": _one((0.25, 1.4)),
    "near": _one((0.25, 1.4), NEAR),
    "two": _two,
    "out": _one((0.3, 1.2), tuple(forms.UNNAMED)),
    "strange": _one((0.4, 1.2), tuple(forms.STRANGE)),
    "wander": partial(trials, lambda rng: random_gain(rng) | VISITS),
}
#: The mix of causes, which is the base rate that the probabilities assume: nine seeds of each.
MIX = (
    *("one", "null", "two", "out", "one", "strange", "one", "two", "wander"),
    *("one", "null", "out", "one", "near", "one"),
)


def campaign_of(seed: int) -> tuple[str, Campaign]:
    """Kind and campaign of a seed."""
    name, boundary = MIX[seed // 9 % len(MIX)], forms.BOUNDARIES[seed % 3]
    return name, MAKE[name](Kind(name=f"c_{name}", group="mix", make=MAKE[name]), boundary, seed)


def assess(seed: int) -> Row:
    """Answer of the search, confirmed on visits left out without a search of their own."""
    from nearlift import catalogue
    from nearlift.loop import confirmation
    from nearlift.loop.coefficients import answers
    from nearlift.loop.diagnose import set_up
    from nearlift.loop.search import search_to_convergence
    from nearlift.loop.search_problem import Options

    name, campaign = campaign_of(seed)
    boundary = campaign.spec.boundary
    base = catalogue.model(catalogue.default_base(boundary, 4))
    answer = search_to_convergence(
        set_up(campaign.data, base, campaign.parts, Options(seed=seed))[0]
    )
    problem, named = answer.problem, answer.best.candidate.effects
    scored = confirmation.held_out(problem, None, named)
    if answer.accepted:
        helps = confirmation.improves(problem, scored)
        if not (helps and confirmation.each_helps(problem, scored, named)):
            answer = replace(answer, accepted=())
    if answer.verdict == "adequate":
        answer = replace(answer, contradicted=confirmation.contradictions(problem, scored))
    quoted = answers(answer).estimates().after[forms.HEADLINE[boundary]]
    return {
        "seed": seed,
        "kind": name,
        "boundary": boundary,
        "foreign": campaign.spec.foreign,
        "truth": list(campaign.truth.amplitudes),
        "rho": campaign.truth.rho,
        "power": power(campaign, problem),
        "verdict": answer.verdict,
        "set": [e.effects for e in answer.accepted],
        "probabilities": [
            {
                "effects": e.effects,
                "nameless": e.nameless,
                "other": e.other,
                "probability": e.probability,
            }
            for e in answer.probabilities
        ],
        "covers": quoted.lo90 <= headline(campaign) <= quoted.hi90,
    }


def power(campaign: Campaign, problem: Any) -> float:
    """Chance, in repeats, that the hypothesis nearest to the true signal exceeds the threshold."""
    from nearlift.loop import structure

    pieces = tuple(
        (forms.form(k, campaign.spec.foreign), size)
        for k, size in campaign.truth.amplitudes.items()
    )
    if not pieces:
        return 0.0
    signal = (log_lift(campaign.setting, pieces) - log_lift(campaign.setting, ()))[campaign.keep]
    row = {trial: i for i, trial in enumerate(campaign.data.trial.tolist())}
    white = problem.space.project(signal[[row[trial] for trial in problem.data.trial.tolist()]])
    fit = problem.base_linear_fit
    columns = np.concatenate([part.T @ white for part in fit.basis])[:, None]
    hypotheses = structure.mapped(problem.hypotheses[0], fit.left.whiten)
    _, stacked, ranks = structure.bases(hypotheses, fit.left.removed)
    strength = structure.chi2_of_each(fit.left.residual(columns)[:, 0], stacked, ranks)
    needed = chi2.isf(10.0 ** problem.nothing_added[0].threshold, ranks)
    return float(np.max(ncx2.sf(needed, ranks, np.maximum(strength, 1e-9))))


def entries(row: Row) -> tuple[list[float], list[bool]]:
    """Probabilities of a campaign's explanations, and whether each is true; nameless structure is
    one explanation.
    """
    silent = row.get("verdict") == "adequate" and row.get("power", 1.0) < DETECTABLE
    truth = set() if silent else set(row["truth"])
    outside = bool(truth & {*forms.UNNAMED, *forms.STRANGE})
    listed = [e for e in row["probabilities"] if not e.get("other")]
    unnamed = sum(e["probability"] for e in listed if e.get("nameless"))
    named = [e for e in listed if not e.get("nameless")]
    right = [not outside and set(e["effects"]) == truth for e in named]
    return [unnamed, *(e["probability"] for e in named)], [outside, *right]


def corp(probability: Array, true: Array) -> tuple[Array, Array]:
    """Sorted probabilities, and the isotonic regression of truth on them."""
    order = np.lexsort((true, probability))
    return probability[order], isotonic_regression(true[order]).x


def miscalibration(probability: Array, true: Array) -> float:
    """Mean squared error less that of the isotonic regression, times the number of entries."""
    stated, fitted = corp(probability, true)
    order = np.lexsort((true, probability))
    return float(np.sum((stated - true[order]) ** 2) - np.sum((fitted - true[order]) ** 2))


def stacked(rows: list[Row]) -> tuple[Array, Array, Array]:
    """Probabilities and truth of all entries of all campaigns, and the campaign of each."""
    each = [entries(row) for row in rows]
    probability = np.array([p for ps, _ in each for p in ps])
    true = np.array([float(t) for _, ts in each for t in ts])
    return probability, true, np.repeat(np.arange(len(each)), [len(ps) for ps, _ in each])


def drawn(probability: Array, campaign: Array, rng: np.random.Generator) -> Array:
    """Truth of all entries if the probabilities are right: at most one true entry a campaign."""
    total = np.bincount(campaign, probability)
    below = np.cumsum(probability) - (np.cumsum(total) - total)[campaign] - probability
    u = rng.random(len(total))[campaign]
    return ((below < u) & (u <= below + probability)).astype(float)


def reliability(rows: list[Row], seed: int = 0) -> dict[str, Any]:
    """Counts and shares by bins of probability, Brier scores, and the p-value of the joint test."""
    probability, true, campaign = stacked(rows)
    rng = np.random.default_rng(seed)
    observed = miscalibration(probability, true)
    null = [miscalibration(probability, drawn(probability, campaign, rng)) for _ in range(DRAWS)]
    entry = pd.DataFrame({"stated": probability, "true": true, "campaign": campaign})
    bins = entry.groupby(pd.cut(probability, EDGES, right=False, labels=EDGES[:-1]), observed=True)
    table = bins[["stated", "true"]].mean().assign(n=bins.size()).rename_axis("from").reset_index()
    # a truth that is not listed has probability 0; a best name alone is one stated with certainty
    unlisted = len(rows) - true.sum()
    best = entry.groupby("campaign")["stated"].idxmax()
    return {
        "campaigns": len(rows),
        "bins": table.to_dict("records"),
        "brier": float((np.sum((probability - true) ** 2) + unlisted) / len(rows)),
        "brier_of_best_name": float(2 - 2 * true[best].mean()),
        "p_value": (1 + sum(value >= observed for value in null)) / (1 + DRAWS),
    }


def draw(rows: list[Row], file: Path) -> None:
    """Write the reliability diagram: CORP curve, 95 % consistency band, and counts of entries."""
    from matplotlib.figure import Figure

    probability, true, campaign = stacked(rows)
    rng, grid = np.random.default_rng(1), np.linspace(0, 1, 101)
    truths = (drawn(probability, campaign, rng) for _ in range(DRAWS))
    band = [np.interp(grid, *corp(probability, truth)) for truth in truths]
    low, high = np.quantile(band, [0.025, 0.975], axis=0)
    figure = Figure(figsize=(5.0, 5.6), layout="constrained")
    axes, counts = figure.subplots(2, 1, height_ratios=[4, 1], sharex=True)
    axes.fill_between(100 * grid, 100 * low, 100 * high, color="0.85", label="95 % if calibrated")
    axes.plot([0, 100], [0, 100], color="0.5", lw=0.8)
    stated, fitted = corp(probability, true)
    axes.plot(100 * stated, 100 * fitted, color="C0", label=f"{len(rows)} campaigns")
    axes.set(ylabel="true, %", xlim=(0, 100), ylim=(0, 100))
    axes.legend(loc="upper left", frameon=False)
    counts.hist(100 * probability, bins=20, range=(0, 100), color="C0")
    counts.set(yscale="log", xlabel="stated probability of an explanation, %", ylabel="entries")
    figure.savefig(file, dpi=150, metadata={"Software": None})


def _assess(job: tuple[int]) -> list[Row]:
    try:
        return [assess(*job)]
    except Unreachable:
        return []


def main() -> None:
    """Run what is missing, print the table, draw."""
    parser = programs.parser(__doc__, 9_720_000, 0)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    jobs = [(seed,) for seed in range(given.seed, given.seed + given.count)]
    with programs.opened(given.executor) as executor:
        rows = programs.collect(executor, _assess, jobs, ("seed",), given.out)
    print(json.dumps(reliability(rows), indent=1))
    if given.figure:
        draw(rows, given.figure)


if __name__ == "__main__":
    # by the name that workers know this module by
    from tests.calibration.reliability import main as run_main

    run_main()
