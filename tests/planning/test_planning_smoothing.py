"""The curve along a tight route, and the quadratic programme behind it, against a general solver."""

import clarabel
import numpy as np
import pytest
import scipy.sparse as sp
import shapely
from scipy.interpolate import BSpline
from shapely import Polygon, box

from sandwich_sitl.errors import MapError
from sandwich_sitl.planning.banded_qp import solve
from sandwich_sitl.planning.outlines import Outlines
from sandwich_sitl.planning.smoothing import Departure, along, smooth_route

BOUNDS = (0.0, 0.0, 60.0, 40.0)
ROUTE = np.array([[4.0, 8.0], [18.0, 8.0], [20.0, 26.0], [38.0, 27.0], [40.0, 8.0], [56.0, 8.0]])
BODIES = [box(22, 4, 36, 24.5), Polygon([(8, 12), (15, 12), (14, 24)])]
SOLID = shapely.union_all(BODIES)
OUTLINES = Outlines(BODIES, 0.0)


def sampled(curve: BSpline, count: int = 6000) -> np.ndarray:
    return np.asarray(curve(np.linspace(curve.t[0], curve.t[-1], count)))


def length(path: np.ndarray) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


@pytest.mark.parametrize("kept", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("bending", [0.3, 1.5, 5.0])
def test_curve_keeps_its_clearance_its_ends_and_the_routes_length(kept: float, bending: float) -> None:
    curve = smooth_route(ROUTE, OUTLINES, BOUNDS, kept, bending)
    points = sampled(curve)
    np.testing.assert_allclose(points[[0, -1]], ROUTE[[0, -1]], atol=1e-9)
    assert shapely.LineString(points).distance(SOLID) >= kept - 0.011
    assert box(*BOUNDS).buffer(1e-6).covers(shapely.LineString(points))
    assert length(points) <= 1.005 * length(ROUTE)


def test_curve_round_a_touched_corner_is_hardly_longer_than_the_tight_route() -> None:
    """A route that touches corners grown by the margin leaves no corner to cut, only bends to widen."""
    margin = 0.6
    route = np.array([[5.0, 15.0], [20 - margin, 10 - margin], [40 + margin, 10 - margin], [55.0, 20.0]])
    curve = smooth_route(route, Outlines([box(20, 10, 40, 30)], 0.0), BOUNDS, 0.8 * margin, 1.5)
    points = sampled(curve)
    assert length(points) <= 1.005 * length(route)
    d1, d2 = (curve.derivative(order)(np.linspace(0, curve.t[-1], 6000)) for order in (1, 2))
    curvature = np.abs(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.hypot(*d1.T) ** 3
    assert curvature.max() < 0.5


def test_route_too_near_an_obstacle_is_refused() -> None:
    with pytest.raises(MapError, match=r"passes .* m from an obstacle"):
        smooth_route(ROUTE, OUTLINES, BOUNDS, 5.0, 1.5)


def test_free_straight_route_stays_straight() -> None:
    line = np.array([[5.0, 5.0], [45.0, 35.0]])
    curve = smooth_route(line, Outlines([], 0.4), BOUNDS, 0.3, 1.5)
    points = sampled(curve)
    assert shapely.distance(shapely.points(points), shapely.LineString(line)).max() < 1e-6
    assert curve.t[-1] == pytest.approx(50.0)


def test_curve_begins_with_the_derivatives_it_is_given() -> None:
    departure = Departure(np.array([0.6, -0.8]), np.array([0.1, 0.05]), np.array([-0.02, 0.03]))
    curve = smooth_route(ROUTE, OUTLINES, BOUNDS, 0.3, 1.5, departure)
    np.testing.assert_allclose(curve(0.0), ROUTE[0], atol=1e-9)
    for order, wanted in enumerate((departure.tangent, departure.second, departure.third), start=1):
        np.testing.assert_allclose(curve.derivative(order)(0.0), wanted, atol=1e-7)


def test_along_walks_the_polyline() -> None:
    route = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]])
    np.testing.assert_allclose(
        along(route, np.array([0.0, 1.0, 3.0, 5.0, 7.0])), [[0, 0], [1, 0], [3, 0], [3, 2], [3, 4]]
    )


