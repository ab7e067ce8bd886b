"""Assumptions behind Delta L, from products to the page."""

import json
import re

import numpy as np
import pytest
from tests.unit import small_run
from tests.unit.conftest import true_ratio
from tests.unit.manifests import raw_manifest

from nearlift.stages.fit import FIT
from nearlift.stages.gathering import gather

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


def test_a_map_adds_the_rotor_to_the_page(mapped):
    evidence = gather(mapped)
    text = small_run.chapter(evidence, "assumptions")
    rotor = text.partition("Lift coefficient of the rotor at each throttle")[2]
    rotor = rotor.partition("<tbody>")[2].partition("</tbody>")[0]
    rows = re.findall(r'<th scope="row">Ground</th><td>([^<]+)</td>', rotor)
    assert rows == [f"{t}\N{NO-BREAK SPACE}%" for t in (25, 50, 75, 92)]
    speed = "fit.json#/rotor_coefficient/ground/per_throttle/0.25/speed_Hz"
    assert f'<td><data value="{10885 / 60!r}" data-source="{speed}">' in rotor


def test_every_number_of_the_page_has_its_place(small_job):
    text = small_run.chapter(gather(small_job), "assumptions")
    collapse = text.partition("<tbody>")[2].partition("</tbody>")[0]
    rows = collapse.split("<tr>")[1:]
    assert [re.findall(r'<th scope="row">([^<]+)', row) for row in rows] == [
        ["Ground"],
        ["Ceiling"],
        ["Sidewall"],
    ]
    assert [re.findall(r'data-source="([^"]+)', row)[0] for row in rows] == [
        f"fit.json#/throttle_collapse/{boundary}/test/p_value"
        for boundary in ("ground", "ceiling", "sidewall")
    ]
    assert 'data-source="fit.json#/held_quantity/ceiling/plausible/0/value"' in text
    each = text.partition("log ratio at each throttle")[2]
    each = each.partition("<tbody>")[2].partition("</tbody>")[0].split("<tr>")[1:]
    assert len(each) == 12
    assert "<td>25\N{NO-BREAK SPACE}%</td>" in each[0]
    place = "fit.json#/throttle_collapse/ground/per_throttle/0.25/"
    assert re.findall(r'data-source="([^"]+)', each[0]) == [
        place + key for key in ("value", "u", "lo90", "hi90")
    ]
    assert "Lift coefficient of the rotor at each throttle" not in text


def test_a_departure_without_an_end_has_no_number(make_job):
    job = make_job()
    path = job.processed / FIT.file
    fit = json.loads(path.read_text())
    for entry in fit["throttle_collapse"].values():
        entry["largest_departure"]["bound95"] = None
    path.write_text(json.dumps(fit))
    text = small_run.chapter(gather(job), "assumptions")
    assert "throttle_collapse/ground/test/p_value" in text
    assert "largest_departure/bound95" not in text


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
    assert [x["n"] for x in held["supported"]] == [low, high]
    rotor = found["rotor_coefficient"]["ground"]
    assert rotor["speed_from"] == "the rpm logged, far from the boundary"
    # the trials' L_inf goes as throttle to 1.4, the speed squared as 1.2
    assert rotor["exponent"]["value"] == pytest.approx(0.2 / 0.6, abs=0.02)
    assert rotor["p_trend"] < 1e-3
