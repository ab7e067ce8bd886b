"""Nothing in the current folder or in the campaign's is run or changed, whatever lies there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import click
import numpy as np
import pytest
import scipy.io
from tests.unit import small_run
from tests.unit.small_run import state

from nearlift.cli import main
from nearlift.stages import STAGES
from nearlift.synthetic import demo_flow
from nearlift.synthetic.records import SimulatedBench

#: Runs each command in turn, as the console script would. The demo's campaign is a small one, and
#: one figure is drawn.
DRIVER = """
import json, shutil, sys
from nearlift.cli import main
from nearlift.stages import STAGES
from nearlift.loop import power
from nearlift.report import registry
from nearlift.synthetic import demo

if __name__ == "__main__":
    raw, commands = json.loads(sys.argv[1])
    demo.write_demo = lambda folder: shutil.copytree(raw, folder)
    registry.FIGURES, power.DRAWS, codes = registry.FIGURES[:1], 50, {}
    for words in commands:
        try:
            codes[words[0]] = main(words, standalone_mode=False) or 0
        except SystemExit as end:
            codes[words[0]] = end.code
    print(json.dumps(codes))
"""
#: What has nothing to do here: no such workspace.
REFUSED = {"serve": 2}
QUICK = """
[fit]
ess = 100
ground = { rivals = [] }
[simulate]
flights = 20
draws = 2
risks = [0.5]
presets = ["paper"]
set_points = { ground = [1.2, 1.6] }
[detect]
"""


#: A module that says that it was run, and then is the one whose name it bears, so that nobody
#: notices.
PLANTED = """
with open({mark!r}, "a") as file:
    file.write(__name__ + "\\n")
import sys
path = sys.path[:]
sys.path[:] = [entry for entry in path if entry not in ("", {folder!r})]
del sys.modules[__name__]
__import__(__name__)
sys.path[:] = path
"""


def planted(folder: Path, mark: Path) -> None:
    """Fill a folder with what Python and the libraries used would read in the current one; whatever
    is run says so in `mark`.
    """
    code = PLANTED.format(mark=str(mark), folder=str(folder))
    names = {
        *sys.stdlib_module_names,
        *metadata.packages_distributions(),
        "sitecustomize",
        "usercustomize",
        "conftest",
        "planted",
    }
    for name in names:
        if "/" not in name:
            (folder / f"{name}.py").write_text(code)
    (folder / "planted.pth").write_text(f"import sys; open({str(mark)!r}, 'a').write('pth')\n")
    entry = folder / "planted-1.dist-info"
    entry.mkdir()
    (entry / "METADATA").write_text("Metadata-Version: 2.1\nName: planted\nVersion: 1\n")
    (entry / "entry_points.txt").write_text(
        "".join(
            f"[nearlift.{kind}]\nplanted = planted:it\n"
            for kind in ("models", "effects", "readers")
        )
    )
    # numba would keep its code here, and load what it finds; what matplotlib cannot understand it
    # says
    (folder / ".numba_config.yaml").write_text(f"cache_dir: {folder}\n")
    (folder / "matplotlibrc").write_text("planted : yes\naxes.prop_cycle : planted()\n")
    for name, text in {
        ".env": "PYTHONPATH=.\n",
        "pyvenv.cfg": "home = .\n",
        "setup.cfg": "[nearlift]\n",
    }.items():
        (folder / name).write_text(text)


def every_command(raw: Path, out: Path) -> list[list[str]]:
    """A form of each that ends soon; in an order in which each finds what it reads."""
    given: dict[str, list[object]] = {
        "new": [out / "new"],
        **{stage.name: [raw] for stage in STAGES},
        "run": [raw],
        "demo": [],
        "design": [raw],
        "explain": [raw, "supply_sag"],
        "next": [raw, "--for", "K_b"],
        "export": [raw, "--c", "--document", "--python"],
        "compare": [],
        "serve": [raw / "nowhere"],
        "inspect": [raw / "log.mat"],
        "describe": [],
        "data": ["list"],
    }
    assert sorted(given) == sorted(main.list_commands(click.Context(main, **main.context_settings)))
    return [[name, *map(str, words)] for name, words in given.items()]


@pytest.mark.nightly
def test_no_command_runs_or_changes_what_is_planted(tmp_path, monkeypatch):
    raw = small_run.write(tmp_path / "raw", visits=2)
    monkeypatch.setattr(demo_flow, "FIELDS", 2)
    two = {
        name: wake
        for name, wake in demo_flow.wakes(SimulatedBench()).items()
        if name in ("control", "ground-3.4")
    }
    monkeypatch.setattr(demo_flow, "wakes", lambda _: two)
    text = demo_flow.write_piv(raw, SimulatedBench(), seed=3).replace(', "ceiling-2"', "")
    (raw / "campaign.toml").write_text((raw / "campaign.toml").read_text() + text + QUICK)
    scipy.io.savemat(raw / "log.mat", {"force": np.zeros(9)})
    here, mark, out = tmp_path / "here", tmp_path / "mark", tmp_path / "out"
    here.mkdir()
    for folder in (here, raw):
        planted(folder, mark)
    before = {*state(here).values(), *state(raw).values()}
    (tmp_path / "driver").mkdir()
    driver = tmp_path / "driver" / "nearlift"
    driver.write_text(DRIVER)
    commands = every_command(raw, out)
    for words in commands:
        options = {
            o
            for p in main.get_command(click.Context(main, **main.context_settings), words[0]).params
            for o in p.opts
        }
        words += ["--out", str(out)] if "--out" in options else []
        words += ["--executor", "processes:2"] if "--executor" in options else []
    asked = json.dumps([str(raw), commands])
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, driver, asked],
        cwd=here,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (sorted(set(mark.read_text().split())) if mark.exists() else []) == []
    assert [
        name for name, content in {**state(here), **state(raw)}.items() if content not in before
    ] == []
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "planted" not in done.stderr
    assert {
        name: code for name, code in json.loads(done.stdout.splitlines()[-1]).items() if code
    } == REFUSED
