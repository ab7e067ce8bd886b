"""posterior.nc in ArviZ 1.x, which wants Python 3.12: in an environment of its own, where one can
be made. `make calibrate`.
"""

import shutil
import subprocess

import pytest
from tests.unit import small_run

pytestmark = pytest.mark.calibration
NEWER = ("python3.14", "python3.13", "python3.12")
LOOK = """
import sys, arviz
tree = arviz.from_netcdf(sys.argv[1])
assert int(arviz.__version__.split(".")[0]) >= 1, arviz.__version__
for group in ("posterior", "ground/sanchez_cuevas/posterior"):
    assert tree[group]["K_b"].size >= 4000, tree[group]["K_b"].shape
print(float(arviz.ess(tree["posterior"]["K_b"].to_numpy())))
"""


def test_posterior_nc_opens_in_arviz_1(tmp_path):
    python = next((found for name in NEWER if (found := shutil.which(name))), None)
    if python is None:
        pytest.skip("ArviZ 1.x wants Python 3.12 or newer, and there is none here")
    subprocess.run([python, "-m", "venv", str(tmp_path / "env")], check=True)
    own = tmp_path / "env" / "bin" / "python"
    made = subprocess.run(
        [own, "-m", "pip", "install", "--quiet", "arviz>=1", "h5netcdf", "h5py"],
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode:
        pytest.skip(f"ArviZ 1.x could not be installed: {made.stderr.strip().splitlines()[-1]}")
    raw = small_run.write(tmp_path / "raw", visits=2)
    for stage in ("ingest", "fit"):
        assert small_run.nearlift(stage, raw, "--out", tmp_path).exit_code == 0
    assert small_run.nearlift("export", raw, "--out", tmp_path, "--netcdf").exit_code == 0
    path = tmp_path / "processed" / small_run.NAME / "posterior.nc"
    found = subprocess.run(
        [own, "-c", LOOK, str(path)], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert float(found.stdout.split()[-1]) > 3800
