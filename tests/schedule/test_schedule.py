"""The schedule: SI columns, strictness, and geometry that can be true."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.bench_campaign import write_schedule
from tests.unit.manifests import UNITS, manifest

from nearlift.errors import InputRefused, ManifestError
from nearlift.schedule import STANDARD_ERROR, Schedule, read_schedule, visits

HEAD = "trial,boundary,distance,throttle\n"


def read(folder: Path, text: str, **changes: Any) -> Schedule:
    return read_schedule(manifest(**changes), write_schedule(folder, text))


def units(**more: str) -> dict[str, Any]:
    return {"units": {**UNITS, **more}}


def test_every_known_column_becomes_si(tmp_path: Path) -> None:
    text = (
        "trial,boundary,distance,throttle,start,session,supply,current,rpm,power,temperature,pressure,humidity,approach,tilt,orientation,tare_after\n"
        "a,ground,43.0,25,1,s1,3900,500,12000,2,20,101.3,50,-1,1,upright,0.5\n"
        "b,ceiling,10,92,2,s2,3800,,15000,3,,101.4,51,+1,-1,inverted,\n"
    )
    more = units(
        start="min",
        supply="mV",
        current="mA",
        power="W",
        temperature="degC",
        pressure="kPa",
        humidity="percent",
        tilt="deg",
        tare_after="mN",
    )
    got = read(tmp_path, text, trials=more)
    assert list(got.trial) == ["a", "b"]
    assert list(got.boundary) == ["ground", "ceiling"]
    np.testing.assert_allclose(got.z_m, [0.043, 0.010])
    np.testing.assert_allclose(got.z_hat, [43 / 23, 10 / 23])
    np.testing.assert_allclose(got.throttle, [0.25, 0.92])
    want = {
        "start_s": [60, 120],
        "supply_V": [3.9, 3.8],
        "current_A": [0.5, np.nan],
        "speed_Hz": [200, 250],
        "power_W": [2, 3],
        "temperature_K": [293.15, np.nan],
        "pressure_Pa": [101300, 101400],
        "humidity": [0.5, 0.51],
        "approach": [-1, 1],
        "tilt_rad": [np.pi / 180, -np.pi / 180],
        "tare_after_N": [5e-4, np.nan],
    }
    for name, values in want.items():
        np.testing.assert_allclose(got.covariates[name], values, err_msg=name)
    assert list(got.covariates["session"]) == ["s1", "s2"]
    assert list(got.covariates["orientation"]) == ["upright", "inverted"]
    assert got.notes == ()


@pytest.mark.parametrize(
    ("humidity", "unit", "said"),
    [
        ("45", "fraction", r"line 3, column 'humidity': a humidity of 45 fraction is not between"),
        (
            "-3",
            "percent",
            r"a humidity of -3 percent is not between 0 and 1\n  humidity is a part of saturation",
        ),
        (
            "0.5",
            "percent",
            r"the largest humidity is 0.5 percent, drier than any room\n  fraction\?",
        ),
    ],
)
def test_a_humidity_that_cannot_be_is_refused(
    tmp_path: Path, humidity: str, unit: str, said: str
) -> None:
    text = (
        f"trial,boundary,distance,throttle,humidity\na,ground,43,25,\nb,ground,43,25,{humidity}\n"
    )
    with pytest.raises(InputRefused, match=said):
        read(tmp_path, text, trials=units(humidity=unit))


@pytest.mark.parametrize(
    ("unit", "factor"), [("rpm", 1 / 60), ("Hz", 1.0), ("rad/s", 1 / (2 * np.pi))]
)
def test_a_turn_is_a_turn(tmp_path: Path, unit: str, factor: float) -> None:
    text = "trial,boundary,distance,throttle,rpm\na,ground,43,25,600\n"
    speed = read(tmp_path, text, trials=units(rpm=unit)).covariates["speed_Hz"]
    np.testing.assert_allclose(speed, [600 * factor])


def test_further_columns_are_kept_and_a_likely_slip_is_noted(tmp_path: Path) -> None:
    head = "trial,boundary,distance,throttle,propeller,nut torque,suply,lift_se\n"
    got = read(tmp_path, head + "a,ground,43,25,A,1.5,4,1\nb,ground,43,50,B,,4,1\n")
    assert list(got.covariates["propeller"]) == ["A", "B"]
    np.testing.assert_array_equal(got.covariates["nut torque"], [1.5, np.nan])
    assert got.notes == (
        "trials.csv: column 'suply' is kept as it is; did you mean 'supply'?",
        "trials.csv: column 'lift_se' is kept as it is; " + STANDARD_ERROR,
    )
    # names of files, from which `nearlift new` took the ids
    rows = "trial,record,boundary,distance,throttle\na,a,ground,43,25\nb,b.csv,ground,43,50\n"
    assert read(tmp_path, rows).notes == ()


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_remarks_above_the_header_are_no_rows_and_lines_keep_their_numbers(
    tmp_path: Path, end: str
) -> None:
    remarks = ['# bench 2, 5" props, trial,error', "", "  # run by hand", HEAD.strip()]
    text = end.join([*remarks, "a,ground,43,25", "b,ground,43,x", ""])
    with pytest.raises(ManifestError, match="line 6"):
        read(tmp_path, text)
    assert list(read(tmp_path, text.replace("x", "50")).trial) == ["a", "b"]
    with pytest.raises(ManifestError, match=r"has no column 'trial'\n  is it '#trial'\?"):
        read(tmp_path, f"#{HEAD}a,ground,43,25\n")
    with pytest.raises(ManifestError, match=r"names each trial's record: rename 'essai', or add"):
        read(tmp_path, f"{HEAD.replace('trial', 'essai')}a,ground,43,25\nb,ground,60,25\n")


def test_constants_stand_for_columns(tmp_path: Path) -> None:
    trials = {
        "units": {**UNITS, "temperature": "K", "supply": "V"},
        "constants": {
            "boundary": "ground",
            "temperature": "20 degC",
            "supply": 4.0,
            "current": "2 A",
        },
    }
    got = read(tmp_path, "trial,distance,throttle\na,43,25\nb,43,50\n", trials=trials)
    assert list(got.boundary) == ["ground", "ground"]
    np.testing.assert_allclose(got.covariates["temperature_K"], [293.15, 293.15])
    np.testing.assert_allclose(got.covariates["supply_V"], [4.0, 4.0])
    np.testing.assert_allclose(got.covariates["current_A"], [2.0, 2.0])


def test_iso_times_count_from_the_first_trial(tmp_path: Path) -> None:
    rows = "a,ground,43,25,2026-03-01T14:05:00\nb,ground,43,50,2026-03-01T14:05:20.5\n"
    got = read(tmp_path, "trial,boundary,distance,throttle,start\n" + rows)
    np.testing.assert_allclose(got.covariates["start_s"], [0, 20.5])


def test_free_air_has_no_distance_and_needs_no_column_of_it(tmp_path: Path) -> None:
    z_hat = read(tmp_path, HEAD + "a,none,,25\nb,ground,43,25\n").z_hat
    assert np.isfinite(z_hat).tolist() == [False, True]
    assert np.all(np.isinf(read(tmp_path, "trial,boundary,throttle\na,none,25\n").z_m))


def test_visits_count_the_stops_of_the_traverse() -> None:
    side = np.array(["ground", "ground", "ground", "ceiling", "ceiling", "ceiling"], dtype=object)
    z = np.array([1.0, 1.0, 2.0, 2.0, 2.0, 2.0])
    assert visits(side, z).tolist() == [0, 0, 1, 2, 2, 2]
    # the same station from the other side is another stop; an unknown side is not
    approach = np.array([1.0, 1.0, -1.0, -1.0, 1.0, np.nan])
    assert visits(side, z, approach).tolist() == [0, 0, 1, 2, 3, 3]
    # so is the same station in another session
    session = np.array(["1", "2", "2", "2", "2", "2"], dtype=object)
    assert visits(side, z, None, session).tolist() == [0, 1, 2, 3, 3, 3]
    # without an order, equal rows are one stop wherever they are
    assert visits(side[:4], z[[0, 2, 1, 3]], ordered=False).tolist() == [0, 1, 0, 2]


def test_offsets_add_to_the_distance_by_boundary(tmp_path: Path) -> None:
    rig = {
        "distance_datum": {"ground": "airframe", "sidewall": "rotor axis"},
        "distance_offset": {"ground": "24 mm", "sidewall": "-23 mm"},
    }
    got = read(tmp_path, HEAD + "a,ground,10,25\nb,sidewall,33,25\n", rig=rig)
    np.testing.assert_allclose(got.z_m, [0.034, 0.010])


REFUSED = [
    line.split(" => ")
    for line in Path(__file__).with_name("refused.txt").read_text("utf-8").splitlines()[1:]
]


@pytest.mark.parametrize(
    ("at_fault", "text", "changes", "match"),
    [pytest.param(*case, id=name) for name, *case in REFUSED],
)
def test_refusals(tmp_path: Path, at_fault: str, text: str, changes: str, match: str) -> None:
    trials = tomllib.loads(f"trials = {changes}")["trials"]
    trials["units"] = UNITS | trials.get("units", {})
    text = text.encode().decode("unicode_escape").replace("HEAD\n", HEAD, 1)
    with pytest.raises({"manifest": ManifestError, "input": InputRefused}[at_fault], match=match):
        read(tmp_path, text, trials=trials)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\n\n", "\n  "])
def test_a_last_line_without_its_end_is_noted_for_it_may_be_cut(tmp_path: Path, end: str) -> None:
    text = HEAD + "a,ground,43,25\nb,ground,300,25"
    assert read(tmp_path, text + end).notes == ()
    (note,) = read(tmp_path, text[:-4] + ",25").notes
    cut = "'b,ground,30,25': if it was cut off there, that row is wrong"
    assert note.startswith(f"trials.csv ends within a line, {cut}")


def test_a_start_before_the_row_above_is_noted(tmp_path: Path) -> None:
    starts = [(0, "a"), (9e9, "a"), (20, "a"), ("", "a"), (3, "b")]
    rows = "".join(f"t{i},ground,43,25,{start},{s}\n" for i, (start, s) in enumerate(starts))
    text = f"trial,boundary,distance,throttle,start,session\n{rows}"
    (note,) = read(tmp_path, text, trials=units(start="s")).notes
    assert note == (
        "trials.csv, line 4, column 'start': 20 lies before the row above: rows must be in the"
        " order in which they were run"
    )


@pytest.mark.parametrize(
    ("rows", "unit", "match"),
    [
        # the literal table is refused with the unit that fits
        (
            "a,ceiling,5,25\nb,ceiling,525,25\n",
            "cm",
            r"line 3.*: 525 cm is outside the 1\.5 m arena; mm\?",
        ),
        # 0.05 to 4000 can be no unit's: whichever brings 4000 into the room takes 0.05 to nothing
        ("a,ground,0.05,25\nb,ground,4000,25\n", "mm", r"4000 mm is outside the 1\.5 m arena\n"),
    ],
)
def test_a_distance_outside_the_arena_is_refused_with_the_unit_that_fits(
    tmp_path: Path, rows: str, unit: str, match: str
) -> None:
    with pytest.raises(InputRefused, match=match):
        read(tmp_path, HEAD + rows, trials=units(distance=unit))


@pytest.mark.parametrize(
    ("distance", "offset", "fits"),
    [(23, "-23 mm", False), (22, "-23 mm", False), (24, "-23 mm", True), (0, "0 mm", False)],
)
def test_a_blade_in_the_wall_is_refused(
    tmp_path: Path, distance: float, offset: str, fits: bool
) -> None:
    text = HEAD + f"a,sidewall,{distance},25\n"
    datum = "blade tip" if offset == "0 mm" else "rotor axis"
    rig = {"distance_datum": datum, "distance_offset": offset}
    if fits:
        assert read(tmp_path, text, rig=rig).z_m[0] > 0
    else:
        with pytest.raises(InputRefused, match=r"puts the rotor .*(into|on) the sidewall"):
            read(tmp_path, text, rig=rig)


def test_the_rotor_axis_wants_minus_one_radius(tmp_path: Path) -> None:
    rig = {"distance_datum": "rotor axis"}
    with pytest.raises(ManifestError, match='sidewall = "-23 mm"'):
        read(tmp_path, HEAD + "a,sidewall,33,25\n", rig=rig)
    with pytest.raises(ManifestError, match="no datum for the ground"):
        read(tmp_path, HEAD + "a,ground,33,25\n", rig={**rig, "distance_offset": "-23 mm"})
    # from the rotor plane it is noted
    (note, *_) = read(tmp_path, HEAD + "a,sidewall,33,25\n").notes
    assert "wall to nearest blade tip" in note


def test_a_schedule_that_is_missing_elsewhere_or_in_another_encoding_is_refused(
    tmp_path: Path,
) -> None:
    inner = tmp_path / "campaign"
    inner.mkdir()
    with pytest.raises(InputRefused, match=r"trials\.csv: is missing"):
        read_schedule(manifest(), tmp_path)
    write_schedule(tmp_path, HEAD + "a,ground,43,25\n")
    with pytest.raises(InputRefused, match="leads outside the campaign's folder"):
        read_schedule(manifest(trials={"file": "../trials.csv"}), inner)
    text = "trial,boundary,distance,throttle,Prüfer\na,ground,43,25,x\n"
    (tmp_path / "trials.csv").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputRefused, match="is not UTF-8 text"):
        read_schedule(manifest(), tmp_path)
