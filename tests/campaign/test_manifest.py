"""The manifest: values of a good one, and refusals of broken ones.

Each line of broken.txt is one change of good.toml, and the text of its refusal.
"""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from nearlift.campaign import manifest as campaign
from nearlift.errors import ManifestError
from nearlift.observed import choice

FOLDER = Path(__file__).parent
GOOD = (FOLDER / "good.toml").read_text(encoding="utf-8")
BROKEN = [
    line.replace(r"\n", "\n").split(" => ")
    for line in (FOLDER / "broken.txt").read_text(encoding="utf-8").splitlines()[1:]
]


def parsed(**sections) -> campaign.Campaign:
    """The good manifest with changed keys of sections; None takes a key or section away."""
    raw = tomllib.loads(GOOD)
    for name, keys in sections.items():
        if isinstance(keys, dict):
            keys = {k: v for k, v in {**raw.get(name, {}), **keys}.items() if v is not None}
        raw[name] = keys
    return campaign.parse({name: keys for name, keys in raw.items() if keys is not None})


def good(**vehicle) -> campaign.Campaign:
    return parsed(vehicle=vehicle)


# --- a good one


def test_quantities_are_si():
    c = good()
    assert c.vehicle.rotor_radius == pytest.approx(0.023)
    assert c.vehicle.mass == pytest.approx(0.027)
    assert c.rig.gravity == 9.8
    assert c.load_cell.accuracy == pytest.approx(1.5e-3 * 9.80665)
    assert c.load_cell.sample_rate == 1000
    assert c.tare_s == 2.0


def test_it_is_frozen():
    with pytest.raises(ValueError, match="frozen"):
        good().vehicle.mass = 1.0  # type: ignore[misc]


def test_geometry_of_four_rotors():
    known = good().geometry()
    assert known["spacing_hat"] == pytest.approx(65 / 23)
    assert known["diagonal_hat"] == pytest.approx(math.sqrt(2) * 65 / 23)
    layout = known["layout_hat"]
    sides = np.linalg.norm(layout - np.roll(layout, 1, axis=0), axis=1)
    np.testing.assert_allclose(sides, 65 / 23)
    assert np.linalg.norm(layout[0] - layout[2]) == pytest.approx(known["diagonal_hat"])


def test_given_diagonal_wins():
    assert good(rotor_diagonal="92 mm").geometry()["diagonal_hat"] == pytest.approx(4.0)


