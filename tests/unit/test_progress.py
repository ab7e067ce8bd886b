"""Progress on a terminal: the activity, its share and the time; elsewhere nothing."""

from __future__ import annotations

import io
import re
import subprocess
import sys

import pytest

from nearlift.run import engine
from nearlift.run.engine import stage_of, subprogress
from nearlift.stages import STAGES
from nearlift.terminal import Call

from . import small_run


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch):
    """A terminal in place of stderr; called in the test, since pytest sets its own streams before."""

    def begin(is_terminal: bool = True) -> io.StringIO:
        stream = io.StringIO()
        stream.isatty = lambda: is_terminal
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setenv("COLUMNS", "100")
        monkeypatch.setattr(sys, "stderr", stream)
        return stream

    return begin


def test_a_terminal_shows_what_how_far_and_how_long(screen):
    stream, call = screen(), Call()
    with call.busy("nearlift: demo"):
        now = [100.0]
        call.bar.get_time = lambda: now[0]
        call.progress("ingest 0 of 40 trials", 0.0)
        for done in (10, 20):
            now[0] += 5.0
            call.progress(f"ingest {done} of 40 [trials]", done / 40)
        call.bar.refresh()
        call.line("a line that stays")
        # another activity begins again, and an unknown share is not made up
        call.progress("fit ground: a")
        (task,) = call.bar.tasks
        assert (task.description, task.total, task.elapsed) == ("fit ground: a", None, 0.0)
    shown = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", stream.getvalue())
    for text in ("ingest 20 of 40 [trials]", "50%", "0:00:10 00:10 left", "\ra line that stays\n"):
        assert text in shown
    assert call.bar is None


@pytest.mark.parametrize(
    ("settings", "is_terminal", "text"),
    [
        ({"quiet": True}, True, ""),
        ({"as_json": True}, True, ""),
        ({}, False, ""),
        ({"verbose": True}, False, "  ingest 1 of 4 trials\n"),
    ],
)
def test_quiet_stays_quiet_and_elsewhere_only_v_speaks(screen, settings, is_terminal, text):
    stream, call = screen(is_terminal), Call(**settings)
    with call.busy("nearlift: demo"):
        call.progress("ingest 1 of 4 trials", 0.25)
    assert stream.getvalue() == text


def test_help_loads_nothing_of_it():
    program = (
        "import sys; from click.testing import CliRunner; from nearlift.cli import main;"
        " CliRunner().invoke(main, ['--help']); print([m for m in sys.modules if"
        " m.startswith('rich')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stdout + done.stderr


def test_stages_say_how_far_they_are(tmp_path):
    """Shares of one activity never fall, and none is beyond the whole."""
    file = small_run.write(tmp_path / "raw", visits=2) / "campaign.toml"
    file.write_text(file.read_text() + "\n[fit]\ness = 100\n")
    heard: list[tuple[str, float | None]] = []

    def say(text, share=None, /):
        heard.append((text, share))

    for i in range(2):
        part = subprogress(say, i, 2)
        part("begins")
        part("half", 0.5)
    assert heard == [("begins", 0.0), ("half", 0.25), ("begins", 0.5), ("half", 0.75)]
    heard.clear()
    job = small_run.job(tmp_path / "raw", tmp_path, say=say)
    names = ("ingest", "reduce", "fit", "diagnose")
    assert list(engine.run(job, tuple(stage_of(STAGES, name) for name in names)))
    for activity in ("ingest", "fit", "diagnose"):
        shares = [share for text, share in heard if text.split()[0] == activity]
        assert None not in shares
        assert shares == sorted(shares)
        assert len(set(shares)) > 1
        assert 0 <= shares[0] < shares[-1] <= 1
    texts = [text for text, _ in heard]
    assert any(text.startswith("fit ground: posterior of sanchez_cuevas, ") for text in texts)
    assert any(text.startswith("diagnose ground: fold 1 of ") for text in texts)
