"""A flyable curve near the A* route: it stays inside a tube of proven clearance and bends as little as it can.

The route is resampled; each sample p_k may move inside the box |q_k - p_k| <= delta_k with delta_k = (c_k - c_min) /
sqrt(2), where c_k is its distance to the obstacles grown by the vehicle's radius. So every q_k keeps at least c_min.
Among those a QP takes the points of least sum of squared first, second and third differences: short, straight,
smooth.
"""

import numpy as np
import osqp
import scipy.sparse as sp
import shapely
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline
from shapely.geometry.base import BaseGeometry

from sandwich_sitl.channels.boundary import along_arc
from sandwich_sitl.errors import MapError

Array = NDArray[np.float64]

_WIDEST_M = 2.0  # half width of the tube where there is nothing near
_WEIGHTS = (1.0, 20.0, 100.0)  # of the first, second and third differences


def smooth_route(
    route: Array,
    solid: BaseGeometry,
    bounds: tuple[float, float, float, float],
    spacing_m: float,
    least_clearance_m: float,
) -> BSpline:
    """A C^4 curve s -> (x, y), s in metres along its control polyline, from route (n, 2).

    `solid` are the obstacles grown by the vehicle's radius.
    Raises `MapError` when the route itself is nearer to `solid` than `least_clearance_m`.
    """
    length = float(shapely.length(shapely.linestrings(route)))
    points = along_arc(route, max(12, int(np.ceil(length / spacing_m)) + 1))
    clearance = shapely.distance(shapely.points(points), solid) if not solid.is_empty else np.full(len(points), np.inf)
    if (clearance < least_clearance_m).any():
        raise MapError(f"route: passes {clearance.min():.3f} m from an obstacle grown by the vehicle's radius")
    half_width = np.minimum((clearance - least_clearance_m) / np.sqrt(2), _WIDEST_M)
    half_width[[0, 1, -2, -1]] = 0.0
    low, high = points - half_width[:, None], points + half_width[:, None]
    low, high = np.maximum(low, bounds[:2]), np.minimum(high, bounds[2:])
    smooth = np.column_stack([_smoothest(low[:, axis], high[:, axis]) for axis in range(2)])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(smooth, axis=0).T))])
    return make_interp_spline(arc, smooth, k=5)


def _smoothest(low: Array, high: Array) -> Array:
    n = len(low)
    P = sp.csc_matrix((n, n))
    for order, weight in enumerate(_WEIGHTS, start=1):
        difference = sp.csc_matrix(np.diff(np.eye(n), n=order, axis=0))
        P = P + weight * difference.T @ difference
    solver = osqp.OSQP()
    solver.setup(
        sp.csc_matrix(sp.triu(P)), np.zeros(n), sp.eye(n, format="csc"), low, high,
        verbose=False, eps_abs=1e-5, eps_rel=1e-6, max_iter=20000, polishing=False,
    )  # fmt: skip
    solution = np.asarray(solver.solve(raise_error=False).x, dtype=float)
    if not np.isfinite(solution).all():
        raise MapError("route: smoothing found no curve inside its tube")
    return np.asarray(np.clip(solution, low, high))
