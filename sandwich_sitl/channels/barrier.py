"""`Barrier`: an obstacle as the channel map sees it, its ring cut into two walls at its two tips.

A dividing streamline arrives at the left tip, splits, and joins again at the right tip (paper, Fig. BoundaryMapping).
A tip lies on the barrier's left or right face, the run of steep edges round its extreme vertices; where the
face leans, the streamline runs level between the tip and the extreme x. A barrier on the left or right border has no
tip there: its walls begin or end at the border, apart from each other.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bounds = tuple[float, float, float, float]

_STEEP = np.tan(np.radians(75.0))  # |dy/dx| from which an edge counts to a face


Pick = Callable[[Array], int]


def _lowest(y: Array) -> int:
    return int(np.argmin(y))


def _highest(y: Array) -> int:
    return int(np.argmax(y))


@dataclass(frozen=True)
class Barrier:
    """One vertically convex barrier.

    `index` is the position of its first polygon in the grown world; `ring_m` (V, 2) is counter-clockwise; `left_tip`
    and `right_tip` (2,) lie on it, None where the barrier ends at a border or tips are not placed yet.
    """

    index: int
    name: str
    ring_m: Array
    bounds: Bounds
    left_tip: Array | None = None
    right_tip: Array | None = None

    @property
    def x_min(self) -> float:
        return float(self.ring_m[:, 0].min())

    @property
    def x_max(self) -> float:
        return float(self.ring_m[:, 0].max())

    @property
    def on_bottom(self) -> bool:
        return bool((self.ring_m[:, 1] == self.bounds[1]).any())

    @property
    def on_top(self) -> bool:
        return bool((self.ring_m[:, 1] == self.bounds[3]).any())

    @property
    def on_left(self) -> bool:
        return self.x_min == self.bounds[0]

    @property
    def on_right(self) -> bool:
        return self.x_max == self.bounds[2]

    def lower(self) -> Array:
        """Underside (V, 2), left to right, between the lowest points of the two extreme x."""
        return _chain(self.ring_m, _at(self.ring_m, self.x_min, _lowest), _at(self.ring_m, self.x_max, _lowest))

    def upper(self) -> Array:
        """Upper side (V, 2), left to right, between the highest points of the two extreme x."""
        right, left = _at(self.ring_m, self.x_max, _highest), _at(self.ring_m, self.x_min, _highest)
        return _chain(self.ring_m, right, left)[::-1]

    def left_face(self) -> Array:
        """The steep run (F, 2) round the leftmost vertices, bottom to top."""
        ring = self.ring_m
        return _face(ring[::-1], len(ring) - 1 - _at(ring, self.x_min, _lowest))

    def right_face(self) -> Array:
        """The steep run (F, 2) round the rightmost vertices, bottom to top."""
        return _face(self.ring_m, _at(self.ring_m, self.x_max, _lowest))

    def lower_wall(self) -> Array:
        """From tip to tip, or border, along the underside (V, 2), left to right."""
        return _chain(
            self.ring_m,
            self._end(self.left_tip, self.x_min, _lowest),
            self._end(self.right_tip, self.x_max, _lowest),
        )

    def upper_wall(self) -> Array:
        """From tip to tip, or border, along the upper side (V, 2), left to right."""
        right, left = self._end(self.right_tip, self.x_max, _highest), self._end(self.left_tip, self.x_min, _highest)
        return _chain(self.ring_m, right, left)[::-1]

    def border_wall(self) -> Array:
        """The one wall (V, 2), left to right, of a barrier on the bottom or the top border."""
        far, near = (_highest, _lowest) if self.on_bottom else (_lowest, _highest)
        left = _at(self.ring_m, self.x_min, far if self.on_left else near)
        right = _at(self.ring_m, self.x_max, far if self.on_right else near)
        return _chain(self.ring_m, right, left)[::-1] if self.on_bottom else _chain(self.ring_m, left, right)

    def fixed_points(self) -> list[Array]:
        """Points (n, 2) at whose x a streamline beside the barrier may have to bend: vertices and tips."""
        tips = [tip[None] for tip in (self.left_tip, self.right_tip) if tip is not None]
        return [self.lower(), self.upper(), *tips]

    def extent(self, x: Array) -> tuple[Array, Array]:
        """Closed y-extent (low, high) at positions `x` (n,) inside [x_min, x_max], the ways out of the tips included."""
        low, high = _heights(self.lower(), x, np.minimum), _heights(self.upper(), x, np.maximum)
        for tip, beyond in ((self.left_tip, x <= _x(self.left_tip)), (self.right_tip, x >= _x(self.right_tip))):
            if tip is not None:
                low, high = (
                    np.where(beyond, np.minimum(low, tip[1]), low),
                    np.where(beyond, np.maximum(high, tip[1]), high),
                )
        return low, high

    def _end(self, tip: Array | None, x: float, pick: Pick) -> int:
        if tip is None:
            return _at(self.ring_m, x, pick)
        return int(np.flatnonzero((self.ring_m == tip).all(axis=1))[0])


def _x(tip: Array | None) -> float:
    return np.nan if tip is None else float(tip[0])


def _at(ring: Array, x: float, pick: Pick) -> int:
    """Index of the lowest or highest vertex at an extreme x."""
    index = np.flatnonzero(ring[:, 0] == x)
    return int(index[pick(ring[index, 1])])


def _chain(ring: Array, start: int, end: int) -> Array:
    """Vertices from `start` to `end` counter-clockwise, both included; once round where they are one."""
    return ring[(start + np.arange((end - start - 1) % len(ring) + 2)) % len(ring)]


def _face(ring: Array, extreme: int) -> Array:
    """The run of steep rising edges through vertex `extreme`, in ring order."""
    first, last, count = extreme, extreme, len(ring)
    while last - first < count - 2 and _steep(ring[first % count - 1], ring[first % count]):
        first -= 1
    while last - first < count - 2 and _steep(ring[last % count], ring[(last + 1) % count]):
        last += 1
    return ring[np.arange(first, last + 1) % count]


def _steep(a: Array, b: Array) -> bool:
    return bool(b[1] - a[1] > _STEEP * abs(b[0] - a[0]))


def _heights(path: Array, x: Array, extreme: np.ufunc) -> Array:
    """Lowest or highest y of a polyline, x never falling, at positions x (n,)."""
    first = np.searchsorted(path[:, 0], x, side="left")
    beyond = np.searchsorted(path[:, 0], x, side="right")
    between = np.interp(x, path[:, 0], path[:, 1])
    at_vertex = extreme(path[np.minimum(first, len(path) - 1), 1], path[np.maximum(beyond - 1, 0), 1])
    return np.asarray(np.where(beyond > first, at_vertex, between))
