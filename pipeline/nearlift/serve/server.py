"""HTTP server of the page: one machine, one browser, GET alone.

Every request is checked before it is answered. Its `Host` is this very address, so no other name
resolves here. `Origin` and `Sec-Fetch-Site` are this page's own. It carries the cookie that the
printed link was exchanged for, once. Cookies ignore ports: another server on this machine that the
same browser visits receives the cookie, and is trusted like all programs of this user.

One connection carries one request and is then closed. A request that does not arrive in `REQUEST_S`
is dropped.
"""

from __future__ import annotations

import hmac
import secrets
import socket
import socketserver
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler
from typing import Any
from urllib.parse import parse_qsl, unquote

from nearlift.errors import UsageError

#: Seconds for a request to arrive, and for a browser to take the answer.
REQUEST_S, ANSWER_S = 5.0, 60.0
#: Connections at a time, and fields of a query.
MOST_CONNECTIONS, MOST_FIELDS = 256, 20
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
    """HttpAnswer to a request; `headers` replace those of `HEADERS`."""

    body: bytes = b""
    kind: str = HTML
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)


def plain(status: int, text: str, **headers: str) -> HttpAnswer:
    """One line of text."""
    return HttpAnswer(body=f"{text}\n".encode(), kind=TEXT, status=status, headers=headers)


#: HttpAnswer to a path and the fields of its query.
Respond = Callable[[str, dict[str, str]], HttpAnswer]


class Server(socketserver.ThreadingTCPServer):
    """Server on 127.0.0.1.

    Raises
    ------
    UsageError
        The port is taken.
    """

    allow_reuse_address = daemon_threads = True
    request_queue_size = MOST_CONNECTIONS

    def __init__(self, port: int, respond: Respond) -> None:
        try:
            super().__init__(("127.0.0.1", port), Handler)
        except OSError as fault:
            raise UsageError(
                f"--port {port}", f"is not free: {fault.strerror}", "leave --port out: any free one"
            ) from None
        self.respond = respond
        self.host = f"127.0.0.1:{self.server_address[1]}"
        self.token, self.secret = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self.cookie = f"nearlift-{self.server_address[1]}={self.secret}"
        #: Open connections, and when each must have sent its request.
        self._deadlines: dict[Any, float] = {}

    @property
    def link(self) -> str:
        """Address to open, good for one browser."""
        return f"http://{self.host}{DOOR}?token={self.token}"

    def process_request(self, request: Any, client_address: Any) -> None:
        """HttpAnswer in a thread, or close where too many connections are open."""
        if len(self._deadlines) >= MOST_CONNECTIONS:
            self.shutdown_request(request)
            return
        self._deadlines[request] = time.monotonic() + REQUEST_S
        super().process_request(request, client_address)

    def arrived(self, request: Any) -> None:
        """Note that a request was read; sending the answer has its own limit."""
        self._deadlines[request] = float("inf")

    def shutdown_request(self, request: Any) -> None:
        """Close a connection."""
        self._deadlines.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """Cut off requests that did not arrive in time; called twice a second."""
        now = time.monotonic()
        for request, deadline in list(self._deadlines.items()):
            if deadline < now:
                with suppress(OSError):
                    request.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a browser that has gone."""


class Handler(BaseHTTPRequestHandler):
    """One request."""

    server: Server
    timeout = ANSWER_S

    def do_GET(self) -> None:
        """Check the request and answer it."""
        self.server.arrived(self.request)
        target, _, query = self.path.partition("?")
        try:
            path = unquote(target, errors="strict")
            fields = dict(parse_qsl(query, keep_blank_values=True, max_num_fields=MOST_FIELDS))
        except ValueError:
            self._send(plain(400, "this address cannot be read"))
            return
        known = self._known()
        if refusal := self._refusal():
            self._send(plain(403, refusal))
        elif path == DOOR:
            self._send(self._opened(fields.get("token", ""), known))
        elif self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            self._send(plain(403, "another site"))
        elif not known:
            self._send(plain(403, "open the link that nearlift serve printed"))
        else:
            try:
                answer = self.server.respond(path, fields)
            except Exception as fault:
                answer = plain(500, f"this page failed: {type(fault).__name__}: {fault}")
            self._send(answer)

    def _refusal(self) -> str:
        """Reason to refuse, or an empty text."""
        if self.headers.get_all("Host") != [self.server.host]:
            return "another host"
        address = f"http://{self.server.host}"
        return "" if self.headers.get("Origin", address) == address else "another origin"

    def _known(self) -> bool:
        """Whether the browser has the cookie."""
        cookie = self.server.cookie.encode()
        given = ";".join(self.headers.get_all("Cookie", [])).encode("utf-8", "replace")
        return any(hmac.compare_digest(part.strip(), cookie) for part in given.split(b";"))

    def _opened(self, token: str, known: bool) -> HttpAnswer:
        """Exchange the token for the cookie. The page follows by a refresh: a browser that came
        from another site would not send a strict cookie along a redirection.
        """
        secret = self.server.token
        fits = bool(secret) and hmac.compare_digest(
            token.encode("utf-8", "replace"), secret.encode()
        )
        if fits:
            self.server.token = ""
            cookie = {"Set-Cookie": f"{self.server.cookie}; Path=/; HttpOnly; SameSite=Strict"}
        elif known:
            cookie = {}
        else:
            return plain(403, "this link was used already: start nearlift serve again")
        return plain(200, "nearlift", Refresh="0; url=/", **cookie)

    def _send(self, answer: HttpAnswer) -> None:
        self.send_response_only(answer.status)
        sizes = {"Content-Type": answer.kind, "Content-Length": str(len(answer.body))}
        for name, value in {**HEADERS, **sizes, **answer.headers}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(answer.body)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """HttpAnswer a request that is no GET or cannot be parsed."""
        self._send(plain(code, message or "this request cannot be answered"))

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""
