"""Seeded standard normal numbers: one independent stream a source, drawn in blocks of rows."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class NoiseTable:
    """Rows of normal numbers, one row a step, each source in columns of its own."""

    def __init__(self, seed: int, sources: tuple[tuple[str, int], ...], rows: int) -> None:
        """`sources` are (name, columns). A stream depends on the seed and the name's place, not on how much the others drew."""
        children = np.random.SeedSequence(seed).spawn(len(sources))
        self._generators = [np.random.default_rng(child) for child in children]
        self._widths = [width for _, width in sources]
        self.rows = rows
        self.values: Array = np.zeros((rows, sum(self._widths)))
        self.refill()

    def refill(self) -> None:
        """The next block of rows, in place."""
        at = 0
        for generator, width in zip(self._generators, self._widths, strict=True):
            self.values[:, at : at + width] = generator.standard_normal((self.rows, width))
            at += width
