"""Measured files dropped on the bench's page in a real browser become a report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit import driven
from tests.unit.browser import CHROMIUM, browser
from tests.unit.test_serve import served

from .test_stand_logs import Z_HATS, column_times, ratio

pytest.importorskip("starlette", reason="nearlift[serve] is not installed")
SHARED = Path(__file__).parents[3] / "shared"
pytestmark = [
    pytest.mark.skipif(not SHARED.is_dir(), reason="the measured files of ../shared are not here"),
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed"),
]
RIG = {
    "vehicle.name": "one rotor",
    "vehicle.rotors": "1",
    "vehicle.rotor_radius": "152.4 mm",
    "vehicle.rotor_spacing": "",
    "vehicle.mass": "1 kg",
    "rig.held": "throttle",
    "rig.distance_datum": "rotor plane",
    "rig.distance_offset": "0 mm",
    "rig.gravity": "9.80665 m/s^2",
    "rig.arena": "5 m",
}
CONTACT = {"vehicle.contact.ground": "1 mm", "vehicle.contact.ceiling": "1 mm"}


def test_steps_of_an_rcbenchmark(tmp_path):
    """One log of steps, with thrust times a known ratio at eight distances."""
    log = SHARED / "data" / "rcbenchmark-logs" / "aerostack2_xNova-SR-steps-up.csv"
    text = log.read_text(encoding="utf-8-sig")
    source, root = tmp_path / "stand", tmp_path / "work"
    source.mkdir()
    root.mkdir()
    rows = "record\tboundary\tdistance\n"
    for k, z in enumerate(Z_HATS):
        (source / f"r{k}.csv").write_text(column_times(text, 9, ratio(z)), encoding="utf-8")
        rows += f"r{k}\tground\t{100 * z:g}\n"
    with served(root) as own, browser(tmp_path) as page:
        page.open(own.link)
        driven.make(page, "stand", *sorted(source.iterdir()))
        cell = {"load_cell.tare": "none", "load_cell.range": "", "load_cell.accuracy": "0.05 N"}
        own_rig = RIG | CONTACT | {"vehicle.rotor_radius": "100 mm", "vehicle.mass": "0.5 kg"}
        driven.fill(page, own_rig | cell | {"trials.units.distance": "mm"})
        page.wait("document.querySelector('#reads').textContent.includes('change the sign')")
        driven.fill(page, {"records.force.sign": "-1", "segments.settle": "1 s"})
        page.paste("#grid th[scope=col]", rows)
        driven.settled(page)
        report = driven.run(page)
        assert page.errors == []
    assert report["figures"] > 5
    found = json.loads((root / "processed" / "stand" / "results.json").read_text())
    k = found["boundaries"]["ground"]["coefficients"]["k"]
    assert abs(k["value"] - 1.0) < max(0.05, 3 * k["u"])


def test_a_table_of_means(tmp_path):
    """Pitt-RAS 2017: 378 mean lifts of one rotor, whose supply explains what distance seemed to."""
    root = tmp_path / "work"
    root.mkdir()
    with served(root) as own, browser(tmp_path) as page:
        page.open(own.link)
        driven.make(page, "pitt", SHARED / "campaigns" / "pitt-ras-2017" / "trials.csv")
        units = {
            "distance": "m",
            "throttle": "fraction",
            "lift": "kgf",
            "supply": "V",
            "start": "s",
        }
        units = {f"trials.units.{name}": unit for name, unit in units.items()}
        driven.fill(page, RIG | CONTACT | units)
        driven.settled(page)
        report = driven.run(page)
        assert page.errors == []
    assert "supply" in report["text"]
    found = json.loads((root / "processed" / "pitt" / "results.json").read_text())
    assert found["boundaries"]["ground"]["verdict"] == "effect"
