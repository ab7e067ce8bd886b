"""A headless Chromium at the other end of two pipes: DevTools' protocol, nothing else needed."""

from __future__ import annotations

import base64
import contextlib
import fcntl
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

CHROMIUM = next(
    (
        found
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (found := shutil.which(name))
    ),
    None,
)
#: Unprivileged, and offline: no name is ever resolved, and only this machine is reached.
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--remote-debugging-pipe",
)
PATIENCE_S = 120.0


class Navigated(Exception):
    """The page was left while it was asked."""


class Page:
    """One page: `errors` and `requests` list what it said and what it asked for since it was
    opened.
    """

    def __init__(self, read: int, write: int) -> None:
        self._read, self._write, self._rest, self._last, self._session = read, write, b"", 0, ""
        self.errors: list[str] = []
        self.requests: list[str] = []
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")

    def _receive(self, deadline: float) -> dict[str, Any]:
        while b"\0" not in self._rest:
            if not select.select([self._read], [], [], max(deadline - time.monotonic(), 0))[0]:
                raise TimeoutError("the browser does not answer")
            part = os.read(self._read, 1 << 20)
            if not part:
                raise EOFError("the browser has gone")
            self._rest += part
        told, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(told)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, method: str, params: dict[str, Any]) -> None:
        if method == "Runtime.exceptionThrown":
            self.errors.append(str(params["exceptionDetails"]))
        elif method == "Log.entryAdded":
            entry = params["entry"]
            self.errors.append(f"{entry['text']} {entry.get('url', '')}".rstrip())
        elif method == "Runtime.consoleAPICalled":
            self.errors.append(str([a.get("value") for a in params["args"]]))
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """One command and its answer."""
        self._last += 1
        own = self._last
        message = {"id": own, "method": method, "params": params} | (
            {"sessionId": self._session} if self._session else {}
        )
        os.write(self._write, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + PATIENCE_S
        while (answer := self._receive(deadline)).get("id") != own:
            pass
        if "navigated" in answer.get("error", {}).get("message", ""):
            raise Navigated(method)
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def run(self, script: str) -> Any:
        """What an expression comes to; a promise is waited for."""
        answer = self.ask(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, script: str, patience_s: float = PATIENCE_S) -> Any:
        """Until an expression comes true; an element has no value, and is true."""
        deadline = time.monotonic() + patience_s
        while True:
            # where the page is left meanwhile, the next one is asked
            with contextlib.suppress(Navigated):
                if found := self.run(f"(v => (v instanceof Node ? true : v))({script})"):
                    return found
            if time.monotonic() > deadline:
                shown = self.run("`${location.href}\n${document.body?.innerText}`")
                raise AssertionError(f"never true: {script}\n{self.errors}\n{shown}")
            time.sleep(0.05)

    def open(self, address: str, width: int = 1200, dark: bool = False, media: str = "") -> None:
        """Load a page at a width, in a scheme, and wait until its charts are drawn."""
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.ask(
            "Emulation.setEmulatedMedia",
            media=media,
            features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}],
        )
        self.errors.clear()
        self.requests.clear()
        # a page behind another tab is hidden, and does not follow its campaign
        self.ask("Page.bringToFront")
        self.ask("Page.navigate", url=address)
        self.wait(
            "document.readyState === 'complete' && document.documentElement.dataset.charts !=="
            " 'drawing'"
        )

    def point(self, x: float, y: float) -> None:
        """Move the mouse there."""
        self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def press(self, key: str) -> None:
        """A key, down and up."""
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=key)

    def screenshot(self, path: Path, whole: bool = True) -> None:
        """As PNG."""
        path.write_bytes(
            base64.b64decode(
                self.ask("Page.captureScreenshot", captureBeyondViewport=whole)["data"]
            )
        )

    def pdf(self) -> bytes:
        """As printed on A4."""
        found = self.ask(
            "Page.printToPDF",
            printBackground=True,
            preferCSSPageSize=True,
            paperWidth=8.27,
            paperHeight=11.69,
        )
        return base64.b64decode(found["data"])


@contextlib.contextmanager
def browser(folder: Path) -> Iterator[Page]:
    """A page of a browser whose profile lives in `folder`; ended with the block."""
    assert CHROMIUM is not None
    to_read, to_write = os.pipe(), os.pipe()
    command = [
        CHROMIUM,
        *OPTIONS,
        f"--user-data-dir={folder / 'profile'}",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    ]

    def plug() -> None:
        # the protocol is read at descriptor 3 and written at 4, wherever the pipes' own ends happen
        # to be
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (to_read[0], to_write[1])]
        for own, end in zip((3, 4), ends, strict=True):
            os.dup2(end, own)

    process = subprocess.Popen(
        command,
        pass_fds=(3, 4),
        preexec_fn=plug,
        env={**os.environ, "HOME": str(folder)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(to_read[0])
    os.close(to_write[1])
    try:
        yield Page(to_write[0], to_read[1])
    finally:
        process.terminate()
        process.wait(30)
        os.close(to_write[0])
        os.close(to_read[1])
