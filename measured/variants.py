"""Variants of measured campaigns: an effect put into the trials by arithmetic, or a logged cause
withheld; and the answer of the loop to each.

Sizes are in units of the campaign's noise floor: the rms of the relative change of lift over its
trials. A synthetic voltage acts with an exponent of 2; a logged one is made to act more. Heights
are in millimetres, as a lab reads them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import tomlkit
from click.testing import CliRunner
from pydantic import TypeAdapter

from nearlift.campaign import manifest as manifests
from nearlift.campaign.manifest import Campaign
from nearlift.cli import main
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.likelihood import budget, noise
from nearlift.loop import coefficients, confirmation
from nearlift.loop.diagnose import decide, set_up
from nearlift.loop.search_problem import Options
from nearlift.observed import boundaries, choice, observe
from nearlift.randomness import generator
from nearlift.results import Observations
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS

SEED = 46
#: Effects that are put into trials; each is the library's of the same name.
KINDS = ("gain_drift", "zero_offset", "session_gain", "supply_sag", "height_offset")
SIZES, HEIGHTS_MM = (1.0, 2.0, 4.0), (0.3, 1.0)
SAG_EXPONENT = 2.0
#: Columns that hold a logged cause, by campaign.
WITHHELD = {
    "pitt-ras-2017": ("supply",),
    "garofano-soldado-2023": ("tilt", "beta"),
    "garofano-soldado-2023-axes": ("tilt", "beta"),
    "jirs2024-ground-10-inch": ("rpm",),
    "jirs2024-ground-12-inch": ("rpm",),
    "jirs2024-ceiling-10-inch": ("rpm",),
    "jirs2024-ceiling-12-inch": ("rpm",),
}
#: A shorter table is diagnosed as published, without an order; a drift has no name there.
FEWEST_ORDERED = 45
MM_PER = {"m": 1e3, "cm": 1e1, "mm": 1.0}
#: Of more trials, only the most influential is left out; of more visits, all of one distance.
MOST = 24
Interval = tuple[float, float, float]


@dataclass(frozen=True)
class Case:
    """Variant of a campaign: of a kind of `KINDS`, or ``published`` (as it is), ``withheld``
    (without the columns of `WITHHELD`) or ``none`` (nothing put in, but with the order, start and
    supply that variants have and the lab did not publish).
    """

    campaign: str
    kind: str = "none"
    size: float = 0.0

    @property
    def name(self) -> str:
        """Name of its campaign on disk."""
        size = f"-{self.size:g}" if self.size else ""
        return f"{self.campaign}--{self.kind.replace('_', '-')}{size}".replace(".", "p")

    @property
    def reference(self) -> Case:
        """Variant that it is compared with."""
        return Case(self.campaign, "none" if self.kind in KINDS else "published")


def cases(campaign: str) -> Iterator[Case]:
    """All variants of one campaign."""
    if campaign in WITHHELD:
        yield Case(campaign, "withheld")
        # the forces along the axes are the vertical ones, divided
        for kind in () if campaign.endswith("-axes") else KINDS:
            for size in HEIGHTS_MM if kind == "height_offset" else SIZES:
                yield Case(campaign, kind, size)


# ---- trials of a variant


def write(case: Case, folder: Path, made: Path, floor: float) -> None:
    """Write the variant's manifest and trials."""
    manifest = tomlkit.parse((folder / "campaign.toml").read_text(encoding="utf-8")).unwrap()
    trials, units = manifest["trials"], manifest["trials"]["units"]
    table = pd.read_csv(folder / "trials.csv", dtype={"trial": str, "session": str})
    if case.kind == "withheld":
        table = table.drop(columns=list(WITHHELD[case.campaign]))
        for column in WITHHELD[case.campaign]:
            units.pop(column, None)
    elif case.kind != "published":
        if trials.get("order") == "unknown" and len(table) >= FEWEST_ORDERED:
            del trials["order"]
        if "start" not in table:
            table = in_random_order(table, case.campaign)
        sag = max(case.size, 1.0) if case.kind == "supply_sag" else 1.0
        table = logged(table, case.campaign, sag * floor / SAG_EXPONENT)
        manifest["trials"]["units"] = {"start": "s", "supply": "V", **units}
        if case.kind == "height_offset":
            table["distance"] += case.size / MM_PER[units["distance"]]
        elif case.kind != "none":
            change = relative_change(table, case.kind)
            table["lift"] *= 1 + case.size * floor * change / np.sqrt(np.mean(change**2))
    manifest["name"] = case.name
    made.mkdir(parents=True, exist_ok=True)
    (made / "campaign.toml").write_text(tomlkit.dumps(manifest), encoding="utf-8")
    table.to_csv(made / "trials.csv", index=False)


