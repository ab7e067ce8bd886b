"""The list of public data sets."""

from __future__ import annotations

import json
import re

import pytest
from tests.unit.small_run import nearlift

from nearlift.datasets.registry import OWN, dataset, datasets
from nearlift.errors import UsageError


def test_every_file_is_pinned_to_a_commit_and_every_set_names_its_authors():
    for item in datasets().values():
        assert item.licence
        assert item.citation
        for file in item.file:
            # a URL without a commit may change under its digest
            assert re.match(r"https://raw\.githubusercontent\.com/.*/[0-9a-f]{40}/", file.url)


def test_list_shows_names_and_licences():
    answer = nearlift("data", "list")
    assert answer.exit_code == 0
    for words in ("pitt-ras-2017", "licence: MIT", "licence: none stated"):
        assert words in answer.stdout
    names = [d["name"] for d in json.loads(nearlift("data", "list", "--json").stdout)]
    assert names == [*datasets()]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('licence   = "GPL', 'license   = "GPL', "dataset.0.licence"),
        ('sha256 = "', 'sha256 = "x', "sha256 = 'x"),
        ('name   = "thrust', 'name   = "../thrust', "file.0.name = '../thrust"),
        ('name      = "pitt', 'name      = "../../esc', "dataset.0.name = '../../esc"),
        ('converter = "pitt_ras"', 'converter = "fetch"', "there is no such converter; there are"),
        ("[[dataset]]", "[[dataset", "is not valid TOML"),
    ],
)
def test_a_list_that_breaks_its_form_is_refused(tmp_path, old, new, message):
    changed = OWN.read_text(encoding="utf-8").replace(old, new, 1)
    (tmp_path / "list.toml").write_text(changed, encoding="utf-8")
    answer = nearlift("data", "list", "--registry", tmp_path / "list.toml")
    assert (answer.exit_code, message in answer.stderr) == (4, True), answer.stderr


def test_a_slip_in_the_name_is_met_with_the_nearest():
    with pytest.raises(UsageError, match="did you mean 'pitt-ras-2017'"):
        dataset("pitt-ras-2018")
    with pytest.raises(UsageError, match=r"there are pitt-ras-2017, "):
        dataset("qqq")
