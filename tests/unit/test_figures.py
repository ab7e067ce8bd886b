"""Figures: distinguishable in colour and in grey, the same picture each time, no trace in
matplotlib's settings.
"""

from __future__ import annotations

import dataclasses
import io

import matplotlib
import numpy as np
import pytest
from matplotlib.lines import Line2D
from matplotlib.text import Text
from PIL import Image, ImageChops

from nearlift.campaign import manifest as manifest
from nearlift.errors import ManifestError
from nearlift.report.figures import corner, fig2, residuals, style
from nearlift.report.figures.fig2 import force_unit
from nearlift.report.figures.files import render
from nearlift.report.registry import FIGURES
from nearlift.stages.fit import FIT, POSTERIOR
from nearlift.stages.gathering import gather
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

from .manifests import raw_manifest

#: Figures of the loop, of flow, flight and proximity need more, and that of what is carried other
#: columns: they are tested beside what makes them.
OF_A_FIT = [
    s for s in FIGURES if set(s.needs) <= {TRIALS, LIFT, FIT, POSTERIOR} and s.name != "carried"
]


@pytest.fixture(scope="module")
def table(small_job):
    return fig2.summarise(gather(small_job))


def drawn(draw, table):
    look = style.Style()
    with style.context(look):
        return draw(table, look)


def same_picture(one, other):
    """Whether two pictures differ in fewer than a pixel in a thousand."""
    differs = np.asarray(ImageChops.difference(one.convert("RGB"), other.convert("RGB"))).any(
        axis=2
    )
    return differs.mean() < 1e-3


def test_series_differ_in_colour_and_marker():
    colours, markers = zip(*style.SERIES, strict=True)
    assert len(set(colours)) == len(set(markers)) == len(style.SERIES)


def test_four_throttles_are_told_apart_by_marker_and_colour(table):
    figure = drawn(fig2.draw, table)
    assert len(figure.axes) == 6
    for ax in figure.axes:
        lines = [c.lines[0] for c in ax.containers]
        assert len({line.get_marker() for line in lines}) == 4
        assert len({line.get_color() for line in lines}) == 4


def test_theory_is_told_apart_without_colour(table):
    ground = drawn(fig2.draw, table).axes[0]
    styles = [str(line._dash_pattern) for line in ground.lines if len(line.get_xdata()) > 100]
    assert len(styles) == len(set(styles)) == 4


