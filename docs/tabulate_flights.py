"""CrazyPAD's flights in docs/measured.md: a row for each set of logs, and what hover shows of each
defect. A start stands for a visit, a window of flight for a trial.
"""

import json
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray

from nearlift.cli import main
from nearlift.datasets import crazypad, registry
from nearlift.errors import NotConverged
from nearlift.fit import hover
from nearlift.likelihood import budget
from nearlift.loop.diagnose import diagnose
from nearlift.loop.search_problem import Options
from nearlift.manifest import campaign as manifests
from nearlift.products import TRIALS
from nearlift.run import store
from nearlift.run.store import Table
from nearlift.stages import hovering
from nearlift.stages.fit import choice
from nearlift.stages.observe import observe

NAME = "crazypad-2024"
SOUND = "normal_flight"
DEFECTS = """
## Flights with known defects

CrazyPAD (`nearlift data get crazypad-2024`): 24 logs of two flights each, which hover at 0.55 m; no set-point was logged, so nothing near the ground is diagnosed. What
[hover](flights.md#which-flights-are-not-like-the-sound-ones) shows of each defect against six normal logs, in per cent of motor voltage; *holds*: with how many of the starts (its own
and the normal ones), and of the windows of hover, left out one by one the same is named, or nothing again:

| flights | logs | all rotors (limit) | rotor farthest beyond or nearest to its limit | named, or as well | holds: starts, windows |
|---|---|---|---|---|---|
"""
NAMELESS = """
Of the twelve normal flights, each alone against the other five logs, {clean} have no name. M2 differs by up to 9 % from one normal log to another, which nobody declared; so small a defect as 1 mm, tape, and the
lighter weight beside one rotor, and the weight on a string, lie below what six normal logs can tell, and nothing is claimed of them. The weight between M3 and M4 is told by the one of them that is beyond its limit.
"""


@dataclass(frozen=True, kw_only=True)
class Flights:
    """One set of logs: its condition in CrazyPAD, and what a reader should know of it."""

    condition: str
    remark: str

    @property
    def name(self) -> str:
        """Of its campaign."""
        return "crazypad-" + self.condition.replace("_", "-").lower()


SETS = (
    Flights(condition=SOUND, remark="six logs, nothing changed"),
    Flights(condition="add_weight_W1_near_M3", remark="a weight beside M3"),
    Flights(condition="add_weight_W1_near_M3_M4", remark="a weight between M3 and M4"),
    Flights(condition="cut_propeller_M3_1mm", remark="M3's propeller cut by 1 mm"),
    Flights(condition="cut_propeller_M3_3mm", remark="M3's propeller cut by 3 mm"),
    Flights(condition="tape_on_propeller_M3", remark="tape on M3's propeller"),
    Flights(condition="weight_on_string_W3_near_M3", remark="a weight on a string beside M3"),
)


def written(data: Path, root: Path, condition: str = "") -> Path:
    """The campaign of all logs, or of those of one condition, whose hover stands in the other."""
    if root.exists():
        return root
    root.mkdir(parents=True)
    listed = (f.name for f in registry.dataset(NAME).file)
    files = {
        name: data / NAME / name.replace("-", "/")
        for name in listed
        if not condition or name.startswith(f"{condition}-")
    }
    crazypad.convert(files, root, root.name)
    if condition:
        manifest = root / "campaign.toml"
        lines = manifest.read_text(encoding="utf-8").splitlines(keepends=True)
        kept = [line for line in lines if not line.startswith("sound ")]
        manifest.write_text("".join(kept), encoding="utf-8")
    return root


def made(root: Path, out: Path, *stages: str) -> None:
    """Bring a campaign through these stages, where that is not done."""
    for stage in stages:
        answer = CliRunner().invoke(main, [stage, str(root), "--out", str(out), "-q"])
        if answer.exit_code not in (0, 3):
            raise SystemExit(f"{root.name}, {stage}: {answer.output}")


class Hover:
    """What hover shows of every condition, and whether it does so without some of the trials."""

    def __init__(self, data: Path, out: Path) -> None:
        root = written(data, out / "raw" / NAME)
        made(root, out, "ingest")
        self.campaign = manifests.load(root)
        self.trials = store.read_table(out / "processed" / NAME / TRIALS.file, TRIALS)
        self.found = self.compared(self.trials)

    def compared(self, trials: Table) -> dict[str, list[hovering.HoverComparison]]:
        """Comparisons by condition; those of sound logs one by one."""
        found: dict[str, list[hovering.HoverComparison]] = {}
        with warnings.catch_warnings():
            # a start that is left out has no mean
            warnings.simplefilter("ignore", RuntimeWarning)
            for one in hovering.compared(self.campaign, trials, "ground"):
                found.setdefault(one.condition, []).append(one)
        return found

    def names(self, condition: str, trials: Table | None = None) -> set[str]:
        """What is named in one condition's flights, rivals as well."""
        found = self.found if trials is None else self.compared(trials)
        return {name for one in found[condition] for name in (*one.effects, *one.rivals)}

    def concerned(self, condition: str) -> NDArray[np.bool_]:
        """The trials that tell of a condition: its own, and sound ones."""
        own = self.trials["condition"]
        return np.asarray((own == condition) | (own == SOUND))

    def without(self, out: NDArray[np.bool_]) -> Table:
        """The trials less some."""
        return {name: values[~out] for name, values in self.trials.items()}

    def starts(self, condition: str) -> Iterator[tuple[str, NDArray[np.bool_]]]:
        """Every start that tells of a condition, and its trials."""
        own = self.concerned(condition)
        for log in dict.fromkeys(self.trials["record"][own]):
            for start in (1, 2):
                name = f"{log}, start {start}"
                yield name, (self.trials["record"] == log) & (self.trials["flight"] == start)

    def windows(self, condition: str) -> list[int]:
        """Every window of hover that tells of a condition."""
        hovers = (np.abs(self.trials["climb_m_s"]) < hovering.SLOW_M_S) & (
            self.trials["z_hat"] > hovering.FAR
        )
        return [int(i) for i in np.flatnonzero(hovers & self.concerned(condition))]

    def lost(self, condition: str) -> tuple[list[str], int, list[str], int]:
        """Without which starts, of how many, and which windows, of how many, another is named."""
        told = self.names(condition)
        starts = list(self.starts(condition))
        other = [n for n, out in starts if self.names(condition, self.without(out)) != told]
        windows, places = self.windows(condition), np.arange(len(self.trials["trial"]))
        odd = [
            str(self.trials["trial"][i])
            for i in windows
            if self.names(condition, self.without(places == i)) != told
        ]
        return other, len(starts), odd, len(windows)


