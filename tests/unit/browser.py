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

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
#: Unprivileged, and offline: no name is ever resolved, and only this machine is reached.
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--remote-debugging-pipe",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
PATIENCE_S = 120.0
DRAWN = (
    "document.readyState === 'complete' && document.documentElement.dataset.charts !== 'drawing'"
)


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
        attached = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")

    def _receive(self, deadline: float) -> dict[str, Any]:
        while b"\0" not in self._rest:
            if not select.select([self._read], [], [], max(deadline - time.monotonic(), 0))[0]:
                raise TimeoutError("the browser does not answer")
            if not (part := os.read(self._read, 1 << 20)):
                raise EOFError("the browser has gone")
            self._rest += part
        text, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(text)
        params = message.get("params", {})
        match message.get("method"):
            case "Runtime.exceptionThrown":
                self.errors.append(str(params["exceptionDetails"]))
            case "Log.entryAdded":
                entry = params["entry"]
                self.errors.append(f"{entry['text']} {entry.get('url', '')}".rstrip())
            case "Runtime.consoleAPICalled":
                self.errors.append(str([a.get("value") for a in params["args"]]))
            case "Network.requestWillBeSent":
                self.requests.append(params["request"]["url"])
        return message

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """One command and its answer."""
        self._last += 1
        number = self._last
        session = {"sessionId": self._session} if self._session else {}
        message = {"id": number, "method": method, "params": params, **session}
        os.write(self._write, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + PATIENCE_S
        while (answer := self._receive(deadline)).get("id") != number:
            pass
        if "navigated" in answer.get("error", {}).get("message", ""):
            raise Navigated(method)
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def run(self, script: str) -> Any:
        """What an expression comes to; a promise is waited for."""
        how = {"returnByValue": True, "awaitPromise": True}
        answer = self.ask("Runtime.evaluate", expression=script, **how)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, script: str, patience_s: float = PATIENCE_S) -> Any:
        """Until an expression comes true; an element has no value, and is true."""
        deadline = time.monotonic() + patience_s
        while True:
            # where the page is left meanwhile, the next one is asked
            with contextlib.suppress(Navigated):
                if value := self.run(f"(v => (v instanceof Node ? true : v))({script})"):
                    return value
            if time.monotonic() > deadline:
                shown = self.run("`${location.href}\n${document.body?.innerText}`")
                raise AssertionError(f"never true: {script}\n{self.errors}\n{shown}")
            time.sleep(0.05)

    def open(self, address: str, width: int = 1200, dark: bool = False, media: str = "") -> None:
        """Load a page at a width, in a scheme, and wait until its charts are drawn."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.ask("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", media=media, features=[scheme])
        self.errors.clear()
        self.requests.clear()
        # a page behind another tab is hidden, and does not follow its campaign
        self.ask("Page.bringToFront")
        self.ask("Page.navigate", url=address)
        self.wait(DRAWN)

    def press(self, key: str, text: str = "") -> None:
        """A key, down and up; `text` is what it types."""
        for kind, typed in (("keyDown", {"text": text} if text else {}), ("keyUp", {})):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=key, **typed)

    def screenshot(self) -> bytes:
        """What is shown, as PNG."""
        return base64.b64decode(self.ask("Page.captureScreenshot")["data"])

    def pdf(self) -> bytes:
        """As printed on A4."""
        paper = {"paperWidth": 8.27, "paperHeight": 11.69, "preferCSSPageSize": True}
        return base64.b64decode(self.ask("Page.printToPDF", printBackground=True, **paper)["data"])


@contextlib.contextmanager
def browser(folder: Path) -> Iterator[Page]:
    """A page of a browser whose profile lives in `folder`; ended with the block."""
    assert CHROMIUM is not None
    to_read, to_write = os.pipe(), os.pipe()

    def plug() -> None:
        # the protocol is read at descriptor 3 and written at 4, wherever the pipes' own ends happen
        # to be
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (to_read[0], to_write[1])]
        for own, end in zip((3, 4), ends, strict=True):
            os.dup2(end, own)

    process = subprocess.Popen(
        [CHROMIUM, *OPTIONS, f"--user-data-dir={folder / 'profile'}"],
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
