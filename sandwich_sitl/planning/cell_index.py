"""Which convex cells hold a point, in microseconds: cells sorted into a uniform grid of boxes.

State: corners (C, 4, 2), counter-clockwise, metres; compressed rows of cell numbers, one row a box.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class CellIndex:
    """Cells `corners_m` (C, K, 2) and, for box (i, j) of a `shape` grid from `origin_m` on, the cells that reach it."""

    corners_m: Array
    origin_m: Array
    box_m: float
    shape: tuple[int, int]
    first: Ints
    cells: NDArray[np.int32]

    @classmethod
    def of(cls, corners_m: Array) -> "CellIndex":
        """Index of convex cells (C, K, 2), counter-clockwise, about one cell a box."""
        corners_m = np.ascontiguousarray(corners_m)
        if not len(corners_m):
            return cls(corners_m, np.zeros(2), 1.0, (1, 1), np.zeros(2, dtype=np.int64), np.empty(0, dtype=np.int32))
        x, y = corners_m[..., 0], corners_m[..., 1]
        low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
        extent = np.maximum(high - low, 1e-9)
        box = float(np.sqrt(extent[0] * extent[1] / len(corners_m)))
        n_x, n_y = (int(side / box) + 1 for side in extent)
        first, cells = _sorted_in(corners_m, low, box, n_x, n_y)
        return cls(corners_m, low, box, (n_x, n_y), first, cells)

    def holding(self, point: Array, tolerance_m: float = 1e-9) -> Ints:
        """Numbers of the cells that hold a point (2,), more than one on shared sides."""
        n_x, n_y = self.shape
        return np.asarray(
            _holding(
                self.corners_m, self.origin_m, self.box_m, n_x, n_y, self.first, self.cells,
                float(point[0]), float(point[1]), tolerance_m,
            )
        )  # fmt: skip


@njit(cache=True, nogil=True)
def rows_of(corners: Ints, nodes: int) -> tuple[Ints, Ints]:
    """For node numbers (C, K) of cells' corners: the cells at each node as compressed rows (first, cells)."""
    first = np.zeros(nodes + 1, dtype=np.int64)
    for cell in range(len(corners)):
        for v in range(corners.shape[1]):
            first[corners[cell, v] + 1] += 1
    for node in range(nodes):
        first[node + 1] += first[node]
    cells = np.empty(first[nodes], dtype=np.int64)
    filled = np.zeros(nodes, dtype=np.int64)
    for cell in range(len(corners)):
        for v in range(corners.shape[1]):
            node = corners[cell, v]
            cells[first[node] + filled[node]] = cell
            filled[node] += 1
    return first, cells


@njit(cache=True, nogil=True)
def _boxes(corners: Array, cell: int, origin: Array, box: float, n_x: int, n_y: int) -> tuple[int, int, int, int]:
    """First and last box along x and y that a cell reaches."""
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for v in range(corners.shape[1]):
        x0, x1 = min(x0, corners[cell, v, 0]), max(x1, corners[cell, v, 0])
        y0, y1 = min(y0, corners[cell, v, 1]), max(y1, corners[cell, v, 1])
    i0, i1 = int((x0 - origin[0]) / box), int((x1 - origin[0]) / box)
    j0, j1 = int((y0 - origin[1]) / box), int((y1 - origin[1]) / box)
    return max(i0, 0), min(i1, n_x - 1), max(j0, 0), min(j1, n_y - 1)


@njit(cache=True, nogil=True)
def _sorted_in(corners: Array, origin: Array, box: float, n_x: int, n_y: int) -> tuple[Ints, NDArray[np.int32]]:
    first = np.zeros(n_x * n_y + 1, dtype=np.int64)
    for cell in range(len(corners)):
        i0, i1, j0, j1 = _boxes(corners, cell, origin, box, n_x, n_y)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                first[i * n_y + j + 1] += 1
    for k in range(n_x * n_y):
        first[k + 1] += first[k]
    cells = np.empty(first[-1], dtype=np.int32)
    filled = np.zeros(n_x * n_y, dtype=np.int64)
    for cell in range(len(corners)):
        i0, i1, j0, j1 = _boxes(corners, cell, origin, box, n_x, n_y)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                k = i * n_y + j
                cells[first[k] + filled[k]] = cell
                filled[k] += 1
    return first, cells


@njit(cache=True, nogil=True)
def _holding(
    corners: Array,
    origin: Array,
    box: float,
    n_x: int,
    n_y: int,
    first: Ints,
    cells: NDArray[np.int32],
    x: float,
    y: float,
    tolerance: float,
) -> Ints:
    found = np.empty(16, dtype=np.int64)
    count = 0
    i0, i1 = int((x - tolerance - origin[0]) / box), int((x + tolerance - origin[0]) / box)
    j0, j1 = int((y - tolerance - origin[1]) / box), int((y + tolerance - origin[1]) / box)
    for i in range(max(i0, 0), min(i1, n_x - 1) + 1):
        for j in range(max(j0, 0), min(j1, n_y - 1) + 1):
            for k in range(first[i * n_y + j], first[i * n_y + j + 1]):
                cell = cells[k]
                if not _holds(corners, cell, x, y, tolerance):
                    continue
                known = False
                for m in range(count):
                    known |= found[m] == cell
                if not known:
                    if count == len(found):
                        found = np.concatenate((found, np.empty_like(found)))
                    found[count] = cell
                    count += 1
    return np.sort(found[:count])


@njit(cache=True, nogil=True)
def _holds(corners: Array, cell: int, x: float, y: float, tolerance: float) -> bool:
    sides = corners.shape[1]
    for v in range(sides):
        w = (v + 1) % sides
        s_x, s_y = corners[cell, w, 0] - corners[cell, v, 0], corners[cell, w, 1] - corners[cell, v, 1]
        left = s_x * (y - corners[cell, v, 1]) - s_y * (x - corners[cell, v, 0])
        if left < -tolerance * np.sqrt(s_x * s_x + s_y * s_y):
            return False
    return True
