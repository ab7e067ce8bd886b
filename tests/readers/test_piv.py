"""Every dialect into SI on a grid; what is no vector is never zero; what cannot be known is refused
with the remedy.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.readers.reading import put

from nearlift.errors import InputRefused, ManifestError
from nearlift.readers import piv
from nearlift.readers.piv import DIALECTS, Setting, claimed_by, read

SHARED = Path(__file__).parents[3] / "shared" / "data" / "piv-samples"
measured = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the measured samples are not beside this repository"
)
X, Y = np.meshgrid([1.0, 2.0, 3.0, 4.0], [10.0, 20.0, 30.0])
U, V = 0.5 * X + 0.25, -0.1 * Y
PX = Setting(scale_m=20e-6, frame_time_s=100e-6)


def table(*columns: np.ndarray, sep: str = "\t") -> str:
    rows = np.column_stack([c.ravel() for c in columns])
    return "".join(sep.join(f"{v:.6g}" for v in row) + "\n" for row in rows)


def one(path: Path, setting: Setting = Setting(), name: str | None = None):  # noqa: B008
    (field,) = read(path, setting, name)
    return field


INSIGHT = (
    'TITLE="a" VARIABLES="X mm", "Y mm", "U m/s", "V m/s", "CHC", DATASETAUXDATA'
    ' MicrometersPerPixelX="20.0" DATASETAUXDATA MicrosecondsPerDeltaT="100.0" ZONE I=4, J=3,'
    " F=POINT\n"
)
DAVIS = '#DaVis 8.1.6 2D-vector 32 3 4 "position" "mm" "position" "mm" "velocity" "m/s"\n'
DANTEC = (
    ">>*HEADER*<<\nFileID:DSExport.CSV\nVersion:7.6\nGridSize:{Width=4, Height=3}\nTimeStamp: #1,"
    " 0.066\n>>*DATA*<<\n"
)
NAMES = (
    "x,y,X (pix)[pix],Y (pix)[pix],X (mm)[mm],Y (mm)[mm],U pix[pix],V"
    " pix[pix],U[m/s],V[m/s],Length[m/s],Status\n"
)
FRAME = (
    "PIVlab, ASCII chart output - 1\nFRAME: 1, filenames: A & B, conversion factor xy (px -> m):"
    " {}, conversion factor uv (px/frame -> m/s): {}\n"
)
HEAD = "x [m],y [m],u [m/s],v [m/s],Vector type [-]\n"
ONE = np.ones_like(X)
NEW = "# x\ty\tu\tv\tflags\tmask\n"
PLAIN = NEW + table(X, Y, U, V, 0 * X, 0 * X)
KNOWN = Setting(length_unit="mm", velocity_unit="m/s")


def dantec(status: np.ndarray = 0 * ONE) -> str:
    columns = (X, Y, 50 * X, 50 * Y, X, Y, 5 * U, 5 * V, U, V, np.hypot(U, V), status)
    return DANTEC + NAMES + table(*columns, sep=",")


@pytest.mark.parametrize(
    ("name", "text", "setting"),
    [
        ("insight", INSIGHT + table(X, Y, U, V, ONE, sep=", "), Setting()),
        ("davis", DAVIS + table(X, Y, U, V), Setting()),
        ("davis", DAVIS + table(X, Y, U, V).replace(".", ","), Setting()),
        ("openpiv", PLAIN, KNOWN),
        ("openpiv", table(X, Y, U, V, 3.7 * ONE, sep=" "), KNOWN),
        ("pivlab", FRAME.format("1e-3", "10") + HEAD + table(1e-3 * X, 1e-3 * Y, U, V, ONE, sep=","), Setting()),
        ("pivlab", HEAD.replace("[m]", "[mm]") + table(X, Y, U, V, ONE, sep=","), Setting()),
        ("dantec", dantec(), Setting()),
        ("dantec", dantec().replace(",", "\t"), Setting()),
    ],
)  # fmt: skip
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_every_text_dialect_gives_the_same_field(tmp_path, name, text, setting, ending):
    path = put(tmp_path, text.replace("\n", ending))
    assert claimed_by(path) == name
    field = one(path, setting)
    np.testing.assert_allclose(field.x_m, 1e-3 * X[0])
    np.testing.assert_allclose(field.y_m, 1e-3 * Y[:, 0])
    np.testing.assert_allclose(field.vx_m_s, U, rtol=1e-5)
    np.testing.assert_allclose(field.vy_m_s, V, rtol=1e-5)


@pytest.mark.parametrize(
    ("text", "setting"),
    [
        (INSIGHT + table(X, Y, U, V, np.where(X == 2, -1, 1), sep=", "), Setting()),
        (INSIGHT + table(X, Y, U, V, np.where(X == 2, 2, 1), sep=", "), Setting()),
        (DAVIS + table(X, Y, np.where(X == 2, 0, U), np.where(X == 2, 0, V)), Setting()),
        (NEW + table(X, Y, U, V, np.where(X == 2, 1, 0), 0 * X), KNOWN),
        (NEW + table(X, Y, U, V, 0 * X, np.where(X == 2, 1, 0)), KNOWN),
        (HEAD + table(1e-3 * X, 1e-3 * Y, np.where(X == 2, np.nan, U), V, ONE, sep=","), Setting()),
        (HEAD + table(1e-3 * X, 1e-3 * Y, U, V, np.where(X == 2, 0, 1), sep=","), Setting()),
        (dantec(status=np.where(X == 2, 16, 0)), Setting()),
    ],
)
def test_what_is_no_vector_is_nan_and_never_zero(tmp_path, text, setting):
    field = one(put(tmp_path, text), setting)
    assert (~field.valid == (X == 2)).all()
    assert np.isnan(field.vx_m_s[X == 2]).all()
    assert not (field.vx_m_s == 0).any()


def test_pixels_and_displacements_become_velocities_by_scale_and_frame_time(tmp_path):
    path = put(tmp_path, PLAIN)
    field = one(path, PX._replace(length_unit="px", velocity_unit="px/frame"))
    np.testing.assert_allclose(field.x_m, 20e-6 * X[0])
    np.testing.assert_allclose(field.vx_m_s, 0.2 * U, rtol=1e-5)
    field = one(path, Setting(length_unit="px", velocity_unit="px/s", scale_m=20e-6))
    np.testing.assert_allclose(field.vx_m_s, 20e-6 * U, rtol=1e-5)


def test_pivlab_is_believed_on_its_factors_not_on_its_unit_line(tmp_path):
    rows = table(1e-3 * X, 1e-3 * Y, 1e-4 * U, 1e-4 * V, ONE, sep=",")
    displaced = put(tmp_path, FRAME.format("1e-3", "1e-3") + HEAD + rows)
    with pytest.raises(InputRefused, match=r"holds displacements \(m/frame\), not velocities"):
        one(displaced)
    np.testing.assert_allclose(one(displaced, Setting(frame_time_s=1e-4)).vx_m_s, U, rtol=1e-5)
    pixels = put(tmp_path, FRAME.format("1", "1") + HEAD + table(X, Y, U, V, ONE, sep=","))
    with pytest.raises(InputRefused, match="the size of a pixel is not stated"):
        one(pixels)


def test_insight_brings_its_own_scale_and_frame_time(tmp_path):
    text = INSIGHT.replace(" mm", " pixel").replace(" m/s", " pixel")
    field = one(put(tmp_path, text + table(X, Y, U, V, ONE, sep=", ")))
    np.testing.assert_allclose(field.vx_m_s, 0.2 * U, rtol=1e-5)


@pytest.mark.parametrize(
    ("text", "setting", "says"),
    [
        (NEW + table(X, Y, 0 * X, 0 * X, 0 * X, 0 * X), KNOWN, "every vector is zero"),
        (NEW + table(X, Y, U, V, 0 * X, ONE), KNOWN, "none of its 12 vectors is valid"),
        (PLAIN, Setting(), 'does not say its length unit\n  add length_unit = "mm"'),
        (PLAIN, Setting("mm"), "does not say its velocity unit"),
        (PLAIN, Setting("px", "m/s"), 'add scale = "20 um/px"'),
        (PLAIN, Setting("mm", "mm"), 'add frame_time = "100 us"'),
        (PLAIN, Setting("mm", "kg"), "not a unit of length"),
        (table(X, Y, U, V, ONE, sep=" "), KNOWN, "no header says whether 0 or 1 is a good vector"),
        (DAVIS + table(X, Y, U, V), Setting(velocity_unit="mm/s"), "says 'm/s' where the manifest's velocity_unit is 'mm/s'"),
        (DAVIS + table(X, Y, U, V).replace("0.75", "0,75"), Setting(), "is not a number\n  export it again, with decimal points"),
        (DAVIS + table(X[:2], Y[:2], U[:2], V[:2]), Setting(), "has 8 rows of 4, its header promises 3 x 4"),
        (DAVIS.replace('"velocity" "m/s"', '"displacement" "pixel"') + table(X, Y, U, V), PX._replace(frame_time_s=None), "holds displacements"),
        (PLAIN[:-9], KNOWN, "line 13: has . cells under 6 column names"),
        (PLAIN.replace("0.75", "0,75", 1), KNOWN, "line 2: '0,75' in column 'column 3' is not a number\n  export it again"),
        (PLAIN + table(X[:1], Y[:1], U[:1], V[:1], 0 * X[:1], 0 * X[:1]), KNOWN, "two vectors at one place"),
        (NEW + table(X**2, Y, U, V, 0 * X, 0 * X), KNOWN, "not evenly spaced along x"),
        (NEW, KNOWN, "holds a header and no vectors"),
        ("", Setting(), "is empty"),
        ("hello\n", Setting(), "is of no known format"),
        (DANTEC + NAMES.replace("[m/s]", "") + table(*[X] * 12, sep=","), Setting(), "the size of a pixel is not stated"),
        (b"# x\ty\tu\tv\n\x00\x00\x00", Setting(), "holds zero bytes"),
        (FRAME.format("+", "0") + "1,1,2,3,1\n", Setting(), "line 2: has conversion factors that"),
        (INSIGHT.replace('X="20.0', 'X="1e') + "1,1,2,3,1\n", Setting(), "line 1: has MicrometersPerPixelX '1e', which is no number"),
    ],
)  # fmt: skip
def test_what_cannot_be_known_is_refused_with_its_remedy(tmp_path, text, setting, says):
    with pytest.raises(InputRefused, match=says):
        one(put(tmp_path, text), setting)


def test_a_near_miss_of_a_format_is_named(tmp_path):
    with pytest.raises(ManifestError, match="did you mean 'davis'"):
        one(tmp_path / "none", name="davies")


def test_an_old_file_of_flags_can_be_said_to_be_pivlab(tmp_path):
    path = put(tmp_path, table(X, Y, U, V, np.where(X == 2, 0, 1), sep=" "))
    assert (~one(path, KNOWN, "pivlab").valid == (X == 2)).all()


def test_pivlab_matlab_version_5(tmp_path):
    from scipy.io import savemat

    flags = np.where(X == 2, 0.0, 1.0)
    pairs = {
        "x": (1e-3 * X, 1e-3 * X),
        "y": (1e-3 * Y, 1e-3 * Y),
        "typevector_original": (flags, flags),
    }
    pairs |= {"u_original": (U, 2 * U), "v_original": (V, 2 * V)}
    content = {name: np.empty((2, 1), dtype=object) for name in pairs}
    for name, fields in pairs.items():
        content[name][:, 0] = fields
    savemat(tmp_path / "s.mat", content | {"units": "[m] respectively [m/s]"})
    first, second = read(tmp_path / "s.mat")
    assert (~first.valid == (X == 2)).all()
    np.testing.assert_allclose(second.vx_m_s, 2 * first.vx_m_s)
    savemat(tmp_path / "p.mat", content)
    with pytest.raises(InputRefused, match="the size of a pixel"):
        list(read(tmp_path / "p.mat"))


def netcdf(path: Path, chc: np.ndarray = ONE, units: str = "m/s", **attrs: float) -> Path:
    import h5netcdf

    with h5netcdf.File(path, "w") as f:
        f.dimensions = {"x": 4, "y": 3, "t": 2}
        f.create_variable("x", ("x",), data=X[0]).attrs["units"] = "mm"
        f.create_variable("y", ("y",), data=Y[:, 0]).attrs["units"] = "mm"
        f.create_variable("chc", ("y", "x", "t"), data=np.stack([chc, chc], axis=-1))
        for name, data in (("u", U), ("v", V)):
            both = np.stack([data, 2 * data], axis=-1)
            f.create_variable(name, ("y", "x", "t"), data=both).attrs["units"] = units
        f.attrs.update(attrs)
    return path


def test_netcdf_in_pivpy_layout(tmp_path):
    first, second = read(netcdf(tmp_path / "a.nc", np.where(X == 2, 0.0, 1.0)))
    assert (~first.valid == (X == 2)).all()
    np.testing.assert_allclose(first.vx_m_s[X != 2], U[X != 2])
    np.testing.assert_allclose(second.vx_m_s, 2 * first.vx_m_s)
    shifted, _ = read(netcdf(tmp_path / "b.nc", units="mm/dt", delta_t=1e-3))
    np.testing.assert_allclose(shifted.vx_m_s, U)


def test_hdf5_that_leads_elsewhere_is_refused(tmp_path):
    with h5py.File(tmp_path / "bad.nc", "w") as f:
        f["u"] = h5py.ExternalLink("/etc/passwd", "u")
    with pytest.raises(InputRefused, match="u is a link to another file"):
        list(read(tmp_path / "bad.nc"))


def test_an_extra_that_is_not_installed_is_named(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "h5py", None)
    path = put(tmp_path, b"\x89HDF\r\n\x1a\n" + bytes(100), "a.nc")
    with pytest.raises(InputRefused, match=r"needs the package h5py\n.*nearlift\[netcdf\]"):
        list(piv.netcdf_fields(path))


def test_what_a_library_parses_is_parsed_in_another_process(tmp_path, monkeypatch):
    """Fields come out as they would here, in one answer or several; damage costs that file."""

    def refuse(*_, **__):
        raise AssertionError("parsed in this process")

    assert [name for name, d in DIALECTS.items() if d.fields] == ["pivlab_mat", "netcdf"]
    path = netcdf(tmp_path / "a.nc")
    here = [raw.u for raw in piv.netcdf_fields(path)]
    monkeypatch.setattr(h5py, "File", refuse)
    for most in (piv.ANSWER, 0):
        monkeypatch.setattr(piv, "ANSWER", most)
        there = list(read(path))
        np.testing.assert_array_equal([f.vx_m_s.ravel() for f in there], here)
    (tmp_path / "cut.nc").write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputRefused, match=r"cut\.nc: cannot be read"):
        list(read(tmp_path / "cut.nc"))
    assert len(list(read(path))) == 2


@measured
@pytest.mark.parametrize(
    ("name", "setting", "shape", "vectors"),
    [
        ("Run000001.T000.D000.P000.H001.L.vec", Setting(), (63, 63), 3616),
        # written with decimal commas, and `0 -0` where there is none
        ("davis_decimal_comma_B00001.txt", Setting(), (64, 64), 64 * 64 - 2530),
        ("openpiv_exp1_001_b.txt", PX._replace(length_unit="px", velocity_unit="px/frame"), (22, 30), 660),
        ("test_pivlab.mat", PX, (8, 10), None),
    ],
)  # fmt: skip
def test_real_files(name, setting, shape, vectors):
    field = next(read(SHARED / name, setting))
    assert field.shape == shape
    assert vectors in (None, field.valid.sum())
