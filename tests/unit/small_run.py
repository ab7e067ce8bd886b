"""A small campaign on disk, records and all, and the command line run on it inside this process."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from click.testing import CliRunner, Result

from nearlift import catalogue
from nearlift.cli import main
from nearlift.report.evidence import Evidence
from nearlift.report.page.render import page
from nearlift.report.registry import CHAPTERS
from nearlift.report.tables import csv
from nearlift.run import engine
from nearlift.run.engine import Job
from nearlift.stages import STAGES
from nearlift.synthetic.records import Form, SimulatedBench, write_campaign
from nearlift.synthetic.trial_schedule import randomised
from nearlift.synthetic.truth import Truth

NAME = "small"
STATIONS = 0.023 * np.array([1.14, 1.4, 1.8, 2.5, 4.0, 7.0, 12.0])
FAR = {0.25: 0.107, 0.5: 0.239, 0.75: 0.409, 0.92: 0.551}
GEOMETRY = {"spacing_hat": 65 / 23, "diagonal_hat": np.sqrt(2) * 65 / 23}
#: Where the vehicle touches.
CONTACT_M = {"ground": 0.012, "ceiling": 0.002}
UNCERTAINTY = """
[[uncertainty]]
name  = "distance datum"
on    = "height"
value = "0.1 mm"
scope = "boundary"
"""


def write(folder: Path, form: Form = "csv", visits: int = 4) -> Path:
    """112 short trials near the ground in three sessions, K_b = 2."""
    truth = Truth(
        model=catalogue.model("sanchez_cuevas"),
        parameters={"K_b": 2.0},
        lift_inf_N=FAR,
        geometry=GEOMETRY,
    )
    bench = SimulatedBench(
        rate_Hz=500.0, tare_s=0.1, record_s=0.3, contact_m=CONTACT_M, text=UNCERTAINTY
    )
    design = randomised({"ground": STATIONS}, seed=4, visits=visits, sessions=3)
    write_campaign(
        folder,
        design,
        {"ground": truth},
        name=NAME,
        note="for tests",
        seed=4,
        bench=bench,
        form=form,
    )
    return folder


def write_means(folder: Path, rows: int, lift_sd: float | None = None, quick: bool = False) -> Path:
    """The first `rows` trials of a campaign of which only means are known, and their standard
    deviation in mN where it is given; with `quick`, no rival model is fitted.
    """
    folder.mkdir()
    (folder / "campaign.toml").write_text(
        """
schema = "nearlift.campaign/1"
name = "means"
vehicle = { name = "Crazyflie 2.0", rotors = 4, rotor_radius = "23 mm", rotor_spacing = "65 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
records = { reader = "means" }
[trials.units]
distance = "mm"
throttle = "percent"
lift = "mN"
lift_sd = "mN"
[trials.constants]
"""
        + ("" if lift_sd is None else f'lift_sd = {lift_sd}\n[trials]\norder = "unknown"\n')
        + ("[fit]\nground = { rivals = [] }\n" if quick else "")
    )
    lifts = [
        (30 + 20 * i, t, far * (1 + 0.1 / (1 + i)))
        for i in range(6)
        for t, far in ((25, 107.0), (50, 239.0), (75, 409.0), (92, 551.0))
    ]
    text = "".join(
        f"m{i},ground,{z},{t},{lift:.3f}\n" for i, (z, t, lift) in enumerate(lifts[:rows])
    )
    (folder / "trials.csv").write_text("trial,boundary,distance,throttle,lift\n" + text)
    return folder


def nearlift(*words: object) -> Result:
    """What `nearlift WORDS` answers."""
    return CliRunner().invoke(main, [str(w) for w in words])


def undrawn(_: Any, table: pd.DataFrame, simulated: bool = False) -> dict[str, bytes]:
    """In place of `figures.files.render`: what depends on the table and the mark, without the
    seconds of drawing.
    """
    told = hashlib.sha256(csv(table) + repr(simulated).encode()).hexdigest().encode()
    return {"pdf": b"%PDF " + told, "png": b"PNG " + told}


def chapter(evidence: Evidence, name: str) -> str:
    """A page that has this chapter alone."""
    return page(evidence, [], [c for c in CHAPTERS if c.name == name]).decode()


def job(root: Path, out: Path, **changes: Any) -> Job:
    """The campaign as the command line would open it."""
    with engine.open_job(root, out, STAGES, "serial", 0, fresh=True) as opened:
        return replace(opened, **changes)


def ran(of: Job) -> list[str]:
    """Bring everything up to date; the names of the stages that had to run."""
    return [step.stage.name for step in engine.run(of) if step.why]


def state(folder: Path) -> dict[str, tuple[str, int]]:
    """Every file under a folder: digest and time of last change."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {
        p.relative_to(folder).as_posix(): (
            hashlib.sha256(p.read_bytes()).hexdigest(),
            p.stat().st_mtime_ns,
        )
        for p in files
    }
