"""Groups, tips and dividing streamlines: order, least number of levels, and curves that meet no barrier or each other."""

import functools
import itertools

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon, box
from world_samples import BOUNDS, QUICK, grown_world, random_shapes, sample_world

from sandwich_sitl.channels.barrier import Barrier
from sandwich_sitl.channels.build import _barriers
from sandwich_sitl.channels.classify import Classification, classify
from sandwich_sitl.channels.dividers import Piece, lay_dividers
from sandwich_sitl.channels.thinning import thinned
from sandwich_sitl.world.grow import GrownWorld, snapped

CELL_M = 1.5
SEEDS = [3, 6, 8, 11, 12, 14, 17, 18, 19, 20, 22, 24, 25]
HAND_MADE = {
    "wedge on the left border": (Polygon([(-3, 10), (3, 40), (-3, 44)]), box(30, 6, 40, 10)),
    "wedge on the right border": (Polygon([(83, 10), (77, 40), (83, 44)]), box(30, 6, 40, 10)),
}
WORLDS = [*SEEDS, *HAND_MADE, "horseshoes", "nested", "over_border", "border_walls", "chains", "tiles"]


@functools.cache
def classified(world: int | str) -> tuple[GrownWorld, tuple[Barrier, ...], Classification]:
    if isinstance(world, int):
        return of_world(snapped(grown_world(*random_shapes(world))))
    grown = grown_world(*HAND_MADE[world]) if world in HAND_MADE else sample_world(QUICK[world]).grown
    return of_world(snapped(grown))


def of_world(grown: GrownWorld) -> tuple[GrownWorld, tuple[Barrier, ...], Classification]:
    barriers, _, _ = _barriers(grown, CELL_M)
    barriers = tuple(b for b in barriers if not (b.on_bottom and b.on_top))
    return grown, barriers, classify(barriers, grown.bounds_m[1], grown.bounds_m[3], CELL_M)


@functools.cache
def laid(world: int | str) -> tuple[tuple[Piece, ...], ...]:
    grown, _, found = classified(world)
    return lay_dividers(found, grown.bounds_m, CELL_M)


def lies_below(a: Barrier, b: Barrier) -> bool:
    """By many upright lines through both shapes."""
    left, right = max(a.x_min, b.x_min), min(a.x_max, b.x_max)
    if left > right:
        return False
    for x in np.linspace(left, right, 23):
        line = LineString([(x, -1e3), (x, 1e3)])
        spans = [line.intersection(Polygon(barrier.ring_m)).bounds for barrier in (a, b)]
        if all(spans):
            return bool(spans[0][1] + spans[0][3] < spans[1][1] + spans[1][3])
    return False


@pytest.mark.parametrize("world", WORLDS)
def test_levels_are_chains_that_respect_the_order_with_the_least_number(world: int | str) -> None:
    groups = classified(world)[2].groups
    for chain in groups:
        assert chain
        for a, b in itertools.pairwise(chain):
            assert a.x_max < b.x_min
    inner = [(level, barrier) for level, chain in enumerate(groups) for barrier in chain]
    below = {m: [k for k, (_, a) in enumerate(inner) if k != m and lies_below(a, b)] for m, (_, b) in enumerate(inner)}
    for m, lower in below.items():
        assert all(inner[k][0] < inner[m][0] for k in lower)

    @functools.cache
    def longest(m: int) -> int:
        return 1 + max((longest(k) for k in below[m]), default=0)

    assert len(groups) == max((longest(m) for m in below), default=0)


@pytest.mark.parametrize("world", WORLDS)
def test_every_barrier_belongs_to_one_group_or_border(world: int | str) -> None:
    grown, barriers, found = classified(world)
    everyone = [*found.bottom, *found.top, *itertools.chain(*found.groups)]
    assert sorted(b.index for b in everyone) == sorted(b.index for b in barriers)
    for chain, y in ((found.bottom, grown.bounds_m[1]), (found.top, grown.bounds_m[3])):
        assert all((barrier.ring_m[:, 1] == y).any() for barrier in chain)
    touching = [b for b in barriers if {grown.bounds_m[1], grown.bounds_m[3]} & set(b.ring_m[:, 1].tolist())]
    assert len(found.bottom) + len(found.top) == len(touching)


@pytest.mark.parametrize("world", WORLDS)
def test_tips_lie_on_their_barrier_and_cut_it_into_two_walls(world: int | str) -> None:
    grown, _, found = classified(world)
    for barrier in itertools.chain(*found.groups):
        assert (barrier.left_tip is None) == barrier.on_left
        assert (barrier.right_tip is None) == barrier.on_right
        whole = Polygon(barrier.ring_m)
        for tip in (barrier.left_tip, barrier.right_tip):
            if tip is not None:
                assert whole.exterior.distance(Point(tip)) < 1e-9
                assert grown.bounds_m[0] < tip[0] < grown.bounds_m[2]
        lower, upper = LineString(barrier.lower_wall()), LineString(barrier.upper_wall())
        assert lower.is_simple
        assert upper.is_simple
        on_border = sum(barrier_side(barrier, x) for x in (grown.bounds_m[0], grown.bounds_m[2]))
        assert lower.length + upper.length + on_border == pytest.approx(whole.exterior.length)
        for x in np.linspace(barrier.x_min, barrier.x_max, 9)[1:-1]:
            low, high = barrier.extent(np.array([x]))
            cut = LineString([(x, -1e3), (x, 1e3)]).intersection(whole).bounds
            assert low[0] <= cut[1] + 1e-9
            assert high[0] >= cut[3] - 1e-9


