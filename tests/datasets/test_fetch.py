"""`nearlift data get`: files come from a server on this machine."""

from __future__ import annotations

import hashlib
import json

import pandas as pd
import pytest
from tests.datasets.published import listed, published
from tests.unit.small_run import nearlift

# requests leaves a socket to the collector where an answer is refused in the middle; when that runs
# is chance
pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
SWEEPS = {
    "thrust_data_2020-01-01_10-00-00.500000.csv": (
        "0.1,0.01,12.6,2.0\n0.5,0.50,12.4,2.0\n1.0,1.50,12.0,2.0\n"
    ),
    "thrust_data_2020-01-01_10-20-00.500000_0.25m.csv": (
        "0.5,0.52,12.2,2.5e-01\n1.0,1.52,11.8,2.5e-01\n"
    ),
}


@pytest.fixture
def server(tmp_path):
    with published(tmp_path / "published") as running:
        yield running


@pytest.fixture
def get(tmp_path, monkeypatch):
    """Fetch the data set `made-up` of a list."""
    monkeypatch.setenv("NEARLIFT_CACHE", str(tmp_path / "cache"))

    def command(own, *more, to="raw"):
        return nearlift("data", "get", "made-up", tmp_path / to, "--registry", own, *more)

    return command


def test_sweeps_become_a_campaign_that_runs(server, get, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml")
    answer = get(own, "--json")
    assert answer.exit_code == 0, answer.output
    content = json.loads(answer.stdout)
    assert (content["licence"], content["next"]) == ("CC0", f"nearlift run {tmp_path / 'raw'}")
    rows = pd.read_csv(tmp_path / "raw" / "trials.csv")
    assert rows["trial"].tolist() == ["r01-01", "r01-02", "r02-00", "r02-01"]
    assert rows["distance"].tolist() == [2, 2, 0.25, 0.25]
    assert rows["session"].tolist() == [1, 1, 2, 2]
    assert rows["start"].tolist() == [0, 0, 1200, 1200]
    assert nearlift("ingest", tmp_path / "raw", "--out", tmp_path).exit_code == 0
    source = (tmp_path / "raw" / "SOURCE.txt").read_text()
    assert all(hashlib.sha256(text.encode()).hexdigest() in source for text in SWEEPS.values())
    assert sorted(server.asked) == sorted(SWEEPS)
    assert "Cite: none." in source
    assert "Licence: CC0." in source
    assert all("http://127.0.0.1" in line for line in source.splitlines() if "sha256" in line)


def test_the_cache_is_not_fetched_again_unless_it_is_damaged(server, get, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml")
    first, second = SWEEPS
    (server.folder / second).unlink()
    answer = get(own)
    assert (answer.exit_code, "the server says 404" in answer.stderr) == (4, True)
    assert not (tmp_path / "raw").exists()
    (server.folder / second).write_text(SWEEPS[second])
    assert get(own).exit_code == 0
    assert server.asked == [first, second, second]
    (tmp_path / "cache" / "made-up" / first).write_text("0.5,9,12,2\n")
    assert get(own, to="again").exit_code == 0
    assert pd.read_csv(tmp_path / "again" / "trials.csv")["lift"][0] == 0.5
    assert server.asked[3:] == [first]


def test_offline_says_where_to_put_the_file_by_hand(server, get, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml")
    server.stop()
    answer = get(own)
    assert answer.exit_code == 4
    assert "cannot be fetched (ConnectionError)" in answer.stderr
    where = tmp_path / "cache" / "made-up"
    assert str(where / next(iter(SWEEPS))) in answer.stderr
    where.mkdir(parents=True, exist_ok=True)
    for name, text in SWEEPS.items():
        (where / name).write_text(text)
    assert get(own).exit_code == 0


def test_a_wrong_digest_leaves_nothing_behind(server, get, tmp_path):
    own = listed(server, SWEEPS, tmp_path / "list.toml", digest="0" * 64)
    answer = get(own)
    assert (answer.exit_code, "is not the file that is known here" in answer.stderr) == (4, True)
    assert [p for p in (tmp_path / "cache").rglob("*") if p.is_file()] == []
    assert not (tmp_path / "raw").exists()


def test_nothing_is_overwritten_and_a_broken_file_leaves_no_campaign(server, get, tmp_path):
    broken = {next(iter(SWEEPS)): "0.5,0.5,12\n"}
    own = listed(server, broken, tmp_path / "list.toml")
    answer = get(own)
    assert (answer.exit_code, "is not the published table" in answer.stderr) == (4, True)
    assert not (tmp_path / "raw").exists()
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "mine.txt").write_text("mine")
    assert get(own).exit_code == 2
    assert [p.name for p in (tmp_path / "raw").iterdir()] == ["mine.txt"]
