"""Groups and dividing streamlines: order, least number of levels, and curves that never meet a hull or each other."""

import functools
import itertools

import numpy as np
import pytest
import shapely
from sandwich_sitl.channels.hull import ring_edges, vertical_hull
from shapely import box
from world_samples import BOUNDS, grown_world, horseshoe, random_shapes

from sandwich_sitl.channels.barrier import Barrier
from sandwich_sitl.channels.classify import classify
from sandwich_sitl.channels.dividers import lay_dividers
from sandwich_sitl.errors import NoRouteError

SEEDS = [3, 6, 8, 11, 12, 14, 17, 18, 19, 20, 22, 24, 25]


def lies_below(a: Barrier, b: Barrier) -> bool:
    """By many upright lines through both shapes."""
    left = max(a.ring_m[:, 0].min(), b.ring_m[:, 0].min())
    right = min(a.ring_m[:, 0].max(), b.ring_m[:, 0].max())
    if left > right:
        return False
    for x in np.linspace(left, right, 23):
        line = shapely.LineString([(x, -1), (x, 51)])
        spans = [line.intersection(shapely.Polygon(barrier.ring_m)).bounds for barrier in (a, b)]
        if all(spans):
            return bool(spans[0][1] + spans[0][3] < spans[1][1] + spans[1][3])
    return False


@pytest.mark.parametrize("seed", SEEDS)
def test_levels_are_chains_that_respect_the_order_with_the_least_number(seed: int) -> None:
    groups = classify(grown_world(*random_shapes(seed))).groups
    for chain in groups:
        for a, b in itertools.pairwise(chain):
            assert a.ring_m[:, 0].max() < b.ring_m[:, 0].min()
    inner = [(level, barrier) for level, chain in enumerate(groups) for barrier in chain]
    below = {m: [k for k, (_, a) in enumerate(inner) if k != m and lies_below(a, b)] for m, (_, b) in enumerate(inner)}
    for m, lower in below.items():
        assert all(inner[k][0] < inner[m][0] for k in lower)

    @functools.cache
    def longest(m: int) -> int:
        return 1 + max((longest(k) for k in below[m]), default=0)

    assert len(groups) == max((longest(m) for m in below), default=0)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_obstacle_belongs_to_one_group_or_border(seed: int) -> None:
    grown = grown_world(*random_shapes(seed))
    found = classify(grown)
    barriers = [*found.bottom, *found.top, *itertools.chain(*found.groups)]
    owners = [
        sum(shapely.Polygon(barrier.ring_m).buffer(1e-6).covers(polygon) for barrier in barriers)
        for polygon in grown.polygons
    ]
    assert owners == [1] * len(grown.polygons)


@pytest.mark.parametrize("seed", SEEDS)
def test_dividers_stay_off_each_other_and_off_foreign_hulls(seed: int) -> None:
    found = classify(grown_world(*random_shapes(seed)))
    streamlines = lay_dividers(found, BOUNDS, 1.5)
    assert len(streamlines) == len(found.groups) + 2
    for d, pieces in enumerate(streamlines):
        for a, b in itertools.pairwise(pieces):
            np.testing.assert_array_equal(a.lower[-1], b.lower[0])
            np.testing.assert_array_equal(a.upper[-1], b.upper[0])
        assert pieces[0].lower[0, 0] == BOUNDS[0]
        assert pieces[-1].lower[-1, 0] == BOUNDS[2]
        free = [shapely.LineString(piece.lower) for piece in pieces if piece.barrier is None]
        if 0 < d < len(streamlines) - 1:
            foreign = [
                barrier.hull.polygon() for level, chain in enumerate(found.groups, 1) if level != d for barrier in chain
            ]
            assert not any(line.intersects(hull) for line in free for hull in foreign)
    for below, above in itertools.pairwise(streamlines):
        upper = shapely.LineString(np.concatenate([piece.upper for piece in below]))
        lower = shapely.LineString(np.concatenate([piece.lower for piece in above]))
        channel = shapely.Polygon([*upper.coords, *reversed(lower.coords)])
        assert channel.is_valid
        assert channel.area > 0


def test_hand_made_groups() -> None:
    """Two stacked obstacles on the left, one on the right: two groups; one on each border belongs to the border."""
    found = classify(
        grown_world(
            box(10, 10, 20, 15), box(12, 30, 22, 35), box(40, 12, 50, 17), box(60, -5, 70, 8), box(5, 45, 9, 60)
        )
    )
    assert [[barrier.name for barrier in chain] for chain in found.groups] == [["o0", "o2"], ["o1"]]
    assert [barrier.name for barrier in found.bottom] == ["o3"]
    assert [barrier.name for barrier in found.top] == ["o4"]


def test_interlocking_obstacles_become_one_barrier_of_both_names() -> None:
    found = classify(grown_world(horseshoe(35, 25, 20, -90), box(33, 23, 60, 26)))
    ((barrier,),) = found.groups
    assert set(barrier.name.split("+")) == {"o0", "o1"}


def test_split_world_is_named() -> None:
    with pytest.raises(NoRouteError, match="'o0' reaches from the bottom to the top"):
        classify(grown_world(box(30, -5, 40, 60)))


@pytest.mark.parametrize("seed", [8, 12, 19])
def test_vertical_hull_is_the_shape_closed_along_y(seed: int) -> None:
    for ring in grown_world(*random_shapes(seed)).rings_m():
        hull = vertical_hull(ring_edges(ring))
        shape = shapely.Polygon(ring)
        for x in np.random.default_rng(seed).uniform(hull.x_min, hull.x_max, 20):
            cut = shapely.LineString([(x, -10), (x, 60)]).intersection(shape)
            (low,), (high,) = hull.extent(np.array([x]))
            assert (low, high) == pytest.approx((cut.bounds[1], cut.bounds[3]), abs=1e-6)
        assert hull.polygon().buffer(1e-6).covers(shape)
