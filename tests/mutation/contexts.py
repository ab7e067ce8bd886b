"""Plugin of pytest: coverage.py records what every test module runs, under the module's path."""

import coverage
import pytest


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begin the context of a test's module."""
    coverage.Coverage.current().switch_context(item.nodeid.partition("::")[0])
