"""MATLAB files of every version."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.readers.reading import contents
from tests.unit import written


@pytest.mark.filterwarnings("ignore::pandas.errors.Pandas4Warning")
@pytest.mark.filterwarnings("ignore:duration_to_mat")
def test_matlab_of_every_age(tmp_path: Path) -> None:
    import pandas as pd
    import scipy.io
    from matio import save_to_mat

    force = [1.0, 2.0, 3.0]
    for name, content in (("v5", written.mat(force, compressed=False)), ("v7", written.mat(force))):
        found = contents("mat", written.put(tmp_path, f"{name}.mat", content))
        assert [(c.name, c.values.tolist()) for c in found.channels] == [("run.force", force)]
    found = contents("mat", written.put(tmp_path, "v73.mat", written.v73(force)))
    assert [(c.name, c.values.tolist()) for c in found.channels] == [("force", force)]
    scipy.io.savemat(tmp_path / "m.mat", {"data": np.arange(6.0).reshape(3, 2), "who": "me"})
    found = contents("mat", tmp_path / "m.mat", names=("data(:,2)",))
    assert [(c.name, c.values.tolist()) for c in found.channels] == [("data(:,2)", [1.0, 3.0, 5.0])]
    table = pd.DataFrame(
        {"force": force}, index=pd.Index(np.array([0, 1, 2], dtype="timedelta64[ms]"), name="Time")
    )
    for version in ("v7", "v7.3"):
        save_to_mat(str(tmp_path / "tt.mat"), {"tt": table}, version=version)
        found = contents("mat", tmp_path / "tt.mat")
        assert [(c.name, c.unit) for c in found.channels] == [("tt.Time", "s"), ("tt.force", "")]
        np.testing.assert_allclose(found.channels[0].values, [0, 0.001, 0.002])