@pytest.mark.parametrize("seed", range(6))
def test_banded_solver_finds_the_optimum_a_general_solver_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, order = 24, 4
    difference = np.diff(np.eye(n), n=2, axis=0)
    P = np.diff(np.eye(n), axis=0).T @ np.diff(np.eye(n), axis=0) + 3.0 * difference.T @ difference
    H = np.array([np.pad(np.diag(P, d), (0, d)) for d in range(3)])
    start = np.cumsum(rng.normal(0, 1, (n, 2)), axis=0)
    free = np.ones(n, dtype=np.bool_)
    free[[0, 1, -1]] = False
    first = np.arange(n - order + 1)
    basis = rng.dirichlet(np.ones(order), len(first))
    sample = np.repeat(np.arange(len(first)), 3)
    angle = rng.uniform(0, 2 * np.pi, len(sample))
    rows = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(sample))])
    design = np.zeros((len(first), n))
    for k in range(len(first)):
        design[k, first[k] : first[k] + order] = basis[k]
    at = design @ start
    rows[:, 2] = (rows[:, :2] * at[sample]).sum(axis=1) + rng.uniform(0.0, 0.6, len(sample))
    solution, worst = solve(H, start, free, first, basis, rows, sample)
    assert worst < 1e-6
    np.testing.assert_array_equal(solution[~free], start[~free])

    G = rows[:, :1] * design[sample], rows[:, 1:2] * design[sample]
    held = np.eye(n)[~free]
    zero = np.zeros_like(held)
    A = np.vstack([np.hstack([held, zero]), np.hstack([zero, held]), np.hstack(G)])
    b = np.concatenate([start[~free, 0], start[~free, 1], rows[:, 2]])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.ZeroConeT(2 * len(held)), clarabel.NonnegativeConeT(len(rows))]
    whole = sp.csc_matrix(np.triu(np.kron(np.eye(2), P)))
    other = clarabel.DefaultSolver(whole, np.zeros(2 * n), sp.csc_matrix(A), b, cones, settings).solve()
    cost, least = (np.einsum("ai,ij,aj->", x, P, x) for x in (solution.T, np.reshape(other.x, (2, n))))
    assert cost == pytest.approx(least, rel=1e-4)
    np.testing.assert_allclose(solution.T.ravel(), other.x, atol=1e-3)


@pytest.mark.parametrize("gap_m", [3.0, 1.2])
def test_curve_takes_the_wished_berth_where_there_is_room_and_passes_a_gap_all_the_same(gap_m: float) -> None:
    """Round a lone corner twice the least clearance; then a gap that is narrower than the wish asks for."""
    kept, wished = 0.4, 0.8
    corner, low, high = box(16, 20, 24, 45), box(39, -5, 41, 20 - gap_m / 2), box(39, 20 + gap_m / 2, 41, 45)
    route = np.array([[4.0, 30.0], [16 - kept, 20 - kept], [24 + kept, 20 - kept], [40.0, 20.0], [56.0, 20.0]])
    outlines = Outlines([corner, low, high], 0.0)
    curve = smooth_route(route, outlines, BOUNDS, 0.9 * kept, 5.0, wished_clearance_m=wished)
    path = shapely.LineString(sampled(curve))
    assert path.distance(corner) >= wished - 0.02
    assert path.distance(shapely.union(low, high)) >= min(wished, gap_m / 2 - 0.35) - 0.02
    plain = shapely.LineString(sampled(smooth_route(route, outlines, BOUNDS, 0.9 * kept, 5.0)))
    assert plain.distance(corner) < wished - 0.2
    assert path.length < 1.02 * plain.length
