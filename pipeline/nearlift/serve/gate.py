"""Who may ask the page for anything: a browser of this machine that came by the printed link, and
no other page that it has open.

Every request is judged before a byte of its body is read: its `Host` is this very address (no name
that somebody made resolve to it), its `Origin` and `Sec-Fetch-Site` are this page's own, and it
carries the cookie for which the link's token was exchanged, once. Cookies know no ports: another
server on this machine that the same browser visits sees the cookie, and is trusted with it as all
programs of this user are.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterable
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

#: What the page's own documents may do: nothing within the text, nothing from elsewhere.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src"
    " 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS = {
    b"content-security-policy": POLICY.encode(),
    b"x-content-type-options": b"nosniff",
    # with "no-referrer" a browser sends the forms of its own page as from Origin: null
    b"referrer-policy": b"same-origin",
    b"cache-control": b"no-store",
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
}
#: Where the link leads to.
DOOR = "/open"


class Gate:
    """The application behind its checks."""

    def __init__(self, app: ASGIApp, port: int) -> None:
        self.app, self.host = app, f"127.0.0.1:{port}"
        self.token, self._secret = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        self._cookie = f"nearlift-{port}"

    @property
    def link(self) -> str:
        """What is printed, good for one browser."""
        return f"http://{self.host}{DOOR}?token={self.token}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] != "http":
            return
        headers: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.lower(), []).append(value)
        address = f"http://{self.host}".encode()
        origin = headers.get(b"origin")
        knows = self._knows(headers.get(b"cookie", ()))
        if headers.get(b"host") != [self.host.encode()]:
            await _answer(send, 403, "another host")
        elif origin not in (None, [address]) or (
            origin is None and scope["method"] not in ("GET", "HEAD")
        ):
            await _answer(send, 403, "another origin")
        elif scope["path"] == DOOR and scope["method"] == "GET":
            await self._open(scope, send, knows)
        elif headers.get(b"sec-fetch-site", [b"none"]) not in ([b"none"], [b"same-origin"]):
            await _answer(send, 403, "another site")
        elif not knows:
            await _answer(send, 403, "open the link that nearlift serve printed")
        else:
            await self.app(scope, receive, _guarded(send))

    def _knows(self, cookies: Iterable[bytes]) -> bool:
        """Whether the cookie is among them."""
        pairs = (part.strip().partition(b"=") for line in cookies for part in line.split(b";"))
        return any(
            name == self._cookie.encode() and hmac.compare_digest(value, self._secret.encode())
            for name, _, value in pairs
        )

    async def _open(self, scope: Scope, send: Send, knows: bool) -> None:
        """The cookie for the token; the page follows by a step of its own, since a browser that
        came from elsewhere would not bring a strict cookie along a redirection.
        """
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        fits = bool(self.token) and hmac.compare_digest(given.encode(), self.token.encode())
        if not (fits or knows):
            await _answer(send, 403, "this link was used, or is another's: run nearlift serve anew")
            return
        headers = [(b"refresh", b"0; url=/")]
        if fits:
            self.token = ""
            cookie = f"{self._cookie}={self._secret}; Path=/; HttpOnly; SameSite=Strict"
            headers.append((b"set-cookie", cookie.encode()))
        await _answer(send, 200, "nearlift", headers)


async def _answer(
    send: Send, status: int, text: str, headers: Iterable[tuple[bytes, bytes]] = ()
) -> None:
    all_headers = [(b"content-type", b"text/plain; charset=utf-8"), *headers]
    await _guarded(send)({"type": "http.response.start", "status": status, "headers": all_headers})
    await send({"type": "http.response.body", "body": f"{text}\n".encode()})


def _guarded(send: Send) -> Send:
    """Every answer with `HEADERS`, unless it has such a one of its own."""

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = {name.lower() for name, _ in message["headers"]}
            more = [pair for pair in HEADERS.items() if pair[0] not in given]
            message = {**message, "headers": [*message["headers"], *more]}
        await send(message)

    return guarded
