"""A small campaign with velocity grids, run once: the demo's pictures with few fields."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from nearlift.campaign import manifest as manifests
from nearlift.run.engine import Job, Outcome
from nearlift.run.workers import SerialExecutor
from nearlift.stages import flow
from nearlift.synthetic import demo_flow
from nearlift.synthetic.records import SimulatedBench

HEAD = """
schema = "nearlift.campaign/1"
name = "wakes"
simulated = true
vehicle = { name = "Crazyflie 2.0", rotors = 4, rotor_radius = "23 mm", rotor_spacing = "65 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
records = { reader = "means" }
"""


def job(root: Path, out: Path) -> Job:
    return Job(
        root=root,
        campaign=manifests.load(root),
        processed=out / "processed",
        reports=out / "reports",
        executor=SerialExecutor(),
    )


@dataclass(frozen=True)
class Made:
    job: Job
    outcome: Outcome


@pytest.fixture(scope="session")
def wakes(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Eight fields of every case of the demo, through the flow stage."""
    root = tmp_path_factory.mktemp("wakes")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo_flow, "FIELDS", 8)
        text = demo_flow.write_piv(root, SimulatedBench(), seed=3)
    (root / "campaign.toml").write_text(HEAD + text)
    made = job(root, root / "out")
    return Made(job=made, outcome=flow.run(made))
