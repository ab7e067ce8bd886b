"""Fixtures of the small campaign."""

from tests.unit.conftest import make_job, small_job

__all__ = ["make_job", "small_job"]
