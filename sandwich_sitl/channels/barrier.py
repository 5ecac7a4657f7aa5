"""`Barrier`: an obstacle as the channel map sees it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.hull import VerticalHull
from sandwich_sitl.channels.tips import Tip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Barrier:
    """One obstacle, or several that interlock, as the map sees it: a ring, its hull and its name.

    `index` is the position of its (first) polygon in the grown world. `ring_m` (V, 2) is counter-clockwise and has the
    tips as vertices; thin bridges that tie interlocking obstacles together are part of it. A tip is None where
    the barrier ends at a border.
    """

    index: int
    name: str
    ring_m: Array
    hull: VerticalHull
    left_tip: Tip | None = None
    right_tip: Tip | None = None
