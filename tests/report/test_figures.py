"""All figures: distinguishable in colour and in grey, the same bytes each time, no trace in
matplotlib's settings.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib.lines import Line2D
from matplotlib.text import Text
from PIL import Image

from nearlift.report.evidence import pick
from nearlift.report.figures import fig2, files, residuals, style
from nearlift.report.registry import FIGURES
from nearlift.stages.fit import FIT, POSTERIOR
from nearlift.stages.gathering import gather
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

#: Figures of the loop, of flow, flight and proximity need more, and are tested with what makes them.
OF_A_FIT = [s for s in FIGURES if set(s.needs) <= {TRIALS, LIFT, FIT, POSTERIOR}]
PANELS = ["a) ground", "b) ceiling", "c) sidewall"]


@pytest.fixture(scope="module")
def table(small_job):
    return fig2.table(gather(small_job))


def drawn(draw, table):
    return files.drawn(draw, table)


def titles(axes):
    return [ax.get_title(loc="left") for ax in axes]


def texts(legend):
    return [t.get_text() for t in legend.get_texts()]


def test_series_differ_in_colour_and_marker_and_theory_in_dashes(table):
    colours, markers = zip(*style.SERIES, strict=True)
    assert len(set(colours)) == len(set(markers)) == len(style.SERIES)
    figure = drawn(fig2.draw, table)
    assert len(figure.axes) == 6
    for ax in figure.axes:
        lines = [c.lines[0] for c in ax.containers]
        assert len({line.get_marker() for line in lines}) == 4
        assert len({line.get_color() for line in lines}) == 4
    curves = [line for line in figure.axes[0].lines if len(line.get_xdata()) > 100]
    assert len({str(line._dash_pattern) for line in curves}) == len(curves) == 4


def test_panels_are_labelled_with_units_and_curves_named(table):
    figure = drawn(fig2.draw, table)
    upper, lower = figure.axes[:3], figure.axes[3:]
    assert titles(upper) == PANELS
    assert figure.axes[0].get_ylabel() == r"$\Delta L$ (%)"
    assert all(ax.get_xlabel() == r"distance $\hat{z}$" for ax in lower)
    assert texts(upper[0].get_legend()) == [
        "S-C, fitted, 90 %",
        "C-B (theory)",
        "S-C, $K_b$ = 2",
        "S-C (PQuad)",
        r"uncertainty of $L_\infty$",
    ]
    assert texts(figure.legends[0]) == ["throttle:", "25 %", "50 %", "75 %", "92 %"]
    # data lie inside their panel, with their bars
    for boundary, ax in zip(("ground", "ceiling", "sidewall"), upper, strict=True):
        mine = pick(table, panel=boundary, kind="data")
        low, high = ax.get_ylim()
        assert (mine["delta_L_percent"] - mine["u_delta_L_percent"] > low).all()
        assert (mine["delta_L_percent"] + mine["u_delta_L_percent"] < high).all()


def test_many_throttles_get_a_colour_bar(make_job):
    levels = tuple(float(t) for t in np.round(np.linspace(0.2, 0.9, 12), 3))
    job = make_job(boundaries=("ground",), throttles=levels, repeats=2)
    figure = drawn(fig2.draw, fig2.table(gather(job)))
    assert figure.axes[-1].get_ylabel() == "throttle (%)"
    assert not figure.legends


@pytest.mark.parametrize("spec", OF_A_FIT, ids=lambda s: s.name)
def test_a_picture_has_its_size_and_type_that_can_be_read(small_job, spec):
    table = spec.table(gather(small_job))
    made = files.render(spec.draw, table)
    assert made["pdf"].startswith(b"%PDF")
    assert b"CreationDate" not in made["pdf"]
    picture = Image.open(io.BytesIO(made["png"]))
    assert "Software" not in picture.info
    assert picture.width == pytest.approx(6.75 * style.DPI, abs=1)
    figure = drawn(spec.draw, table)
    assert min(t.get_fontsize() for t in figure.findobj(Text) if t.get_text()) >= 6
    alt = spec.alt(table)
    assert all(f"{p}: " in alt or f"{p}, " in alt for p in table["panel"].unique())


PROCESS = """
import hashlib, sys
import pandas as pd
from nearlift.report.figures import files, residuals
table = pd.read_parquet(sys.argv[1])
made = files.render(residuals.draw, table, simulated=True)
print(*(hashlib.sha256(made[kind]).hexdigest() for kind in ("pdf", "png")))
"""


@pytest.mark.nightly
def test_every_process_draws_the_same_bytes(small_job, tmp_path):
    """The layout's solver orders its equations by a set, whose order depends on the hash seed."""
    residuals.table(gather(small_job)).to_parquet(tmp_path / "table.parquet")
    said = {
        subprocess.run(
            [sys.executable, "-c", PROCESS, tmp_path / "table.parquet"],
            env=os.environ | {"PYTHONHASHSEED": seed},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "77")
    }
    assert len(said) == 1


def test_settings_are_put_back_and_the_users_own_have_no_part(table):
    matplotlib.rcParams["lines.linewidth"] = 7.0
    try:
        before = dict(matplotlib.rcParams)
        mine = drawn(fig2.draw, table)
        assert dict(matplotlib.rcParams) == before
    finally:
        matplotlib.rcParams["lines.linewidth"] = matplotlib.rcParamsDefault["lines.linewidth"]
    assert 7.0 not in [line.get_linewidth() for line in mine.findobj(Line2D)]


@pytest.mark.parametrize("label", ["$", r"\frac{", "tab\there"])
def test_hostile_labels_are_set_as_text(table, label):
    one = pick(table, panel="ground").replace("C-B (theory)", label)
    drawn(fig2.draw, one).draw_without_rendering()


def test_an_unknown_covariate_keeps_its_name():
    assert style.quantity("rig_$_colour") == r"rig \$ colour"
    assert style.quantity("tilt_rad") == r"tilt $\theta$ (rad)"
    assert style.quantity("supply_V") == "supply voltage $U$ (V)"
