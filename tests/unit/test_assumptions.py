"""What the ratio takes for granted, from products to picture and page."""

import json
import re

import numpy as np
import pytest
from tests.unit.conftest import true_ratio
from tests.unit.manifests import raw_manifest

from nearlift.products import FIT
from nearlift.report.figures import assumptions, style
from nearlift.report.figures import assumptions as drawing
from nearlift.stages.report import gather

from . import small_run

MAP = {
    "points": [
        ["25 percent", "10885 rpm"],
        ["50 percent", "15924 rpm"],
        ["92 percent", "23600 rpm"],
    ],
    "uncertainty": "0.5 percent",
}


@pytest.fixture(scope="module")
def mapped(make_job):
    raw = raw_manifest()
    return make_job(
        boundaries=("ground",),
        vehicle={**raw["vehicle"], "throttle_map": MAP},
        rig={**raw["rig"], "air_density": "1.2 kg/m^3"},
    )


def drawn(table):
    look = style.style("aiaa")
    with style.context(look):
        return drawing.draw(table, look)


def test_the_table_is_what_fit_json_says(small_job):
    evidence = gather(small_job)
    table = assumptions.summarise(evidence)
    assert set(table["part"]) == {"throttle", "exponent"}
    found = evidence.document(FIT)
    for boundary in ("ground", "ceiling", "sidewall"):
        mine = table["panel"] == boundary
        each = mine & (table["kind"] == "throttle")
        assert table["x"][each].tolist() == [25, 50, 75, 92]
        assert table["value"][each].tolist() == [
            e["value"] for e in found["throttle_collapse"][boundary]["per_throttle"].values()
        ]
        # what throttles share is in the thin interval and not in the thick one
        assert (table["hi90_apart"][each] <= table["hi90"][each] * (1 + 1e-9)).all()
        marks = mine & (table["kind"] == "plausible")
        assert table["x"][marks] == pytest.approx([1, 0.82, 2 / 3, 0.6])
        curve = mine & (table["kind"] == "curve")
        assert np.interp(0.82, table["x"][curve], table["value"][curve]) == pytest.approx(
            table["value"][marks][1], rel=0.01
        )


def test_a_row_of_panels_per_question_and_a_column_per_boundary(small_job):
    figure = drawn(assumptions.summarise(gather(small_job)))
    assert [ax.get_title(loc="left") for ax in figure.axes] == [
        "a) ground",
        "b) ceiling",
        "c) sidewall",
        "d) ground",
        "e) ceiling",
        "f) sidewall",
    ]
    assert [ax.get_xlabel() for ax in figure.axes[::3]] == [
        "throttle (%)",
        "exponent $n$ of the ratio",
    ]
    assert [ax.get_ylabel() for ax in figure.axes[:3]] == ["$K_b$", r"$\alpha$", "$a$"]


def test_a_map_adds_the_rotor_to_picture_and_page(mapped):
    evidence = gather(mapped)
    table = assumptions.summarise(evidence)
    figure = drawn(table)
    assert len(figure.axes) == 3
    assert figure.axes[2].get_xlabel() == "rotor speed $f$ (Hz)"
    points = table["kind"] == "C_L"
    assert table["x"][points][0] == pytest.approx(10885 / 60)
    # the law goes through the middle of the points
    law = table["kind"] == "law"
    on_it = np.interp(table["x"][points], table["x"][law], table["value"][law])
    assert np.abs(on_it / table["value"][points] - 1).max() < 0.2
    assert "dashed: the constant of Carter et al. 2021" in assumptions.caption(evidence, table)
    assert "Ground: C_L per speed:" in assumptions.alt(evidence, table)
    text = small_run.chapter(evidence, "assumptions")
    rotor = text.partition("Lift coefficient of the rotor at each throttle")[2]
    assert re.findall(r'<th scope="row">([^<]+)', rotor) == ["25 %", "50 %", "75 %", "92 %"]
    speed = "fit.json#/rotor_coefficient/ground/per_throttle/0.25/speed_Hz"
    assert (
        f'<th scope="row">25 %</th><td><data value="{10885 / 60!r}" data-source="{speed}">' in rotor
    )


def test_supported_exponents_are_shaded(small_job):
    table = assumptions.summarise(gather(small_job))
    row = {name: column[:2].copy() for name, column in table.items()}
    row["kind"][:], row["part"][:], row["x"][:] = "supported", "exponent", [0.5, 0.7]
    both = {name: np.concatenate([column, row[name]]) for name, column in table.items()}
    assert len(drawn(both).axes[3].patches) == 1 + len(drawn(table).axes[3].patches)
    assert "Shade" in assumptions.caption(gather(small_job), both)


def test_every_number_of_the_page_has_its_place(small_job):
    text = small_run.chapter(gather(small_job), "assumptions")
    collapse = text.partition("<tbody>")[2].partition("</tbody>")[0]
    rows = collapse.split("<tr>")[1:]
    assert [re.findall(r'<th scope="row">([^<]+)', row) for row in rows] == [
        ["Ground"],
        ["Ceiling"],
        ["Sidewall"],
    ]
    assert [re.findall(r'data-source="([^"]+)', row)[2] for row in rows] == [
        f"fit.json#/throttle_collapse/{boundary}/tests/cells/p_value"
        for boundary in ("ground", "ceiling", "sidewall")
    ]
    assert 'data-source="fit.json#/held_quantity/ceiling/plausible/0/value"' in text
    assert "fixes neither speed nor power" in text
    assert "Lift coefficient of the rotor at each throttle" not in text


def test_a_departure_without_an_end_has_no_number(make_job):
    job = make_job()
    path = job.processed / FIT.file
    fit = json.loads(path.read_text())
    for entry in fit["throttle_collapse"].values():
        entry["largest_departure"]["coefficient"]["bound95"] = None
    path.write_text(json.dumps(fit))
    text = small_run.chapter(gather(job), "assumptions")
    assert "largest_departure/delta_L/bound95" in text
    assert "largest_departure/coefficient/bound95" not in text


def test_logged_speed_reaches_held_quantity_and_rotor(make_job):
    """A speed that gives way to the load, as trials.parquet carries the schedule's rpm."""

    def log_speed(table):
        rng = np.random.default_rng(3)
        answer = true_ratio("ground", np.minimum(table["z_hat"], 1e3)) ** -0.15
        table["speed_Hz"] = (
            390
            * (table["throttle"] / 0.92) ** 0.6
            * answer
            * np.exp(0.002 * rng.standard_normal(len(answer)))
        )

    raw = raw_manifest()
    job = make_job(
        boundaries=("ground",), edit=log_speed, rig={**raw["rig"], "air_density": "1.2 kg/m^3"}
    )
    found = job.read_json(FIT)
    held = found["held_quantity"]["ground"]
    speed = held["logged"][0]
    assert (speed["quantity"], speed["held"]) == ("speed_Hz", False)
    assert speed["response"]["lo90"] - 0.05 < -0.15 < speed["response"]["hi90"] + 0.05
    low, high = held["supported_exponents"]
    assert low < 0.6 / 1.3 < 0.82 / 1.3 < high
    assert held["range"]["from"] == "logged quantities"
    rotor = found["rotor_coefficient"]["ground"]
    assert rotor["speed_from"] == "the rpm logged, far from the boundary"
    # the trials' L_inf goes as throttle to 1.4, the speed squared as 1.2
    assert rotor["exponent"]["value"] == pytest.approx(0.2 / 0.6, abs=0.02)
    assert rotor["p_trend"] < 1e-3
    assert (assumptions.summarise(gather(job))["kind"] == "supported").sum() == 2
