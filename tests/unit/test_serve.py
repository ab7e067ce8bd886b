"""`nearlift serve`: who is let in, what can be reached, and that nothing is left half."""

from __future__ import annotations

import concurrent.futures
import contextlib
import http.client
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from nearlift.commands import serve as command

from .small_run import nearlift, state

pytest.importorskip("starlette", reason="nearlift[serve] is not installed")
pytest.importorskip("uvicorn", reason="nearlift[serve] is not installed")
PATIENCE_S = 120.0
START = "import sys; sys.argv[0] = 'nearlift'; from nearlift.console import main; main()"
MANIFEST = 'schema = "nearlift.campaign/1"\nname = "rig"\n'


class Client:
    """One client of a served workspace."""

    def __init__(self, root: Path, process: subprocess.Popen[str], link: str) -> None:
        self.root, self.process, self.link = root, process, link
        self.port = int(re.search(r":(\d+)/", link)[1])
        self.host = f"127.0.0.1:{self.port}"
        self.cookie = ""

    def ask(self, method: str, path: str, body: object = None, **headers: str):
        """Status, headers, text."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        own = {"Host": self.host, "Cookie": self.cookie}
        if method != "GET":
            own["Origin"] = f"http://{self.host}"
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        told = {k: v for k, v in {**own, **given}.items() if v}
        try:
            connection.request(method, path, body, told)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read().decode("utf-8", "replace")
        finally:
            connection.close()

    def enter(self) -> None:
        """Exchange the token."""
        status, headers, _ = self.ask("GET", self.link.removeprefix(f"http://{self.host}"))
        assert status == 200
        self.cookie = headers["Set-Cookie"].split(";")[0]


@contextlib.contextmanager
def served(root: Path) -> Iterator[Client]:
    """A workspace in a process of its own."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", START, "serve", str(root)], stdout=subprocess.PIPE, text=True
    )
    try:
        link = re.search(r"http://\S+", process.stdout.readline())[0]
        process.stdout.readline()
        yield Client(root, process, link)
    finally:
        process.send_signal(signal.SIGINT)
        with process.stdout:
            process.wait(PATIENCE_S)


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    base = tmp_path_factory.mktemp("serve")
    root = base / "work"
    (root / "raw" / "rig").mkdir(parents=True)
    (root / "raw" / "rig" / "campaign.toml").write_text(MANIFEST)
    (root / "reports" / "rig").mkdir(parents=True)
    (root / "reports" / "rig" / "index.html").write_text("<script>stolen = 1</script>report")
    (base / "secret.txt").write_text("secret")
    (root / "reports" / "rig" / "leak.txt").symlink_to(base / "secret.txt")
    (root / "raw" / "out").symlink_to(base)
    (base / "campaign.toml").write_text(MANIFEST)
    with served(root) as opened:
        opened.enter()
        yield opened


def test_the_page_lists_the_workspace(client):
    status, headers, text = client.ask("GET", "/")
    assert status == 200
    assert "raw/rig" in text
    assert "raw/out" not in text
    rules = headers["Content-Security-Policy"]
    assert "default-src 'none'" in rules
    assert "unsafe-inline" not in rules
    for name in ("Set-Cookie", "Access-Control-Allow-Origin", "Server"):
        assert name not in headers
    assert headers["X-Content-Type-Options"] == "nosniff"


def test_no_icon_is_missed(client):
    """A browser asks for one where the link leads to, and logs that there is none."""
    assert client.ask("GET", "/favicon.ico")[0] == 204


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "localhost"},
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
        {"Cookie": ""},
        {"Cookie": "nearlift=x"},
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_others_are_refused(client, method, headers):
    where = "/" if method == "GET" else "/begin"
    given = {"Cookie": client.cookie, **headers}
    before = state(client.root)
    if "Cookie" in headers:
        given["Cookie"] = headers["Cookie"] and f"nearlift-{client.port}=x"
    assert client.ask(method, where, b"do=run&campaign=raw/rig", **given)[0] == 403
    assert state(client.root) == before


def test_a_post_without_an_origin_is_refused(client):
    assert client.ask("POST", "/begin", b"do=run&campaign=raw/rig", Origin="")[0] == 403


def test_the_link_is_good_once(client):
    stranger = Client(client.root, client.process, client.link)
    path = client.link.removeprefix(f"http://{client.host}")
    status, headers, _ = stranger.ask("GET", path)
    assert status == 403
    assert "Set-Cookie" not in headers
    for token in ("", "x", "%ff", "\xe9"):
        with contextlib.suppress(UnicodeEncodeError):
            assert stranger.ask("GET", f"/open?token={token}")[0] == 403
    status, headers, _ = client.ask("GET", path)
    assert (status, "Set-Cookie" in headers) == (200, False)


def test_the_cookie_is_for_this_page_alone(tmp_path):
    with served(tmp_path) as own:
        _, headers, _ = own.ask("GET", own.link.removeprefix(f"http://{own.host}"))
        told = headers["Set-Cookie"]
        assert "HttpOnly" in told
        assert "SameSite=Strict" in told
        assert own.link.split("=")[1] not in told


