"""Assumptions behind Delta L, from products to the page."""

import re

import pytest
from tests.unit import small_run
from tests.unit.manifests import raw_manifest

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
