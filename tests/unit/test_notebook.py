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


def cells(file: Path) -> list[dict]:
    return [c for c in json.loads(file.read_text())["cells"] if c["cell_type"] == "code"]


def test_no_output_is_kept():
    for cell in cells(NOTEBOOK):
        assert (cell["outputs"], cell["execution_count"]) == ([], None)


@pytest.mark.nightly
def test_every_answer_shows_itself_and_the_loop_finds_what_is_in_the_demo(demo, tmp_path):
    shutil.copytree(demo, tmp_path, dirs_exist_ok=True)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", EXECUTE, str(NOTEBOOK)],
        cwd=tmp_path,
        env={**os.environ, "JUPYTER_PLATFORM_DIRS": "1"},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    outputs = [output for cell in cells(tmp_path / "executed.ipynb") for output in cell["outputs"]]
    # nothing was printed or warned of
    assert {output["output_type"] for output in outputs} == {"execute_result"}
    assert sum("image/png" in output["data"] for output in outputs) == 1
    text = "\n".join("".join(output["data"].get("text/plain", "")) for output in outputs)
    for words in ("Study('demo'", "u_delta_L", "sanchez_cuevas", "'within 90 %': True"):
        assert words in text