@pytest.mark.parametrize(
    "path",
    [
        "/file/../secret.txt",
        "/file/reports/../../secret.txt",
        "/file/reports/%2e%2e/%2e%2e/secret.txt",
        "/file/reports/rig/leak.txt",
        "/file//etc/passwd",
        "/file/reports/rig/index.html%00.png",
        "/file/raw/rig/campaign.toml",
        "/file/reports/rig",
        "/report?campaign=raw/out",
        "/report?campaign=../",
        "/report?campaign=/etc",
        "/report?campaign=raw/rig%00",
        "/static/../app.py",
        "/static/..%2fapp.py",
    ],
)
def test_nothing_outside_the_workspace_is_read(client, path):
    status, _, text = client.ask("GET", path)
    assert status in (404, 409)
    assert "secret\n" not in text
    assert "root:" not in text


def test_a_report_runs_no_script_but_its_own(client):
    status, headers, text = client.ask("GET", "/file/reports/rig/index.html")
    assert (status, "report" in text) == (200, True)
    rules = headers["Content-Security-Policy"]
    assert re.search("script-src 'sha256-", rules)
    assert "script-src 'unsafe-inline'" not in rules
    assert "connect-src" not in rules


def test_what_is_no_command_of_the_page_is_not_run(client):
    for body in (
        b"do=undo&campaign=raw/rig",
        b"do=run&campaign=--help",
        b"do=run&campaign=raw/out",
        b"do=&campaign=raw/rig",
        b"x" * (3 << 20),
        b"x=1&" * 200,
    ):
        assert client.ask("POST", "/begin", body)[0] in (404, 409, 413)


def test_a_hundred_clients_are_answered_or_told_to_come_again(client):
    def one(_):
        try:
            return client.ask("GET", "/static/bench.js")[0]
        except ConnectionError:
            return 503

    with concurrent.futures.ThreadPoolExecutor(100) as pool:
        told = list(pool.map(one, range(100)))
    assert set(told) <= {200, 503}
    assert 200 in told
    assert client.ask("GET", "/")[0] == 200


def test_a_command_tells_what_it_says_and_how_it_ends(client):
    _, headers, _ = client.ask("POST", "/begin", b"do=verify&campaign=raw/rig")
    status, _, text = client.ask("GET", headers["Location"])
    assert status == 200
    assert "nearlift run --check raw/rig" in text
    key = headers["Location"].split("=")[1]
    _, headers, events = client.ask("GET", f"/events/work?key={key}")
    assert headers["Content-Type"].startswith("text/event-stream")
    assert "event: lines" in events
    assert re.search(r'event: ended\ndata: {"code": [24]', events)


def test_what_is_planted_in_the_workspace_is_not_run(tmp_path):
    mark = tmp_path / "mark"
    root = tmp_path / "work"
    root.mkdir()
    for name in ("numpy", "click", "nearlift", "sitecustomize"):
        (root / f"{name}.py").write_text(f"open({str(mark)!r}, 'w')")
    (root / "campaign.toml").write_text(MANIFEST)
    with served(root) as own:
        own.enter()
        _, headers, _ = own.ask("POST", "/begin", b"do=verify&campaign=.")
        own.ask("GET", f"/events/work?key={headers['Location'].split('=')[1]}")
    assert not mark.exists()


def test_a_cancelled_command_ends(tmp_path):
    from . import small_run

    small_run.write(tmp_path / "raw" / "small", visits=2)
    with served(tmp_path) as own:
        own.enter()
        _, headers, _ = own.ask("POST", "/begin", b"do=run&campaign=raw/small")
        key = headers["Location"].split("=")[1]
        deadline = time.monotonic() + PATIENCE_S
        while not (tmp_path / "processed").exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        assert own.ask("POST", "/cancel", f"key={key}".encode())[0] == 303
        _, _, events = own.ask("GET", f"/events/work?key={key}")
        assert '"code": 130' in events


def test_without_the_extra_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(command, "PACKAGES", ("no_such_package",))
    told = nearlift("serve", tmp_path)
    assert told.exit_code == 2
    assert 'pip install "nearlift[serve]"' in told.output


def test_a_workspace_that_is_no_folder_is_refused(tmp_path):
    told = nearlift("serve", tmp_path / "lift")
    assert told.exit_code == 2
    assert f"{tmp_path / 'lift'}: is no folder" in told.output


def test_a_port_that_is_taken_is_refused(client, tmp_path):
    told = nearlift("serve", tmp_path, "--port", client.port)
    assert told.exit_code == 2
    assert f"--port {client.port}: cannot be had" in told.output


def test_it_listens_on_this_machine_alone(client):
    if not Path("/proc/net/tcp").exists():
        pytest.skip("no /proc")
    port = f":{client.port:04X}"
    own = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    assert {a for a in own if a.endswith(port)} >= {f"0100007F{port}"}
    assert f"00000000{port}" not in own
    assert os.getpid() != client.process.pid
