import numpy as np
import pytest
from click.testing import CliRunner

import nearlift
from nearlift import readers
from nearlift.cli import main
from nearlift.readers.guarded import Malformed
from npz_records import READER, contents

MANIFEST = """
schema = "nearlift.campaign/1"
name = "saved-by-python"
vehicle = { name = "Crazyflie 2.0", rotors = 4, rotor_radius = "23 mm", rotor_spacing = "65 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
load_cell = { sample_rate = "500 Hz", tare = "0.1 s" }
records = { reader = "npz", files = "trials/{trial}.npz", force = { column = "force", unit = "mN", sign = 1 } }
[trials.units]
distance = "mm"
throttle = "percent"
"""


@pytest.fixture
def campaign(tmp_path):
    rng = np.random.default_rng(1)
    (tmp_path / "raw" / "trials").mkdir(parents=True)
    rows = []
    for i, (distance, lift_mN) in enumerate([(30, 280.0), (60, 265.0), (300, 260.0)]):
        force = np.concatenate([np.zeros(50), np.full(200, lift_mN)]) + 0.1 * rng.standard_normal(
            250
        )
        np.savez(
            tmp_path / "raw" / "trials" / f"t{i}.npz", **{"force[mN]": force, "rate_Hz": 500.0}
        )
        rows.append(f"t{i},ground,{distance},50")
    (tmp_path / "raw" / "trials.csv").write_text(
        "trial,boundary,distance,throttle\n" + "\n".join(rows) + "\n"
    )
    (tmp_path / "raw" / "campaign.toml").write_text(MANIFEST)
    return tmp_path / "raw"


def test_it_is_among_the_readers():
    assert readers.reader("npz") is READER


def test_a_campaign_of_archives_is_reduced(campaign):
    study = nearlift.load(campaign, campaign.parent, executor="serial")
    study.reduce()
    trials = study.read("trials.parquet")
    assert trials["lift_N"].tolist() == pytest.approx([0.28, 0.265, 0.26], abs=2e-4)


def test_inspect_shows_its_channels(campaign):
    told = CliRunner().invoke(main, ["inspect", str(campaign / "trials" / "t0.npz")])
    assert told.exit_code == 0, told.output
    assert "force[mN]" in told.output


def test_damage_is_malformed_and_pickles_are_never_loaded(campaign, tmp_path):
    whole = (campaign / "trials" / "t0.npz").read_bytes()
    for bad in (
        whole[: len(whole) // 2],
        b"no archive",
        whole[:80] + bytes([whole[80] ^ 1]) + whole[81:],
    ):
        path = tmp_path / "bad.npz"
        path.write_bytes(bad)
        with pytest.raises(Malformed):
            contents(path, {}, None)
    np.savez(tmp_path / "objects.npz", force=np.array([{}], dtype=object))
    with pytest.raises(Malformed):
        contents(tmp_path / "objects.npz", {}, None)
