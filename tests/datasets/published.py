"""Data sets published on this machine: a folder that is served, and a list of its files."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import http.server
import threading
import urllib.parse
from collections.abc import Iterator
from pathlib import Path


class PublishedFolder:
    """Serves a folder on loopback and remembers what it was asked for."""

    def __init__(self, folder: Path) -> None:
        asked = self.asked = []

        class Handler(http.server.SimpleHTTPRequestHandler):
            def do_GET(self):
                asked.append(urllib.parse.unquote(self.path).lstrip("/"))
                super().do_GET()

            def log_message(self, *args):
                pass

        folder.mkdir()
        self.folder = folder
        self.http = http.server.ThreadingHTTPServer(
            ("127.0.0.1", 0), functools.partial(Handler, directory=str(folder))
        )
        self.url = f"http://127.0.0.1:{self.http.server_port}"
        self.thread = threading.Thread(target=self.http.serve_forever, args=(0.05,))
        self.thread.start()

    def stop(self) -> None:
        self.http.shutdown()
        self.thread.join()
        self.http.server_close()


@contextlib.contextmanager
def published(folder: Path) -> Iterator[PublishedFolder]:
    """A new folder, served until the block ends."""
    running = PublishedFolder(folder)
    try:
        yield running
    finally:
        running.stop()


def listed(
    server: PublishedFolder,
    files: dict[str, str],
    path: Path,
    converter: str = "pitt_ras",
    digest: str | None = None,
) -> Path:
    """Serve files, and list them as the data set `made-up`."""
    text = f"""
[[dataset]]
name = "made-up"
title = "sweeps of nothing"
licence = "CC0"
citation = "none"
home = "{server.url}"
converter = "{converter}"
next = "nearlift run"
"""
    for name, content in files.items():
        (server.folder / name).write_text(content)
        sha = digest or hashlib.sha256(content.encode()).hexdigest()
        text += (
            f'[[dataset.file]]\nname = "{name}"\nurl ='
            f' "{server.url}/{urllib.parse.quote(name)}"\nsha256 = "{sha}"\nbytes ='
            f" {len(content)}\n"
        )
    path.write_text(text)
    return path
