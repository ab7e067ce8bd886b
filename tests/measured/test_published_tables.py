"""Measured tables of 20 cells from ../shared: each gets a verdict, and rotor speed is named where
its exponent is one that physics has.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.measured.jirs import FILE, written
from tests.unit import small_run

from nearlift.likelihood import budget
from nearlift.loop.diagnose import LoopDiagnosis, diagnose
from nearlift.loop.search_problem import Options
from nearlift.observed import choice, observe
from nearlift.report.phrases import dependence
from nearlift.stages.ingest import TRIALS

pytestmark = pytest.mark.skipif(
    not FILE.is_file(), reason="the measured files of ../shared are not here"
)


def diagnosed(folder: Path, boundary: Any, inches: int) -> LoopDiagnosis:
    """What the loop finds in the table, by way of ingest."""
    root = written(folder, boundary, inches)
    assert small_run.nearlift("ingest", root, "--out", folder).exit_code == 0
    job = small_run.job(root, folder)
    data = observe(job.read(TRIALS), job.campaign, boundary)
    assert data.n == 20
    base, _ = choice(job.campaign, boundary)
    return diagnose(data, base, budget.components(job.campaign), Options())


def on_the_page(boundary: str, inches: int) -> str:
    """The verdict that docs/measured.md gives the table."""
    page = Path(__file__).parents[2] / "docs" / "measured.md"
    line, *_ = [
        x for x in page.read_text().splitlines() if x.startswith(f"| jirs2024-{boundary}-{inches}-")
    ]
    return line.split("**")[1]


def candidate(found: dict[str, Any], name: str) -> dict[str, Any]:
    """The line of one candidate in the first round."""
    return next(c for c in found["rounds"][0]["candidates"] if c["name"] == name)


@pytest.mark.parametrize(
    ("boundary", "inches", "verdict"), [("ground", 10, "adequate"), ("ceiling", 10, "unexplained")]
)
def test_where_speed_explains_nothing_it_is_not_named(tmp_path, boundary, inches, verdict):
    found = diagnosed(tmp_path, boundary, inches).findings.content
    assert found["verdict"] == verdict == on_the_page(boundary, inches)
    assert found["effects"] == []
    assert found["sensitivity"]["trials"] == 20


def test_rotor_speed_is_found_under_the_ceiling_with_a_physical_exponent(tmp_path):
    made = diagnosed(tmp_path, "ceiling", 12)
    found = made.findings.content
    assert found["verdict"] == "effect" == on_the_page("ceiling", 12)
    [effect] = found["effects"]
    # a saturating gain stands in for it: five distances cannot tell the two apart
    assert "rotor_speed" in (effect["name"], *effect["rivals"])
    row = candidate(found, "rotor_speed")
    assert not row["at_bound"]
    # by hand, least squares with a level for each pulse width: 2.5 with a standard error of 0.4
    assert row["sizes"]["speed_exponent"] == pytest.approx(2.5, abs=0.4)
    # the name is that of five distances, and the page says which
    assert made.quoted.rests_on_visit is not None
    assert made.quoted.rests_on_visit.verdict == "adequate"
    assert "Without visit 1 (z_hat = 0.98) the verdict is adequate." in dependence(made.quoted)


def test_an_exponent_of_seven_is_refused_at_the_ground(tmp_path):
    found = diagnosed(tmp_path, "ground", 12).findings.content
    assert found["verdict"] == "unexplained" == on_the_page("ground", 12)
    assert candidate(found, "rotor_speed")["at_bound"]
    assert "rotor_speed (speed_exponent runs into 3)" in found["rounds"][0]["reason"]
