"""Growing and simplifying only ever add ground, and add what they promise."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box
from shapely.affinity import rotate, translate

from sandwich_sitl.world.grow import grow
from sandwich_sitl.world.simplify import simplify_outwards
from sandwich_sitl.world.world import Obstacle, World

BOUNDS = (0.0, 0.0, 100.0, 80.0)


@st.composite
def polygons(draw: st.DrawFn) -> Polygon:
    """Star-shaped polygons, convex and not, with 3 to 12 corners, some far outside the bounds' middle."""
    corners = draw(st.integers(3, 12))
    centre = draw(st.tuples(st.floats(5, 95), st.floats(5, 75)))
    radii = draw(st.lists(st.floats(1.0, 15.0), min_size=corners, max_size=corners))
    angle = 2 * np.pi * np.arange(corners) / corners + draw(st.floats(0, 6))
    return Polygon(np.column_stack([centre[0] + radii * np.cos(angle), centre[1] + radii * np.sin(angle)]))


def world_of(shapes: list[Polygon], bounds: tuple[float, float, float, float] = BOUNDS) -> World:
    return World(bounds, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes)))


@settings(max_examples=60, deadline=None)
@given(
    shapes=st.lists(polygons(), min_size=1, max_size=5),
    distance=st.floats(0.1, 3.0),
    detail=st.floats(0.01, 0.5),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_point_within_the_distance_is_covered(
    shapes: list[Polygon], distance: float, detail: float, seed: int
) -> None:
    grown = grow(world_of(shapes), distance, detail)
    points = np.random.default_rng(seed).uniform(BOUNDS[:2], BOUNDS[2:], (400, 2))
    rim = [polygon.exterior.interpolate(0.37, normalized=True).buffer(0.999 * distance) for polygon in shapes]
    points = np.concatenate([points, *(shapely.get_coordinates(disc) for disc in rim)])
    points = points[((points > BOUNDS[:2]) & (points < BOUNDS[2:])).all(axis=1)]
    located = shapely.points(points)
    near = shapely.distance(located, shapely.union_all(shapes)) < distance
    assert shapely.covers(shapely.union_all(list(grown.polygons)), located)[near].all()


@settings(max_examples=60, deadline=None)
@given(shapes=st.lists(polygons(), min_size=1, max_size=5), distance=st.floats(0.1, 3.0), detail=st.floats(0.01, 0.5))
def test_grown_polygons_are_disjoint_simple_rings_in_bounds(
    shapes: list[Polygon], distance: float, detail: float
) -> None:
    grown = grow(world_of(shapes), distance, detail)
    for polygon, ring in zip(grown.polygons, grown.rings_m(), strict=True):
        assert polygon.is_valid
        assert not polygon.interiors
        assert shapely.is_ccw(shapely.LinearRing(ring))
        assert box(*BOUNDS).buffer(1e-6).covers(polygon)
    for k, a in enumerate(grown.polygons):
        assert all(a.intersection(b).area == 0 for b in grown.polygons[k + 1 :])
    union = shapely.union_all(list(grown.polygons)) if grown.polygons else Polygon()
    assert grown.free_area_m2 == pytest.approx(box(*BOUNDS).difference(union).area, abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(shape=polygons(), distance=st.floats(0.1, 3.0), detail=st.floats(0.01, 0.3))
def test_growing_adds_no_more_than_the_mitre_and_the_detail(shape: Polygon, distance: float, detail: float) -> None:
    """A mitre cut at 1.5 distances has its corners within hypot(1.5, 1) distances; details add their tolerance."""
    bounds = (-100.0, -100.0, 200.0, 200.0)
    grown = grow(world_of([shape], bounds), distance, detail)
    (polygon,) = grown.polygons
    rim = shapely.points(polygon.exterior.coords)
    filled = Polygon(shape.buffer(1.81 * distance).exterior)
    assert shapely.distance(rim, filled).max() <= 4 * detail + 0.01


def test_touching_shapes_unite_and_enclosed_ground_is_filled() -> None:
    frame = [box(20, 20, 60, 24), box(20, 56, 60, 60), box(20, 20, 24, 60), box(56, 20, 60, 60)]
    grown = grow(world_of(frame), 1.0, 0.1)
    (polygon,) = grown.polygons
    assert polygon.contains(shapely.Point(40, 40))
    assert set(grown.names[0].split("+")) == {"o0", "o1", "o2", "o3"}
    assert grown.blocker((40.0, 40.0)) == grown.names[0]
    assert grown.blocker((5.0, 5.0)) is None


def test_a_gap_wider_than_two_distances_stays_open() -> None:
    shapes = [box(10, 10, 20, 70), box(22.5, 10, 40, 70)]
    assert len(grow(world_of(shapes), 1.0, 0.1).polygons) == 2
    assert len(grow(world_of(shapes), 1.3, 0.1).polygons) == 1


def test_growing_moves_with_the_world() -> None:
    shape = Polygon([(30, 30), (50, 28), (44, 50), (36, 37)])
    here = grow(world_of([shape], (0, 0, 100, 100)), 1.0, 0.2).polygons[0]
    turned = rotate(shape, 90, origin=(50, 50))
    there = grow(world_of([turned], (0, 0, 100, 100)), 1.0, 0.2).polygons[0]
    assert rotate(here, 90, origin=(50, 50)).symmetric_difference(there).area < 1e-3
    far = grow(world_of([translate(shape, 1000, -500)], (1000, -500, 1100, -400)), 1.0, 0.2).polygons[0]
    assert translate(here, 1000, -500).symmetric_difference(far).area < 1e-3


def test_world_without_obstacles() -> None:
    grown = grow(World(BOUNDS, ()), 1.0, 0.1)
    assert grown.polygons == ()
    assert grown.free_area_m2 == 8000.0


@settings(max_examples=150, deadline=None)
@given(shape=polygons(), tolerance=st.floats(0.01, 1.0))
def test_simplifying_covers_the_shape_and_reaches_little_further(shape: Polygon, tolerance: float) -> None:
    simple = simplify_outwards(shape, tolerance)
    assert simple.is_valid
    assert shape.difference(simple).area < 1e-9 * shape.area
    assert len(simple.exterior.coords) <= len(shape.exterior.coords)
    rim = shapely.points(shapely.get_coordinates(shapely.segmentize(simple.exterior, 0.1)))
    assert shapely.distance(rim, shape).max() <= tolerance + 1e-9


def test_simplifying_a_fine_circle_leaves_few_corners() -> None:
    circle = shapely.Point(0, 0).buffer(10.0, quad_segs=64)
    simple = simplify_outwards(circle, 0.1)
    assert len(simple.exterior.coords) < 60
    radii = np.hypot(*np.array(simple.exterior.coords).T)
    assert radii.max() < 10.3
    assert shapely.Point(0, 0).distance(simple.exterior) >= 10.0 * np.cos(np.pi / 256) - 1e-9


def test_an_obstacle_beside_the_border_is_felt_inside_it() -> None:
    world = World((0, 0, 20, 20), (Obstacle("beside", box(-3, 5, -0.2, 15)), Obstacle("far", box(-9, 5, -5, 15))))
    grown = grow(world, 1.0, 0.1)
    assert grown.names == ("beside",)
    assert grown.blocker((0.7, 10.0)) == "beside"
    assert grown.blocker((0.9, 10.0)) is None


def test_obstacles_out_of_reach_leave_the_world_empty() -> None:
    beyond = Obstacle("beyond", box(-8, -8, -5, -5))
    assert grow(World((0, 0, 40, 30), (beyond,)), 1.0, 0.1).polygons == ()
    inside = Obstacle("inside", box(10, 10, 14, 14))
    assert grow(World((0, 0, 40, 30), (beyond, inside)), 1.0, 0.1).names == ("inside",)
