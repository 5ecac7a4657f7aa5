"""Seeded standard normal numbers: one independent stream a source, drawn in blocks so that one number costs next to nothing."""

from collections.abc import Iterator

import numpy as np

_BLOCK = 1024


class NoiseSource:
    """Standard normal numbers of one stream."""

    def __init__(self, sequence: np.random.SeedSequence) -> None:
        self._numbers = _numbers(np.random.default_rng(sequence))

    def one(self) -> float:
        """The next number."""
        return next(self._numbers)

    def three(self) -> tuple[float, float, float]:
        """The next three numbers."""
        numbers = self._numbers
        return (next(numbers), next(numbers), next(numbers))


def spawn_sources(seed: int, names: tuple[str, ...]) -> dict[str, NoiseSource]:
    """One source a name. A stream depends on the seed and the name's place, not on how much the others drew."""
    children = np.random.SeedSequence(seed).spawn(len(names))
    return {name: NoiseSource(child) for name, child in zip(names, children, strict=True)}


def _numbers(generator: np.random.Generator) -> Iterator[float]:
    while True:
        yield from generator.standard_normal(_BLOCK).tolist()
