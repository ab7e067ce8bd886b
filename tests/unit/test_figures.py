"""Figures: told apart in colour and in grey, the same bytes each time, no trace in matplotlib's
settings.
"""

from __future__ import annotations

import dataclasses
import io
import threading
from functools import partial

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.layout_engine import LayoutEngine
from matplotlib.text import Text
from PIL import Image

from nearlift.errors import ManifestError
from nearlift.products import FIT, LIFT, POSTERIOR, TRIALS
from nearlift.report import drawers
from nearlift.report.figures import corner, encoding, style
from nearlift.report.figures.encoding import PAGE_WIDTH, render
from nearlift.report.figures.fig2 import drawing as draw_fig2
from nearlift.report.figures.fig2 import table as fig2
from nearlift.report.figures.fig2.points import force_unit
from nearlift.report.figures.residuals import drawing as draw_residuals
from nearlift.report.figures.residuals import table as residuals
from nearlift.report.registry import FIGURES
from nearlift.stages.report import gather

#: Figures of the loop, of flow, flight and proximity need more, and that of what is carried other
#: columns: they are tested beside what makes them.
OF_A_FIT = [
    s for s in FIGURES if set(s.needs) <= {TRIALS, LIFT, FIT, POSTERIOR} and s.name != "carried"
]


@pytest.fixture(scope="module")
def table(small_job):
    return fig2.summarise(gather(small_job))


def drawn(draw, table, name="aiaa"):
    look = style.style(name)
    with style.context(look):
        return draw(table, look)


def test_series_differ_in_colour_and_marker():
    colours, markers = zip(*style.SERIES, strict=True)
    assert len(set(colours)) == len(set(markers)) == len(style.SERIES)


def test_four_throttles_are_told_apart_by_marker_and_colour(table):
    figure = drawn(draw_fig2.draw, table)
    for ax in figure.axes:
        lines = [c.lines[0] for c in ax.containers]
        assert len({line.get_marker() for line in lines}) == 4
        assert len({line.get_color() for line in lines}) == 4


def test_theory_is_told_apart_without_colour(table):
    ground = drawn(draw_fig2.draw, table).axes[0]
    styles = [str(line._dash_pattern) for line in ground.lines if len(line.get_xdata()) > 100]
    assert len(styles) == len(set(styles)) == 3


