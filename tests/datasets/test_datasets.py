"""`nearlift data`: files come from a server on this machine; nothing of the published data is in
the repository.
"""

from __future__ import annotations

import csv
import hashlib
import itertools
import json
import re
import urllib.parse
from pathlib import Path

import pytest
from tests.datasets.published import PublishedFolder, listed, published
from tests.unit.small_run import nearlift

from nearlift.campaign import manifest as manifests
from nearlift.datasets import garofano_soldado, pitt_ras_older, registry
from nearlift.errors import InputRefused, UsageError
from nearlift.run.tables import Table, read_table
from nearlift.stages.ingest import TRIALS

SHARED = Path(__file__).parents[3] / "shared"
# requests leaves a socket to the collector where an answer is refused in the middle; when that runs
# is chance
pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
HEX = re.compile(r"/[0-9a-f]{40}/")


@pytest.fixture
def server(tmp_path):
    with published(tmp_path / "published") as running:
        yield running


SWEEPS = {
    "thrust_data_2020-01-01_10-00-00.500000.csv": (
        "0.1,0.01,12.6,2.0\n0.5,0.50,12.4,2.0\n1.0,1.50,12.0,2.0\n"
    ),
    "thrust_data_2020-01-01_10-20-00.500000_0.25m.csv": (
        "0.5,0.52,12.2,2.5e-01\n1.0,1.52,11.8,2.5e-01\n"
    ),
}


def get(tmp_path: Path, own: Path, *more: object, name: str = "made-up", to: str = "raw"):
    return nearlift(
        "data", "get", name, tmp_path / to, "--registry", own, "--cache", tmp_path / "cache", *more
    )


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "trials.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_what_is_listed_is_pinned_and_says_whose_it_is():
    found = registry.datasets()
    assert {"pitt-ras-2017", "garofano-soldado-2023", "crazyflie-2.1-stand"} <= {
        d.name for d in found
    }
    for item in found:
        assert item.licence
        assert item.citation
        for file in item.file:
            assert file.url.startswith("https://raw.githubusercontent.com/")
            assert HEX.search(file.url), "a URL without a commit may change under its digest"
    assert not any(d.unknown for d in found)


def test_list_shows_names_and_licences():
    told = nearlift("data", "list")
    assert told.exit_code == 0
    for words in ("pitt-ras-2017", "licence: MIT", "licence: none stated"):
        assert words in told.stdout
    assert [d["name"] for d in json.loads(nearlift("data", "list", "--json").stdout)] == [
        d.name for d in registry.datasets()
    ]


