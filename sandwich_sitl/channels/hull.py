"""Vertical hulls: the smallest vertically convex cover of a shape, as upper and lower envelopes over x.

Source: notes N6. For disjoint vertically convex shapes the relation "lies below at some x" has no cycle, so obstacles
can be levelled into groups. An envelope is piecewise linear between the x of the shape's vertices; at a vertical edge
it is the closed shape's extent.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VerticalHull:
    """Strips (S,) between consecutive vertex positions `x` (S + 1,) with the envelopes at both ends of each strip.

    `low_left, low_right, high_left, high_right` (S,) are y at the strip's left and right end, so that a vertical edge
    shows as a step between neighbouring strips.
    """

    x: Array
    low_left: Array
    low_right: Array
    high_left: Array
    high_right: Array

    @property
    def x_min(self) -> float:
        return float(self.x[0])

    @property
    def x_max(self) -> float:
        return float(self.x[-1])

    def extent(self, x: Array) -> tuple[Array, Array]:
        """Closed y-extent (low, high) at positions `x` (n,) inside [x_min, x_max]."""
        left = np.clip(np.searchsorted(self.x, x, side="left") - 1, 0, len(self.low_left) - 1)
        right = np.clip(np.searchsorted(self.x, x, side="right") - 1, 0, len(self.low_left) - 1)
        low = np.minimum(
            self._at(x, left, self.low_left, self.low_right), self._at(x, right, self.low_left, self.low_right)
        )
        high = np.maximum(
            self._at(x, left, self.high_left, self.high_right), self._at(x, right, self.high_left, self.high_right)
        )
        return low, high

    def polygon(self) -> Polygon:
        """The hull as a polygon."""
        strips = [
            Polygon([(x0, a), (x1, b), (x1, c), (x0, d)])
            for x0, x1, a, b, c, d in zip(
                self.x[:-1], self.x[1:], self.low_left, self.low_right, self.high_right, self.high_left, strict=True
            )
        ]
        # A hair wider than exact, so that neighbouring strips unite in one polygon.
        hair = 1e-9 * max(1.0, self.x_max - self.x_min)
        united = shapely.union_all([strip.buffer(hair, join_style="mitre") for strip in strips])
        assert isinstance(united, Polygon)
        return united

    def _at(self, x: Array, strip: NDArray[np.int64], left: Array, right: Array) -> Array:
        x0, x1 = self.x[strip], self.x[strip + 1]
        share = np.clip((x - x0) / (x1 - x0), 0.0, 1.0)
        return (1 - share) * left[strip] + share * right[strip]


def ring_edges(ring: Array) -> Array:
    """Edges (V, 2, 2) of a ring (V, 2)."""
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)


def vertical_hull(edges: Array, floor: float | None = None, ceiling: float | None = None) -> VerticalHull:
    """The vertical hull of a connected set of edges (E, 2, 2).

    `floor` or `ceiling` extend it to that y (border obstacles).
    """
    edges = edges.copy()
    swap = edges[:, 0, 0] > edges[:, 1, 0]
    edges[swap] = edges[swap, ::-1]
    x = np.unique(edges[:, :, 0])
    x = x[np.concatenate([[True], np.diff(x) > 1e-9 * max(1.0, x[-1] - x[0])])]
    columns = []
    for x0, x1 in itertools.pairwise(x):
        middle = (x0 + x1) / 2
        spanning = edges[(edges[:, 0, 0] < middle) & (edges[:, 1, 0] > middle)]
        at_left, at_middle, at_right = (_height(spanning, position) for position in (x0, middle, x1))
        low, high = int(np.argmin(at_middle)), int(np.argmax(at_middle))
        columns.append((at_left[low], at_right[low], at_left[high], at_right[high]))
    low_left, low_right, high_left, high_right = (np.array(values) for values in zip(*columns, strict=True))
    if floor is not None:
        low_left, low_right = np.full_like(low_left, floor), np.full_like(low_right, floor)
    if ceiling is not None:
        high_left, high_right = np.full_like(high_left, ceiling), np.full_like(high_right, ceiling)
    return VerticalHull(x, low_left, low_right, high_left, high_right)


def _height(edges: Array, x: float) -> Array:
    run = edges[:, 1, 0] - edges[:, 0, 0]
    return edges[:, 0, 1] + (x - edges[:, 0, 0]) / run * (edges[:, 1, 1] - edges[:, 0, 1])
