"""Tests of the read-only page."""
