"""Budget bars and profiles, from a small campaign that was really fitted."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from nearlift.report.figures import budget, profiles
from nearlift.results.quotation import BudgetLine


def test_bars_are_what_knowing_a_source_would_save(evidence):
    rows = budget.table(evidence)
    for (panel, name), mine in rows.groupby(["panel", "parameter"]):
        c = evidence.quoted(panel).coefficients[name]
        assert math.hypot(*(line.u for line in c.budget)) == pytest.approx(c.u, rel=1e-6)
        assert (mine["u_without"] <= c.u * (1 + 1e-9)).all()
        expected = 100 * (1 - mine["u_without"] / c.u)
        np.testing.assert_allclose(mine["fall_percent"], expected, atol=1e-9)
    assert "K_b (ground): " in budget.caption(evidence, rows)


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
    own = evidence.base("ground")[1].profiles["K_b"]
    assert rows["x"][mine].tolist() == [own.lo90, own.hi90]
    assert rows["rise"][mine].tolist() == pytest.approx([2.74, 2.74], abs=0.1)
    text = profiles.caption(evidence, rows)
    assert re.search(r"[TU](he parabola suffices for|pper over lower half)", text)
