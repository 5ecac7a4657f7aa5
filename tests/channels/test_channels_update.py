"""A map with one more obstacle: the laws of every map, and what the obstacle does not touch stays as it was."""

import numpy as np
import pytest
import shapely
from map_laws import check_laws, check_lookup, free_points
from shapely import Polygon, box
from world_samples import QUICK, WIDE, convex, grown_world, horseshoe, random_shapes, sample_world

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.channels.check import examine
from sandwich_sitl.channels.update import update_map

CELL_M = 1.7


def obstacle_map() -> ChannelMap:
    return build_channel_map(grown_world(*random_shapes(12)), CELL_M, 5)


def newcomer(seed: int) -> Polygon:
    rng = np.random.default_rng([9, seed])
    x, y = rng.uniform(WIDE[:2], WIDE[2:])
    return convex(rng, float(x), float(y), float(rng.uniform(1, 14)))


@pytest.mark.parametrize("seed", QUICK.values(), ids=list(QUICK))
def test_updated_map_keeps_the_laws(seed: int) -> None:
    sample = sample_world(seed)
    cell_m = max(CELL_M, sample.cell_m)
    channel_map = build_channel_map(sample.grown, cell_m, 5, sample.flow)
    updated = update_map(channel_map, newcomer(seed), "newcomer", cell_m)
    check_laws(updated)
    assert examine(updated).failures == ()
    check_lookup(updated, free_points(updated, 30, seed))


def test_obstacles_one_after_another_keep_the_laws() -> None:
    channel_map = obstacle_map()
    for seed in range(6):
        channel_map = update_map(channel_map, newcomer(seed), f"newcomer {seed}", CELL_M)
    check_laws(channel_map)
    assert examine(channel_map).failures == ()


def test_world_of_the_updated_map_is_the_old_one_with_the_obstacle() -> None:
    channel_map, obstacle = obstacle_map(), newcomer(3)
    updated = update_map(channel_map, obstacle, "newcomer", CELL_M)
    before, after = (shapely.union_all(list(m.grown.polygons)) for m in (channel_map, updated))
    expected = before | (obstacle & box(*channel_map.bounds_m))
    assert after.symmetric_difference(expected).area < 1e-9 + sum(
        Polygon(ring).area for part in shapely.get_parts(expected) for ring in part.interiors
    )
    assert any("newcomer" in name for name in updated.grown.names)
    assert shapely.union_all([p.buffer(-1e-9) for p in updated.grown.polygons]).area == pytest.approx(
        sum(p.buffer(-1e-9).area for p in updated.grown.polygons)
    )


def test_nodes_away_from_the_obstacle_stay_as_they_were() -> None:
    channel_map, obstacle = obstacle_map(), newcomer(3)
    updated = update_map(channel_map, obstacle, "newcomer", CELL_M)
    changed = 0
    for before, after, here, there in zip(
        channel_map.xy_m, updated.xy_m, channel_map.gridded, updated.gridded, strict=True
    ):
        kept = ~np.isnan(after).any(axis=-1)
        np.testing.assert_array_equal(after[kept], before[kept])
        assert not (there & ~here).any()
        changed += int((here & ~there).sum())
    assert 0 < changed < 0.5 * channel_map.gridded.size
    np.testing.assert_array_equal(updated.barred, channel_map.barred)


@pytest.mark.parametrize("obstacle", [box(-20, 0, -10, 10), box(79.9, 49.9, 90, 60).buffer(-0.2)])
def test_obstacle_outside_changes_nothing(obstacle: Polygon) -> None:
    channel_map = obstacle_map()
    assert update_map(channel_map, obstacle, "far", CELL_M) is channel_map


def test_obstacle_in_a_bay_changes_that_bay_alone() -> None:
    channel_map = build_channel_map(grown_world(horseshoe(40, 25, 24, -90)), CELL_M, 5)
    (bay,) = channel_map.bays
    x, y = bay.corners_m().mean(axis=(0, 1))
    updated = update_map(channel_map, box(x - 1, y - 1, x + 1, y + 1), "crate", CELL_M)
    check_laws(updated)
    np.testing.assert_array_equal(updated.gridded, channel_map.gridded)
    assert sum(shapely.area(shapely.polygons(updated.bays[0].corners_m()))) == pytest.approx(
        sum(shapely.area(shapely.polygons(bay.corners_m()))) - 4
    )


def test_obstacle_over_the_whole_world_leaves_nothing() -> None:
    updated = update_map(obstacle_map(), box(-5, -5, 90, 60), "flood", CELL_M)
    assert len(updated.corners_m()) == 0
    assert updated.grown.free_area_m2 == pytest.approx(0.0, abs=1e-6)


def test_obstacle_that_shuts_ground_in_fills_it() -> None:
    """A door closed: nothing is mapped behind it, and the ground counts as obstacle."""
    channel_map = build_channel_map(grown_world(horseshoe(40, 25, 24, -90)), CELL_M, 5)
    (bay,) = channel_map.bays
    room = shapely.coverage_union_all(shapely.polygons(bay.corners_m()))
    x_min, y_min, x_max, y_max = room.bounds
    updated = update_map(channel_map, box(x_max - 2, y_min - 2, x_max + 1, y_max + 2), "door", CELL_M)
    check_laws(updated)
    assert updated.grown.blocker((x_min + 1, (y_min + y_max) / 2)) is not None
