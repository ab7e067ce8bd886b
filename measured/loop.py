"""Diagnosis of a campaign of means: by the command line, and in this process for many variants."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

from nearlift.campaign import manifest as manifests
from nearlift.campaign.manifest import Campaign
from nearlift.cli import main
from nearlift.errors import NotConverged
from nearlift.likelihood import budget, noise
from nearlift.loop import coefficients, confirmation
from nearlift.loop.diagnose import decide, set_up
from nearlift.loop.findings import named_effects
from nearlift.loop.search_problem import Options
from nearlift.observed import boundaries, choice, observe
from nearlift.results import Observations
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS

#: Of more trials, only the most influential is left out; of more visits, all of one distance.
MOST = 24
Interval = tuple[float, float, float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Finding:
    """Answer of the loop: named effects with their rivals, held-out rms error in fractions of lift
    (value and 90 % interval), noise floor, and the headline coefficient (value and 90 % interval).
    """

    verdict: str
    effects: tuple[tuple[str, tuple[str, ...]], ...]
    before: Interval | None
    after: Interval | None
    floor: float
    coefficient: str
    number: Interval

    @property
    def names(self) -> set[str]:
        """All names in the answer, rivals included."""
        return {name for first, rivals in self.effects for name in (first, *rivals)}

    @classmethod
    def load(cls, path: Path) -> Finding:
        """Finding kept in a JSON file."""
        kept = json.loads(path.read_text())
        kept["effects"] = tuple((name, tuple(rivals)) for name, rivals in kept["effects"])
        return cls(**{k: tuple(v) if isinstance(v, list) else v for k, v in kept.items()})

    def save(self, path: Path) -> None:
        """Keep the finding in a JSON file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(dataclasses.asdict(self)))


def stages(folder: Path, out: Path, *names: str) -> None:
    """Run these stages by the command line."""
    for stage in names:
        answer = CliRunner().invoke(main, [stage, str(folder), "--out", str(out), "-q"])
        if answer.exit_code not in (0, 3):
            raise SystemExit(f"{folder}, {stage}: {answer.output}")


def ingested(folder: Path, out: Path) -> tuple[Campaign, Observations]:
    """Campaign and accepted trials of its only boundary."""
    campaign = manifests.load(folder)
    trials = tables.read_table(out / "processed" / campaign.name / TRIALS.file, TRIALS)
    (boundary,) = boundaries(trials)
    return campaign, observe(trials, campaign, boundary)


def diagnosed(campaign: Campaign, data: Observations) -> Finding:
    """Search and cross-validation, without the chapters of `nearlift diagnose`.

    Raises
    ------
    NotConverged
        The trials cannot be diagnosed.
    """
    base, _ = choice(campaign, data.boundary)
    parts, options = budget.components(campaign), Options()
    ground, _, _ = set_up(data, base, parts, options)
    decided = decide(ground, True, options.false_alarm_rate)
    answer, problem = decided.answer, decided.answer.problem
    floor = noise.floor(problem.data, problem.noise, problem.slope)
    before = after = None
    if decided.scored is not None:
        error = confirmation.error(answer, decided.scored, floor)
        before, after = ((e.held_out_rmse, e.lo90, e.hi90) for e in (error.before, error.after))
    name, c = next(iter(coefficients.answers(answer).estimates().after.items()))
    return Finding(
        verdict=answer.verdict,
        effects=tuple((e.name, tuple(e.rivals)) for e in named_effects(problem, answer)),
        before=before,
        after=after,
        floor=float(floor),
        coefficient=name,
        number=(c.value, c.lo90, c.hi90),
    )


def same(campaign: Campaign, data: Observations, found: dict[str, Any]) -> bool:
    """Whether the loop finds the same verdict in these trials, and each effect, possibly as a
    rival.
    """
    try:
        again = diagnosed(campaign, data)
    except NotConverged:
        return False
    return again.verdict == found["verdict"] and all(
        again.names & {e["name"], *e["rivals"]} for e in found["effects"]
    )


def stability(folder: Path, out: Path, found: dict[str, Any], heaviest: str) -> dict[str, Any]:
    """Count of equal answers without each visit and each trial, and those that differ."""
    campaign, data = ingested(folder, out)
    group, word = data.visit, "visit"
    if len(np.unique(group)) > MOST:
        group, word = np.unique(data.z_hat, return_inverse=True)[1], "distance"
    visits = np.unique(group)
    by_visit = [same(campaign, data.take(group != v), found) for v in visits]
    order = np.arange(data.n)
    if data.n > MOST:
        order = np.flatnonzero(data.trial == heaviest)
    by_trial = [same(campaign, data.take(np.arange(data.n) != i), found) for i in order]
    lost = [f"{word} {v}" for v, held in zip(visits, by_visit, strict=True) if not held]
    lost += [str(data.trial[i]) for i, held in zip(order, by_trial, strict=True) if not held]
    return {
        "visits": [sum(by_visit), len(by_visit)],
        "trials": [sum(by_trial), len(by_trial)],
        "lost": lost,
    }
