"""A free-space decomposition of the same way, as a yardstick for the corridor: regions with as many sides as they like.

Like IRIS (Deits and Tedrake 2015): grow a region round the stretch in the metric of an ellipse, take the ellipse of the
region's second moments for the next metric, keep the largest region found. The same reach as the corridor's regions, no
limit of eight sides, and nothing kept for what happens between samples.
"""

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.planning.corridor import REACH_M, hull
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.planning.inflation import inflate
from sandwich_sitl.planning.outlines import Outlines

Array = NDArray[np.float64]

_ROUNDS = 3
_MOST_FACES = 60
_WIDE = 50.0  # half width of the transformed frame, in units of the metric


def areas_m2(reference: Reference, corridor: Corridor, outlines: Outlines) -> tuple[float, float, float]:
    """Mean area per control step of the corridor's regions, of the paper's quadrangles and of the decomposition.

    `outlines` are those of the obstacles grown by the vehicle's radius, upwards too.
    """
    region = reference.region
    used = np.unique(region)
    low = corridor.z_m[used, 0] if len(corridor.z_m) else np.full(len(used), -np.inf)
    hulls = [hull(reference.xyz_m[region == m, :2]) for m in used]
    frames = np.array([_frame(h, corridor.polygons_m[m]) for h, m in zip(hulls, used, strict=True)])
    own = shapely.area([shapely.Polygon(corridor.polygons_m[m]) for m in used])
    paper = shapely.area([shapely.Polygon(corridor.neighbours_m[m]) for m in used])
    near = [edges[above > z] for (edges, above), z in zip(outlines.near_with_tops(frames), low, strict=True)]
    free = [_largest(h, edges, frame) for h, edges, frame in zip(hulls, near, frames, strict=True)]
    steps = np.array([np.count_nonzero(region == m) for m in used])
    mean = [float(np.average(areas, weights=steps)) for areas in (own, paper, np.array(free))]
    return mean[0], mean[1], mean[2]


def _frame(seed: Array, ring: Array) -> Array:
    """(x_min, y_min, x_max, y_max) of what a region may reach: as far as the corridor's region has."""
    points = np.concatenate([seed - REACH_M, seed + REACH_M, ring])
    return np.concatenate([points.min(axis=0), points.max(axis=0)])


def _largest(seed: Array, edges: Array, frame: Array) -> float:
    """Area of the largest region round a seed (S, 2) inside a frame."""
    x_min, y_min, x_max, y_max = frame
    corners = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
    walls = np.concatenate([edges, np.hstack([corners, np.roll(corners, -1, axis=0)])])
    metric, best = np.eye(2), 0.0
    for _ in range(_ROUNDS):
        centre = seed.mean(axis=0)
        ends = (walls.reshape(-1, 2) - centre) @ metric.T
        box = np.array([-_WIDE, -_WIDE, _WIDE, _WIDE]) * np.linalg.norm(metric, 2) * REACH_M
        _, ring = inflate((seed - centre) @ metric.T, np.ascontiguousarray(ends.reshape(-1, 4)), box, 0.0, _MOST_FACES)
        if len(ring) == 0:
            break
        ring = ring @ np.linalg.inv(metric).T
        best = max(best, float(shapely.Polygon(ring).area))
        values, vectors = np.linalg.eigh(_second_moments(ring))
        metric = vectors @ np.diag(1 / np.sqrt(values)) @ vectors.T
    return best


def _second_moments(ring: Array) -> Array:
    """Covariance (2, 2) of a uniform convex polygon, by its triangles."""
    a, b, c = ring[0], ring[1:-1], ring[2:]
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    middle = np.average((a + b + c) / 3, axis=0, weights=area)
    p, q, r = a - middle, b - middle, c - middle
    total = p + q + r
    outer = sum(np.einsum("ki,kj->kij", x, x) for x in (np.broadcast_to(p, q.shape), q, r, total))
    return np.asarray(np.average(outer / 12, axis=0, weights=area))
