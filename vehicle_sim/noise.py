"""Seeded standard normal numbers: one independent stream a source, drawn in blocks of rows."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Columns of the vehicle's noise table: (source, width). One row a step; slow sources use the row of their step.
NOISE_COLUMNS = (
    ("gyroscope", 3),
    ("wind", 3),
    ("estimate", 9),
    ("accelerometer", 3),
    ("magnetometer", 3),
    ("barometer", 1),
    ("gps", 3),
    ("barometer wander", 1),
    ("turbulence", 5),
    ("gps velocity", 3),
    ("gps wander", 3),
)


def first_column(sources: tuple[tuple[str, int], ...], name: str) -> int:
    """Where a source's columns begin."""
    at = [source for source, _ in sources].index(name)
    return sum(width for _, width in sources[:at])


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