def barrier_side(barrier: Barrier, x: float) -> float:
    """Length of a barrier's outline on the border at x."""
    y = barrier.ring_m[barrier.ring_m[:, 0] == x, 1]
    return float(np.ptp(y)) if y.size else 0.0


@pytest.mark.parametrize("world", WORLDS)
def test_dividers_stay_off_each_other_and_off_all_barriers(world: int | str) -> None:
    grown, barriers, found = classified(world)
    x_min, _, x_max, _ = grown.bounds_m
    streamlines = laid(world)
    assert len(streamlines) == len(found.groups) + 2
    solid = shapely.union_all([Polygon(barrier.ring_m).buffer(-1e-9) for barrier in barriers])
    for pieces in streamlines:
        for a, b in itertools.pairwise(pieces):
            np.testing.assert_array_equal(a.lower[-1], b.lower[0])
            np.testing.assert_array_equal(a.upper[-1], b.upper[0])
        for side in ("lower", "upper"):
            path = np.concatenate([getattr(piece, side) for piece in pieces])
            assert (path[0, 0], path[-1, 0]) == (x_min, x_max)
            assert not LineString(path).intersects(solid)
    area = 0.0
    for below, above in itertools.pairwise(streamlines):
        upper = np.concatenate([piece.upper for piece in below])
        lower = np.concatenate([piece.lower for piece in above])
        channel = Polygon([*upper, *lower[::-1]])
        assert channel.is_valid
        area += channel.area
    free = box(*grown.bounds_m).area - sum(Polygon(barrier.ring_m).area for barrier in barriers)
    assert area == pytest.approx(free, rel=1e-9)


def test_hand_made_groups() -> None:
    """Two stacked obstacles on the left, one on the right: two groups; one on each border belongs to the border."""
    shapes = box(10, 10, 20, 15), box(12, 30, 22, 35), box(40, 12, 50, 17), box(60, -5, 70, 8), box(35, 45, 39, 60)
    _, _, found = of_world(grown_world(*shapes))
    assert [[barrier.name for barrier in chain] for chain in found.groups] == [["o0", "o2"], ["o1"]]
    assert [barrier.name for barrier in found.bottom] == ["o3"]
    assert [barrier.name for barrier in found.top] == ["o4"]


def test_streamline_of_an_obstacle_in_the_middle_is_straight() -> None:
    _, _, found = of_world(grown_world(box(30, 20, 50, 30)))
    _, pieces, _ = lay_dividers(found, BOUNDS, CELL_M)
    for piece in pieces:
        if piece.barrier is None:
            np.testing.assert_allclose(piece.lower[:, 1], 25.0, atol=0.01)


def test_streamlines_of_a_stack_are_evenly_spaced_beside_it() -> None:
    shapes = [box(35, 10 * k - 1, 45, 10 * k + 1) for k in range(1, 5)]
    streamlines = laid_through(*shapes)
    heights = [np.interp(2.0, *pieces[0].lower.T) for pieces in streamlines]
    np.testing.assert_allclose(heights, 10.0 * np.arange(6), atol=0.3)


def laid_through(*shapes: Polygon) -> tuple[tuple[Piece, ...], ...]:
    return lay_dividers(of_world(grown_world(*shapes))[2], BOUNDS, CELL_M)


@settings(max_examples=80, deadline=None)
@given(
    steps=st.lists(st.tuples(st.floats(0.05, 3.0), st.floats(-2.0, 2.0)), min_size=1, max_size=40),
    tolerance=st.floats(0.0, 1.5),
)
def test_thinned_curve_passes_every_dropped_vertex_within_its_tolerance(
    steps: list[tuple[float, float]], tolerance: float
) -> None:
    path = np.concatenate([[(0.0, 0.0)], np.cumsum(steps, axis=0)])
    kept = thinned(path, np.full(len(path), tolerance))
    np.testing.assert_array_equal(kept[[0, -1]], path[[0, -1]])
    assert {tuple(p) for p in kept.tolist()} <= {tuple(p) for p in path.tolist()}
    assert np.abs(np.interp(path[:, 0], *kept.T) - path[:, 1]).max() <= tolerance + 1e-9


def test_straight_run_is_thinned_to_its_ends_and_a_stiff_vertex_stays() -> None:
    path = np.column_stack([np.arange(11.0), np.zeros(11)])
    assert len(thinned(path, np.full(11, 0.1))) == 2
    path[4, 1] = 0.05
    give = np.full(11, 0.1)
    assert len(thinned(path, give)) == 2
    give[4] = 0.0
    np.testing.assert_array_equal(thinned(path, give)[1], path[4])
