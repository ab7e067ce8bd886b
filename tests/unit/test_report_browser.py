"""The page in a real browser: it renders, says nothing on the console, asks for nothing, and keeps within a phone's width."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest
from PIL import Image

from nearlift.stages import report

CHROMIUM = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")


@pytest.fixture(scope="module")
def address(make_job):
    job = make_job(simulated=True)
    report.run(job)
    return (job.reports / "index.html").as_uri()


def browse(folder, address, *options):
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr", "--v=0"]
    # unprivileged, offline, with a profile of its own
    command += [f"--user-data-dir={folder / 'profile'}", "--no-first-run", "--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND"]
    return subprocess.run(
        [*command, *options, address], capture_output=True, text=True, timeout=120, env={**os.environ, "HOME": str(folder)}, check=True
    )


@pytest.mark.parametrize(
    ("name", "width", "options"), [("light", 1200, []), ("dark", 1200, ["--blink-settings=preferredColorScheme=0"]), ("phone", 500, [])]
)
def test_it_renders_without_a_word_on_the_console(address, tmp_path, name, width, options):
    picture = tmp_path / f"{name}.png"
    done = browse(tmp_path, address, *options, f"--window-size={width},3000", f"--screenshot={picture}")
    assert "CONSOLE" not in done.stderr
    image = Image.open(picture).convert("L")
    assert image.size == (width, 3000)
    low, high = image.getextrema()
    assert high - low > 150
    corner = image.getpixel((2, 2))
    assert corner < 60 if name == "dark" else corner > 240


def test_the_document_is_whole(address, tmp_path):
    done = browse(tmp_path, address, "--dump-dom")
    for part in ('id="verdict"', 'id="provenance"', "<footer>", "SIMULATED"):
        assert part in done.stdout
