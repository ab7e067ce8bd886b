"""Trials run in two ways on purpose: the schedule's words become covariates, the effect that they
tell is named, and a campaign that has no such columns hears nothing of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.calibration import forms
from tests.calibration.simulator import Errors, Spec, simulate
from tests.unit import small_run
from tests.unit.small_run import nearlift

from nearlift import catalogue
from nearlift.likelihood.covariates import derive
from nearlift.loop.admission import effects_to_test
from nearlift.loop.diagnose import diagnose
from nearlift.loop.search_problem import Options
from nearlift.observed import observe
from nearlift.stages.ingest import TRIALS

MANIFEST = """
schema = "nearlift.campaign/1"
name = "turned"
vehicle = { name = "quadrotor", rotors = 1, rotor_radius = "127 mm", mass = "1 kg" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
records = { reader = "means" }
[trials.units]
distance = "cm"
throttle = "percent"
lift = "N"
lift_sd = "N"
turn = "deg"
[trials.constants]
boundary = "ground"
throttle = 50
lift = 3
lift_sd = 0.05
"""
ROWS = """trial,distance,orientation,propeller,turn,fountain
a,20,upright,old,0,1
b,30,inverted,old,90,-1
c,40,inverted,nicked,180,0
d,50,,,270,
"""


def test_words_and_angles_become_covariates(tmp_path: Path) -> None:
    root = tmp_path / "raw"
    root.mkdir()
    (root / "campaign.toml").write_text(MANIFEST)
    (root / "trials.csv").write_text(ROWS)
    done = nearlift("ingest", root, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    job = small_run.job(root, tmp_path)
    known = observe(job.read(TRIALS), job.campaign, "ground").covariates
    np.testing.assert_array_equal(known["inverted"], [0, 1, 1, np.nan])
    np.testing.assert_array_equal(known["other_propeller"], [0, 0, 1, np.nan])
    np.testing.assert_allclose(known["turn_rad"], np.arange(4) * np.pi / 2)
    np.testing.assert_array_equal(known["fountain_side"], [1, -1, 0, np.nan])


@pytest.mark.parametrize("name", forms.EXPERIMENTS)
def test_each_is_named_with_its_size(name: str) -> None:
    spec = Spec(
        boundary="ground", effects=((name, 0.5),), errors=Errors(), visits=5, experiments=True
    )
    campaign = simulate(spec, 5)
    base = catalogue.model("sanchez_cuevas")
    found = diagnose(campaign.data, base, (), Options(seed=5), confirm=False).findings
    (named,) = found.effects
    assert named.name == name
    size = campaign.truth.amplitudes[name]
    values = [p.value for p in named.parameters.values()]
    assert np.hypot.reduce(values) == pytest.approx(abs(size), rel=0.15)


def test_without_their_columns_nobody_hears_of_them() -> None:
    base = catalogue.model("sanchez_cuevas")
    for told in (True, False):
        data = simulate(
            Spec(boundary="ground", errors=Errors(), visits=3, experiments=told), 7
        ).data
        library, untestable = effects_to_test(derive(data, data.lift_N), base)
        mine = {e.name for e in library} & forms.EXPERIMENTS.keys()
        assert mine == (forms.EXPERIMENTS.keys() if told else set())
        assert not {u.effect for u in untestable} & forms.EXPERIMENTS.keys()