def in_random_order(table: pd.DataFrame, seed: str) -> pd.DataFrame:
    """Table in the order in which a lab might have measured it, which is not published: sessions in
    random order, and trials in random order within each.
    """
    rng = generator(SEED, "order", seed)
    if "session" not in table:
        mixed = table.iloc[rng.permutation(len(table))].reset_index(drop=True)
        return mixed.assign(session=(1 + mixed.index // 5).astype(str))
    sessions = [table[table["session"] == s] for s in rng.permutation(np.unique(table["session"]))]
    order = np.concatenate([rng.permutation(g.index) for g in sessions])
    return table.loc[order].reset_index(drop=True)


def logged(table: pd.DataFrame, seed: str, rms: float) -> pd.DataFrame:
    """Table with a start and a supply voltage where the lab logged none: 20 s from trial to trial,
    and a battery that falls within each session, by this rms of its logarithm over all trials.
    """
    rng, session = generator(SEED, "supply", seed), table.groupby("session")
    spent = (session.cumcount() / session["lift"].transform("size")).to_numpy()
    fall = 0.1 * rng.standard_normal(len(table)) - spent
    volts = 4.0 * np.exp(rms * (fall - fall.mean()) / fall.std())
    log = pd.DataFrame({"start": 20.0 * np.arange(len(table)), "supply": volts})
    return pd.concat([log.drop(columns=log.columns.intersection(table.columns)), table], axis=1)


def relative_change(table: pd.DataFrame, kind: str) -> FloatArray:
    """Relative change of each trial's lift, of any size."""
    if kind == "gain_drift":
        start = table["start"].to_numpy()
        return np.asarray(2 * (start - start.min()) / np.ptp(start) - 1)
    if kind == "zero_offset":
        return 1 / table["lift"].to_numpy()
    if kind == "session_gain":
        _, index = np.unique(table["session"], return_inverse=True)
        gain = generator(SEED, "session gain").standard_normal(index.max() + 1)
        return np.asarray((gain - gain.mean())[index])
    log_volts = np.log(table["supply"].to_numpy())
    return np.asarray(log_volts - log_volts.mean())


# ---- answer of the loop


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Answer of the loop: explanations (each the names of its effects, the likeliest first),
    probability of the answer, held-out rms error in fractions of lift (value and 90 % interval),
    noise floor, and the headline coefficient (value and 90 % interval).
    """

    verdict: str
    explanations: tuple[tuple[str, ...], ...]
    probability: float
    before: Interval | None
    after: Interval | None
    floor: float
    coefficient: str
    number: Interval

    @property
    def names(self) -> set[str]:
        """All names in the answer, rivals included."""
        return {name for names in self.explanations for name in names}


STORED = TypeAdapter(Finding)


def outcome(case: Case, answer: Finding, without: Finding) -> str:
    """Found, false (a name that is neither the cause nor in the answer without it), abstained
    (*unexplained*), or missed.
    """
    if case.kind in answer.names - without.names:
        return "found"
    if answer.names and not answer.names & (without.names | {case.kind}):
        return "false"
    if answer.verdict == "unexplained":
        return "abstained"
    return "found" if case.kind in answer.names else "missed"


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
    ground, _, _ = set_up(data, base, budget.components(campaign), Options())
    answer = decide(ground, True, ground.options.false_alarm_rate)
    problem = answer.problem
    floor = noise.floor(problem.data, problem.noise, problem.slope)
    before = after = None
    if error := confirmation.error(answer, floor):
        before, after = ((e.held_out_rmse, e.lo90, e.hi90) for e in (error.before, error.after))
    name, c = next(iter(coefficients.answers(answer).estimates().after.items()))
    return Finding(
        verdict=answer.verdict,
        explanations=tuple(e.effects for e in answer.accepted),
        probability=answer.probability,
        before=before,
        after=after,
        floor=float(floor),
        coefficient=name,
        number=(c.value, c.lo90, c.hi90),
    )


@dataclass(frozen=True, kw_only=True)
class Stability:
    """Campaigns without one visit or one trial whose answer is the same, of how many; and what was
    left out where it is not.
    """

    visits: tuple[int, int]
    trials: tuple[int, int]
    lost: tuple[str, ...]


def stability(
    folder: Path, out: Path, verdict: str, effects: list[set[str]], influential: str
) -> Stability:
    """Verdict without each visit and each trial; each effect must be named again, or a rival."""
    campaign, data = ingested(folder, out)

    def same(keep: FloatArray) -> bool:
        try:
            again = diagnosed(campaign, data.take(keep))
        except NotConverged:
            return False
        return again.verdict == verdict and all(again.names & names for names in effects)

    group, word = data.visit, "visit"
    if len(np.unique(group)) > MOST:
        group, word = np.unique(data.z_hat, return_inverse=True)[1], "distance"
    trials = data.trial if data.n <= MOST else data.trial[data.trial == influential]
    by_visit = {f"{word} {v}": same(group != v) for v in np.unique(group)}
    by_trial = {str(t): same(data.trial != t) for t in trials}
    return Stability(
        visits=(sum(by_visit.values()), len(by_visit)),
        trials=(sum(by_trial.values()), len(by_trial)),
        lost=tuple(name for name, held in (by_visit | by_trial).items() if not held),
    )
