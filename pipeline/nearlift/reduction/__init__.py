"""Samples to trials, trials to cells: pure functions on arrays."""
