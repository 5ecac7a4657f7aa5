"""A flyable curve near a tight route: it swings wide before a corner where there is room and keeps its clearance.

A route of straight legs touches corners of the grown obstacles. The curve is a quintic B-spline c(u), C^4, with u in
metres along the route, of least  int |c'|^2 + w int (B^2 |c''|^2 + B^4 |c'''|^2) du  (B a bending length), subject to
c(u_k) lying in a convex region free of obstacles round the route's point at u_k (`inflation`). The regions are then
grown again round the curve, and the curve solved again: every round starts from a curve that the new regions hold.
Bending less costs length: w is lowered until the length is within `_LONGEST` of the route's.

A fast vehicle must slow down near an obstacle, so it is given a wider berth where there is room: each region draws back
from its obstacles, by all of the wished berth or by the share of it that leaves a region.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csr_array, diags_array

from sandwich_sitl.errors import MapError
from sandwich_sitl.planning.banded_qp import solve
from sandwich_sitl.planning.inflation import drawn_back, inflate
from sandwich_sitl.planning.outlines import Outlines

Array = NDArray[np.float64]

_DEGREE = 5
_KNOTS_M = (0.6, 0.3, 0.15)  # spacing of the knots; finer when a coarse curve cannot keep its clearance
_WEIGHTS = (1.0, 0.3, 0.1, 0.03, 0.01)
_LONGEST = 1.004
_ROUNDS = 2
_REACHES_M = (2.5, 1.0, 0.4, 0.15, 0.05)  # half widths of the boxes that bound the regions, tried in turn
_FACES = 8
_CHECK_M = 0.05
_BULGE = 1.05  # the samples keep this much more, for what the curve does between them
_BERTHS = (1.0, 0.5, 0.25, 0.0)  # of the wished one, tried in turn: a berth may cost more way than it saves time
_BERTH_PER_M = 0.25  # of way from the nearer end: near an end the vehicle is slow, and the end itself is where it is
_SLACK_M = 0.01  # by which the curve may come nearer than asked between the samples that hold it


@dataclass(frozen=True)
class Departure:
    """How a curve begins that a moving vehicle has to join: c', c'', c''' (2,) at its first point."""

    tangent: Array
    second: Array
    third: Array


def smooth_route(
    route: Array, outlines: Outlines, bounds: tuple[float, float, float, float], least_clearance_m: float,
    bending_m: float, departure: Departure | None = None, wished_clearance_m: float = 0.0,
) -> BSpline:  # fmt: skip
    """A C^4 curve u -> (x, y), u in metres along `route` (n, 2), that keeps `least_clearance_m` from `outlines`.

    Where there is room it keeps `wished_clearance_m`. Raises `MapError` when the route itself is too near.
    """
    if not outlines.keeps(route, least_clearance_m):
        nearest = outlines.distance_m(route)
        raise MapError(f"route: passes {nearest:.3f} m from an obstacle grown by the vehicle's radius")
    berth = max(0.0, wished_clearance_m - least_clearance_m)
    for share in _BERTHS if berth > 0.0 else (0.0,):
        kept = _Kept(outlines, bounds, least_clearance_m, share * berth)
        curve = _smoothed(route, kept, bending_m, departure)
        if curve is not None:
            return curve
    raise MapError("route: no smooth curve keeps its clearance along it")


@dataclass(frozen=True)
class _Kept:
    """What a curve keeps: its distance from outlines and bounds, and the berth it takes besides where there is room."""

    outlines: Outlines
    bounds: tuple[float, float, float, float]
    clearance_m: float
    berth_m: float


def _smoothed(route: Array, kept: _Kept, bending_m: float, departure: Departure | None) -> BSpline | None:
    """The curve with the coarsest knots that are fine enough, bent as little as its length allows.

    None when there is none. With a berth it must be coarse and short enough: a lesser berth is the better remedy.
    """
    legs = np.diff(route, axis=0)
    length = float(np.hypot(*legs.T).sum())
    turns = np.diff(np.unwrap(np.arctan2(legs[:, 1], legs[:, 0])))
    longest = _LONGEST * (length + kept.berth_m * float(np.abs(turns).sum()))  # round a corner at the berth's radius
    for knots_m in _KNOTS_M[:1] if kept.berth_m > 0.0 else _KNOTS_M:
        spline = _Spline(length, knots_m)
        shortest: BSpline | None = None
        for weight in _WEIGHTS:
            energy = spline.energy((1.0, weight * bending_m**2, weight * bending_m**4))
            curve = _curve(spline, energy, route, kept, departure)
            if curve is None:
                continue
            shortest = curve
            if _curve_length(curve) <= longest:
                return curve
        if shortest is not None and kept.berth_m == 0.0:
            return shortest
    return None


def _count(length: float, spacing: float) -> int:
    return max(2, int(np.ceil(length / spacing)) + 1)


def _curve_length(curve: BSpline) -> float:
    points = curve(np.linspace(curve.t[0], curve.t[-1], _count(float(curve.t[-1]), _CHECK_M)))
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


class _Spline:
    """Clamped quintic splines over [0, length] on knots at most `knots_m` apart."""

    def __init__(self, length: float, knots_m: float) -> None:
        spans = max(_DEGREE + 1, _count(length, knots_m) - 1)
        self.knots = np.concatenate([np.zeros(_DEGREE), np.linspace(0.0, length, spans + 1), np.full(_DEGREE, length)])
        self.size = spans + _DEGREE
        self.places = np.array([self.knots[i + 1 : i + _DEGREE + 1].mean() for i in range(self.size)])
        self.u = np.linspace(0.0, length, 2 * spans + 1)
        design = BSpline.design_matrix(self.u, self.knots, _DEGREE)
        self.basis = np.ascontiguousarray(design.data.reshape(len(self.u), -1))
        self.first = np.ascontiguousarray(design.indices.reshape(len(self.u), -1)[:, 0].astype(np.int64))
        self._energies = _energies(self.knots, self.size)

    def energy(self, weights: tuple[float, float, float]) -> Array:
        """Diagonals (degree + 1, n) of the matrix of  sum_nu w_nu int |c^(nu)|^2 du."""
        return np.asarray(sum(w * H for w, H in zip(weights, self._energies, strict=True)))


def _curve(spline: _Spline, energy: Array, route: Array, kept: _Kept, departure: Departure | None) -> BSpline | None:
    """The curve of least energy, or None when none was found that keeps its clearance."""
    control = along(route, spline.places)
    free = np.ones(spline.size, dtype=np.bool_)
    free[[0, -1]] = False
    if departure is not None:
        control[:4], free[:4] = _first_points(spline.knots, route[0], departure), False
    held = slice(1, -1)
    around = along(route, spline.u)
    to_end = np.minimum(spline.u, spline.u[-1] - spline.u)[held]
    curve = None
    for _ in range(_ROUNDS):
        found = _regions(around[held], kept, np.minimum(kept.berth_m, _BERTH_PER_M * to_end))
        if found is None:
            return curve
        rows, sample = found
        solution, worst = solve(energy, control, free, spline.first[held], spline.basis[held], rows, sample)
        next_curve = BSpline(spline.knots, solution, _DEGREE)
        if not np.isfinite(solution).all() or worst > _SLACK_M or not _clear(next_curve, kept):
            return curve
        curve, control = next_curve, solution
        around = np.asarray(curve(spline.u))
    return curve


def along(route: Array, u: Array) -> Array:
    """Points (m, 2) at arc lengths `u` (m,) of a polyline (n, 2)."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route, axis=0).T))])
    return np.column_stack([np.interp(u, arc, route[:, axis]) for axis in range(2)])


