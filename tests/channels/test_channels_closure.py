"""Closures, by polygon arithmetic: nothing is lost, nothing is covered twice, and every upright line meets one once."""

import functools
import itertools

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon, box
from world_samples import BOUNDS, QUICK, WIDE, grown_world, horseshoe, sample_world

from sandwich_sitl.channels.closure import Closure, close_world, with_vertices
from sandwich_sitl.channels.outline import Outline, outline_of
from sandwich_sitl.world.grow import GrownWorld, snapped

HAIR_M = 1e-6


def closed(grown: GrownWorld) -> tuple[Closure, ...]:
    return close_world(snapped(grown).rings_m(), grown.bounds_m)


@functools.cache
def sample(seed: int) -> tuple[GrownWorld, tuple[Closure, ...]]:
    grown = sample_world(seed).grown
    return grown, closed(grown)


@pytest.mark.parametrize("seed", QUICK.values(), ids=list(QUICK))
def test_closures_are_their_members_and_their_bays(seed: int) -> None:
    grown, closures = sample(seed)
    assert sorted(k for closure in closures for k in closure.members) == list(range(len(grown.polygons)))
    for closure in closures:
        whole = Polygon(closure.ring_m)
        assert whole.is_valid
        assert whole.exterior.is_ccw
        members = shapely.union_all([grown.polygons[k] for k in closure.members])
        parts = members.area + sum(bay.area for bay in closure.bays)
        assert whole.area == pytest.approx(parts, abs=HAIR_M)
        assert whole.buffer(HAIR_M).covers(members)
        for bay in closure.bays:
            assert whole.buffer(HAIR_M).covers(bay)
            assert bay.buffer(-HAIR_M).intersection(members).is_empty
    wholes = [Polygon(closure.ring_m) for closure in closures]
    assert shapely.union_all(wholes).area == pytest.approx(sum(whole.area for whole in wholes), abs=HAIR_M)


@pytest.mark.parametrize("seed", QUICK.values(), ids=list(QUICK))
def test_every_upright_line_meets_a_closure_in_one_piece(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for closure in sample(seed)[1]:
        whole = Polygon(closure.ring_m)
        x_min, _, x_max, _ = whole.bounds
        for x in rng.uniform(x_min, x_max, 12):
            cut = LineString([(x, WIDE[1] - 1), (x, WIDE[3] + 1)]).intersection(whole)
            assert cut.length == pytest.approx(cut.bounds[3] - cut.bounds[1], abs=HAIR_M)


@pytest.mark.parametrize("seed", QUICK.values(), ids=list(QUICK))
def test_lids_are_the_free_parts_of_the_outline(seed: int) -> None:
    """Each stretch of an outline lies on a wall, on the border or on a lid, and lids lie on no wall."""
    grown, closures = sample(seed)
    frame = box(*grown.bounds_m).exterior
    solid = shapely.union_all([polygon.buffer(-HAIR_M, join_style="mitre") for polygon in grown.polygons])
    for closure in closures:
        whole = Polygon(closure.ring_m).exterior
        walls = shapely.union_all([grown.polygons[k].exterior for k in closure.members])
        lids = shapely.union_all([LineString(lid) for lid in closure.lids])
        rest = whole.difference(lids.buffer(HAIR_M)).difference(shapely.union(walls, frame).buffer(HAIR_M))
        assert rest.is_empty
        assert lids.difference(whole.buffer(HAIR_M)).is_empty
        assert lids.intersection(solid).is_empty
        assert lids.intersection(walls).length < HAIR_M


def test_convex_shapes_far_apart_are_their_own_closures() -> None:
    shapes = [box(10, 10, 20, 15), Polygon([(40, 15), (50, 25), (40, 35), (30, 25)]), box(56, 38, 66, 42)]
    grown = grown_world(*shapes)
    closures = closed(grown)
    assert [closure.members for closure in closures] == [(0,), (1,), (2,)]
    for closure, polygon in zip(closures, grown.polygons, strict=True):
        assert Polygon(closure.ring_m).equals(polygon)
        assert (closure.bays, len(closure.lids)) == ((), 0)


def test_pocket_of_a_horseshoe_by_hand() -> None:
    """A cup open to the right, 20 m wide: its pocket, grown by 1 m from all sides, is 11 m deep and 8 m wide."""
    grown = grown_world(horseshoe(40, 25, 20, -90))
    (closure,) = closed(grown)
    (bay,) = closure.bays
    assert bay.bounds == pytest.approx((39, 21, 51, 29), abs=0.2)
    assert bay.area == pytest.approx(12 * 8, rel=0.03)
    (lid,) = closure.lids
    assert lid[:, 0] == pytest.approx([51, 51], abs=0.1)
    assert np.ptp(lid[:, 1]) == pytest.approx(8, abs=0.1)


def test_shape_on_the_bottom_border_is_closed_down_to_it() -> None:
    grown = grown_world(Polygon([(20, -2), (22, -2), (22, 10), (40, 20), (20, 20)]))
    (closure,) = closed(grown)
    whole = Polygon(closure.ring_m)
    assert whole.bounds[1] == BOUNDS[1]
    right = grown.polygons[0].bounds[2]
    assert whole.covers(shapely.Point(right - 0.01, 0.01))
    assert closure.bays


def test_interlocking_shapes_are_closed_together() -> None:
    (closure,) = closed(grown_world(horseshoe(35, 25, 20, -90), box(38, 23.5, 60, 26.5)))
    assert closure.members == (0, 1)


def test_outline_is_the_highest_and_lowest_point_over_every_x() -> None:
    rng = np.random.default_rng(4)
    for seed in (4, 5, 6, 9):
        for ring in sample_world(seed).grown.rings_m():
            outline = outline_of([ring], np.empty((0, 2, 2)), (-1e3, -1e3, 1e3, 1e3))
            shape = Polygon(ring)
            for x in rng.uniform(ring[:, 0].min(), ring[:, 0].max(), 15):
                _, low, _, high = LineString([(x, -99), (x, 199)]).intersection(shape).bounds
                assert (height_at(outline.lower, x), height_at(outline.upper, x)) == pytest.approx((low, high))


def height_at(path: np.ndarray, x: float) -> float:
    """y of a path over an x that is none of its vertices."""
    return float(np.interp(x, path[:, 0], path[:, 1]))


def test_profiles_run_from_the_lowest_to_the_highest_point() -> None:
    ring = np.array([[0.0, 4.0], [3.0, 0.0], [8.0, 2.0], [9.0, 6.0], [5.0, 9.0]])
    outline: Outline = outline_of([ring], np.empty((0, 2, 2)), (-10.0, -10.0, 20.0, 20.0))
    assert outline.own
    for profile, expected in (
        (outline.right_profile(), [(3, 0), (8, 2), (9, 6), (5, 9)]),
        (outline.left_profile(), [(3, 0), (0, 4), (5, 9)]),
    ):
        assert [point for point, _ in itertools.groupby(map(tuple, profile.tolist()))] == expected


def test_inserted_vertices_lie_on_the_ring_in_order() -> None:
    ring = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
    points = np.array([[3.0, 0.0], [1.0, 0.0], [4.0, 3.0], [2.0, 1.0], [0.0, 1.5], [1.0, 0.0]])
    expected = [[0, 0], [1, 0], [3, 0], [4, 0], [4, 3], [0, 3], [0, 1.5]]
    np.testing.assert_array_equal(with_vertices(ring, points), expected)
