"""Every code block of README, CONTRIBUTING and docs runs, or says why it does not."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from . import small_run
from .blocks import Block, Runner, blocks, pages

#: The programs of export.md are compiled and run by test_export_page.
WITH_BLOCKS = [page for page in pages() if blocks(page) and page.name != "export.md"]
#: Pages whose blocks run on every change; all others by `make nightly`.
OFTEN = {"README", "tutorial", "python"}


@pytest.fixture(scope="session")
def workspace(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the pages speak of: the demo, run; a rig's campaign; a plan; logs without a manifest."""
    folder = tmp_path_factory.mktemp("docs")
    shutil.copytree(demo, folder, dirs_exist_ok=True)
    rig = small_run.write(folder / "raw" / "my-rig")
    shutil.copytree(rig / "trials", folder / "logs")
    (folder / "raw" / "next").mkdir()
    [planning] = (page for page in pages() if page.name == "planning.md")
    plan = next(b.body for b in blocks(planning) if b.kind == "toml")
    text = (rig / "campaign.toml").read_text().replace('"small"', '"next"')
    (folder / "raw" / "next" / "campaign.toml").write_text(f"{text}\n{plan}")
    return folder


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=page.stem, marks=[pytest.mark.nightly] * (page.stem not in OFTEN))
        for page in WITH_BLOCKS
    ],
)
@pytest.mark.usefixtures("plain_pictures")
def test_blocks_run(page, workspace, monkeypatch):
    monkeypatch.chdir(workspace)
    runner = Runner()
    for block in blocks(page):
        runner.run(block)


def test_no_block_is_overlooked_and_reasons_are_reasons():
    """As many fences as blocks."""
    spared = []
    for page in pages():
        fences = len(re.findall(r"^ *```", page.read_text(encoding="utf-8"), flags=re.M))
        assert fences == 2 * len(blocks(page)), page
        spared += [b.why_not for b in blocks(page) if b.why_not]
    assert all(len(reason) > 15 for reason in spared)
    # one more than there are would be a habit: the last of them needs several machines
    assert len(spared) <= 7


def test_a_wrong_block_fails(tmp_path, monkeypatch):
    """The test is tested: a command that fails, an output that was not printed, a key that no
    manifest has.
    """
    monkeypatch.chdir(tmp_path)
    runner = Runner()

    def run(kind: str, body: str) -> None:
        runner.run(Block(pages()[0], 1, kind, body))

    for kind, body, text in (
        ("sh", "nearlift run nowhere\n", r"README\.md:1: nearlift run nowhere: 2"),
        ("sh", "rm -r raw\n", "only nearlift and make"),
        ("sh", "make coffee\n", "make"),
        ("toml", "[design]\nvisit = 3\n", "unknown key"),
        ("", "nothing\n", "is not known here"),
    ):
        with pytest.raises(Exception, match=text):
            run(kind, body)
    run("python", "print('K_b = 2.01')\nprint('and more')\n")
    run("text", "K_b = 2.02\n...\n")
    for body, text in (
        ("K_c = 2.01\n", "was not printed"),
        ("K_b = 1.98\n...\n", "but printed: 'K_b = 2.01'"),
        ("and more\n", "more was printed before"),
        ("K_b = 2.01\n", "more was printed"),
    ):
        with pytest.raises(AssertionError, match=text):
            run("text", body)
