"""Who is let in, what an answer carries, and that no request holds the server."""

from __future__ import annotations

import concurrent.futures
import http.client
import socket
import time
from pathlib import Path

import pytest
from tests.unit.small_run import nearlift

from nearlift.errors import UsageError
from nearlift.serve import server
from nearlift.serve.server import HEADERS, Server, plain

from .client import served


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "localhost:80"},
        {"Host": "attacker.example"},
        {"Origin": "http://attacker.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
        {"Cookie": ""},
        {"Cookie": "nearlift-1=x"},
    ],
)
@pytest.mark.parametrize("path", ["/", "/processed/small/results.json", "/static/page.css"])
def test_others_are_refused(client, headers, path):
    assert client.ask(path)[0] == 200
    status, _, text = client.ask(path, **headers)
    assert status == 403
    assert len(text) < 100


def test_the_link_is_good_once(client):
    path = client.link.removeprefix(f"http://{client.host}")
    status, headers, _ = client.ask(path, Cookie="")
    assert (status, "Set-Cookie" in headers) == (403, False)
    for token in ("", "x", "%ff", "%E9"):
        assert client.ask(f"/open?token={token}", Cookie="")[0] == 403
    # the browser that has the cookie may come back by it
    status, headers, _ = client.ask(path)
    assert (status, "Set-Cookie" in headers) == (200, False)


def test_the_cookie_is_strict_and_is_not_the_token(tmp_path):
    with served(tmp_path) as own:
        cookie = own.ask(own.link.removeprefix(f"http://{own.host}"))[1]["Set-Cookie"]
    assert cookie.endswith("; Path=/; HttpOnly; SameSite=Strict")
    assert own.link.split("=")[1] not in cookie


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD"])
def test_nothing_but_get_is_answered(client, method):
    status, headers, _ = client.ask("/", method)
    assert status == 501
    assert headers["X-Content-Type-Options"] == "nosniff"


def test_every_answer_carries_the_headers_and_names_no_server(client):
    for path in ("/", "/nothing", "/favicon.ico", "/processed/small/results.json"):
        _, headers, _ = client.ask(path)
        for name in HEADERS.keys() - {"Content-Security-Policy"}:
            assert headers[name] == HEADERS[name]
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert not {"Server", "Access-Control-Allow-Origin", "Set-Cookie"} & set(headers)


@pytest.mark.parametrize(
    "path",
    [
        "/%00",
        "/campaign/small?seen=%00",
        "/campaign/%00",
        "/campaign/" + 5000 * "a",
        "/processed/" + 5000 * "a",
        "/processed/" + 2500 * "a/",
        "/" + 5000 * "%41",
        "/?" + "&".join(f"f{i}=1" for i in range(200)),
        "/%ff%fe",
        "/" + 70_000 * "a",
    ],
)
def test_odd_addresses_are_no_fault_of_the_server(client, path):
    status, _, _ = client.ask(path)
    assert status == 200 if "seen" in path else 400 <= status < 500


def test_half_requests_are_dropped_and_hold_nobody_up(client):
    halves = [socket.create_connection(("127.0.0.1", client.port)) for _ in range(200)]
    begun = time.monotonic()
    for half in halves:
        half.sendall(b"GET / HTTP/1.1\r\nHost: ")
    assert client.ask("/")[0] == 200
    while halves:
        half = halves.pop()
        half.settimeout(4 * server.REQUEST_S)
        with half:
            assert b"200" not in half.recv(100)
    assert time.monotonic() - begun < 8 * server.REQUEST_S


def test_a_hundred_requests_at_a_time_are_answered(client):
    with concurrent.futures.ThreadPoolExecutor(100) as pool:
        found = list(pool.map(lambda _: client.ask("/static/page.css")[0], range(100)))
    assert set(found) == {200}


def test_a_port_is_free_again_once_the_page_has_ended(tmp_path):
    with served(tmp_path) as own:
        port = own.port
        # the server closes first, and its side of the connection lingers
        assert own.ask("/")[0] == 403
    with served(tmp_path, port) as own:
        assert own.port == port
        refused = nearlift("serve", tmp_path, "--port", port)
        assert refused.exit_code == 2
        assert f"--port {port}: is not free" in refused.output
        with pytest.raises(UsageError, match="is not free"):
            Server(port, lambda path, query: plain(200, path))


def test_a_workspace_that_is_no_folder_is_refused(tmp_path):
    refused = nearlift("serve", tmp_path / "lift")
    assert refused.exit_code == 2
    assert f"{tmp_path / 'lift'}: is no folder" in refused.output


def test_a_page_that_fails_says_so_and_the_server_goes_on(tmp_path):
    import threading

    def respond(path, query):
        return plain(200, "fine") if path == "/fine" else 1 / 0

    with Server(0, respond) as own:
        threading.Thread(target=own.serve_forever, kwargs={"poll_interval": 0.05}).start()
        for path, status in (("/", 500), ("/fine", 200)):
            line = http.client.HTTPConnection("127.0.0.1", own.server_address[1])
            line.request("GET", path, headers={"Host": own.host, "Cookie": own.cookie})
            assert line.getresponse().status == status
            line.close()
        own.shutdown()


def test_it_listens_on_this_machine_alone(client):
    if not Path("/proc/net/tcp").exists():
        pytest.skip("no /proc")
    port = f":{client.port:04X}"
    own = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    assert {a for a in own if a.endswith(port)} >= {f"0100007F{port}"}
    assert f"00000000{port}" not in own
