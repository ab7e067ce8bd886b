"""Lets the calibration's modules import each other as `tests.calibration.*`, from pytest, from its workers and from the command line."""

import sys
from pathlib import Path

ROOT = str(Path(__file__).resolve().parents[2])
if ROOT not in sys.path:
    sys.path.insert(0, ROOT)
