"""Published files as campaigns of means."""

from __future__ import annotations

import hashlib
import itertools
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.unit.small_run import nearlift

from nearlift.campaign import manifest as manifests
from nearlift.datasets import converters
from nearlift.datasets.converters import garofano_soldado_table, tilted_pairs, write_campaign
from nearlift.errors import InputRefused
from nearlift.run.tables import read_table
from nearlift.stages.ingest import TRIALS

DATA = Path(__file__).parents[3] / "shared" / "data"
measured = pytest.mark.skipif(not DATA.is_dir(), reason="../shared is not here")
STAND = "weight[g],pwm,vbat[V],rpm1,rpm2,rpm3,rpm4,v[V]\n"
SCRIPT = """
Fz0\t=[2.0 1.5 1.0\t];
std_Fz0 = [0.1 0.1 0.2];
Fz10_minbeta20 = [3 2.5];
std_Fz10_minbeta20=[0.1 0.1];
R = 0.5; %m
z = [0.6*R, 1*R, 5*R];
z2 = [1*R, 5*R];
"""


def convert(converter: str, text: str, folder: Path, name: str = "made-up") -> pd.DataFrame:
    """Schedule of a campaign that is made of one file."""
    file = folder / "file.txt"
    file.write_text(text)
    write_campaign(folder / "raw", converter, {file.name: file}, name)
    return pd.read_csv(folder / "raw" / "trials.csv")


def dwells(*each: tuple[int, int, float, float]) -> str:
    return STAND + "".join(
        f"{weight + 0.1 * (i // 10 % 2)},{pwm},3.9,{rpm},{rpm},{rpm},0,3.9\n"
        for n, pwm, weight, rpm in each
        for i in range(n)
    )


def test_dwells_in_free_air_become_trials_and_a_throttle_map(tmp_path):
    at_rest, short = (100, 0, -1.0, 0), (30, 20000, 20.0, 9000)
    text = dwells(at_rest, (200, 13107, 9.0, 8000), short, (200, 32768, 24.0, 12000))
    rows = convert("crazyflie_stand", text, tmp_path)
    wanted = {"throttle": [0.2, 0.500008], "lift": [10, 25], "n": [10, 10], "rpm": [8000, 12000]}
    assert {name: rows[name].tolist() for name in wanted} == wanted
    manifest = manifests.load(tmp_path / "raw")
    assert manifest.vehicle.throttle_map.points[0] == pytest.approx((0.2, 8000 / 60))
    assert nearlift("ingest", tmp_path / "raw", "--out", tmp_path).exit_code == 0
    trials = read_table(tmp_path / "processed" / "made-up" / "trials.parquet", TRIALS)
    assert set(trials["boundary"]) == {"none"}
    refused = nearlift("reduce", tmp_path / "raw", "--out", tmp_path)
    assert (refused.exit_code, "only in free air" in refused.stderr) == (4, True)


@pytest.mark.parametrize(
    ("converter", "text", "message"),
    [
        ("crazyflie_stand", STAND, "does not begin with rotors at rest"),
        ("crazyflie_stand", "a,b\n1,2\n", "not the published table"),
        ("crazyflie_stand", dwells((9, 0, 0, 0)) + "x,0,3,0,0,0,0,3\n", "not the published table"),
        ("pitt_ras_older", "data = 1", "has no sweeps"),
        ("garofano_soldado", SCRIPT, "holds other numbers"),
        ("pitt_ras", "0.5,0.5,12,2\n", "does not hold the start of its sweep"),
    ],
)
def test_another_file_is_refused_and_no_campaign_made(tmp_path, converter, text, message):
    with pytest.raises(InputRefused, match=message):
        convert(converter, text, tmp_path)
    assert not (tmp_path / "raw").exists()


def test_older_sweeps_are_read_from_their_script_or_a_transcript(tmp_path):
    script = (
        "data = (\n#     np.array((\n#             (470,2011,12.5,1.5),\n#         )),\n"
        "    np.array((\n            (15,1220,12.4,1.5),\n            (9,1100,12.4,1.5),\n        )),\n"
        "    np.array((\n            (27,1320,12.1,0.2),\n        )))\n"
    )
    rows = convert("pitt_ras_older", script, tmp_path)
    assert rows["trial"].tolist() == ["s1-00", "s2-02"]
    assert rows["throttle"].tolist() == [0.2, 0.290909]
    assert rows["supply"].tolist() == [12.4, 12.1]
    assert rows["distance"].tolist() == [1.5, 0.2]
    table = tmp_path / "sweeps.csv"
    head = "sweep,force_raw,throttle_us,vbat_V,dist_to_ground_m\n"
    table.write_text(head + "1,15,1220,12.4,1.5\n2,27,1320,12.1,0.2\n")
    rows, _ = converters.pitt_ras_older({"sweeps": table}, "older")
    assert rows["trial"].tolist() == ["s1-00", "s2-01"]
    assert rows["lift"].tolist() == [15, 27]
    assert rows["distance"].tolist() == [1.5, 0.2]