def test_panels_are_labelled_with_units_and_curves_named(table):
    figure = drawn(fig2.draw, table)
    upper, lower = figure.axes[:3], figure.axes[3:]
    assert [ax.get_title(loc="left") for ax in upper] == [
        "a) ground",
        "b) ceiling",
        "c) sidewall",
    ]
    assert figure.axes[0].get_ylabel() == r"$\Delta L$ (%)"
    assert all(ax.get_xlabel() == r"distance $\hat{z}$" for ax in lower)
    named = [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    assert named == [
        "S-C, fitted, 90 %",
        "C-B (theory)",
        "S-C, $K_b$ = 2",
        "S-C (PQuad)",
        r"uncertainty of $L_\infty$",
    ]
    assert [t.get_text() for t in figure.legends[0].get_texts()] == [
        "throttle:",
        "25 %",
        "50 %",
        "75 %",
        "92 %",
    ]


def test_data_lie_inside_the_panel_with_their_bars(table):
    figure = drawn(fig2.draw, table)
    for boundary, ax in zip(("ground", "ceiling", "sidewall"), figure.axes[:3], strict=True):
        mine = (table["panel"] == boundary) & (table["kind"] == "data")
        low, high = ax.get_ylim()
        assert np.all(table["delta_L_percent"][mine] - table["u_delta_L_percent"][mine] > low)
        assert np.all(table["delta_L_percent"][mine] + table["u_delta_L_percent"][mine] < high)


def test_figures_have_the_widths_of_the_manifest(make_job):
    job = make_job(report={"column_width": "89 mm", "full_width": "183 mm"})
    look, table = style.style_of(job.campaign), fig2.summarise(gather(job))
    assert look.radius_mm is None
    one = {k: v[table["panel"] == "ground"] for k, v in table.items()}
    with style.context(look):
        for rows, width_mm in ((table, 183), (one, 89)):
            figure = fig2.draw(rows, look)
            assert 25.4 * figure.get_figwidth() == pytest.approx(width_mm)


@pytest.mark.parametrize("width", ["8 mm", "3 m", "90"])
def test_a_width_that_no_page_has_is_refused(width):
    with pytest.raises(ManifestError, match=r"report\.full_width"):
        manifest.parse(raw_manifest(report={"full_width": width}))


def test_many_throttles_get_a_colour_bar(make_job):
    levels = tuple(float(t) for t in np.round(np.linspace(0.2, 0.9, 12), 3))
    job = make_job(boundaries=("ground",), throttles=levels, repeats=2)
    figure = drawn(fig2.draw, fig2.summarise(gather(job)))
    assert figure.axes[-1].get_ylabel() == "throttle (%)"
    assert not figure.legends


@pytest.mark.parametrize("spec", OF_A_FIT, ids=lambda s: s.name)
def test_the_same_table_gives_the_same_picture(small_job, spec):
    rows = spec.summarise(gather(small_job))
    first, second = (render(spec.draw, rows, style.Style()) for _ in range(2))
    assert first["pdf"].startswith(b"%PDF")
    assert b"CreationDate" not in first["pdf"]
    one, other = (Image.open(io.BytesIO(files["png"])) for files in (first, second))
    assert "Software" not in one.info
    assert one.width == pytest.approx(6.75 * style.DPI, abs=1)
    assert one.size == other.size
    assert same_picture(one, other)


@pytest.mark.parametrize("spec", OF_A_FIT, ids=lambda s: s.name)
def test_no_type_is_below_six_points_at_printed_size(small_job, spec):
    figure = drawn(spec.draw, spec.summarise(gather(small_job)))
    assert min(t.get_fontsize() for t in figure.findobj(Text) if t.get_text()) >= 6


def test_settings_are_put_back_and_the_users_own_have_no_part(table):
    matplotlib.rcParams["lines.linewidth"] = 7.0
    try:
        before = dict(matplotlib.rcParams)
        mine = drawn(fig2.draw, table)
        assert dict(matplotlib.rcParams) == before
    finally:
        matplotlib.rcParams["lines.linewidth"] = matplotlib.rcParamsDefault["lines.linewidth"]
    widths = [
        [line.get_linewidth() for line in f.findobj(Line2D)]
        for f in (mine, drawn(fig2.draw, table))
    ]
    assert widths[0] == widths[1]
    assert 7.0 not in widths[0]


@pytest.mark.parametrize("label", ["$", r"\frac{", "a $x_1", "tab\there", r"\$"])
def test_hostile_labels_are_set_as_text(table, label):
    edited = {**table, "label": np.where(table["label"] == "C-B (theory)", label, table["label"])}
    render(fig2.draw, edited, style.Style())


def test_residuals_fill_a_grid_or_columns(small_job, make_job):
    three = drawn(residuals.draw, residuals.summarise(gather(small_job)))
    assert [ax.get_title(loc="left") for ax in three.axes[:3]] == [
        "a) ground",
        "b) ceiling",
        "c) sidewall",
    ]
    one = drawn(residuals.draw, residuals.summarise(gather(make_job(boundaries=("ground",)))))
    labels = [ax.get_xlabel() for ax in one.axes if ax.axison]
    assert labels == [
        r"$\hat{z}$",
        r"throttle $\tau$ (%)",
        "run order (trial)",
    ]
    assert one._supylabel.get_text() == "relative residual (%)"


def test_an_unknown_covariate_keeps_its_name():
    assert style.quantity("rig_$_colour") == r"rig \$ colour"
    assert style.quantity("tilt_rad") == r"tilt $\theta$ (rad)"
    assert style.quantity("supply_V") == "supply voltage $U$ (V)"


def test_distances_in_millimetres_move_the_axis_and_nothing_else(small_job, table):
    """The same picture over another axis: 23 mm a radius."""
    over, far = style.Style(), dataclasses.replace(style.Style(), radius_mm=23.0)
    for draw, rows in (
        (fig2.draw, table),
        (residuals.draw, residuals.summarise(gather(small_job))),
    ):
        with style.context(over):
            one, other = (
                next(ax for ax in draw(rows, unit).axes if ax.get_xlabel()) for unit in (over, far)
            )
        assert other.get_xlabel().endswith("$z$ (mm)")
        np.testing.assert_allclose(np.multiply(23.0, one.get_xlim()), other.get_xlim())
        assert one.get_ylim() == other.get_ylim()


@pytest.mark.parametrize(("unit", "factor"), [("N", 1.0), ("mN", 1e3), ("gf", 1 / 9.80665e-3)])
def test_forces_are_shown_in_the_unit_that_is_asked_for(make_job, unit, factor):
    job = make_job(boundaries=("ground",), report={"units": {"force": unit}})
    evidence = gather(job)
    assert force_unit(evidence) == (pytest.approx(factor), unit)
    level = [n for n in corner.draws(evidence, "ground") if n.startswith("L_inf_")]
    assert [n.partition("[")[0] for n in level] == [f"L_inf_{unit}"]
    shown = corner.draws(evidence, "ground")[level[0]]
    draws = evidence.table(POSTERIOR)
    mine = (draws["parameter"] == f"L_inf_N[{level[0].partition('[')[2]}") & (
        draws["model"] == "sanchez_cuevas"
    )
    np.testing.assert_allclose(shown, factor * draws["value"][mine])
