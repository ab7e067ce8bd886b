"""Pages by address, the page of a campaign that is being recorded, and what no address reaches."""

from __future__ import annotations

import json
import os
import re
import shutil

import pandas as pd
import pytest
from tests.unit.small_run import state

from nearlift.rounding import plus_minus
from nearlift.serve import pages
from nearlift.serve.pages import respond, spoken

from .conftest import REPORT


@pytest.fixture
def copy(workspace, tmp_path):
    for folder in ("processed", "reports"):
        shutil.copytree(workspace / folder / "small", tmp_path / folder / "small", symlinks=True)
    return tmp_path


def text_of(root, path):
    return respond(root, path, {}).body.decode()


def test_the_list_has_verdict_and_quoted_number_of_each_campaign(workspace, tmp_path):
    text = text_of(workspace, "/")
    links = re.findall(r'href="(/(?!static)[^"]+)"', text)
    assert links == ["/campaign/small", "/reports/small/index.html"]
    assert re.search(r"<i>K</i><sub>b</sub> = [12]\.\d+ ± 0\.\d+", text)
    assert re.search(r'class="card (good|fair|bad)"', text)
    assert 'class="verdict"' in text
    assert "No campaign was run here yet" in text_of(tmp_path, "/")


def test_a_damaged_product_is_named_in_the_list_and_on_its_page(copy):
    (copy / "processed" / "small" / "results.json").write_text("{")
    for path in ("/", "/campaign/small"):
        assert "results.json: is damaged" in text_of(copy, path)
    (copy / "processed" / "small" / "trials.parquet").write_bytes(b"PAR1")
    assert respond(copy, "/campaign/small", {}).status == 409


def test_a_campaign_shows_its_newest_trials_and_what_is_to_be_checked(workspace):
    text = text_of(workspace, "/campaign/small")
    trials = pd.read_parquet(workspace / "processed/small/trials.parquet")
    landed = trials[trials["n"] > 0]
    assert "84 of 112 trials have landed" in text
    rows = re.findall(r'<tr><th scope="row">(.*?)</th>(.*)</tr>', text)
    assert [trial for trial, _ in rows] == landed["trial"].tolist()[::-1][: pages.NEWEST]
    last = landed.iloc[-1]
    assert f"<td>{plus_minus(1e3 * last.lift_N, 1e3 * last.u_lift_N)}</td>" in rows[0][1]
    assert "TARE: the force changes within the tare" in text


def test_cards_quote_results_json_and_say_what_the_interim_analysis_needs(workspace):
    content = json.loads((workspace / "processed/small/results.json").read_text())
    result = content["boundaries"]["ground"]
    k = result["coefficients"]["K_b"]
    text = text_of(workspace, "/campaign/small")
    assert f"= {plus_minus(k['value'], k['u'])} (90 %: " in text
    assert f'class="card {pages.TONES[result["verdict"]]}"' in text
    assert "of 112 trials; claims need p &lt;" in text


def test_the_next_visits_and_a_refusal_are_those_of_the_last_round(copy):
    file = copy / "processed/small/watch.json"
    latest = json.loads(file.read_text())
    assert latest["next"][0] in text_of(copy, "/campaign/small")
    file.write_text(json.dumps(latest | {"refused": "start has no unit"}))
    assert "start has no unit" in text_of(copy, "/campaign/small")
    # a later run without --watch knows of no next visits
    os.utime(file, ns=(0, 0))
    assert "Next visits" not in text_of(copy, "/campaign/small")


def test_a_state_that_was_seen_is_not_sent_again(copy):
    seen = pages.stamp(copy / "processed/small", copy / "reports/small")
    assert f'data-stamp="{seen}"' in text_of(copy, "/campaign/small")
    assert respond(copy, "/campaign/small", {"seen": seen}).status == 204
    (copy / "reports/small/fig2.png").write_bytes(b"another")
    assert respond(copy, "/campaign/small", {"seen": seen}).status == 200


def test_before_the_first_fit_nothing_is_claimed(copy):
    for folder, name in (("processed", "results.json"), ("reports", "fig2.png")):
        (copy / folder / "small" / name).unlink()
    text = text_of(copy, "/campaign/small")
    assert "Not fitted yet" in text
    assert "fig2.png" not in text
    assert "residuals.png" in text


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
        "/static/page.html.j2",
        "/other",
    ],
)
def test_nothing_else_is_read(client, workspace, path):
    assert respond(workspace, path, {}).status == 404
    # as a client may write it
    sent = path.replace("\0", "%00")
    for address in (sent, sent.replace("..", "%2e%2e"), sent.replace("/..", "%2f..")):
        status, _, text = client.ask(address)
        assert status == 404
        assert "secret\n" not in text
        assert "root:" not in text


def test_a_report_runs_no_script_but_nearlift_s_own(workspace):
    answer = respond(workspace, "/reports/small/index.html", {})
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
    answer = respond(workspace, path, {})
    assert (answer.body, answer.kind) == ((workspace / path[1:]).read_bytes(), kind)
    assert answer.headers["Content-Security-Policy"].startswith("default-src 'none'")


def test_looking_writes_nothing(client, workspace):
    before = state(workspace)
    for path in ("/", "/campaign/small", "/processed/small/results.json", "/campaign/none"):
        client.ask(path)
    assert state(workspace) == before


def test_names_are_words_and_letters_have_their_index():
    assert spoken("supply_sag; K_b <at z_hat>") == "supply sag; <i>K</i><sub>b</sub> &lt;at ẑ&gt;"
