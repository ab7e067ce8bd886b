"""Programs of `make calibrate` run for hours and seldom: that each still imports is seen here."""

import importlib
from pathlib import Path

import pytest

PROGRAMS = sorted(
    path.stem for path in (Path(__file__).parents[1] / "calibration").glob("[!_]*.py")
)


@pytest.mark.parametrize("name", PROGRAMS)
def test_it_finds_what_it_takes_from_the_package(name):
    importlib.import_module(f"tests.calibration.{name}")
