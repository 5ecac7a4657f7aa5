"""Dead ends: pockets behind narrow mouths are found and filled, passages and wanted points are left alone."""

import pytest
import shapely
from shapely import Polygon, box

from sandwich_sitl.world.grow import GrownWorld
from sandwich_sitl.world.pockets import dead_ends, fill

BOUNDS = (0.0, 0.0, 60.0, 40.0)


def grown_world(*polygons: Polygon) -> GrownWorld:
    return GrownWorld(
        BOUNDS,
        tuple(shapely.orient_polygons(polygon) for polygon in polygons),
        tuple(f"o{k}" for k in range(len(polygons))),
    )


def court(mouth_m: float) -> Polygon:
    """A walled yard of 12 m x 12 m, open to the right through a mouth."""
    yard = box(20, 12, 36, 28).difference(box(22, 14, 34, 26))
    return yard.difference(box(33, 20 - mouth_m / 2, 37, 20 + mouth_m / 2))


def filled_union(world: GrownWorld, mouth_m: float, keep: tuple[tuple[float, float], ...] = ()) -> Polygon:
    return shapely.union_all(list(fill(world, dead_ends(world, mouth_m, keep)).polygons))


YARD = shapely.Point(28, 20)


def test_a_yard_behind_a_narrow_mouth_is_filled() -> None:
    world = grown_world(court(2.0))
    after = filled_union(world, 3.0)
    assert after.covers(YARD)
    assert after.area == pytest.approx(16 * 16, rel=0.02)


def test_a_yard_behind_a_wide_mouth_stays() -> None:
    assert not filled_union(grown_world(court(4.0)), 3.0).covers(YARD)


def test_a_yard_with_a_wanted_point_stays() -> None:
    after = filled_union(grown_world(court(2.0)), 3.0, ((28.0, 20.0), (5.0, 20.0)))
    assert not after.covers(YARD)
    assert not after.covers(shapely.Point(35, 20))


def test_a_passage_between_two_rooms_stays() -> None:
    walls = grown_world(box(28, 0, 32, 19), box(28, 21, 32, 40))
    assert not filled_union(walls, 3.0, ((10.0, 5.0), (50.0, 5.0))).intersects(shapely.Point(30, 20))


def test_the_smaller_room_is_the_dead_end_when_nothing_is_wanted() -> None:
    after = filled_union(grown_world(box(18, 0, 22, 19), box(18, 21, 22, 40)), 3.0)
    assert after.covers(shapely.Point(10, 20))
    assert not after.covers(shapely.Point(40, 20))


def test_a_lane_between_two_blocks_stays() -> None:
    blocks = grown_world(box(20, 12, 40, 19), box(20, 21, 40, 28))
    assert not filled_union(blocks, 3.0).intersects(box(22, 19.5, 38, 20.5))


def test_a_blind_alley_is_filled() -> None:
    alley = box(20, 12, 40, 28).difference(box(24, 19, 41, 21))
    after = filled_union(grown_world(alley), 3.0)
    assert after.covers(shapely.Point(26, 20))


def test_filling_only_adds_ground_and_keeps_names() -> None:
    world = grown_world(court(2.0), box(45, 5, 50, 10))
    after = fill(world, dead_ends(world, 3.0, ()))
    before = shapely.union_all(list(world.polygons))
    assert before.difference(shapely.union_all(list(after.polygons))).area < 0.01
    assert set(after.names) == {"o0", "o1"}
    assert after.bounds_m == BOUNDS


def test_open_ground_has_no_dead_ends() -> None:
    assert dead_ends(grown_world(), 5.0, ()) == []
    lone = grown_world(box(25, 15, 35, 25))
    assert dead_ends(lone, 3.0, ()) == []
    assert fill(lone, []) is lone
