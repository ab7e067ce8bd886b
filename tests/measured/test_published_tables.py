"""Measured tables of 20 cells from ../shared: each has the verdict of docs/measured.md, and rotor
speed is named where its exponent is one that physics has.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from measured.campaigns import campaign
from measured.variants import ingested, stages

from nearlift.likelihood import budget
from nearlift.loop.diagnose import LoopDiagnosis, diagnose
from nearlift.loop.search_problem import Options
from nearlift.observed import choice
from nearlift.results.diagnosis import TriedCandidate

DATA = Path(__file__).parents[3] / "shared" / "data"
PAGE = Path(__file__).parents[2] / "docs" / "measured.md"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not here")


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """Diagnosis of a table, by way of fetch and ingest; made once."""
    out = tmp_path_factory.mktemp("tables")

    @cache
    def make(name: str) -> LoopDiagnosis:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("NEARLIFT_CACHE", str(out / "cache"))
            folder = campaign(name, out / "raw" / name, DATA, print)
        stages(folder, out, "ingest")
        known, data = ingested(folder, out)
        base, _ = choice(known, data.boundary)
        return diagnose(data, base, budget.components(known), Options())

    return make


def rotor_speed(made: LoopDiagnosis) -> TriedCandidate:
    return next(c for c in made.findings.rounds[0].candidates if c.name == "rotor_speed")


@pytest.mark.parametrize("inches", [pytest.param(10, marks=pytest.mark.nightly), 12])
@pytest.mark.parametrize("boundary", ["ground", "ceiling"])
def test_verdict_is_that_of_the_page(diagnosed, boundary, inches):
    name = f"jirs2024-{boundary}-{inches}-inch"
    [line, *_] = [x for x in PAGE.read_text().splitlines() if x.startswith(f"| {name} ")]
    assert f"**{diagnosed(name).findings.verdict}**" in line


def test_a_table_says_what_it_could_have_shown(diagnosed):
    made = diagnosed("jirs2024-ground-10-inch").findings
    assert made.effects == ()
    assert made.sensitivity.trials == 20


@pytest.mark.nightly
def test_exponents_of_rotor_speed_are_those_by_hand(diagnosed):
    ceiling, ground = (
        rotor_speed(diagnosed(f"jirs2024-{b}-12-inch")) for b in ("ceiling", "ground")
    )
    # by hand, least squares with a level for each pulse width: 2.5 with a standard error of 0.4
    assert ceiling.sizes["speed_exponent"] == pytest.approx(2.5, abs=0.4)
    assert not ceiling.at_bound
    # by hand 7.5, which no physics has
    assert ground.at_bound
