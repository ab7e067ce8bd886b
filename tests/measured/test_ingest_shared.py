"""Campaigns beside the repository: the measured one, and one whose content is not known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearlift.campaign import manifest as campaign
from nearlift.reduction.quality import rejected
from nearlift.run.engine import Job, Outcome
from nearlift.run.workers import SerialExecutor
from nearlift.stages import ingest
from nearlift.stages.ingest import TRIALS

SHARED = Path(__file__).parents[2].parent / "shared"


def ingested(relative: str, out: Path) -> tuple[Outcome, dict[str, Any]]:
    folder = SHARED / relative
    if not (folder / "campaign.toml").is_file():
        pytest.skip(f"{folder} is not here")
    job = Job(
        root=folder,
        campaign=campaign.load(folder),
        processed=out,
        reports=out,
        executor=SerialExecutor(),
    )
    return ingest.run(job), job.read(TRIALS)


def test_the_measured_campaign_has_one_step_that_does_not_rise(tmp_path: Path) -> None:
    outcome, table = ingested("campaigns/pitt-ras-2017", tmp_path)
    assert len(table["trial"]) == 378
    assert outcome.rejected == ()
    assert len(outcome.notes) == 2
    assert "accepted trial" in outcome.notes[1]
    assert (
        "the lift does not rise with throttle: 24.44 N at 97.96 %, 24.37 N at 100 %"
        in outcome.notes[0]
    )
    flagged = table["quality"] == "not_rising"
    assert np.all(table["throttle"][flagged] == 1.0)
    assert np.all(table["z_m"][flagged] == 2.0)
    assert set(table["quality"]) == {"", "not_rising"}
    np.testing.assert_allclose(table["z_hat"][0], 2.0 / 0.1524)
    np.testing.assert_allclose(table["lift_N"][0], 0.210818 * 9.80665)


def test_a_campaign_of_raw_records(tmp_path: Path) -> None:
    outcome, table = ingested("blind/blind-a", tmp_path)
    assert len(table["trial"]) == 1200
    assert outcome.rejected == ()
    assert outcome.notes == ()
    assert not rejected(table["quality"]).any()
    assert set(table["n"]) == {1000}
    # a white noise of 3 mN, tare of 200 samples and mean of 1000, whatever the tone does
    np.testing.assert_allclose(
        np.sqrt(np.mean(table["u_lift_N"] ** 2)), 2.99e-3 * np.sqrt(1 / 200 + 1 / 1000), rtol=0.03
    )
    assert {"supply_V", "temperature_K", "approach", "tilt_rad", "start_s", "session"} <= set(table)