def test_panels_are_labelled_with_units_and_curves_named(table):
    figure = drawn(draw_fig2.draw, table)
    assert [ax.get_title(loc="left") for ax in figure.axes] == [
        "a) ground",
        "b) ceiling",
        "c) sidewall",
    ]
    assert figure.axes[0].get_ylabel() == r"$\Delta L$ from the fit's $L_\infty$ (%)"
    assert all(ax.get_xlabel() == r"distance $\hat{z}$" for ax in figure.axes)
    named = [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    assert named == [
        "S-C, fitted, 90 %",
        "C-B (theory)",
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
    figure = drawn(draw_fig2.draw, table)
    for boundary, ax in zip(("ground", "ceiling", "sidewall"), figure.axes, strict=True):
        mine = (table["panel"] == boundary) & (table["kind"] == "data")
        low, high = ax.get_ylim()
        assert np.all(table["delta_L_percent"][mine] - table["u_delta_L_percent"][mine] > low)
        assert np.all(table["delta_L_percent"][mine] + table["u_delta_L_percent"][mine] < high)


@pytest.mark.parametrize("name", [s.name for s in style.STYLES])
def test_every_style_has_its_column_width(table, name):
    look = style.style(name)
    assert drawn(draw_fig2.draw, table, name).get_figwidth() == pytest.approx(look.double_in)
    one = {k: v[table["panel"] == "ground"] for k, v in table.items()}
    assert drawn(draw_fig2.draw, one, name).get_figwidth() == pytest.approx(look.single_in)


def test_many_throttles_get_a_colour_bar(make_job):
    levels = tuple(float(t) for t in np.round(np.linspace(0.2, 0.9, 12), 3))
    job = make_job(boundaries=("ground",), throttles=levels, repeats=2)
    figure = drawn(draw_fig2.draw, fig2.summarise(gather(job)))
    assert figure.axes[-1].get_ylabel() == "throttle (%)"
    assert not figure.legends


@pytest.mark.parametrize("spec", OF_A_FIT, ids=lambda s: s.name)
def test_the_same_table_gives_the_same_bytes(small_job, spec):
    rows = spec.summarise(gather(small_job))
    first, second = (render(spec.draw, rows, style.style("aiaa")) for _ in range(2))
    assert first == second
    assert b"CreationDate" not in first["pdf"]
    assert first["pdf"].startswith(b"%PDF")
    picture = Image.open(io.BytesIO(first["png"]))
    assert "Software" not in picture.info
    assert picture.width == pytest.approx(6.75 * 300, abs=1)
    assert Image.open(io.BytesIO(first["page"])).width == min(PAGE_WIDTH, picture.width)


@pytest.mark.parametrize("spec", OF_A_FIT, ids=lambda s: s.name)
def test_no_type_is_below_six_points_at_printed_size(small_job, spec):
    # Nature's, whose type is the smallest
    figure = drawn(spec.draw, spec.summarise(gather(small_job)), "nature")
    assert min(t.get_fontsize() for t in figure.findobj(Text) if t.get_text()) >= 6


def test_settings_are_put_back_and_the_users_own_have_no_part(table):
    matplotlib.rcParams["lines.linewidth"] = 7.0
    try:
        before = dict(matplotlib.rcParams)
        mine = render(draw_fig2.draw, table, style.style("aiaa"))
        assert dict(matplotlib.rcParams) == before
    finally:
        matplotlib.rcParams["lines.linewidth"] = matplotlib.rcParamsDefault["lines.linewidth"]
    assert mine == render(draw_fig2.draw, table, style.style("aiaa"))


def test_unknown_style_is_refused_with_the_nearest():
    with pytest.raises(ManifestError, match=r"no style 'elsevire'\n  did you mean 'elsevier'\?"):
        style.style("elsevire")


@pytest.mark.parametrize("label", ["$", r"\frac{", "a $x_1", "tab\there", r"\$"])
def test_hostile_labels_are_set_as_text(table, label):
    edited = {**table, "label": np.where(table["label"] == "C-B (theory)", label, table["label"])}
    render(draw_fig2.draw, edited, style.style("aiaa"))


def test_residuals_fill_a_grid_or_columns(small_job, make_job):
    three = drawn(draw_residuals.draw, residuals.summarise(gather(small_job)))
    assert [ax.get_title(loc="left") for ax in three.axes[:3]] == [
        "a) ground",
        "b) ceiling",
        "c) sidewall",
    ]
    one = drawn(draw_residuals.draw, residuals.summarise(gather(make_job(boundaries=("ground",)))))
    labels = [ax.get_xlabel() for ax in one.axes if ax.axison]
    assert labels == [
        r"$\hat{z}$",
        r"throttle $\tau$ (%)",
        "run order (trial)",
        "time $t_0$ (s)",
        "session",
        "supply voltage $U$ (V)",
        "direction of the last move",
        r"drift $\dot{L}$ (N/s)",
    ]
    assert one._supylabel.get_text() == "relative residual (%)"


def test_an_unknown_covariate_keeps_its_name():
    assert style.quantity("rig_$_colour") == r"rig \$ colour"
    assert style.quantity("tilt_rad") == r"tilt $\theta$ (rad)"
    # what the page calls a covariate stands at the axis too
    assert style.quantity("supply_V") == "supply voltage $U$ (V)"
    assert style.quantity("climb_m_s") == r"climb $\dot{z}$ (m/s)"


def test_distances_in_millimetres_move_the_axis_and_nothing_else(small_job, table):
    """The same picture over another axis: 23 mm a radius."""
    over, far = style.style("aiaa"), dataclasses.replace(style.style("aiaa"), radius_mm=23.0)
    for draw, rows in (
        (draw_fig2.draw, table),
        (draw_residuals.draw, residuals.summarise(gather(small_job))),
    ):
        with style.context(over):
            one, other = draw(rows, over).axes[0], draw(rows, far).axes[0]
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


def test_the_solvers_last_digits_are_not_in_the_file():
    """A layout may differ in the fourteenth digit from run to run."""

    class Unsteady(LayoutEngine):
        _adjust_compatible = _colorbar_gridspec = True

        def __init__(self, off):
            super().__init__()
            self.off = off

        def execute(self, fig):
            for ax in fig.axes:
                ax.set_position((0.1234565 + 1e-9 + self.off, 0.2, 0.7, 0.7))

    def draw(off, table, look):
        figure = Figure(layout=Unsteady(off))
        figure.subplots().plot([0, 1], [0, 1])
        return figure

    look = style.style("nature")
    assert render(partial(draw, 0.0), {}, look) == render(partial(draw, 3e-13), {}, look)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_drawers_answer_in_order_whoever_drew(count):
    tasks = [partial(style.quantity, name) for name in ("tilt_rad", "supply_V", "power_W", "z_hat")]
    with drawers.drawers(count) as give:
        assert [answer() for answer in [give(task) for task in tasks]] == [t() for t in tasks]


def test_what_a_drawer_cannot_do_is_drawn_here():
    """What cannot be sent, what fails, and a drawer that is gone."""
    with drawers._drawer() as ask:
        assert ask(partial(str, threading.Lock())) is None
        assert ask(partial(style.quantity, "tilt_rad")) == style.quantity("tilt_rad")
        assert ask(partial(style.style, "no such style")) is None
        assert ask(partial(style.quantity, "tilt_rad")) is None
    tasks = [lambda: {"pdf": b"1"}, lambda: {"pdf": b"2"}, partial(style.style, "no such style")]
    with drawers.drawers(1) as give:
        *answers, failing = [give(task) for task in tasks]
        assert [answer()["pdf"] for answer in answers] == [b"1", b"2"]
        with pytest.raises(ManifestError, match="no style"):
            failing()


def test_what_is_given_is_drawn_before_it_is_asked_for():
    with drawers.drawers(1) as give:
        first, second = threading.Event(), threading.Event()
        give(partial(style.quantity, "tilt_rad"))
        # a task that cannot be sent comes back at once: the drawer did not wait to be asked
        give(Unsent(first, second))
        assert first.wait(60)
    assert not second.is_set()


class Unsent:
    """A task that tells when it is to be sent, and when it is done here."""

    def __init__(self, sent, done):
        self.sent, self.done = sent, done

    def __reduce__(self):
        self.sent.set()
        raise TypeError

    def __call__(self):
        self.done.set()
        return {}


@pytest.mark.parametrize("draw", [draw_fig2.draw, draw_residuals.draw])
def test_what_spares_time_moves_nothing(draw, table, small_job, monkeypatch):
    rows = table if draw is draw_fig2.draw else residuals.summarise(gather(small_job))
    files = render(draw, rows, style.style("aiaa"))
    monkeypatch.setattr(encoding, "_measured_once", lambda figure: None)
    assert render(draw, rows, style.style("aiaa")) == files
