"""Benchmarks, each with its peer in one run: ratios count, times are for orientation."""
