"""HTTP server of the page: one machine, one browser, GET alone.

Every request is checked before it is answered. Its `Host` is this very address, so no other name
resolves here. `Origin` and `Sec-Fetch-Site` are this page's own. It carries the cookie that the
printed link was exchanged for, once. Cookies ignore ports: another server on this machine that the
same browser visits receives the cookie, and is trusted like all programs of this user.

One connection carries one request, in a thread of its own, and is then closed. A request that stops
arriving for `REQUEST_S` is dropped.
"""

from __future__ import annotations

import hmac
import secrets
import socketserver
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler
from typing import Any
from urllib.parse import parse_qsl, unquote

from nearlift.errors import UsageError

#: Seconds for the next bytes of a request, and for a browser to take the answer.
REQUEST_S, ANSWER_S = 5.0, 60.0
#: Fields of a query.
MOST_FIELDS = 20
HTML, TEXT = "text/html; charset=utf-8", "text/plain; charset=utf-8"
#: Path of the printed link.
DOOR = "/open"
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:;"
        " connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class HttpAnswer:
    """Answer to a request; `headers` replace those of `HEADERS`."""

    body: bytes = b""
    kind: str = HTML
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)


def plain(status: int, text: str, **headers: str) -> HttpAnswer:
    """One line of text."""
    return HttpAnswer(body=f"{text}\n".encode(), kind=TEXT, status=status, headers=headers)


#: Answer to a path and the fields of its query.
Respond = Callable[[str, dict[str, str]], HttpAnswer]


class Server(socketserver.ThreadingTCPServer):
    """Server on 127.0.0.1.

    Raises
    ------
    UsageError
        The port is taken.
    """

    allow_reuse_address = daemon_threads = True
    request_queue_size = 256

    def __init__(self, port: int, respond: Respond) -> None:
        try:
            super().__init__(("127.0.0.1", port), Handler)
        except OSError as fault:
            what, remedy = f"is not free: {fault.strerror}", "leave --port out: any free one"
            raise UsageError(f"--port {port}", what, remedy) from None
        self.respond = respond
        self.host = f"127.0.0.1:{self.server_address[1]}"
        self.token, secret = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self.cookie = f"nearlift-{self.server_address[1]}={secret}"

    @property
    def link(self) -> str:
        """Address to open, good for one browser."""
        return f"http://{self.host}{DOOR}?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a browser that has gone."""


class Handler(BaseHTTPRequestHandler):
    """One request."""

    server: Server
    timeout = REQUEST_S

    def do_GET(self) -> None:
        """Check the request and answer it."""
        target, _, query = self.path.partition("?")
        try:
            path = unquote(target, errors="strict")
            fields = dict(parse_qsl(query, keep_blank_values=True, max_num_fields=MOST_FIELDS))
        except ValueError:
            return self._send(plain(400, "this address cannot be read"))
        origin = f"http://{self.server.host}"
        if self.headers.get_all("Host") != [self.server.host]:
            return self._send(plain(403, "another host"))
        if self.headers.get("Origin", origin) != origin:
            return self._send(plain(403, "another origin"))
        cookies = ";".join(self.headers.get_all("Cookie", [])).split(";")
        known = any(_equal(part.strip(), self.server.cookie) for part in cookies)
        if path == DOOR:
            return self._send(self._opened(fields.get("token", ""), known))
        if self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return self._send(plain(403, "another site"))
        if not known:
            return self._send(plain(403, "open the link that nearlift serve printed"))
        try:
            answer = self.server.respond(path, fields)
        except Exception as fault:
            answer = plain(500, f"this page failed: {type(fault).__name__}: {fault}")
        return self._send(answer)

    def _opened(self, token: str, known: bool) -> HttpAnswer:
        """Exchange the token for the cookie. The page follows by a refresh: a browser that came
        from another site would not send a strict cookie along a redirection.
        """
        cookie = {}
        if self.server.token and _equal(token, self.server.token):
            self.server.token = ""
            cookie = {"Set-Cookie": f"{self.server.cookie}; Path=/; HttpOnly; SameSite=Strict"}
        elif not known:
            return plain(403, "this link was used already: start nearlift serve again")
        return plain(200, "nearlift", Refresh="0; url=/", **cookie)

    def _send(self, answer: HttpAnswer) -> None:
        self.connection.settimeout(ANSWER_S)
        self.send_response_only(answer.status)
        sizes = {"Content-Type": answer.kind, "Content-Length": str(len(answer.body))}
        for name, value in {**HEADERS, **sizes, **answer.headers}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(answer.body)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer a request that is no GET or cannot be parsed."""
        self._send(plain(code, message or "this request cannot be answered"))

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""


def _equal(given: str, secret: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), secret.encode())
