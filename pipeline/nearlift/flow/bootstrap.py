"""Resampled mean fields from one pass over the fields: each block of fields enters each resample a
Poisson number of times.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray


class Resamples:
    """Sums and counts of `size` resamples of columns; flat in memory however many fields there are.

    Fields next to each other in time are drawn together, `block` at a time, so that their
    correlation stays in the resamples. Of few blocks a resample may come out empty (e^-6 of them,
    of six blocks); it is no resample and is left out.
    """

    def __init__(self, size: int, block: int, rng: np.random.Generator) -> None:
        self.fields = np.zeros(size)
        self.total = self.count = np.zeros((size, 0))
        self.block = max(block, 1)
        self.rng = rng
        self.held: list[FloatArray] = []

    def add(self, row: FloatArray) -> None:
        """One field's values (columns,); nan is no observation."""
        self.held.append(row)
        if len(self.held) == self.block:
            self._draw()

    def _draw(self) -> None:
        if not self.held:
            return
        block = np.stack(self.held)
        known = np.isfinite(block)
        if not self.total.size:
            self.total = np.zeros((len(self.fields), block.shape[1]))
            self.count = np.zeros_like(self.total)
        times = self.rng.poisson(1.0, len(self.fields)).astype(float)
        self.total += np.outer(times, np.where(known, block, 0.0).sum(axis=0))
        self.count += np.outer(times, known.sum(axis=0))
        self.fields += times * len(block)
        self.held = []

    def means(self) -> FloatArray:
        """Resampled means, a row each, at most `size` of them; nan where a resample has no
        observation of a column.
        """
        self._draw()
        drawn = self.fields > 0
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.count[drawn] > 0, self.total[drawn] / self.count[drawn], np.nan)


def block_length(n: int) -> int:
    """Fields in a block for n fields: the cube root, the usual rate for a mean."""
    return int(max(round(n ** (1 / 3)), 1))