def test_sweeps_become_a_campaign_that_runs(server, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml")
    told = get(tmp_path, own, "--json")
    assert told.exit_code == 0, told.output
    answer = json.loads(told.stdout)
    assert (answer["licence"], answer["next"]) == ("CC0", f"nearlift run {tmp_path / 'raw'}")
    found = rows(tmp_path / "raw")
    assert [(r["trial"], r["distance"], r["session"], r["start"]) for r in found] == [
        ("r01-01", "2", "1", "0.000000"),
        ("r01-02", "2", "1", "0.000000"),
        ("r02-00", "0.25", "2", "1200.000000"),
        ("r02-01", "0.25", "2", "1200.000000"),
    ]
    assert nearlift("ingest", tmp_path / "raw", "--out", tmp_path).exit_code == 0
    source = (tmp_path / "raw" / "SOURCE.txt").read_text()
    assert all(hashlib.sha256(text.encode()).hexdigest() in source for text in SWEEPS.values())
    assert sorted(server.asked) == sorted(SWEEPS)


def test_what_the_cache_holds_is_not_fetched_again(server, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml")
    first, second = SWEEPS
    (server.folder / second).unlink()
    told = get(tmp_path, own)
    assert (told.exit_code, "the server says 404" in told.stderr) == (4, True)
    assert not (tmp_path / "raw").exists()
    (server.folder / second).write_text(SWEEPS[second])
    assert get(tmp_path, own).exit_code == 0
    assert server.asked == [first, second, second]
    server.stop()
    assert get(tmp_path, own, to="again").exit_code == 0


def test_offline_says_where_to_put_the_file_by_hand(server, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml")
    server.stop()
    told = get(tmp_path, own)
    assert told.exit_code == 4
    assert "cannot be fetched (ConnectionError)" in told.stderr
    where = tmp_path / "cache" / "made-up"
    assert str(where / next(iter(SWEEPS))) in told.stderr
    where.mkdir(parents=True, exist_ok=True)
    for name, text in SWEEPS.items():
        (where / name).write_text(text)
    assert get(tmp_path, own).exit_code == 0


def test_a_wrong_digest_leaves_nothing_behind(server, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml", digest="0" * 64)
    told = get(tmp_path, own)
    assert (told.exit_code, "is not the file that is known here" in told.stderr) == (4, True)
    assert [p for p in (tmp_path / "cache").rglob("*") if p.is_file()] == []
    assert not (tmp_path / "raw").exists()


def test_a_damaged_cache_is_mended(server, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml")
    (tmp_path / "cache" / "made-up").mkdir(parents=True)
    (tmp_path / "cache" / "made-up" / next(iter(SWEEPS))).write_text("0.5,9,12,2\n")
    assert get(tmp_path, own).exit_code == 0
    assert rows(tmp_path / "raw")[0]["lift"] == "0.5"


def test_an_unknown_digest_wants_trust(server, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml", digest="unknown")
    told = get(tmp_path, own)
    assert (told.exit_code, "whose digest is unknown" in told.stderr, "--trust" in told.stderr) == (
        2,
        True,
        True,
    )
    assert server.asked == []
    assert get(tmp_path, own, "--trust").exit_code == 0


def test_nothing_is_overwritten_and_a_broken_file_leaves_no_campaign(server, tmp_path):
    own = listed(
        server, {"thrust_data_2020-01-01_10-00-00.5.csv": "0.5,0.5,12\n"}, tmp_path / "list.toml"
    )
    told = get(tmp_path, own)
    assert (told.exit_code, "is not four numbers" in told.stderr) == (4, True)
    assert [p.name for p in tmp_path.iterdir() if "raw" in p.name] == []
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "mine.txt").write_text("mine")
    assert get(tmp_path, own).exit_code == 2
    assert [p.name for p in (tmp_path / "raw").iterdir()] == ["mine.txt"]
    assert (
        get(
            tmp_path,
            listed(server, {"sweep.csv": "0.5,0.5,12,2\n"}, tmp_path / "list.toml"),
            to="other",
        ).exit_code
        == 4
    )


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("CC0", 'CC0"\nlicense = "CC0'), "license: Extra inputs"),
        (('sha256 = "', 'sha256 = "x'), "is no SHA-256"),
        (('name = "thrust', 'name = "../thrust'), "is a path"),
        (("[[dataset]]", "[[dataset"), "is not valid TOML"),
    ],
)
def test_a_list_that_breaks_its_form_is_refused(server, tmp_path, change, told):
    own = listed(server, SWEEPS, tmp_path / "list.toml")
    own.write_text(own.read_text().replace(*change, 1))
    with pytest.raises(InputRefused, match=told):
        registry.datasets(own)


def test_a_slip_in_the_name_is_met_with_the_nearest():
    with pytest.raises(UsageError, match="did you mean 'pitt-ras-2017'"):
        registry.dataset("pitt-ras-2018")
    with pytest.raises(UsageError, match=r"there are pitt-ras-2017, "):
        registry.dataset("qqq")


STAND = "weight[g],pwm,vbat[V],rpm1,rpm2,rpm3,rpm4,v[V]\n"


def stand(*dwells: tuple[int, int, float, float]) -> str:
    return STAND + "".join(
        f"{weight + 0.1 * (i // 10 % 2)},{pwm},3.9,{rpm},{rpm},{rpm},0,3.9\n"
        for n, pwm, weight, rpm in dwells
        for i in range(n)
    )


def test_dwells_in_free_air_become_trials_and_a_throttle_map(server, tmp_path):
    text = stand(
        (100, 0, -1.0, 0),
        (200, 13107, 9.0, 8000),
        (30, 20000, 20.0, 9000),
        (200, 32768, 24.0, 12000),
    )
    told = get(
        tmp_path,
        listed(server, {"stand.csv": text}, tmp_path / "list.toml", converter="crazyflie_stand"),
    )
    assert told.exit_code == 0, told.output
    found = rows(tmp_path / "raw")
    assert [(r["throttle"], r["lift"], r["n"], r["rpm"]) for r in found] == [
        ("0.2", "10", "10", "8000"),
        ("0.500008", "25", "10", "12000"),
    ]
    manifest = manifests.load(tmp_path / "raw")
    assert manifest.vehicle.throttle_map.points[0] == pytest.approx((0.2, 8000 / 60))
    assert nearlift("ingest", tmp_path / "raw", "--out", tmp_path).exit_code == 0
    trials: Table = read_table(tmp_path / "processed" / "made-up" / "trials.parquet", TRIALS)
    assert set(trials["boundary"]) == {"none"}
    refused = nearlift("reduce", tmp_path / "raw", "--out", tmp_path)
    assert (refused.exit_code, "only in free air" in refused.stderr) == (4, True)
    for text, told in (
        (STAND, "does not begin with rotors at rest"),
        ("a,b\n1,2\n", "lacks the columns"),
        (stand((9, 0, 0, 0)) + "x,0,3,0,0,0,0,3\n", "is not a row"),
    ):
        own = listed(
            server, {"stand.csv": text}, tmp_path / "list.toml", converter="crazyflie_stand"
        )
        assert told in get(tmp_path, own, to="broken").stderr


SCRIPT = """
Fz0\t=[2.0 1.5 1.0\t];
std_Fz0 = [0.1 0.1 0.2];
Fz10_minbeta20 = [3 2.5];
std_Fz10_minbeta20=[0.1 0.1];
R = 0.5; %m
z = [0.6*R, 1*R, 5*R];
z2 = [1*R, 5*R];
"""


def test_a_script_becomes_a_table_with_the_heights_of_each_row():
    lines = garofano_soldado.table(SCRIPT, "script.m").splitlines()
    assert lines[1:] == [
        "Fz0,coplanar,0,0,0.6,0.3,2.0,0.1",
        "Fz0,coplanar,0,0,1.0,0.5,1.5,0.1",
        "Fz0,coplanar,0,0,5.0,2.5,1.0,0.2",
        "Fz10_minbeta20,face_to_face,10,20,1.0,0.5,3.0,0.1",
        "Fz10_minbeta20,face_to_face,10,20,5.0,2.5,2.5,0.1",
    ]
    with pytest.raises(InputRefused, match="has no rows"):
        garofano_soldado.table("nothing", "script.m")
    with pytest.raises(InputRefused, match="1 standard deviations and no such heights"):
        garofano_soldado.table(
            SCRIPT.replace("std_Fz0 = [0.1 0.1 0.2]", "std_Fz0 = [0.1]"), "script.m"
        )


def test_other_numbers_than_the_published_ones_are_refused_although_trusted(server, tmp_path):
    own = listed(
        server,
        {"script.m": SCRIPT},
        tmp_path / "list.toml",
        converter="garofano_soldado",
        digest="unknown",
    )
    told = get(tmp_path, own, "--trust")
    assert (told.exit_code, "holds other numbers" in told.stderr) == (4, True)


def served(server: PublishedFolder, name: str, folder: Path, tmp_path: Path) -> Path:
    """The real entry of the list, its files served from a folder; their digests are the
    list's own.
    """
    entry = registry.dataset(name)
    text = registry.OWN.read_text().split("[[dataset]]")[
        1 + [d.name for d in registry.datasets()].index(name)
    ]
    for file in entry.file:
        (server.folder / file.name).write_bytes((folder / file.name).read_bytes())
        text = text.replace(file.url, f"{server.url}/{urllib.parse.quote(file.name)}")
    (tmp_path / "list.toml").write_text("[[dataset]]" + text)
    return tmp_path / "list.toml"


@pytest.mark.skipif(not (SHARED / "data").is_dir(), reason="../shared is not here")
def test_the_measured_sweeps_are_the_measured_campaign(server, tmp_path):
    own = served(
        server,
        "pitt-ras-2017",
        SHARED / "data/pitt-ras-iarc7-thrust/v1_sweeps_with_ground_distance",
        tmp_path,
    )
    assert get(tmp_path, own, name="pitt-ras-2017").exit_code == 0
    ours, theirs = rows(tmp_path / "raw"), rows(SHARED / "campaigns/pitt-ras-2017")
    assert len(ours) == len(theirs) == 378
    for own_row, row in zip(ours, theirs, strict=True):
        assert (own_row["trial"], own_row["session"]) == (row["trial"], row["session"])
        for column in ("distance", "throttle", "lift", "supply", "start"):
            assert float(own_row[column]) == pytest.approx(
                float(row[column]), rel=1e-5, abs=1e-5
            ), (own_row, row)
    assert (
        manifests.load(tmp_path / "raw").vehicle.rotor_radius
        == manifests.load(SHARED / "campaigns/pitt-ras-2017").vehicle.rotor_radius
    )


@pytest.mark.skipif(not (SHARED / "data").is_dir(), reason="../shared is not here")
def test_the_measured_stand_gives_a_map(server, tmp_path):
    own = served(server, "crazyflie-2.1-stand", SHARED / "data/crazyflie-thrust-stand", tmp_path)
    assert get(tmp_path, own, name="crazyflie-2.1-stand").exit_code == 0
    points = manifests.load(tmp_path / "raw").vehicle.throttle_map.points
    assert len(points) >= 8
    found = rows(tmp_path / "raw")
    lifts = sorted((float(r["throttle"]), float(r["lift"])) for r in found)
    assert all(b[1] > a[1] for a, b in itertools.pairwise(lifts) if b[0] > a[0])
    assert 25 < lifts[-1][1] < 70  # gf, a craft of 27 g at 69 % of the pulse width
    assert nearlift("ingest", tmp_path / "raw", "--out", tmp_path).exit_code == 0


@pytest.mark.skipif(not (SHARED / "data").is_dir(), reason="../shared is not here")
def test_the_digest_of_the_numbers_is_that_of_the_table_at_hand():
    assert (
        hashlib.sha256(
            (SHARED / "data/garofano-soldado-2023/thrust_vs_height.csv").read_bytes()
        ).hexdigest()
        == garofano_soldado.NUMBERS_SHA256
    )


def test_older_sweeps_are_read_from_their_script(tmp_path):
    script = tmp_path / "fit.py"
    script.write_text(
        "data = (\n#     np.array((\n#             (470,2011,12.5,1.5),\n#         )),\n"
        "    np.array((\n            (15,1220,12.4,1.5),\n            (9,1100,12.4,1.5),\n        )),\n"
        "    np.array((\n            (27,1320,12.1,0.2),\n        )))\n"
    )
    pitt_ras_older.convert({"fit.py": script}, tmp_path, "older")
    assert (tmp_path / "trials.csv").read_text().splitlines()[1:] == [
        "s1-00,1.5,0.2,15,12.4,1",
        "s2-02,0.2,0.290909,27,12.1,2",
    ]
