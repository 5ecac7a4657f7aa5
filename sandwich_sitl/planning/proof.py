"""Proof that a reference and its corridor are safe, by exact geometry on the obstacles as they were given.

It shares nothing with the way regions are made: distances between polygons, signs of half-planes. For every region m
and every control step k with its region R_k:

 1. the half-planes of m are the sides of its polygon, which is convex: each side lies on one of them and no corner lies
    beyond any of them, so their intersection is the polygon;
 2. the polygon keeps from every obstacle the vehicle's radius and what the tracker may leave it by between samples
    (`between_samples_m` at the fastest step of m);
 3. r_k and r_{k+1} lie in R_k with a margin of at least a dt^2 / 8, the most that the reference between the two leaves
    their chord by: so the reference lies in the union of the regions throughout, and R_k and R_{k+1} overlap round
    r_{k+1}.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.planning.corridor import between_samples_m, speeds_mps
from sandwich_sitl.planning.flight_plan import Corridor, CorridorProof, Reference

Array = NDArray[np.float64]

_ON_M = 1e-6
_HAIR_M = 1e-9


def prove_corridor(
    reference: Reference, corridor: Corridor, obstacles_m: Sequence[Array], radius_m: float, interval_s: float
) -> CorridorProof:
    """Check all of the above for a vehicle of `radius_m` held in its regions every `interval_s`.

    `obstacles_m` are rings (V, 2) that were not grown.
    """
    t, xy, region = reference.t_s, reference.xyz_m[:, :2], reference.region
    polygons = [shapely.Polygon(ring) for ring in corridor.polygons_m]
    bound = _bounds(t, xy, region, len(polygons), interval_s)
    clearance = _least_distance(polygons, obstacles_m, radius_m + bound.max() + 1.0) - radius_m
    steps = np.arange(len(xy) - 1)
    dt = np.diff(t)
    acceleration = np.hypot(*np.diff(np.diff(xy, axis=0) / dt[:, None], axis=0).T) / dt[1:] if len(xy) > 2 else dt[:0]
    sagitta = float(np.max(acceleration, initial=0.0)) * float(dt.max()) ** 2 / 8
    margin = np.minimum(_margin(corridor, region, xy), np.append(_margin(corridor, region[steps], xy[1:]), np.inf))
    problems = [
        (_faults(corridor) + ~shapely.is_valid(polygons), "region {} is not the convex polygon of its half-planes"),
        (clearance < bound - _HAIR_M, "region {} comes too near an obstacle"),
    ]
    found = [text.format(int(np.argmax(bad))) for bad, text in problems if bad.any()]
    if margin.min() <= sagitta:
        k = int(np.argmin(margin))
        found.append(f"step {k} leaves its region at ({xy[k, 0]:.2f}, {xy[k, 1]:.2f})")
    return CorridorProof(
        proven=not found,
        problem="; ".join(found),
        steps=len(xy),
        least_margin_m=float(margin.min()),
        least_clearance_m=float((clearance - bound).min()),
        between_samples_m=float(bound.max()),
    )


def _bounds(t: Array, xy: Array, region: NDArray[np.int64], count: int, interval_s: float) -> Array:
    """`between_samples_m` (M,) at the fastest step of each region."""
    fastest = np.zeros(count)
    np.maximum.at(fastest, region, speeds_mps(t, xy))
    return between_samples_m(fastest, interval_s)


def _least_distance(polygons: list[shapely.Polygon], obstacles_m: Sequence[Array], reach_m: float) -> Array:
    """Distance (M,) of each polygon to the nearest obstacle, `reach_m` where none is nearer."""
    least = np.full(len(polygons), reach_m)
    if obstacles_m:
        tree = shapely.STRtree([shapely.Polygon(ring) for ring in obstacles_m])
        (which, _), distance = tree.query_nearest(polygons, max_distance=reach_m, return_distance=True)
        np.minimum.at(least, which, distance)
    return least


def _margin(corridor: Corridor, region: NDArray[np.int64], xy: Array) -> Array:
    """Distance (n,) of points (n, 2) to the nearest side of their region, negative outside."""
    return np.asarray((corridor.Gamma[region] - np.einsum("kfd,kd->kf", corridor.Lambda[region], xy)).min(axis=1))


def _faults(corridor: Corridor) -> NDArray[np.bool_]:
    """Regions (M,) whose polygon is not the intersection of their half-planes."""
    faulty = np.zeros(len(corridor.polygons_m), dtype=np.bool_)
    for m, ring in enumerate(corridor.polygons_m):
        beyond = ring @ corridor.Lambda[m].T - corridor.Gamma[m]
        on = np.abs(beyond) < _ON_M
        side = np.roll(ring, -1, axis=0) - ring
        turn = side[:, 0] * np.roll(side[:, 1], -1) - side[:, 1] * np.roll(side[:, 0], -1)
        unit = np.abs(np.hypot(*corridor.Lambda[m].T) - 1.0).max() < _ON_M
        faulty[m] = not (unit and beyond.max() < _ON_M and (on & np.roll(on, -1, axis=0)).any(axis=1).all()
                         and turn.min() > -_ON_M)  # fmt: skip
    return faulty