def _clear(curve: BSpline, kept: _Kept) -> bool:
    points = curve(np.linspace(curve.t[0], curve.t[-1], _count(float(curve.t[-1]), _CHECK_M)))
    return kept.outlines.keeps(points, kept.clearance_m - min(_SLACK_M, 0.2 * kept.clearance_m))


def _regions(points: Array, kept: _Kept, berths_m: Array) -> tuple[Array, NDArray[np.int64]] | None:
    """Half-planes (r, 3) of a free region round each point (n, 2) and the point (r,) each belongs to.

    The regions keep the clearance, and the berths (n,) where they leave anything of the region.
    """
    bounds, clearance = kept.bounds, _BULGE * kept.clearance_m
    wide = np.hstack([points - _REACHES_M[0] - clearance, points + _REACHES_M[0] + clearance])
    rows, sample = [], []
    for k, (point, edges) in enumerate(zip(points, kept.outlines.near(wide), strict=True)):
        for reach in _REACHES_M:
            box = np.array([
                max(point[0] - reach, min(bounds[0], point[0])), max(point[1] - reach, min(bounds[1], point[1])),
                min(point[0] + reach, max(bounds[2], point[0])), min(point[1] + reach, max(bounds[3], point[1])),
            ])  # fmt: skip
            planes, _ = inflate(point[None], edges, box, clearance, _FACES)
            if len(planes):
                rows.append(drawn_back(planes, box, berths_m[k]) if len(edges) and berths_m[k] > 0.0 else planes)
                sample.append(np.full(len(planes), k))
                break
        else:
            return None
    return np.concatenate(rows), np.concatenate(sample).astype(np.int64)


def _energies(knots: Array, n: int) -> list[Array]:
    """Diagonals (degree + 1, n) of the matrices of  int |c^(nu)|^2 du,  nu = 1, 2, 3, by exact Gauss quadrature."""
    nodes, gauss = np.polynomial.legendre.leggauss(_DEGREE)
    breaks = np.unique(knots)
    half = np.diff(breaks) / 2
    u = (breaks[:-1, None] + half[:, None] * (1 + nodes)).ravel()
    weight = diags_array((half[:, None] * gauss).ravel())
    to_control: Any = csr_array(np.eye(n))
    inner, found = knots, []
    for degree in range(_DEGREE - 1, _DEGREE - 4, -1):
        size = to_control.shape[0]
        at = np.arange(size - 1)
        rise = (degree + 1) / (inner[degree + 2 : degree + 1 + size] - inner[1:size])
        difference = csr_array((np.column_stack([-rise, rise]).ravel(), np.column_stack([at, at + 1]).ravel(),
                                2 * np.arange(size)), shape=(size - 1, size))  # fmt: skip
        to_control = difference @ to_control
        inner = inner[1:-1]
        values = BSpline.design_matrix(u, inner, degree) @ to_control
        H = (values.T @ (weight @ values)).todia()
        found.append(np.array([np.pad(H.diagonal(d), (0, d)) for d in range(_DEGREE + 1)]))
    return found


def _first_points(knots: Array, start: Array, departure: Departure) -> Array:
    """The first four control points (4, 2) of a clamped spline with the given value and first three derivatives."""
    basis = BSpline(knots[: 2 * (_DEGREE + 1)], np.eye(_DEGREE + 1), _DEGREE)
    rows = np.array([basis.derivative(order)(0.0)[:4] if order else basis(0.0)[:4] for order in range(4)])
    wanted = np.array([start, departure.tangent, departure.second, departure.third])
    return np.asarray(np.linalg.solve(rows, wanted))