@pytest.mark.parametrize("rotors", [2, 6, 8])
def test_opposite_spacing_of_other_rings(rotors):
    known = good(rotors=rotors).geometry()
    layout = known["layout_hat"]
    assert layout.shape == (rotors, 2)
    assert np.linalg.norm(layout[0] - layout[rotors // 2]) == pytest.approx(known["diagonal_hat"])


def test_one_rotor_has_a_layout_and_no_spacing():
    assert set(good(rotors=1, rotor_spacing=None).geometry()) == {"layout_hat"}


def test_no_geometry_is_invented():
    assert good(rotor_spacing=None).geometry() == {}


def test_gap_and_edge_are_geometry_where_the_rig_gives_them():
    assert not {"gap_hat", "edge_hat"} & set(good().geometry())
    rig = {"gap": "92 mm", "edge": "-23 mm"}
    known = parsed(rig=rig).geometry()
    assert [known["gap_hat"], known["edge_hat"]] == pytest.approx([4.0, -1.0])
    with pytest.raises(ManifestError, match=r"gap 0.092 m is more than the arena of 0.08 m"):
        parsed(rig={**rig, "arena": "80 mm"})


def test_a_gap_or_an_edge_brings_its_model_among_the_rivals_and_is_asked_for():
    both = {"corridor", "images_edge"}
    assert not both & {m.name for m in choice(good(), "ground")[1]}
    rig = {"edge": "20 mm"}
    assert both < {m.name for m in choice(parsed(rig={**rig, "gap": "0.3 m"}), "ground")[1]}
    with pytest.raises(ManifestError, match=r"corridor needs gap_hat\n  give gap in \[rig\]"):
        choice(parsed(rig=rig, fit={"ground": {"base": "corridor"}}), "ground")
    # a tilt is a column of the trials, which the manifest cannot promise
    base, _ = choice(parsed(rig=rig, fit={"ground": {"base": "images_tilted"}}), "ground")
    assert base.needs == ("layout_hat", "tilt_rad")


def test_offset_and_datum_by_boundary():
    offset = {"ground": "3 mm", "sidewall": "-23 mm"}
    datum = {"ground": "airframe", "sidewall": "rotor axis"}
    rig = {"distance_offset": offset, "distance_datum": datum}
    reference = parsed(rig=rig, vehicle={"rotor_radius": "23 mm"}).distance_reference
    assert reference("sidewall") == ("rotor axis", pytest.approx(-0.023))
    assert reference("ground").datum == "airframe"
    missing = r"rig.distance_datum: has no entry for the ceiling\n  add ceiling = "
    with pytest.raises(ManifestError, match=missing):
        reference("ceiling")
    assert good().distance_reference("ceiling").offset_m == 0.0


def test_counts_become_newtons_of_lift():
    calibration = {"gain": "9.8e-3 mN/count", "offset": "120 count"}
    force = {"column": "f", "unit": "count", "sign": -1, "calibration": calibration}
    records = parsed(records={"force": force}).records
    assert records.force.linear() == (pytest.approx(-9.8e-6), 120.0)


def test_uniform_component_is_a_half_width():
    height = {"name": "datum", "on": "height", "value": "0.2 mm", "scope": "boundary"}
    gain = {"name": "gain", "on": "gain", "value": "0.5 percent", "scope": "session"}
    stated = parsed(uncertainty=[height, {**gain, "distribution": "uniform"}]).uncertainty
    expected = [2e-4, 0.005 / math.sqrt(3)]
    assert [u.standard() for u in stated] == pytest.approx(expected)


def test_means_need_neither_records_nor_tare():
    gone = dict.fromkeys(tomllib.loads(GOOD)["records"])
    assert parsed(records={**gone, "reader": "means"}, load_cell=None).tare_s == 0.0


@pytest.mark.parametrize(("tare", "seconds"), [("0 s", 0.0), ("none", 0.0), ("1500 ms", 1.5)])
def test_tare(tare, seconds):
    assert parsed(load_cell={"tare": tare}).tare_s == seconds


def test_boundaries_in_order():
    mixed = ["none", "sidewall", "ground", "ground"]
    assert campaign.boundaries_of(mixed) == ["ground", "sidewall"]


# --- broken ones


@pytest.mark.parametrize("case", BROKEN, ids=lambda case: case[0])
def test_a_broken_manifest_is_refused_in_these_words(case):
    _, old, new, *refusals = case
    assert refusals
    assert not old or old in GOOD
    text = GOOD.replace(old, new, 1) if old else f"{GOOD}\n{new}"
    with pytest.raises(ManifestError) as refusal:
        campaign.parse(tomllib.loads(text), "it")
    for line in refusals:
        assert line in str(refusal.value)
    assert refusal.value.exit_code == 2


def test_every_fault_is_listed_at_once():
    with pytest.raises(ManifestError) as refusal:
        parsed(vehicle={"rotor_radius": 23, "mass": "27 mm"}, rig={"gravity": None})
    for key in ("vehicle.rotor_radius", "vehicle.mass", "rig.gravity: is missing"):
        assert key in str(refusal.value)


def test_load_reads_the_folder(tmp_path):
    (tmp_path / "campaign.toml").write_text(GOOD, encoding="utf-8")
    assert campaign.load(tmp_path).name == "good"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, r"holds no campaign.toml\n  `nearlift new DIR` writes one to fill in"),
        (b"name = ", r"campaign.toml: is not valid TOML: .*\n  correct that line"),
        (b'name = "caf\xe9"', r"is not UTF-8 text \(.* at byte 11\)\n  save it as UTF-8"),
    ],
)
def test_unreadable_manifest_is_refused(tmp_path, content, told):
    if content is not None:
        (tmp_path / "campaign.toml").write_bytes(content)
    with pytest.raises(ManifestError, match=told):
        campaign.load(tmp_path)
