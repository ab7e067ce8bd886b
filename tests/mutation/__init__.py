"""Seeded mutants of the core, and whether the tests notice them; see docs/mutation.md."""
