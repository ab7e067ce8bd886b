"""The example packages: installed as a user would, without a network, and put to their own tests
and to the declarations' contract.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from .test_plugin import python

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted(path.parent for path in ROOT.glob("examples/*/pyproject.toml"))


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    target = tmp_path_factory.mktemp("examples")
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-index",
        "--no-build-isolation",
        "--no-deps",
        "--disable-pip-version-check",
    ]
    subprocess.run(
        [*command, "--target", str(target), *map(str, EXAMPLES)],
        check=True,
        capture_output=True,
        timeout=300,
    )
    return target


def test_there_is_one_of_each_kind():
    groups = [
        tomllib.loads((path / "pyproject.toml").read_text())["project"]["entry-points"]
        for path in EXAMPLES
    ]
    assert sorted(name for group in groups for name in group) == [
        "nearlift.effects",
        "nearlift.models",
        "nearlift.readers",
    ]


def test_their_own_tests_pass(site):
    out = python(
        site,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        *(str(path / "tests") for path in EXAMPLES),
    )
    assert out.returncode == 0, out.stdout[-3000:] + out.stderr[-1000:]
    assert "9 passed" in out.stdout


def test_they_pass_the_contract_of_the_built_in_ones(site):
    out = python(
        site,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        str(Path(__file__).with_name("test_declarations.py")),
        "-k",
        "scaled_image or span_temperature",
    )
    assert out.returncode == 0, out.stdout[-3000:]
    assert "passed" in out.stdout
