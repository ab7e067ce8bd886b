"""Fixtures of the small campaign."""

from tests.unit.conftest import make_job, remake, small_job

__all__ = ["make_job", "remake", "small_job"]
