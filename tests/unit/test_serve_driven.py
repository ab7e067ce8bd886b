"""From a dropped folder of records to the report in a real browser, without the file system."""

from __future__ import annotations

import json

import pytest

from . import driven, small_run
from .browser import CHROMIUM, browser
from .test_serve import served

pytest.importorskip("starlette", reason="nearlift[serve] is not installed")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")
VALUES = {
    "vehicle.name": "Crazyflie 2.0",
    "vehicle.rotors": "4",
    "vehicle.rotor_radius": "23 mm",
    "vehicle.rotor_spacing": "65 mm",
    "vehicle.mass": "27 g",
    "vehicle.contact.ground": "12 mm",
    "vehicle.contact.ceiling": "2 mm",
    "rig.held": "throttle",
    "rig.distance_datum": "rotor plane",
    "rig.distance_offset": "0 mm",
    "rig.gravity": "9.8 m/s^2",
    "rig.arena": "",
    "load_cell.sample_rate": "500 Hz",
    "load_cell.range": "1 kgf",
    "load_cell.accuracy": "1.5 gf",
    "records.force.unit": "N",
    "trials.units.distance": "mm",
    "trials.units.throttle": "percent",
}


def test_a_folder_of_records_becomes_a_report(tmp_path):
    source = small_run.write(tmp_path / "measured", visits=2)
    root = tmp_path / "work"
    root.mkdir()
    with served(root) as own, browser(tmp_path) as page:
        page.open(own.link)
        driven.make(page, "rig", source / "trials")
        page.click("#force")
        # without a rate nobody knows the seconds of a sample
        page.wait("document.querySelector('#tare').disabled")
        driven.fill(page, VALUES)
        page.wait("!document.querySelector('#tare').disabled")
        # 0.1 of 0.4 s, and what lies left of the axis
        page.drag("#channels svg", 0.12, 0.2, 0.24, (64 + 0.25 * 564) / 640)
        reads = "document.querySelector('#reads').textContent"
        page.wait(f"{reads}.includes('is the unit')")
        driven.fill(page, {"records.force.unit": "mN"})
        page.wait(f"!{reads}.includes('unit')")
        # the schedule comes from a spreadsheet, with a column whose unit is then asked for
        page.paste("#grid th[scope=col]", (source / "trials.csv").read_text().replace(",", "\t"))
        page.wait(
            "document.getElementById('fault trials.units.start')?.textContent.includes('unit')"
        )
        driven.fill(page, {"trials.units.start": "s"})
        driven.settled(page)
        report = driven.run(page)
        assert page.errors == []
        page.back()
        driven.on(page, "work")
        page.wait(f"{driven.STATE} === 'done'")
        assert "report   figures" in page.run("document.querySelector('#log').textContent")
    made = (root / "raw" / "rig" / "campaign.toml").read_text()
    tare = float(made.split('tare        = "')[1].split(" s")[0])
    assert tare == pytest.approx(0.1, abs=0.004)
    assert (root / "raw" / "rig" / "trials.csv").read_text() == (source / "trials.csv").read_text()
    assert report["figures"] > 5
    found = json.loads((root / "processed" / "rig" / "results.json").read_text())
    k = found["boundaries"]["ground"]["coefficients"]["K_b"]
    # a draw of one campaign, whose true value is 2
    assert abs(k["value"] - 2.0) < 4 * k["u"]
