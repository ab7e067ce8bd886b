"""Fixtures of the small campaign."""

from tests.unit.conftest import make_job, plain_pictures, small_job

__all__ = ["make_job", "plain_pictures", "small_job"]
