"""Budget bars and profiles, from a small campaign that was really fitted."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from nearlift.report import tables
from nearlift.report.figures import budget, profiles
from nearlift.report.figures.files import render
from nearlift.report.figures.style import Style
from nearlift.results.quotation import BudgetLine
from nearlift.stages.fit import PROFILES
from nearlift.stages.gathering import gather


@pytest.fixture(scope="module")
def evidence(small_job):
    return gather(small_job)


def base(evidence, boundary):
    return evidence.base(boundary)[1]


def test_the_squares_of_a_budget_add_up(evidence):
    for boundary in evidence.boundaries:
        for c in evidence.quoted(boundary).coefficients.values():
            assert math.hypot(*(line.u for line in c.budget)) == pytest.approx(c.u, rel=1e-6)
            assert all(0 <= line.u_without <= c.u * (1 + 1e-9) for line in c.budget)
            assert all(
                abs(line.sensitivity) * line.u_input == pytest.approx(line.u, rel=1e-6)
                for line in c.budget
            )


def test_profiles_are_stored(evidence):
    table = evidence.table(PROFILES)
    entry = base(evidence, "ground")
    mine = (
        (table["boundary"] == "ground")
        & (table["model"] == "sanchez_cuevas")
        & (table["parameter"] == "K_b")
    )
    x, rise = table["value"][mine], table["rise"][mine]
    assert (np.diff(x) > 0).all()
    assert rise.min() == 0
    assert np.interp(entry.profiles["K_b"].hi95, x, rise) == pytest.approx(3.9, abs=0.2)


def test_bars_are_what_knowing_a_source_would_save(evidence):
    rows = budget.table(evidence)
    for panel, name in set(zip(rows["panel"], rows["parameter"], strict=True)):
        mine = (rows["panel"] == panel) & (rows["parameter"] == name)
        whole = evidence.quoted(panel).coefficients[name].u
        np.testing.assert_allclose(
            rows["fall_percent"][mine], 100 * (1 - rows["u_without"][mine] / whole), atol=1e-9
        )
    text = budget.caption(evidence, rows)
    assert "K_b (ground): " in text
    render(budget.draw, rows, Style())
    assert tables.csv(rows).startswith(b"panel,parameter,component,type,fall_percent,u,u_without\n")


def test_of_repeats_only_what_matters_somewhere_is_drawn_and_what_was_declared_always(evidence):
    def line(name, fall, kind):
        return BudgetLine(source=name, kind=kind, u=1.0, u_without=2.0 * (1 - fall))

    own = dataclasses.replace(evidence.quoted("ground").coefficients["K_b"], u=2.0)
    lines = (line("large", 0.9, "A"), line("small", 0.0015, "A"), line("declared", 1e-9, "B"))
    ground = dataclasses.replace(own, budget=lines)
    ceiling = dataclasses.replace(own, budget=(line("large", 1.0, "A"),))
    bars = budget.bars([("ground", "K_b", ground), ("ceiling", "alpha", ceiling)])
    assert list(zip(bars["panel"], bars["component"], bars["type"], strict=True)) == [
        ("ground", "large", "A"),
        ("ground", "declared", "B"),
        ("ceiling", "large", "A"),
    ]
    assert bars["fall_percent"].tolist() == pytest.approx([90.0, 0.0, 100.0], abs=1e-6)


def test_profiles_are_drawn_with_their_intervals(evidence):
    rows = profiles.table(evidence)
    mine = (rows["parameter"] == "K_b") & (rows["kind"] == "90")
    own = base(evidence, "ground").profiles["K_b"]
    assert rows["x"][mine].tolist() == [own.lo90, own.hi90]
    assert rows["rise"][mine].tolist() == pytest.approx([2.74, 2.74], abs=0.1)
    text = profiles.caption(evidence, rows)
    assert re.search(r"[TU](he parabola suffices for|pper over lower half)", text)
    files = render(profiles.draw, rows, Style())
    assert set(files) == {"pdf", "png"}
