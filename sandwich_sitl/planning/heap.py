"""A binary heap of numbers by cost, in arrays that compiled searches keep."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(cache=True, nogil=True)
def push(cost: Array, node: Ints, size: int, c: float, v: int) -> None:
    """Add to a binary heap of `size` entries."""
    k = size
    while k > 0 and cost[(k - 1) // 2] > c:
        cost[k], node[k] = cost[(k - 1) // 2], node[(k - 1) // 2]
        k = (k - 1) // 2
    cost[k], node[k] = c, v


@njit(cache=True, nogil=True)
def pop(cost: Array, node: Ints, size: int) -> None:
    """Take the first entry away; `size` are left."""
    c, v = cost[size], node[size]
    k = 0
    while 2 * k + 1 < size:
        child = 2 * k + 1
        if child + 1 < size and cost[child + 1] < cost[child]:
            child += 1
        if cost[child] >= c:
            break
        cost[k], node[k] = cost[child], node[child]
        k = child
    cost[k], node[k] = c, v


@njit(cache=True, nogil=True)
def doubled(values):  # type: ignore[no-untyped-def]
    """A copy with room for as much again."""
    longer = np.empty(2 * len(values), dtype=values.dtype)
    longer[: len(values)] = values
    return longer
