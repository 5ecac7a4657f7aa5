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

Where regions have altitudes (floors) they are prisms, obstacles end at their heights, and

 2. holds for every obstacle of height  h + radius > z_low - b,  with b the same bound at the fastest climb or descent
    of m: the others lie below the region, whatever the vehicle does between samples;
 3. holds in z too, with the band's two ends for sides.
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
    reference: Reference, corridor: Corridor, obstacles_m: Sequence[Array], radius_m: float, interval_s: float,
    heights_m: Array | None = None,
) -> CorridorProof:  # fmt: skip
    """Check all of the above for a vehicle of `radius_m` held in its regions every `interval_s`.

    `obstacles_m` are rings (V, 2) that were not grown; `heights_m` (n,), by default infinite, count where regions have
    altitudes.
    """
    t, xyz, region = reference.t_s, reference.xyz_m, reference.region
    polygons = [shapely.Polygon(ring) for ring in corridor.polygons_m]
    flat = _bounds(t, xyz[:, :2], region, len(polygons), interval_s)
    low = np.full(len(polygons), -np.inf)
    if len(corridor.z_m):
        low = corridor.z_m[:, 0] - _bounds(t, xyz[:, 2:], region, len(polygons), interval_s)
    tops = (np.full(len(obstacles_m), np.inf) if heights_m is None else heights_m) + radius_m
    distance, headroom = _least_distances(polygons, low, obstacles_m, tops, radius_m + flat.max() + 1.0, radius_m)
    clearance = distance - radius_m
    margin = _least_margin(corridor, region, xyz)
    problems = [
        (_faults(corridor) + ~shapely.is_valid(polygons), "region {} is not the convex polygon of its half-planes"),
        (clearance < flat - _HAIR_M, "region {} comes too near an obstacle"),
    ]
    found = [text.format(int(np.argmax(bad))) for bad, text in problems if bad.any()]
    if margin.min() <= _sagitta(t, xyz if len(corridor.z_m) else xyz[:, :2]):
        k = int(np.argmin(margin))
        found.append(f"step {k} leaves its region at ({xyz[k, 0]:.2f}, {xyz[k, 1]:.2f})")
    return CorridorProof(
        proven=not found,
        problem="; ".join(found),
        steps=len(xyz),
        least_margin_m=float(margin.min()),
        least_clearance_m=float((clearance - flat).min()),
        between_samples_m=float(flat.max()),
        least_headroom_m=headroom if np.isfinite(headroom) else None,
    )


def _sagitta(t: Array, points: Array) -> float:
    """The most that a motion through points (n, d) leaves its chords by."""
    dt = np.diff(t)
    change = np.diff(np.diff(points, axis=0) / dt[:, None], axis=0)
    acceleration = np.linalg.norm(change, axis=1) / dt[1:]
    return float(np.max(acceleration, initial=0.0)) * float(dt.max()) ** 2 / 8


def _bounds(t: Array, points: Array, region: NDArray[np.int64], count: int, interval_s: float) -> Array:
    """`between_samples_m` (M,) at the fastest step of each region, of the motion's components (n, d)."""
    fastest = np.zeros(count)
    np.maximum.at(fastest, region, speeds_mps(t, points))
    return between_samples_m(fastest, interval_s)


def _least_distances(
    polygons: list[shapely.Polygon],
    low: Array,
    obstacles_m: Sequence[Array],
    tops: Array,
    reach_m: float,
    radius_m: float,
) -> tuple[Array, float]:
    """Distance (M,) of each polygon to the obstacles with tops above `low` (M,), `reach_m` where none is nearer.

    And the least height of `low` over the other obstacles that a vehicle of `radius_m` may be above, infinite without.
    """
    least, headroom = np.full(len(polygons), reach_m), np.inf
    if obstacles_m:
        solids = np.array([shapely.Polygon(ring) for ring in obstacles_m], dtype=object)
        which, near = shapely.STRtree(solids).query(polygons, predicate="dwithin", distance=reach_m)
        distance = shapely.distance(np.array(polygons, dtype=object)[which], solids[near])
        over = tops[near] <= low[which]
        np.minimum.at(least, which[~over], distance[~over])
        under = over & (distance <= radius_m)
        headroom = float(np.min((low[which] - tops[near])[under], initial=np.inf))
    return least, headroom


def _least_margin(corridor: Corridor, region: NDArray[np.int64], xyz: Array) -> Array:
    """Distance (n,) of each point and of the one after it to the nearest side of the point's region."""
    here, after = _margin(corridor, region, xyz), _margin(corridor, region[:-1], xyz[1:])
    return np.asarray(np.minimum(here, np.append(after, np.inf)))


def _margin(corridor: Corridor, region: NDArray[np.int64], xyz: Array) -> Array:
    """Distance (n,) of points (n, 3) to the nearest side of their region, negative outside."""
    sides = corridor.Gamma[region] - np.einsum("kfd,kd->kf", corridor.Lambda[region], xyz[:, :2])
    margin = sides.min(axis=1)
    if len(corridor.z_m):
        low, high = corridor.z_m[region].T
        margin = np.minimum(margin, np.minimum(xyz[:, 2] - low, high - xyz[:, 2]))
    return np.asarray(margin)


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
