"""Files that laboratories recorded, damaged: whatever their bytes are, a trial has its row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.calibration.records import damages, reduced
from tests.unit.manifests import manifest

from nearlift.reduction.quality import rejected

DATA = Path(__file__).parents[2].parent / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not here")

RAMP = {
    "columns": ["thrust", "current", "voltage", "power", "throttle", "loop", "t"],
    "units": ["kgf", "A", "V", "W", "percent", "Hz", "us"],
    "ignore": ["START", "STOP"],
}
#: Reader, file, column, unit, dialect.
REAL: list[tuple[str, str, str, str, dict[str, Any]]] = [
    ("rcbenchmark", "rcbenchmark-logs/StepsTest_2020-06-16_220513.csv", "Thrust", "gf", {}),
    ("rcbenchmark", "rcbenchmark-logs/aerostack2_xNova-SR-steps-up.csv", "Thrust", "N", {}),
    ("lvm", "daq-format-samples/short.lvm", "Excitation (Trigger)", "N", {}),
    ("tdms", "daq-format-samples/big_endian.tdms", "Measured Data/Amplitude sweep", "N", {}),
    ("crazyflie", "crazyflie-thrust-stand/imrc_cf21bl_guards_2026.csv", "thrust", "gf", {}),
    ("text", "pitt-ras-iarc7-thrust/v2_static/apc_12_6.txt", "thrust", "kgf", RAMP),
]


@pytest.mark.parametrize(
    ("name", "file", "column", "unit", "dialect"), REAL, ids=[row[1].split("/")[-1] for row in REAL]
)
def test_a_damaged_file_of_a_laboratory_has_its_row(
    name: str, file: str, column: str, unit: str, dialect: dict[str, Any], tmp_path: Path
) -> None:
    content = (DATA / file).read_bytes()
    campaign = manifest(
        load_cell={"sample_rate": "40 Hz", "tare": "none", "range": None},
        records={
            "reader": name,
            "files": f"{{trial}}{Path(file).suffix}",
            "force": {"column": column, "unit": unit, "sign": 1},
            "dialect": {**dialect, "ignore_rate": True},
        },
    )
    contents = [spoilt for _, spoilt in damages(content, flips=10, sectors=10)]
    whole, *rows = reduced(campaign, tmp_path, [content, *contents])
    assert np.isfinite(whole.reduced.lift_N)
    assert len(rows) == len(contents)
    for row in rows:
        good = not rejected(np.array([" ".join(row.reduced.codes)], dtype=object))[0]
        assert np.isfinite(row.reduced.lift_N) or not good
        assert row.fault or "MALFORMED" not in row.reduced.codes
