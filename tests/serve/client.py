"""A served workspace in a process of its own, and a client of it."""

from __future__ import annotations

import contextlib
import http.client
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from email.message import Message
from pathlib import Path

PATIENCE_S = 120.0
#: Ctrl-C works in a child of a shell's background job too, which ignores it.
START = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
    " sys.argv[0] = 'nearlift'; from nearlift.cli import main; main()"
)


@dataclass
class Client:
    """One client; `link` is the printed one."""

    process: subprocess.Popen[str]
    link: str
    cookie: str = ""

    @property
    def host(self) -> str:
        return self.link.split("/")[2]

    @property
    def port(self) -> int:
        return int(self.host.split(":")[1])

    def ask(self, path: str, method: str = "GET", **headers: str) -> tuple[int, Message, str]:
        """Status, headers and text; a header given as empty is left out."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        given = {"Host": self.host, "Cookie": self.cookie, **named}
        with contextlib.closing(connection):
            connection.request(method, path, headers={k: v for k, v in given.items() if v})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read().decode("utf-8", "replace")

    def enter(self) -> None:
        """Exchange the token."""
        status, headers, _ = self.ask(self.link.removeprefix(f"http://{self.host}"))
        assert status == 200
        self.cookie = headers["Set-Cookie"].split(";")[0]


@contextlib.contextmanager
def served(root: Path, port: int = 0) -> Iterator[Client]:
    """A workspace, until the block ends; then Ctrl-C."""
    command = [sys.executable, "-P", "-c", START, "serve", str(root), "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        first = process.stdout.readline()
        process.stdout.readline()
        yield Client(process, re.search(r"http://\S+", first)[0])
    finally:
        process.send_signal(signal.SIGINT)
        with process.stdout:
            assert process.wait(PATIENCE_S) == 0
