"""Write docs/measured.md from measured data: python docs/tabulate_measured.py DATA OUT; DATA is the
folder of measured files (not in this repository), OUT takes the campaigns and their products. With
names behind OUT these campaigns alone are brought to their verdict, and nothing is written here.
"""

import json
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.measured import jirs

from nearlift.campaign import manifest as manifests
from nearlift.cli import main
from nearlift.datasets import garofano_soldado_table, pitt_ras, registry
from nearlift.errors import NotConverged
from nearlift.likelihood import budget
from nearlift.loop.diagnose import decide, set_up
from nearlift.loop.findings import named_effects
from nearlift.loop.search_problem import Options
from nearlift.observed import choice, observe
from nearlift.results import Observations
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS

HEAD = """# Measured campaigns

Made by `python docs/tabulate_measured.py DATA OUT` from measured data that are not in this repository. *Error*: cross-validated rms over visits (trials, where their order is unknown), in per cent of lift, of the base model and of the final one; *floor*: the noise floor.
*Moves*: shift of the quoted coefficient without the most influential trial and visit (for a table, distance). *Holds*: in how many of the campaigns without one visit (of more than 24, one distance), or one trial (of more than 24, the most influential), the verdict is
the same, and a named effect is named again or a rival.

| campaign | trials | base model | verdict: effects (rivals) | error before | after | floor | quoted coefficient (90 %) | moves: trial, visit | holds: visits, trials |
|---|---|---|---|---|---|---|---|---|---|
"""
#: Of more trials, the one that moves the coefficient most is left out; of more visits, distances.
MOST = 24
LOST = "Another verdict without"
SWEEPS = """\
schema = "nearlift.campaign/1"
name   = "{name}"
note   = "Propeller and unit of force are not recorded: 12x6 and gram-force are taken; a ratio of lifts hangs on neither, z over the radius does."

[vehicle]
name         = "one rotor, propeller not recorded"
rotors       = 1
rotor_radius = "152.4 mm"
mass         = "1 kg"

[rig]
held            = "throttle"
distance_datum  = "rotor plane"
distance_offset = "0 mm"
gravity         = "9.80665 m/s^2"

[records]
reader = "means"

[levels]
by = "curve"                         # no throttle repeats
of = ["throttle", "supply"]

[trials.units]
distance = "m"
throttle = "fraction"
lift     = "gf"
supply   = "V"
[trials.constants]
boundary = "ground"

[[uncertainty]]
name = "rotor radius"
on = "rotor_radius"
value = "20 percent"
scope = "campaign"
"""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measured campaign: where its folder is made from, and what a reader should know of it."""

    name: str
    source: str
    make: Callable[[Path, Path], Path]
    remark: str


def pitt(data: Path, folder: Path) -> Path:
    """The nine sweeps of one day."""
    folder.mkdir(parents=True)
    place = data / "pitt-ras-iarc7-thrust" / "v1_sweeps_with_ground_distance"
    files = registry.dataset("pitt-ras-2017").file
    pitt_ras.convert({f.name: place / f.name for f in files}, folder, "pitt-ras-2017")
    return folder


def older_sweeps(data: Path, folder: Path) -> Path:
    """Six older sweeps, whose throttles do not repeat."""
    folder.mkdir(parents=True)
    (folder / "campaign.toml").write_text(SWEEPS.format(name="pitt-ras-older"))
    lines = ["trial,distance,throttle,lift,supply,session"]
    table = data / "pitt-ras-iarc7-thrust" / "v1_inline_sweeps.csv"
    for i, line in enumerate(table.read_text().splitlines()[1:]):
        sweep, force, pulse, supply, distance = line.split(",")
        # pulses reach 2012 us
        throttle = (float(pulse) - 1000) / 1100
        if throttle > pitt_ras.LEAST_THROTTLE and float(force) > 0:
            lines.append(f"s{sweep}-{i:02d},{distance},{throttle:g},{force},{supply},{sweep}")
    (folder / "trials.csv").write_text("\n".join(lines) + "\n")
    return folder


def garofano(along_axes: bool) -> Callable[[Path, Path], Path]:
    """The published table of a pair of rotors, as measured or along their axes."""

    def make(data: Path, folder: Path) -> Path:
        table = data / "garofano-soldado-2023" / "thrust_vs_height.csv"
        name = "garofano-soldado" + ("-axes" if along_axes else "")
        return garofano_soldado_table.convert(table, folder, along_axes=along_axes, name=name)

    return make


def surface(boundary: str, inches: int) -> Callable[[Path, Path], Path]:
    """A table of 20 cells."""
    return lambda _, folder: jirs.written(folder, boundary, inches)


TABLE = "J Intell Robot Syst 110.3 (2024)"
CAMPAIGNS = (
    Measured(
        name="pitt-ras-2017",
        source="Pitt-RAS thrust stand, nine sweeps",
        make=pitt,
        remark=(
            "distance was made smaller while the battery fell; the supply's effect is found, and k"
            " depends on the one sweep near the ground"
        ),
    ),
    Measured(
        name="pitt-ras-older",
        source="Pitt-RAS thrust stand, six older sweeps",
        make=older_sweeps,
        remark=(
            "no throttle repeats, so L_inf is a curve of throttle and supply; two short sweeps near"
            " the ground, each its own session"
        ),
    ),
    Measured(
        name="garofano-soldado",
        source="Garofano-Soldado et al., 15 configurations, vertical force",
        make=garofano(False),
        remark="tilt accounts for the greater part, and changes the curve too; k is undetermined",
    ),
    Measured(
        name="garofano-soldado-axes",
        source="the same along the rotors' axes",
        make=garofano(True),
        remark="no effect of the library changes the curve with tilt as these rotors do; k is at its bound",
    ),
    *(
        Measured(
            name=f"{boundary}-{inches}-inch",
            source=f"{TABLE}, {boundary}, {inches}-inch",
            make=surface(boundary, inches),
            remark=remark,
        )
        for boundary, inches, remark in (
            ("ground", 10, "one odd cell (z over R 1.18, full throttle) makes the floor"),
            (
                "ground",
                12,
                "an exponent of rotor speed beyond 3 (7.5 in a plain fit) has no physics: not named",
            ),
            ("ceiling", 10, "one rotor's speed is blank nearest the ceiling"),
            ("ceiling", 12, "the rotors turn 2.5 % faster near the ceiling at held pulse width"),
        )
    ),
)


def prepared(one: Measured, data: Path, out: Path) -> None:
    """Make the campaign and bring it to its verdict, where that is not done."""
    root = out / "raw" / one.name
    done = out / "processed" / one.name / "results.json"
    if done.exists() and (out / "processed" / one.name / "diagnosis.json").exists():
        return
    made = one.make(data, root) if not root.exists() else root
    made = made if (made / "campaign.toml").exists() else root / "raw"
    for stage in ("ingest", "reduce", "fit", "diagnose"):
        answer = CliRunner().invoke(main, [stage, str(made), "--out", str(out), "-q"])
        if answer.exit_code not in (0, 3):
            raise SystemExit(f"{one.name}, {stage}: {answer.output}")


def again(data: Observations, campaign: Any, found: dict[str, Any]) -> bool:
    """Whether the loop says the same of these trials: the verdict, and the names where there are
    any, as themselves or among rivals.
    """
    base, _ = choice(campaign, data.boundary)
    options = Options()
    try:
        stage, *_ = set_up(data, base, budget.components(campaign), options)
        answer = decide(stage, True, options.false_alarm_rate).answer
    except NotConverged:
        return False
    if answer.verdict != found["verdict"]:
        return False
    names = {n for e in named_effects(answer.stage, answer) for n in (e.name, *e.rivals)}
    return all(names & {e["name"], *e["rivals"]} for e in found["effects"])


def stability(
    one: Measured, out: Path, boundary: Any, found: dict[str, Any], heaviest: str
) -> dict[str, Any]:
    """How often the verdict holds without each visit, and without each trial."""
    raw = out / "raw" / one.name
    campaign = manifests.load(raw if (raw / "campaign.toml").exists() else raw / "raw")
    trials = tables.read_table(out / "processed" / campaign.name / TRIALS.file, TRIALS)
    data = observe(trials, campaign, boundary)
    group, word = data.visit, "visit"
    if len(np.unique(group)) > MOST:
        group, word = np.unique(data.z_hat, return_inverse=True)[1], "distance"
    visits = np.unique(group)
    by_visit = [again(data.take(group != v), campaign, found) for v in visits]
    order = np.arange(data.n)
    if data.n > MOST:
        order = np.flatnonzero(data.trial == heaviest)
    by_trial = [again(data.take(np.arange(data.n) != i), campaign, found) for i in order]
    return {
        "visits": [sum(by_visit), len(by_visit)],
        "trials": [sum(by_trial), len(by_trial)],
        "lost": [
            f"{word} {v}" for v, held in zip(visits.tolist(), by_visit, strict=True) if not held
        ]
        + [
            str(data.trial[i]) for i, held in zip(order.tolist(), by_trial, strict=True) if not held
        ],
    }


def number(x: Any) -> str:
    """Three digits; a dash where there is none."""
    return "–" if x is None or not math.isfinite(float(x)) else f"{float(x):.3g}"


def row(one: Measured, out: Path) -> tuple[str, str]:
    """The campaign's line, and what is said of it below the table."""
    place = out / "processed" / one.name
    [(boundary, d)] = json.loads((place / "diagnosis.json").read_text())["boundaries"].items()
    quoted = json.loads((place / "results.json").read_text())["boundaries"][boundary]
    name, c = next(iter(quoted["coefficients"].items()))
    kept = out / f"{one.name}.stability.json"
    if not kept.exists():
        heaviest = (c["influence"]["trial"] or {}).get("id", "")
        kept.write_text(json.dumps(stability(one, out, boundary, d, heaviest)))
    held = json.loads(kept.read_text())
    effects = "; ".join(
        f"`{e['name']}`" + (f" ({', '.join(e['rivals'])})" if e["rivals"] else "")
        for e in d["effects"]
    )
    if d["verdict"] == "unexplained":
        effects = (
            f"structure along {', '.join(dict.fromkeys(s['covariate'] for s in d['structure']))}"
        )
    moves = [c["influence"][kind] for kind in ("trial", "visit")]
    e = d["error"]
    errors = [e["before"]["held_out_rmse"], e["after"]["held_out_rmse"], e["noise_floor"]]
    trials = tables.read_table(place / TRIALS.file, TRIALS)
    cells = [
        one.name,
        str(len(trials["trial"])),
        f"{d['base_model']} ({boundary})",
        f"**{d['verdict']}**" + (f": {effects}" if effects else ""),
        *(f"{100 * x:.2f}" for x in errors),
        f"{name} = {number(c['value'])} ({number(c['lo90'])} to {number(c['hi90'])})",
        ", ".join("–" if m is None else number(abs(m["shift"])) for m in moves),
        ", ".join(f"{a} of {b}" for a, b in (held["visits"], held["trials"])),
    ]
    told = f"- **{one.name}** ({one.source}): {one.remark}."
    if held["lost"]:
        more = "" if len(held["lost"]) <= 4 else f" and {len(held['lost']) - 4} more"
        told += f" {LOST} {', '.join(held['lost'][:4])}{more}."
    if partial := d.get("partial"):
        shares = [f"`{x['name']}` {100 * x['share']:.0f} %" for x in partial[:2]]
        told += f" In part: {', '.join(shares)}."
    wanted = [n["measure"] for n in d["next_experiment"]][:2]
    logs = list(
        dict.fromkeys(w for u in d["untestable"] for w in u.get("log_next_time", u["needs"]))
    )
    if wanted:
        told += f" To measure next: {'; '.join(wanted)}."
    if logs:
        told += f" To log next time: {', '.join(logs[:6])}."
    return "| " + " | ".join(cells) + " |", told


TAIL = """
*Unexplained* campaigns have structure and no acceptable candidate. A verdict that changes without one visit or trial depends on it; the page and `results.json` (`rests_on`) say so. The five wall tables of the same paper hold force and moment of the wall and no lift; `roll_moment`,
`pitch_moment` and `wall_force` are carried as outcomes.

"""
if __name__ == "__main__":
    data, out, only = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]
    rows = []
    for campaign in CAMPAIGNS:
        if not only or campaign.name in only:
            prepared(campaign, data, out)
            rows.append(row(campaign, out))
            print(rows[-1][0], flush=True)
    if not only:
        lines, told = zip(*rows, strict=True)
        names = [c.name for c in CAMPAIGNS]
        firm = [name for name, text in zip(names, told, strict=True) if LOST not in text]
        stand = f"\nThe verdict holds without any one visit or trial in {len(firm)} of {len(told)}: {', '.join(firm)}.\n"
        Path(__file__).with_name("measured.md").write_text(
            HEAD + "\n".join(lines) + "\n" + stand + TAIL + "\n".join(told) + "\n"
        )
