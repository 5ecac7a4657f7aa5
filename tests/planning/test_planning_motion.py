"""Smoothing, time law and corridor: what they promise, measured on the result."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline
from shapely import Polygon, box

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.errors import MapError
from sandwich_sitl.planning.corridor import FACES, mended_corridor, neighbouring_quadrangle, paper_corridor
from sandwich_sitl.planning.flight_plan import Corridor
from sandwich_sitl.planning.smoothing import smooth_route
from sandwich_sitl.planning.time_law import climb, rest_to_rest
from sandwich_sitl.world.grow import grow
from sandwich_sitl.world.world import Obstacle, World

BOUNDS = (0.0, 0.0, 60.0, 40.0)
ROUTE = np.array([[4.0, 8.0], [18.0, 8.0], [20.0, 26.0], [38.0, 27.0], [40.0, 8.0], [56.0, 8.0]])
SOLID = shapely.union_all([box(22, 4, 36, 24.5), Polygon([(8, 12), (15, 12), (14, 24)])])


@pytest.mark.parametrize("kept", [0.1, 0.5, 1.0])
def test_smooth_curve_keeps_its_clearance_and_its_ends(kept: float) -> None:
    curve = smooth_route(ROUTE, SOLID, BOUNDS, 0.5, kept)
    s = np.linspace(0, curve.t[-1], 4000)
    points = curve(s)
    np.testing.assert_allclose(points[[0, -1]], ROUTE[[0, -1]], atol=1e-9)
    # Between two samples half a metre apart the curve may bulge by a few centimetres.
    assert shapely.distance(shapely.points(points), SOLID).min() >= kept - 0.05
    assert box(*BOUNDS).buffer(1e-6).covers(shapely.LineString(points))
    speed = np.hypot(*curve.derivative()(s).T)
    assert np.abs(speed - 1).max() < 0.1


def test_smoothing_bends_less_than_the_route() -> None:
    curve = smooth_route(ROUTE, SOLID, BOUNDS, 0.5, 0.2)
    s = np.linspace(0, curve.t[-1], 4000)
    heading = np.unwrap(np.arctan2(*curve.derivative()(s).T[::-1]))
    assert np.abs(np.diff(heading)).max() / (s[1] - s[0]) < 1.5  # 1/m; the route's corners have none
    assert shapely.LineString(curve(s)).length <= shapely.LineString(ROUTE).length + 1e-6


def test_route_too_near_an_obstacle_is_refused() -> None:
    with pytest.raises(MapError, match=r"passes .* m from an obstacle"):
        smooth_route(ROUTE, SOLID, BOUNDS, 0.5, 5.0)


def test_free_straight_route_stays_straight() -> None:
    line = np.array([[5.0, 5.0], [45.0, 35.0]])
    curve = smooth_route(line, shapely.Polygon(), BOUNDS, 0.5, 0.3)
    points = curve(np.linspace(0, curve.t[-1], 200))
    assert shapely.distance(shapely.points(points), shapely.LineString(line)).max() < 1e-3
    assert curve.t[-1] == pytest.approx(50.0, abs=1e-3)


@settings(max_examples=25, deadline=None)
@given(
    steps=st.lists(st.tuples(st.floats(2, 8), st.floats(-6, 6)), min_size=6, max_size=10),
    speed=st.floats(0.5, 8.0),
    acceleration=st.floats(0.5, 5.0),
)
def test_time_law_keeps_its_limits(steps: list[tuple[float, float]], speed: float, acceleration: float) -> None:
    corners = np.concatenate([[(0.0, 0.0)], np.cumsum(steps, axis=0)])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    curve = make_interp_spline(arc, corners, k=5)
    timed = rest_to_rest(curve, speed, acceleration)
    np.testing.assert_allclose(timed.xy_m[[0, -1]], corners[[0, -1]], atol=1e-6)
    dt = 0.005
    t = np.arange(0, timed.t_s[-1] + dt, dt)
    xy = timed.at(t)
    velocity = np.diff(xy, axis=0) / dt
    assert np.hypot(*velocity.T).max() <= speed * 1.01
    assert np.hypot(*(np.diff(velocity, axis=0) / dt).T).max() <= acceleration * 1.05
    assert np.hypot(*velocity[[0, -1]].T).max() < 0.02 * speed + acceleration * dt


@settings(max_examples=25, deadline=None)
@given(
    heights=st.lists(st.floats(-6, 6), min_size=6, max_size=10),
    speed=st.floats(0.5, 8.0),
    acceleration=st.floats(0.5, 5.0),
)
def test_time_law_never_goes_back_and_stays_on_the_curve(
    heights: list[float], speed: float, acceleration: float
) -> None:
    """On a graph y(x) with x as parameter, progress is x itself."""
    x = 5.0 * np.arange(len(heights))
    curve = make_interp_spline(x, np.column_stack([x, heights]), k=5)
    timed = rest_to_rest(curve, speed, acceleration)
    assert (np.diff(timed.xy_m[:, 0]) >= -1e-9).all()
    np.testing.assert_allclose(timed.xy_m, curve(timed.xy_m[:, 0]), atol=1e-6)


def test_time_law_reaches_its_speed_on_a_long_straight() -> None:
    s = np.linspace(0, 100, 41)
    curve = make_interp_spline(s, np.column_stack([s, 0 * s]), k=5)
    timed = rest_to_rest(curve, 4.0, 2.0)
    speeds = np.gradient(timed.xy_m[:, 0], timed.t_s)
    assert speeds.max() == pytest.approx(4.0, rel=0.02)
    assert (np.diff(timed.xy_m[:, 0]) >= 0).all()
    # At least the time of a trapezoid, and not much more.
    trapezoid = 100 / 4.0 + 4.0 / 2.0
    assert trapezoid <= timed.t_s[-1] <= 1.15 * trapezoid + 1.0
    np.testing.assert_array_equal(timed.at(np.array([-1.0, 1e9])), timed.xy_m[[0, -1]])


@settings(max_examples=60, deadline=None)
@given(height=st.floats(0.5, 60), speed=st.floats(0.3, 6), acceleration=st.floats(0.3, 6))
def test_climb_keeps_its_limits_and_rests_at_both_ends(height: float, speed: float, acceleration: float) -> None:
    dt = 0.01
    z = climb(height, speed, acceleration, dt)
    assert (z[0], z[-1]) == (0.0, pytest.approx(height))
    v = np.diff(z) / dt
    a = np.diff(v) / dt
    assert (v >= -1e-9).all()
    assert v.max() <= speed + 1e-9
    assert np.abs(a).max() <= acceleration * 1.001
    assert max(v[0], v[-1]) <= acceleration * dt
    assert v.max() >= 0.9 * speed or np.abs(a).max() >= 0.9 * acceleration


def check_regions(corridor: Corridor, stretches: list[np.ndarray], solid: list[Polygon]) -> None:
    """Convex, at most eight faces, unit normals, holds its stretch, meets no obstacle: by exact geometry."""
    np.testing.assert_allclose(np.hypot(corridor.Lambda[..., 0], corridor.Lambda[..., 1]), 1.0)
    assert corridor.Lambda.shape[1] == FACES
    for m, stretch in enumerate(stretches):
        region = Polygon(corridor.polygons_m[m])
        assert region.is_valid
        assert region.convex_hull.area == pytest.approx(region.area)
        assert shapely.is_ccw(shapely.LinearRing(corridor.polygons_m[m]))
        assert (stretch @ corridor.Lambda[m].T <= corridor.Gamma[m] + 1e-9).all()
        assert sum(region.intersection(polygon).area for polygon in solid) <= 1e-8 * max(1, len(solid))
        # The polygon is the half-planes' intersection: every corner obeys all, every half-plane carries a side.
        excess = corridor.polygons_m[m] @ corridor.Lambda[m].T - corridor.Gamma[m]
        assert excess.max() < 1e-6
        assert (np.sort(np.abs(excess), axis=0)[1] < 1e-6).all()


@pytest.mark.parametrize("seed", range(12))
def test_mended_regions_among_random_obstacles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.arange(0, 40, 0.5)
    path = np.column_stack([x, 3 * np.sin(x / 6 + seed)])
    line = shapely.LineString(path)
    solid = []
    for _ in range(60):
        angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 8)))
        centre, size = rng.uniform((0, -8), (40, 8)), rng.uniform(0.5, 2.5)
        shape = Polygon(centre + size * np.column_stack([np.cos(angles), np.sin(angles)])).convex_hull
        if isinstance(shape, Polygon) and shape.distance(line) > 0.4:
            solid.append(shape)
    stretches = [path[k : k + 4] for k in range(0, len(path) - 4, 2)]
    quadrangles = np.array([s.mean(axis=0) + rng.uniform(-1, 1, (4, 2)) for s in stretches])
    quadrangles = np.array([q if Polygon(q).exterior.is_ccw else q[::-1] for q in quadrangles])
    corridor = mended_corridor(quadrangles, stretches, solid, 0.3, 3.0)
    check_regions(corridor, stretches, solid)
    for m, stretch in enumerate(stretches):
        (x0, y0), (x1, y1) = stretch.min(axis=0) - 3.0, stretch.max(axis=0) + 3.0
        assert box(x0, y0, x1, y1).buffer(1e-6).covers(Polygon(corridor.polygons_m[m]))


def test_reference_through_an_obstacle_is_refused() -> None:
    stretch = np.array([[0.0, 0.0], [4.0, 0.0]])
    quadrangle = np.array([[[-1.0, -1.0], [5.0, -1.0], [5.0, 1.0], [-1.0, 1.0]]])
    with pytest.raises(MapError, match="meets an obstacle"):
        mended_corridor(quadrangle, [stretch], [box(1, -1, 2, 1)], 0.2, 2.0)


def test_quadrangles_are_counter_clockwise_and_hold_their_node() -> None:
    shape = box(20, 15, 40, 25)
    grown = grow(World(BOUNDS, (Obstacle("o", shape),)), 1.0, 0.1)
    channel_map = build_channel_map(grown, 1.5, 5)
    rng = np.random.default_rng(0)
    for _ in range(200):
        d = int(rng.integers(0, channel_map.channels))
        xy = channel_map.xy_m[d]
        i, j = int(rng.integers(0, xy.shape[0])), int(rng.integers(0, xy.shape[1]))
        ring = shapely.LinearRing(neighbouring_quadrangle(channel_map, (d, i, j)))
        assert shapely.is_ccw(ring)
        assert Polygon(ring).area > 0
        if 0 < i < xy.shape[0] - 1 and 0 < j < xy.shape[1] - 1:
            np.testing.assert_array_equal(
                neighbouring_quadrangle(channel_map, (d, i, j)),
                [xy[i - 1, j - 1], xy[i + 1, j - 1], xy[i + 1, j + 1], xy[i - 1, j + 1]],
            )


def test_paper_corridor_has_the_sides_of_the_quadrangle() -> None:
    quadrangle = np.array([[0.0, 0.0], [3.0, 0.5], [3.5, 2.0], [-0.5, 2.5]])
    corridor = paper_corridor(quadrangle[None])
    inside = np.array([[1.5, 1.2], [0.1, 0.1], [3.2, 1.9]])
    outside = np.array([[1.5, -0.1], [3.6, 1.2], [1.0, 2.5], [-0.5, 1.0]])
    assert (inside @ corridor.Lambda[0].T <= corridor.Gamma[0]).all()
    assert (outside @ corridor.Lambda[0].T > corridor.Gamma[0]).any(axis=1).all()
    np.testing.assert_allclose(np.hypot(*corridor.Lambda[0].T), 1.0)
