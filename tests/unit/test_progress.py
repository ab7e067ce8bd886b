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


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """What is written to it; within the test, since pytest sets its own streams before."""
    screen = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr(sys, "stderr", screen)
    return screen


def test_a_terminal_shows_what_how_far_and_how_long(monkeypatch):
    screen = terminal(monkeypatch)
    call = Call()
    with call.busy("nearlift: demo"):
        assert call.bar is not None
        now = [100.0]
        call.bar.get_time = lambda: now[0]
        call.progress("ingest 0 of 40 trials", 0.0)
        for done in (10, 20):
            now[0] += 5.0
            call.progress(f"ingest {done} of 40 [trials]", done / 40)
        call.bar.refresh()
        call.line("a line that stays")
    shown = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", screen.getvalue())
    assert "ingest 20 of 40 [trials]" in shown
    assert "50%" in shown
    assert "0:00:10 00:10 left" in shown
    assert "\ra line that stays\n" in shown
    assert call.bar is None


def test_another_activity_begins_anew_and_an_unknown_share_is_not_made_up(monkeypatch):
    terminal(monkeypatch)
    call = Call()
    with call.busy("nearlift: demo"):
        assert call.bar is not None
        call.progress("fit ground: a", 0.5)
        call.progress("fit ground: b")
        (task,) = call.bar.tasks
        assert (task.description, task.percentage) == ("fit ground: b", 50.0)
        call.progress("report ground: 2 trials put back")
        (task,) = call.bar.tasks
        assert task.total is None
        assert task.elapsed < 5


@pytest.mark.parametrize("settings", [{"quiet": True}, {"as_json": True}])
def test_quiet_stays_quiet_on_a_terminal(monkeypatch, settings):
    screen = terminal(monkeypatch)
    call = Call(**settings)
    with call.busy("nearlift: demo"):
        call.progress("ingest 1 of 4 trials", 0.25)
    assert screen.getvalue() == ""


def test_elsewhere_only_v_tells(monkeypatch):
    for verbose, told in ((False, ""), (True, "  ingest 1 of 4 trials\n")):
        stream = io.StringIO()
        monkeypatch.setattr(sys, "stderr", stream)
        call = Call(verbose=verbose)
        with call.busy("nearlift: demo"):
            call.progress("ingest 1 of 4 trials", 0.25)
        assert stream.getvalue() == told


def test_help_loads_nothing_of_it():
    program = (
        "import sys; from click.testing import CliRunner; from nearlift.cli import main;"
        " CliRunner().invoke(main, ['--help']); print([m for m in sys.modules if"
        " m.startswith('rich')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stdout + done.stderr


def test_parts_of_an_activity_follow_each_other():
    told = []
    for i in range(2):
        say = subprogress(lambda text, share=None, /: told.append((text, share)), i, 2)
        say("begins")
        say("half", 0.5)
    assert told == [("begins", 0.0), ("half", 0.25), ("begins", 0.5), ("half", 0.75)]


def test_stages_tell_how_far_they_are(tmp_path):
    """Shares of one activity never fall, and none is beyond the whole."""
    file = small_run.write(tmp_path / "raw", visits=2) / "campaign.toml"
    file.write_text(file.read_text() + "\n[fit]\ness = 100\n")
    told: list[tuple[str, float | None]] = []
    job = small_run.job(
        tmp_path / "raw", tmp_path, say=lambda text, share=None, /: told.append((text, share))
    )
    names = ("ingest", "reduce", "fit", "diagnose")
    assert list(engine.run(job, tuple(stage_of(STAGES, name) for name in names)))
    for activity in ("ingest", "fit", "diagnose"):
        shares = [share for text, share in told if text.split()[0] == activity]
        assert None not in shares
        assert shares == sorted(shares)
        assert len(set(shares)) > 1
        assert 0 <= shares[0] < shares[-1] <= 1
    texts = [text for text, _ in told]
    assert any(text.startswith("fit ground: posterior of sanchez_cuevas, ") for text in texts)
    assert any(text.startswith("diagnose ground: fold 1 of ") for text in texts)
