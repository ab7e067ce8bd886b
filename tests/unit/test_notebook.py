"""The example notebook runs from top to bottom in a kernel of its own; it is kept without
outputs.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples" / "notebook" / "campaign.ipynb"
EXECUTE = """
import sys, nbclient, nbformat
notebook = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": "."}}).execute()
nbformat.write(notebook, "executed.ipynb")
"""


@pytest.fixture(scope="module")
def executed(demo, tmp_path_factory) -> list[dict]:
    folder = tmp_path_factory.mktemp("notebook")
    shutil.copytree(demo, folder, dirs_exist_ok=True)
    command = [sys.executable, "-W", "ignore", "-c", EXECUTE, str(NOTEBOOK)]
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "JUPYTER_PLATFORM_DIRS": "1"},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return [
        cell
        for cell in json.loads((folder / "executed.ipynb").read_text())["cells"]
        if cell["cell_type"] == "code"
    ]


def test_no_output_is_kept():
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.nightly
def test_every_answer_shows_itself(executed):
    pages = "\n".join(
        "".join(output["data"].get("text/plain", ""))
        for cell in executed
        for output in cell["outputs"]
        if "data" in output
    )
    assert all(
        output["output_type"] == "execute_result" for cell in executed for output in cell["outputs"]
    ), "something was printed or warned of"
    assert sum("image/png" in o["data"] for c in executed for o in c["outputs"]) == 1
    for words in ("Study('demo'", "u_delta_L", "sanchez_cuevas", "within 90 %"):
        assert words in pages


@pytest.mark.nightly
def test_the_loop_found_what_is_in_the_demo(executed):
    (answer,) = [
        "".join(o["data"]["text/plain"])
        for c in executed
        for o in c["outputs"]
        if "within 90 %" in "".join(o["data"]["text/plain"])
    ]
    assert "'within 90 %': True" in answer
