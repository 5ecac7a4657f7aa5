"""Fewer vertices on a curve y(x), moved vertically by no more than a tolerance of its own at each of them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def thinned(path: Array, tolerance_m: Array) -> Array:
    """Vertices (m, 2) of an x-monotone polyline (n, 2), ends included (Douglas and Peucker, with vertical distance).

    Between the kept ones the chord passes every dropped vertex within its `tolerance_m` (n,).
    """
    kept = np.zeros(len(path), dtype=bool)
    kept[[0, -1]] = True
    spans = [(0, len(path) - 1)]
    while spans:
        first, last = spans.pop()
        inner = slice(first + 1, last)
        run = path[last, 0] - path[first, 0]
        share = (path[inner, 0] - path[first, 0]) / run if run > 0 else np.zeros(max(0, last - first - 1))
        chord = path[first, 1] + share * (path[last, 1] - path[first, 1])
        excess = np.abs(path[inner, 1] - chord) - tolerance_m[inner]
        if excess.size and excess.max() > 0:
            split = first + 1 + int(np.argmax(excess))
            kept[split] = True
            spans += [(first, split), (split, last)]
    return path[kept]
