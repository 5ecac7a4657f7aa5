"""The two sides of a barrier: its ring cut at the left and the right end into a lower and an upper wall.

A dividing streamline arrives at the left tip, splits, and joins again at the right tip (paper, Fig. BoundaryMapping;
notes N3). A barrier on the left or right border has no tip there: its walls begin or end at the border, apart from
each other. A barrier on the bottom border has an upper wall only, one on the top border a lower wall only.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.barrier import Barrier
from sandwich_sitl.channels.tips import Tip

Array = NDArray[np.float64]
Bounds = tuple[float, float, float, float]


@dataclass(frozen=True)
class Walls:
    """Polylines (V, 2) from left to right along the underside and the upper side of a barrier."""

    lower: Array
    upper: Array


def walls_between_channels(barrier: Barrier, bounds: Bounds) -> Walls:
    """Both walls of a barrier that has a channel below and one above."""
    ring = barrier.ring_m
    left, right = _ends(ring, barrier.left_tip, bounds[0]), _ends(ring, barrier.right_tip, bounds[2])
    return Walls(
        lower=_chain(ring, left[0], right[0]),
        upper=_chain(ring, right[1], left[1])[::-1],
    )


def wall_on_border(barrier: Barrier, bounds: Bounds, *, top: bool) -> Array:
    """The one wall (V, 2), left to right, of a barrier that touches the bottom (or the `top`) border."""
    ring = barrier.ring_m
    border_y = bounds[3] if top else bounds[1]
    contact = np.flatnonzero(ring[:, 1] == border_y)
    ends = []
    for border_x, pick in ((bounds[0], np.argmin), (bounds[2], np.argmax)):
        side = np.flatnonzero(ring[:, 0] == border_x)
        if side.size:
            ends.append(int(side[np.argmin(ring[side, 1]) if top else np.argmax(ring[side, 1])]))
        else:
            ends.append(int(contact[pick(ring[contact, 0])]))
    left, right = ends
    return _chain(ring, left, right) if top else _chain(ring, right, left)[::-1]


def _ends(ring: Array, tip: Tip | None, border_x: float) -> tuple[int, int]:
    """Vertices where the lower and the upper wall end: the tip twice, or the lowest and highest point on the border."""
    if tip is not None:
        at = int(np.flatnonzero((ring == tip.point_m).all(axis=1))[0])
        return at, at
    side = np.flatnonzero(ring[:, 0] == border_x)
    return int(side[np.argmin(ring[side, 1])]), int(side[np.argmax(ring[side, 1])])


def _chain(ring: Array, start: int, end: int) -> Array:
    """Vertices from `start` to `end` counter-clockwise, both included; once round where they are one."""
    count = (end - start - 1) % len(ring) + 2
    return ring[(start + np.arange(count)) % len(ring)]
