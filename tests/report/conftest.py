"""Fixtures of the small campaign, and its evidence."""

import pytest
from tests.unit.conftest import make_job, plain_pictures, small_job

from nearlift.stages.gathering import gather

__all__ = ["make_job", "plain_pictures", "small_job"]


@pytest.fixture(scope="module")
def evidence(small_job):
    return gather(small_job)
