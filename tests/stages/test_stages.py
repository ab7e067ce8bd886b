"""A stage is one declaration: its command, its place in the plan and its page are made of it."""

from __future__ import annotations

import click
import pytest
from click.testing import CliRunner
from tests.unit import small_run

from nearlift import schedule
from nearlift.cli import QUESTIONS, main, stage_command
from nearlift.errors import NotConverged
from nearlift.run.engine import (
    Outcome,
    Stage,
    products_of,
    stage_of,
)
from nearlift.run.tables import Product, real
from nearlift.stages import STAGES, diagnose
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import RESULTS
from nearlift.stages.ingest import TRIALS

HEIGHTS = Product(
    file="heights.parquet",
    title="Heights",
    row="a trial",
    columns=(real("z_m", "m", "z"),),
)
WEIGH = Stage(
    name="weigh",
    summary="trials to heights",
    run=lambda job: Outcome(),
    reads=(TRIALS,),
    writes=(HEIGHTS,),
    sections=("vehicle",),
    question=(click.Option(["--ask"], help="Instead."),),
)


def test_a_declared_stage_has_a_command_with_its_options(monkeypatch):
    monkeypatch.setitem(QUESTIONS, "weigh", lambda call, campaign, given: print(campaign, given))
    command = stage_command(WEIGH)
    text = CliRunner().invoke(command, ["--help"]).output
    assert "Trials to heights." in text
    assert "Writes heights.parquet. Earlier stages must have run." in text
    assert "--ask TEXT" in text
    assert CliRunner().invoke(command, ["x", "--ask", "why"]).output == "x {'ask': 'why'}\n"


def test_a_product_is_listed_where_it_is_written_last():
    files = [p.file for p in products_of(STAGES)]
    assert len(files) == len(set(files))
    assert files.index(RESULTS.file) > files.index(DIAGNOSIS.file)


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_every_stage_is_on_the_command_line(stage):
    assert stage.name in main.list_commands(None)


def test_sections_are_those_of_the_manifest(tmp_path):
    campaign = small_run.job(small_run.write(tmp_path / "raw"), tmp_path).campaign
    known = set(type(campaign).model_fields)
    for stage in STAGES:
        assert set(stage.sections) <= known
        assert not stage.where or hasattr(campaign, stage.where)
    assert {"trials"} <= {*stage_of(STAGES, "fit").sections} & {
        *stage_of(STAGES, "diagnose").sections
    }


def test_no_column_of_a_schedule_may_be_named_after_one_of_trials():
    assert {column.name for column in TRIALS.columns} <= schedule.RESERVED


def test_a_quoted_posterior_that_does_not_converge_is_an_error(make_job, monkeypatch):
    job = make_job(("ground",), repeats=3)
    # no chain is as near to the grid as that
    monkeypatch.setattr("nearlift.results.fit.APART", 0.0)
    with pytest.raises(NotConverged, match="emcee and the grid disagree") as fault:
        diagnose.run(job)
    assert fault.value.exit_code == 5
