"""Corner plot and bands, from draws made up here."""

import copy
import dataclasses

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.report import curves
from nearlift.report.figures import corner
from nearlift.report.figures.files import render
from nearlift.rounding import plain
from nearlift.stages.diagnose import QUOTED_POSTERIOR
from nearlift.stages.fit import FIT, POSTERIOR, RESULTS
from nearlift.stages.gathering import gather

N = 4000


@pytest.fixture(scope="module")
def small(small_job):
    return gather(small_job)


def with_draws(small, boundary, model, **values):
    """One boundary of the small campaign, with these draws of the base model's posterior."""
    table = {
        "boundary": np.full(N * len(values), boundary, dtype=object),
        "model": np.full(N * len(values), model, dtype=object),
        "parameter": np.repeat(np.array([*values], dtype=object), N),
        "value": np.concatenate([np.broadcast_to(x, N) for x in values.values()]),
    }
    fitted = small.document(FIT)
    alone = fitted | {"boundaries": {boundary: fitted["boundaries"][boundary]}}
    documents = {FIT.file: alone, RESULTS.file: small.document(RESULTS)}
    return dataclasses.replace(small, tables={POSTERIOR.file: table}, documents=documents)


def spread(seed=1, sd=0.3):
    return np.random.default_rng(seed).normal(2.0, sd, N)


def test_the_table_holds_the_draws_of_the_parameters(small):
    a, lambda_ = spread(), spread() + spread(2)
    values = {"a": a, "lambda_": lambda_, "L_inf_N[0.5]": 0.5}
    evidence = with_draws(small, "sidewall", "sidewall_decay", **values)
    table = corner.table(evidence)
    mine = table[table["name"] == "a"]
    assert len(mine) == min(N, corner.MOST_DRAWS)
    np.testing.assert_array_equal(mine["value"], a[mine["draw"].astype(int)])
    assert set(table["name"]) == {"a", "lambda_"}
    r = plain(np.corrcoef(a, lambda_)[0, 1], 2)
    assert f"strongest correlation {r}, of a and λ" in corner.caption(evidence, table)


@pytest.mark.parametrize(
    ("verdict", "answers", "drawn", "panel"),
    [
        ("effect", 1, True, "ground"),
        ("effect", 3, True, "ground: best of 3 explanations"),
        ("effect", 1, False, "ground: base model alone"),
        ("not_diagnosed", 1, False, "ground"),
    ],
)
def test_draws_that_are_not_all_that_is_quoted_say_so(small, verdict, answers, drawn, panel):
    """Of few visits an effect is quoted without draws; draws suppose one of several answers."""
    evidence = with_draws(small, "ground", "sanchez_cuevas", K_b=spread())
    if drawn:
        table = evidence.tables[POSTERIOR.file]
        tables = {**evidence.tables, QUOTED_POSTERIOR.file: table}
        evidence = dataclasses.replace(evidence, tables=tables)
    results = copy.deepcopy(evidence.document(RESULTS))
    ground = results["boundaries"]["ground"]
    ground["verdict"] = verdict
    for coefficient in ground["coefficients"].values():
        coefficient["answers"] = answers
    documents = {**evidence.documents, RESULTS.file: results}
    evidence = dataclasses.replace(evidence, documents=documents)
    made = corner.table(evidence)
    assert set(made["panel"]) == {panel}
    alone = panel.partition(": ")[2]
    said = f"({alone}; results.json has the quoted interval)" in corner.caption(evidence, made)
    assert said == bool(alone)


@pytest.mark.parametrize("value", [0.0, 2.0])
def test_the_corner_plot_survives_a_parameter_without_spread(small, value):
    evidence = with_draws(small, "sidewall", "sidewall_decay", a=value, lambda_=spread())
    made = render(corner.draw, corner.table(evidence))
    assert made["png"].startswith(b"\x89PNG")


def test_a_band_holds_the_share_of_curves_that_it_says(small):
    evidence = with_draws(small, "ground", "sanchez_cuevas", K_b=spread())
    model = catalogue.model("sanchez_cuevas")
    known = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
    z = np.array([0.2, 1.2, 3.0])
    low, middle, high = curves.posterior_quantiles(evidence, "ground", model, z, known)
    assert np.isnan([low[0], high[0]]).all()
    each = model(z[1:], **known, K_b=spread()[:, None]) - 1
    share = np.mean((each >= low[1:]) & (each <= high[1:]), axis=0)
    np.testing.assert_allclose(share, 0.9, atol=2e-3)
    assert np.mean(each < middle[1:], axis=0) == pytest.approx(0.5, abs=2e-3)
    without = dataclasses.replace(evidence, tables={})
    assert curves.posterior_quantiles(without, "ground", model, z, known) is None
