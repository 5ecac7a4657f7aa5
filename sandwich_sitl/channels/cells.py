"""Sines, angles and areas of quads, many at once.

The sine of a corner is its Jacobian over the product of its two edge lengths: not positive means folded.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quad_sines(corners: Array) -> Array:
    """Sines (..., 4) of the corner angles of quads (..., 4, 2); -1 where a side has no length."""
    return np.asarray(_sines(np.ascontiguousarray(corners.reshape(-1, 4, 2))).reshape(corners.shape[:-1]))


def quad_angles(corners: Array) -> Array:
    """Angles (n, 4) in radians at the corners of quads (n, 4, 2)."""
    return np.asarray(_angles(np.ascontiguousarray(corners)))


def quad_sides(corners: Array) -> Array:
    """Lengths (n, 4) of the sides of quads (n, 4, 2)."""
    x, y = np.moveaxis(corners[:, [1, 2, 3, 0]] - corners, -1, 0)
    return np.asarray(np.hypot(x, y))


def quad_areas(corners: Array) -> Array:
    """Signed areas (n,) of quads (n, 4, 2)."""
    one, other = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return np.asarray((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / 2)


@njit(cache=True, nogil=True)
def _corner(quads: Array, k: int, v: int) -> tuple[float, float, float]:
    """Cross product, dot product and product of lengths of the edges from vertex v of quad k."""
    x, y = quads[k, v, 0], quads[k, v, 1]
    a_x, a_y = quads[k, (v + 1) % 4, 0] - x, quads[k, (v + 1) % 4, 1] - y
    b_x, b_y = quads[k, (v + 3) % 4, 0] - x, quads[k, (v + 3) % 4, 1] - y
    product = np.sqrt((a_x * a_x + a_y * a_y) * (b_x * b_x + b_y * b_y))
    return a_x * b_y - a_y * b_x, a_x * b_x + a_y * b_y, product


@njit(cache=True, nogil=True)
def _sines(quads: Array) -> Array:
    sines = np.empty((len(quads), 4))
    for k in range(len(quads)):
        for v in range(4):
            cross, _, product = _corner(quads, k, v)
            sines[k, v] = cross / product if product > 0.0 else -1.0
    return sines


@njit(cache=True, nogil=True)
def _angles(quads: Array) -> Array:
    angles = np.empty((len(quads), 4))
    for k in range(len(quads)):
        for v in range(4):
            cross, dot, _ = _corner(quads, k, v)
            angles[k, v] = np.arctan2(cross, dot)
    return angles
