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
OFFLINE = "--quiet --no-index --no-build-isolation --no-deps --disable-pip-version-check --target"


@pytest.fixture(scope="module")
def tested(tmp_path_factory):
    """Run pytest where the examples are installed."""
    target = tmp_path_factory.mktemp("examples")
    install = [sys.executable, "-m", "pip", "install", *OFFLINE.split(), str(target)]
    subprocess.run([*install, *map(str, EXAMPLES)], check=True, capture_output=True, timeout=300)

    def run(*words: str) -> str:
        out = python(target, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words)
        assert out.returncode == 0, out.stdout[-3000:] + out.stderr[-1000:]
        return out.stdout

    return run


def test_there_is_one_of_each_kind():
    projects = [tomllib.loads((path / "pyproject.toml").read_text()) for path in EXAMPLES]
    groups = [name for one in projects for name in one["project"]["entry-points"]]
    assert sorted(groups) == ["nearlift.effects", "nearlift.models", "nearlift.readers"]


def test_their_own_tests_pass(tested):
    assert "9 passed" in tested(*(str(path / "tests") for path in EXAMPLES))


def test_they_pass_the_contract_of_the_built_in_ones(tested):
    contract = str(Path(__file__).with_name("test_declarations.py"))
    assert "passed" in tested(contract, "-k", "scaled_image or span_temperature")