def near_ground(root: Path, out: Path, heaviest: str) -> tuple[list[str], int, list[str], int]:
    """Without which starts, of how many, and without the heaviest window, the loop says another."""
    campaign = manifests.load(root)
    trials = store.read_table(out / "processed" / campaign.name / TRIALS.file, TRIALS)
    data = observe(trials, campaign, "ground")
    base, _ = choice(campaign, "ground")

    def same(kept: NDArray[np.bool_]) -> bool:
        try:
            diagnose(data.take(kept), base, budget.components(campaign), Options())
        except NotConverged:
            return True
        return False

    start = data.flight_start
    numbers = np.unique(start).tolist()
    lost = [f"start {s}" for s in numbers if not same(start != s)]
    odd = [heaviest] if not same(data.trial != heaviest) else []
    return lost, len(numbers), odd, 1


def row(one: Flights, data: Path, out: Path, shown: Hover) -> tuple[str, str]:
    """The line of a set of logs, and what is said of it below the table."""
    root = written(data, out / "raw" / one.name, one.condition)
    place = out / "processed" / one.name
    if not (place / "diagnosis.json").exists():
        made(root, out, "ingest", "reduce", "fit", "diagnose")
    told = json.loads((place / "results.json").read_text())["boundaries"]["ground"]
    fitted = json.loads((place / "fit.json").read_text())
    gain, decay = (told["in_flight"][name] for name in ("gain_at_2", "decay_length"))
    kept = out / f"{one.name}.stability.json"
    if not kept.exists():
        ground = near_ground(root, out, gain["influence"]["trial"]["id"])
        kept.write_text(json.dumps([ground, shown.lost(one.condition)]))
    ground, hovers = json.loads(kept.read_text())
    base = told["base_model"]
    error = 100 * fitted["comparison"]["ground"]["models"][base]["rmse"]
    trials = store.read_table(place / TRIALS.file, TRIALS)
    names = sorted(shown.names(one.condition))
    moves = [gain["influence"][kind] for kind in ("trial", "visit")]
    held = [
        n - len({*near, *far})
        for near, far, n in ((ground[0], hovers[0], hovers[1]), (ground[2], hovers[2], hovers[3]))
    ]
    cells = [
        one.name,
        str(len(trials["trial"])),
        f"{base} (ground)",
        f"**{told['verdict'].replace('_', ' ')}**; in hover "
        + (" or ".join(f"`{n}`" for n in names) or "nothing"),
        *(f"{error:.2f}", f"{error:.2f}", "–"),
        f"gain at 2 = {gain['value']:.2g} ({gain['lo90']:.2g} to {gain['hi90']:.2g})",
        ", ".join(f"{abs(m['shift']):.2g}" for m in moves),
        f"{held[0]} of {hovers[1]}, {held[1]} of {hovers[3]}",
    ]
    said = (
        f"- **{one.name}** (CrazyPAD, {one.remark}): the gain decays over {decay['value']:.2g} radii"
        f" ({decay['lo90']:.2g} to {decay['hi90']:.2g}); K_b is refused, since no set-point was logged."
    )
    lost = [*ground[0], *hovers[0], *ground[2], *hovers[2]]
    if lost:
        said += f" Another verdict without {', '.join(lost[:4])}"
        said += f" and {len(lost) - 4} more." if lost[4:] else "."
    each = [f"without {m['id']} ({gain['value'] + m['shift']:.2g})" for m in moves]
    said += f" The gain is farthest from this {' and '.join(each)}."
    return "| " + " | ".join(cells) + " |", said + " To log next time: the height's set-point."


def defects(shown: Hover, out: Path) -> str:
    """The table of what hover shows."""
    lines = []
    for one in SETS[1:]:
        [found] = shown.found[one.condition]
        whole, *each = found.shifts
        most = max(each, key=lambda s: abs(s.value) / s.limit)
        names = f"`{found.effects[0]}` ({', '.join(found.rivals)})" if found.effects else "–"
        _, (starts, n, windows, m) = json.loads((out / f"{one.name}.stability.json").read_text())
        lines.append(
            f"| {found.condition} | {len(found.logs)} | {whole.text.removeprefix('all rotors ')} |"
            f" {most.text} | {names} | {n - len(starts)} of {n}, {m - len(windows)} of {m} |"
        )
    own, conditions = hovering.means(shown.trials, "ground")
    normal, clean = [r for r in own if conditions[r] == SOUND], 0
    for r in normal:
        others = np.array([own[q] for q in normal if q != r])
        for start in range(others.shape[1]):
            alone = slice(start, start + 1)
            told = hover.shifts(own[r][None, alone], others[:, alone], 0.05)
            clean += not any(shift.stands_out for shift in told)
    return DEFECTS + "\n".join(lines) + "\n" + NAMELESS.format(clean=clean)
