"""Pages by address, and what no address reaches."""

from __future__ import annotations

import re
import shutil

import pytest
from tests.unit.small_run import state

from nearlift.serve.pages import respond, responder, spoken

from .conftest import REPORT


def shown(root, path, **query):
    return respond(root, path, query)


def test_the_list_has_verdict_and_quoted_number_of_each_campaign(workspace):
    text = shown(workspace, "/").body.decode()
    assert re.findall(r'href="(/(?!static)[^"]+)"', text) == [
        "/campaign/small",
        "/reports/small/index.html",
    ]
    assert re.search(r"<i>K</i><sub>b</sub> = [12]\.\d+ ± 0\.\d+", text)
    assert re.search(r'class="card (good|fair|bad)"', text)
    assert 'class="verdict"' in text


def test_an_empty_workspace_says_what_to_run(tmp_path):
    assert "No campaign was run here yet" in responder(tmp_path)("/", {}).body.decode()


def test_a_damaged_product_is_named_in_the_list_and_on_its_page(workspace, tmp_path):
    shutil.copytree(workspace / "processed" / "small", tmp_path / "processed" / "small")
    (tmp_path / "processed" / "small" / "results.json").write_text("{")
    for path in ("/", "/campaign/small"):
        answer = shown(tmp_path, path)
        assert answer.status == 200
        assert "results.json: is damaged" in answer.body.decode()
    (tmp_path / "processed" / "small" / "trials.parquet").write_bytes(b"PAR1")
    assert shown(tmp_path, "/campaign/small").status == 409


@pytest.mark.parametrize(
    "path",
    [
        "/reports/../secret.txt",
        "/reports/../../secret.txt",
        "/reports/small/../../../secret.txt",
        "/reports/small/leak.txt",
        "/reports//etc/passwd",
        "/processed/out/results.json",
        "/campaign/out",
        "/campaign/..",
        "/campaign/../small",
        "/campaign/small/",
        "/reports/small/index.html\0.png",
        "/raw/small/campaign.toml",
        "/reports/small",
        "/static/../pages.py",
        "/static/frame.html.j2",
        "/other",
    ],
)
def test_nothing_else_is_read(client, workspace, path):
    assert shown(workspace, path).status == 404
    # as a client may write it
    sent = path.replace("\0", "%00")
    for address in (sent, sent.replace("..", "%2e%2e"), sent.replace("/..", "%2f..")):
        status, _, text = client.ask(address)
        assert status == 404
        assert "secret\n" not in text
        assert "root:" not in text


def test_a_report_runs_no_script_but_nearlift_s_own(workspace):
    answer = shown(workspace, "/reports/small/index.html")
    assert answer.body.decode() == REPORT
    rules = answer.headers["Content-Security-Policy"]
    assert re.search("script-src 'sha256-", rules)
    assert "script-src 'unsafe-inline'" not in rules
    assert "connect-src" not in rules


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/processed/small/results.json", "application/json"),
        ("/processed/small/trials.parquet", "application/octet-stream"),
        ("/reports/small/fig2.csv", "text/plain; charset=utf-8"),
        ("/reports/small/fig2.png", "image/png"),
    ],
)
def test_a_product_is_served_as_it_is(workspace, path, kind):
    answer = shown(workspace, path)
    assert (answer.body, answer.kind) == ((workspace / path[1:]).read_bytes(), kind)
    assert answer.headers["Content-Security-Policy"].startswith("default-src 'none'")


def test_looking_writes_nothing(client, workspace):
    before = state(workspace)
    for path in ("/", "/campaign/small", "/processed/small/results.json", "/campaign/none"):
        client.ask(path)
    assert state(workspace) == before


def test_names_are_words_and_letters_have_their_index():
    assert spoken("supply_sag; K_b <at z_hat>") == "supply sag; <i>K</i><sub>b</sub> &lt;at ẑ&gt;"
