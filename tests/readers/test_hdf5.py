"""HDF5: no link out of the file; one file for all trials; a clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.readers.reading import contents, records

from nearlift.errors import InputRefused, ManifestError


def test_hdf5_follows_no_link_out_of_the_file(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["secret"] = np.ones(3)
    layout = h5py.VirtualLayout(shape=(3,), dtype="f8")
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "secret", shape=(3,))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["force"] = np.arange(3.0)
        file["out"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/secret")
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset(
            "far", (3,), dtype="f8", external=[(str(tmp_path / "raw.bin"), 0, h5py.h5f.UNLIMITED)]
        )
        file["circle"] = file["/"]
    found = contents("hdf5", tmp_path / "a.h5")
    assert [c.name for c in found.channels] == ["/force"]
    assert len(found.notes) == 3
    assert any("is a link to another file" in n for n in found.notes)


def test_one_file_may_hold_all_trials(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "all.h5", "w") as file:
        file["a/force"], file["b/force"] = np.arange(3.0), np.arange(4.0)
    a, b = records(tmp_path, "hdf5", "/{trial}/force", "N", "all.h5")
    assert (len(a.force_N), len(b.force_N)) == (3, 4)
    with pytest.raises(ManifestError, match="does not say where the trial's id is"):
        records(tmp_path, "hdf5", "/a/force", "N", "all.h5")
    with pytest.raises(ManifestError, match="both say where"):
        records(tmp_path, "hdf5", "/{trial}/force", "N", "{trial}.h5")


def test_a_clock_beside_the_force(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["force"], file["t"] = np.arange(1.0, 5.0), np.arange(4) / 1000
        file["rare"] = np.zeros(1)
    time = {"column": "/t", "unit": "s"}
    (a,) = records(tmp_path, "hdf5", "/force", "gf", "{trial}.h5", time=time)
    np.testing.assert_allclose(a.time_s, [0, 0.001, 0.002, 0.003])
    time = {"column": "/rare", "unit": "s"}
    with pytest.raises(InputRefused, match=r"has 4 samples of '/force' and 1 of '/rare'"):
        records(tmp_path, "hdf5", "/force", "gf", "{trial}.h5", time=time)
