"""Each outside format: what is written comes back, its traps are sprung, and what contradicts the
manifest is refused.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit import written
from tests.unit.bench_campaign import write_schedule
from tests.unit.manifests import manifest

from nearlift import readers, units
from nearlift.errors import InputRefused, ManifestError
from nearlift.readers.base import fold, pick, split_unit, unit_word

NUMBERS = st.lists(st.floats(-1e6, 1e6, width=32), min_size=3, max_size=40)


def contents(name: str, path: Path, dialect: Any = None, names: Any = None) -> Any:
    return readers.reader(name).open(path, dialect or {}, names)


def records(
    root: Path,
    reader: str,
    column: str,
    unit: str,
    files: str,
    rate: str = "1000 Hz",
    **changes: Any,
) -> list[Any]:
    """Records of trials a, b by their reader."""
    given_manifest = manifest(
        load_cell={"sample_rate": rate},
        records={
            "reader": reader,
            "files": files,
            "force": {"column": column, "unit": unit, "sign": 1},
            **changes,
        },
    )
    return list(readers.reader(reader).read(given_manifest, root, ["a", "b"]))


# ---- round trips


@pytest.mark.parametrize("name", [n for n in written.WRITERS if n != "csv"])
def test_what_is_written_comes_back(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    write, column, _, suffix = written.WRITERS[name]
    folder = tmp_path_factory.mktemp(name)

    @settings(max_examples=15)
    @given(force=NUMBERS)
    def turn(force: list[float]) -> None:
        path = written.put(folder, f"a.{suffix}", write(force))
        found = contents(name, path, names=(column,))
        channel = pick(found.channels, column, "records.force.column", "a")
        np.testing.assert_array_equal(channel.values, force)
        assert set(found.codes) <= {"dead_speed"}

    turn()


@pytest.mark.parametrize("name", list(written.WRITERS))
def test_records_are_newtons_of_lift(tmp_path: Path, name: str) -> None:
    write, column, unit, suffix = written.WRITERS[name]
    force = [1.5, 2.25, 3.5, 4.0, 5.75, 6.5]
    written.put(tmp_path, f"trials/a.{suffix}", write(force))
    written.put(tmp_path, f"trials/b.{suffix}", b"")
    if name == "csv":
        column = "force"
    a, b = records(tmp_path, name, column, unit, f"trials/{{trial}}.{suffix}")
    factor, _ = units.to_si(unit, "force", "")
    np.testing.assert_allclose(a.force_N, factor * np.array(force), rtol=1e-7)
    assert a.source == f"trials/a.{suffix}"
    assert b.codes == ("EMPTY",)
    assert len(b.force_N) == 0


@pytest.mark.parametrize("name", ["rcbenchmark", "flight-stand", "hdf5", "tdms", "lvm", "text"])
def test_a_unit_in_the_file_that_the_manifest_contradicts_is_refused(
    tmp_path: Path, name: str
) -> None:
    """Gram-force read as newton is a factor of 102."""
    write, column, unit, suffix = written.WRITERS[name]
    written.put(tmp_path, f"a.{suffix}", write([1.0, 2.0, 3.0]))
    other = "N" if unit != "N" else "gf"
    with pytest.raises(
        InputRefused,
        match=(
            rf"states .* in {unit}, the manifest says {other}: a factor of .*\n  records.force.unit"
            rf" = \"{unit}\""
        ),
    ):
        records(tmp_path, name, column, other, f"{{trial}}.{suffix}")


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


def test_a_rate_in_the_file_that_the_manifest_contradicts_is_refused(tmp_path: Path) -> None:
    written.put(tmp_path, "a.lvm", written.lvm([1.0, 2.0, 3.0], columns="No"))
    with pytest.raises(
        InputRefused, match=r"'Force' has 1000 Hz, the manifest says 200 Hz\n.*ignore_rate"
    ):
        records(tmp_path, "lvm", "Force", "N", "{trial}.lvm", rate="200 Hz")
    (a,) = records(
        tmp_path, "lvm", "Force", "N", "{trial}.lvm", rate="200 Hz", dialect={"ignore_rate": True}
    )
    assert len(a.force_N) == 3


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


# ---- names and units


def test_names_are_folded_before_they_are_compared() -> None:
    assert fold("Torque (N\u00b7m)") == fold("torque  (N\u22c5m)") == fold("Torque (N*m)")
    assert fold("ESC signal (\u00b5s)") == fold("ESC signal (\u03bcs)")
    assert split_unit("Thrust (gf)") == ("Thrust", "gf")
    assert split_unit("weight[g]") == ("weight", "g")
    assert split_unit("Powertrain 1 - force Fz (thrust) (N)") == (
        "Powertrain 1 - force Fz (thrust)",
        "N",
    )
    assert split_unit("rpm1") == ("rpm1", "")
    assert unit_word("[\u00b5s]") == "us"
    assert unit_word("furlong") is None


def test_a_column_that_is_not_there_or_twice_is_refused(tmp_path: Path) -> None:
    found = contents("rcbenchmark", written.put(tmp_path, "a.csv", written.rcbenchmark([1.0, 2.0])))
    assert pick(found.channels, "thrust", "k", "f").name == "Thrust (gf)"
    with pytest.raises(InputRefused, match=r"has no column 'Trust'\n  k = \"Thrust \(gf\)\""):
        pick(found.channels, "Trust", "k", "f")
    doubled = (*found.channels, *found.channels)
    with pytest.raises(InputRefused, match="has more than one column 'Thrust'"):
        pick(doubled, "Thrust", "k", "f")


# ---- stands


def test_rcbenchmark_traps(tmp_path: Path) -> None:
    """Byte order mark, trailing comma, micro signs, a clock that runs backwards, a speed that reads
    zero while there is lift.
    """
    rows = "0.424,1000,,0.1,0,5.0,4.0,0,0.1,,\n0.378,1000,,0.1,0,6.0,4.0,0,0.1,hello,\n4.318,1000,,0.1,0,7.0,4.0,0,0.1,,\n"
    path = written.put(tmp_path, "a.csv", (written.RC_HEADER + "\n" + rows).encode())
    found = contents("rcbenchmark", path)
    assert [c.name for c in found.channels][:2] == ["Time (s)", "ESC signal (\u00b5s)"]
    assert "App message" not in [c.name for c in found.channels]
    assert found.codes == ("dead_speed",)
    assert pick(found.channels, "Time", "k", "f").values.tolist() == [0.424, 0.378, 4.318]
    path.write_bytes(path.read_bytes() + b"5,1000,,0.1\n")
    with pytest.raises(InputRefused, match=r"a.csv, line 5: has 4 cells under 10 column names"):
        contents("rcbenchmark", path)


def test_stands_refuse_each_others_files(tmp_path: Path) -> None:
    for name, content in (
        ("rcbenchmark", written.tyto([1.0])),
        ("flight-stand", written.crazyflie([1.0])),
        ("crazyflie", written.rcbenchmark([1.0])),
    ):
        with pytest.raises(InputRefused, match="line 1: has not the header of"):
            contents(name, written.put(tmp_path, "a.csv", content))


def test_a_stand_with_a_column_twice_is_refused(tmp_path: Path) -> None:
    path = written.put(tmp_path, "a.csv", b"weight[g],pwm,vbat[V],pwm\n1,2,3,4\n")
    with pytest.raises(InputRefused, match="more than one column 'pwm'"):
        contents("crazyflie", path)


def test_crazyflie_weights_may_be_negative_and_one_dead_rotor_is_seen(tmp_path: Path) -> None:
    text = "weight[g],pwm,vbat[V],rpm1,rpm2,rpm3,rpm4\n-1.0586,0,3.9,0,0,0,0\n30.5,20000,3.8,9000,0,9100,9050\n"
    found = contents("crazyflie", written.put(tmp_path, "a.csv", text.encode()))
    assert pick(found.channels, "weight", "k", "f").values.tolist() == [-1.0586, 30.5]
    assert found.codes == ("dead_speed",)


# ---- LVM


def test_lvm_segments_are_joined_and_counted(tmp_path: Path) -> None:
    path = written.put(tmp_path, "a.lvm", written.lvm([1.5, 2.5, 3.5], segments=2))
    found = contents("lvm", path)
    assert pick(found.channels, "Force", "k", "f").values.tolist() == [1.5, 2.5, 3.5] * 2
    assert found.channels[0].name == "X_Value"
    cut = path.read_bytes().rstrip(b"\n")
    path.write_bytes(cut[: cut.rfind(b"\n") + 1])
    found = contents("lvm", path)
    assert found.codes == ("truncated",), "the last segment has fewer rows than its header promises"


def test_the_rate_in_an_lvm_header_is_not_believed_beside_a_clock(tmp_path: Path) -> None:
    content = written.lvm([1.5, 2.5, 3.5]).replace(b"Delta_X\t0,001\t0,001", b"Delta_X\t1,0\t1,0")
    found = contents("lvm", written.put(tmp_path, "a.lvm", content))
    assert found.notes == ("the header says 1 Hz, X_Value 1000 Hz: the column is believed",)
    assert found.channels[1].rate_Hz == pytest.approx(1000)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ((b"LabVIEW", b"NoVIEW"), "this is no LVM file"),
        ((b"2,5", b"2,5x"), "'2,5x' in column 'Force' is not a number"),
        ((b"2,5\t4,0", b"2,5"), "has 2 cells under 4 columns"),
        ((b"\tSupply", b"\tForce"), "names two columns alike"),
        ((b"Decimal_Separator\t,", b"Decimal_Separator\t;"), "states the decimal separator ';'"),
    ],
)
def test_a_damaged_lvm_is_refused_with_its_line(
    tmp_path: Path, change: tuple[bytes, bytes], match: str
) -> None:
    path = written.put(tmp_path, "a.lvm", written.lvm([1.5, 2.5, 3.5]).replace(*change))
    with pytest.raises(InputRefused, match=match):
        contents("lvm", path)


def test_no_pickle_beside_an_lvm_is_opened(tmp_path: Path) -> None:
    path = written.put(tmp_path, "a.lvm", written.lvm([1.5, 2.5]))
    trap = written.put(
        tmp_path,
        "a.lvm.pkl",
        b"cos\nsystem\n(S'touch " + str(tmp_path / "pwned").encode() + b"'\ntR.",
    )
    contents("lvm", path)
    assert sorted(tmp_path.iterdir()) == [path, trap]


def test_half_written_trials_are_flagged_and_held_against_the_planned_length(
    tmp_path: Path,
) -> None:
    """Flag and sample count, through a whole ingest."""
    from tests.unit.bench_campaign import force_mN, run_ingest
    from tests.unit.manifests import HEAD, LIVE, RATE

    rows = ["trial,boundary,distance,throttle"]
    for k in range(4):
        rows.append(f"t{k},ground,300,{(25, 50, 75, 92)[k]}")
        written.put(
            tmp_path, f"raw/t{k}.tdms", written.tdms(force_mN(100.0 * (k + 1), seed=k).tolist())
        )
    write_schedule(tmp_path / "raw", "\n".join(rows) + "\n")
    whole = (tmp_path / "raw/t1.tdms").read_bytes()
    (tmp_path / "raw/t1.tdms").write_bytes(whole[: int(0.97 * len(whole))])
    (tmp_path / "raw/t2.tdms").write_bytes(
        (tmp_path / "raw/t2.tdms").read_bytes()[: len(whole) // 2]
    )
    chosen = {
        "reader": "tdms",
        "files": "{trial}.tdms",
        "force": {"column": "daq/force", "unit": "mN", "sign": 1},
        "dialect": {"ignore_rate": True},
    }
    with pytest.raises(InputRefused, match="in N, the manifest says mN"):
        run_ingest(tmp_path / "raw", tmp_path, manifest(records=chosen))
    for k in range(4):
        path = tmp_path / f"raw/t{k}.tdms"
        path.write_bytes(path.read_bytes().replace(b"unit_string", b"unit_sXXXXX"))
    outcome, job = run_ingest(
        tmp_path / "raw",
        tmp_path,
        manifest(records=chosen, load_cell={"record": f"{(HEAD + LIVE) / RATE} s"}),
    )
    from nearlift.stages.ingest import TRIALS

    table = job.read(TRIALS)
    assert [t for t, _ in outcome.rejected] == ["t2"]
    assert "truncated" in table["quality"][1].split()
    assert list(table["completeness"]) == ["complete", "truncated", "truncated", "complete"]
    assert table["samples"][0] == HEAD + LIVE