def test_a_script_becomes_a_table_with_the_heights_of_each_row():
    lines = garofano_soldado_table(SCRIPT, "script.m").splitlines()
    assert lines[1:] == [
        "Fz0,coplanar,0,0,0.6,0.3,2.0,0.1",
        "Fz0,coplanar,0,0,1.0,0.5,1.5,0.1",
        "Fz0,coplanar,0,0,5.0,2.5,1.0,0.2",
        "Fz10_minbeta20,face_to_face,10,20,1.0,0.5,3.0,0.1",
        "Fz10_minbeta20,face_to_face,10,20,5.0,2.5,2.5,0.1",
    ]
    with pytest.raises(InputRefused, match="heights or deviations of Fz0"):
        garofano_soldado_table(SCRIPT.replace("[0.1 0.1 0.2]", "[0.1]"), "script.m")


def test_thrust_along_the_axes_is_force_over_both_cosines():
    published = pd.DataFrame(
        [
            ["A", "coplanar", 0, 0, 0.6, 0.09906, 24.2, 0.118],
            ["B", "face_to_face", 30, 0, 0.6, 0.09906, 20.0, 0.06],
            ["C", "back_to_back", 20, 10, 1.0, 0.1651, 20.45, 0.05],
        ],
        columns=["case", "config", "alpha_deg", "beta_deg", "z_over_R", "z_m", "Fz_N", "Fz_std_N"],
    )
    rows, _ = tilted_pairs(published, along_axes=False)
    assert rows["trial"].tolist() == ["A-0.6", "B-0.6", "C-1"]
    assert rows["tilt"].tolist() == [0, 30, -20]
    assert rows["lift"].tolist() == [24.2, 20.0, 20.45]
    axes, _ = tilted_pairs(published, along_axes=True)
    cosines = np.cos(np.radians([0, 30, 20])) * np.cos(np.radians([0, 0, 10]))
    assert axes["lift"].to_numpy() == pytest.approx(rows["lift"].to_numpy() / cosines)
    assert axes["lift_sd"].to_numpy() == pytest.approx(rows["lift_sd"].to_numpy() / cosines)


@measured
def test_the_digest_of_the_numbers_is_that_of_the_table_at_hand(tmp_path):
    table = DATA / "garofano-soldado-2023" / "thrust_vs_height.csv"
    digest = hashlib.sha256(table.read_bytes()).hexdigest()
    assert digest == converters.GAROFANO_SOLDADO_SHA256
    write_campaign(tmp_path / "raw", "garofano_soldado", {table.name: table}, "x-axes")
    loaded = manifests.load(tmp_path / "raw")
    assert (loaded.trials.order, loaded.vehicle.rotors) == ("unknown", 2)


@measured
def test_the_measured_sweeps_are_the_measured_campaign(tmp_path):
    folder = DATA / "pitt-ras-iarc7-thrust" / "v1_sweeps_with_ground_distance"
    theirs = pd.read_csv(DATA.parent / "campaigns" / "pitt-ras-2017" / "trials.csv")
    sweeps = sorted(folder.glob("*06-29_19*.csv")) + sorted(folder.glob("*06-29_20*.csv"))
    write_campaign(tmp_path, "pitt_ras", {p.name: p for p in sweeps}, "pitt-ras-2017")
    ours = pd.read_csv(tmp_path / "trials.csv")
    assert ours["trial"].tolist() == theirs["trial"].tolist()
    columns = ["session", "distance", "throttle", "lift", "supply", "start"]
    np.testing.assert_allclose(ours[columns], theirs[columns], rtol=1e-5, atol=1e-5)


@measured
def test_the_measured_stand_gives_a_map(tmp_path):
    folder = DATA / "crazyflie-thrust-stand"
    files = {p.name: p for p in (folder / "cf21_stock2.csv", folder / "cf2.1-stock-prop.csv")}
    write_campaign(tmp_path, "crazyflie_stand", files, "stand")
    assert len(manifests.load(tmp_path).vehicle.throttle_map.points) >= 8
    rows = pd.read_csv(tmp_path / "trials.csv")
    lifts = sorted(zip(rows["throttle"], rows["lift"], strict=True))
    assert all(b[1] > a[1] for a, b in itertools.pairwise(lifts) if b[0] > a[0])
    # gf, a craft of 27 g at 69 % of the pulse width
    assert 25 < lifts[-1][1] < 70
