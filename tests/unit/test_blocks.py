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
    small_run.write(folder / "raw" / "my-rig")
    shutil.copytree(folder / "raw" / "my-rig" / "trials", folder / "logs")
    (folder / "raw" / "next").mkdir()
    rig = (folder / "raw" / "my-rig" / "campaign.toml").read_text()
    plan = next(
        b.body
        for page in pages()
        if page.name == "planning.md"
        for b in blocks(page)
        if b.kind == "toml"
    )
    (folder / "raw" / "next" / "campaign.toml").write_text(
        rig.replace('"small"', '"next"') + "\n" + plan
    )
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


def test_reasons_are_reasons():
    spared = [b for page in pages() for b in blocks(page) if b.why_not]
    assert all(len(b.why_not) > 15 for b in spared)
    # one more than there are would be a habit: the last of them needs several machines
    assert len(spared) <= 7


def block(kind: str, body: str) -> Block:
    return Block(pages()[0], 1, kind, body, "")


def test_a_wrong_block_fails(tmp_path, monkeypatch):
    """The test is tested: a command that fails, an output that was not printed, a key that no
    manifest has.
    """
    monkeypatch.chdir(tmp_path)
    runner = Runner()
    with pytest.raises(AssertionError, match=r"README\.md:1: nearlift run nowhere: 2"):
        runner.run(block("sh", "nearlift run nowhere\n"))
    with pytest.raises(AssertionError, match="only nearlift and make"):
        runner.run(block("sh", "rm -r raw\n"))
    with pytest.raises(AssertionError, match="make"):
        runner.run(block("sh", "make coffee\n"))
    runner.run(block("python", "print('K_b = 2.01')\nprint('and more')\n"))
    runner.run(block("text", "K_b = 2.02\n...\n"))
    for text, told in (
        ("K_c = 2.01\n", "was not printed"),
        ("K_b = 1.98\n...\n", "but printed: 'K_b = 2.01'"),
        ("and more\n", "stands more"),
        ("K_b = 2.01\n", "more was printed"),
    ):
        with pytest.raises(AssertionError, match=told):
            runner.run(block("text", text))
    with pytest.raises(Exception, match="unknown key"):
        runner.run(block("toml", "[design]\nvisit = 3\n"))
    with pytest.raises(AssertionError, match="nobody knows how to run it"):
        runner.run(block("", "nothing\n"))


def test_no_block_is_overlooked():
    """As many fences as blocks."""
    for page in pages():
        fences = len(re.findall(r"^ *```", page.read_text(encoding="utf-8"), flags=re.M))
        assert fences == 2 * len(blocks(page)), page
