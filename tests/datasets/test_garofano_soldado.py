"""Published tables: the converter, and trials whose order nobody knows."""

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import campaign, findings, hsiao
from tests.unit.small_run import nearlift

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.datasets.garofano_soldado import write_table
from nearlift.errors import InputRefused, UsageError
from nearlift.likelihood.covariates import derive
from nearlift.loop.diagnose import set_up
from nearlift.loop.families import families
from nearlift.loop.search_problem import Options
from nearlift.schedule import read_schedule

HEADER = "case,config,alpha_deg,beta_deg,z_over_R,z_m,Fz_N,Fz_std_N\n"
ROWS = "A,coplanar,0,0,0.6,0.09906,24.2,0.118\nB,face_to_face,30,0,0.6,0.09906,20.0,0.06\nC,back_to_back,20,10,1.0,0.1651,20.45,0.05\n"


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "thrust_vs_height.csv"
    path.write_text(HEADER + ROWS)
    return path


def test_a_table_becomes_a_campaign_of_means(table, tmp_path):
    folder = write_table(table, tmp_path / "bench")
    loaded = manifests.load(folder)
    assert (loaded.name, loaded.trials.order, loaded.vehicle.rotors) == ("bench", "unknown", 2)
    schedule = read_schedule(loaded, folder)
    assert schedule.z_hat == pytest.approx([0.6, 0.6, 1.0])
    assert schedule.covariates["tilt_rad"] == pytest.approx(np.radians([0, 30, -20]))
    assert schedule.means["lift_N"] == pytest.approx([24.2, 20.0, 20.45])
    assert schedule.means["lift_sd_N"] == pytest.approx([0.118, 0.06, 0.05])
    assert schedule.covariates["session"].tolist() == ["A", "B", "C"]
    # nobody says in which order; three sessions are three visits all the same
    assert schedule.visit.tolist() == [0, 1, 2]


def test_thrust_along_the_axes_is_force_over_both_cosines(table, tmp_path):
    folder = write_table(table, tmp_path / "axes", along_axes=True, name="along-axes")
    loaded = manifests.load(folder)
    assert loaded.name == "along-axes"
    lift = read_schedule(loaded, folder).means["lift_N"]
    assert lift == pytest.approx(
        [24.2, 20.0 / np.cos(np.pi / 6), 20.45 / np.cos(np.pi / 9) / np.cos(np.pi / 18)], rel=1e-5
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER.replace("Fz_std_N", "sd") + ROWS, "lacks the columns Fz_std_N"),
        (HEADER + ROWS.replace("24.2", "24.2N"), "line 2"),
        (
            HEADER + ROWS.replace("back_to_back", "sideways"),
            "line 4: 'sideways' is no known configuration",
        ),
    ],
)
def test_a_damaged_table_is_refused(table, tmp_path, text, message):
    table.write_text(text)
    with pytest.raises(InputRefused, match=message):
        write_table(table, tmp_path / "bench")
    assert not (tmp_path / "bench").exists()


def test_nothing_is_overwritten_and_a_missing_table_is_named(table, tmp_path):
    folder = write_table(table, tmp_path / "bench")
    with pytest.raises(UsageError, match="is not empty"):
        write_table(table, folder)
    with pytest.raises(InputRefused, match="name the published table"):
        write_table(tmp_path / "nowhere.csv", tmp_path / "other")


# ---- order unknown


def test_where_the_order_is_unknown_nothing_varies_along_it():
    data = dataclasses.replace(campaign(3, visits=5), ordered=False)
    known = derive(data, np.ones(data.n)).covariates
    for name in (
        "run_order",
        "elapsed_hat",
        "previous_lift_N",
        "previous_throttle",
        "previous_z_hat",
        "order_in_visit",
    ):
        assert np.ptp(known[name]) == 0, name
    assert "start_s" not in known
    assert {f.covariate for f in families(derive(data, np.ones(data.n)))}.isdisjoint(
        {"start", "order_in_visit", "previous_throttle", "previous_distance"}
    )


def test_a_drift_is_seen_in_run_order_and_untestable_without_one():
    base = catalogue.model("sanchez_cuevas")
    data = campaign(5, visits=8)
    data = dataclasses.replace(data, lift_N=data.lift_N * (1 + 0.02 * np.linspace(-1, 1, data.n)))
    assert findings(data, base, confirm=False)["structure"][0]["covariate"] in (
        "start",
        "session",
    )
    bare = {k: v for k, v in data.covariates.items() if k == "approach"}
    found = findings(dataclasses.replace(data, ordered=False, covariates=bare), base, confirm=False)
    assert "start" not in {s["covariate"] for s in found["structure"]}
    assert {"gain_drift", "cell_creep", "warm_up"} <= {u["effect"] for u in found["untestable"]}


def test_at_a_single_throttle_what_l_inf_absorbs_is_no_family():
    """Its rounding errors would be: at one throttle the zero of the cell, in first order,
    is L_inf.
    """
    data = campaign(
        6,
        boundary="ceiling",
        ratio=hsiao,
        stations=(0.15, 0.2, 0.3, 0.5, 0.8, 1.5, 3.0, 10.0),
        visits=12,
    )
    one = data.take(data.throttle == 0.5)
    stage = set_up(one, catalogue.model("hsiao_chirarattananon"), (), Options())[0]
    assert "zero" not in {f.name for f in families(stage.data)}
    # a null of 96 trials: significant at 5 % once in twenty, at one in ten thousand never
    assert stage.nothing_added[0].p_value > 1e-3


def test_a_manifest_says_run_or_unknown(table, tmp_path):
    folder = write_table(table, tmp_path / "bench")
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace('order = "unknown"', 'order = "sorted"'))
    found = nearlift("run", folder, "--dry-run", "--out", tmp_path)
    assert found.exit_code == 2
    assert "trials.order" in found.stderr
