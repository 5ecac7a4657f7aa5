"""The check finds what is broken on purpose, and so does the independent measurement of the laws."""

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely
from map_laws import check_laws
from shapely import Polygon, box
from shapely.affinity import translate
from world_samples import grown_world, horseshoe

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.channels.check import check_map, examine
from sandwich_sitl.errors import MapError


@functools.cache
def sound_map() -> ChannelMap:
    """Two obstacles between channels, one with a bay; one on the border."""
    return build_channel_map(grown_world(horseshoe(25, 25, 16, -90), box(50, 15, 60, 22), box(60, 40, 70, 55)), 1.5, 5)


def with_channel(channel_map: ChannelMap, d: int, change: Callable[[np.ndarray], None]) -> ChannelMap:
    xy = channel_map.xy_m[d].copy()
    change(xy)
    return replace(channel_map, xy_m=(*channel_map.xy_m[:d], xy, *channel_map.xy_m[d + 1 :]))


def with_bay(channel_map: ChannelMap, b: int, change: Callable[[np.ndarray], None]) -> ChannelMap:
    xy = channel_map.bays[b].xy_m.copy()
    change(xy)
    bay = replace(channel_map.bays[b], xy_m=xy)
    return replace(channel_map, bays=(*channel_map.bays[:b], bay, *channel_map.bays[b + 1 :]))


def with_barred(channel_map: ChannelMap, d: int, i: int, value: bool) -> ChannelMap:
    barred = channel_map.barred.copy()
    barred[d, i] = value
    return replace(channel_map, barred=barred)


def with_polygons(channel_map: ChannelMap, *polygons: Polygon) -> ChannelMap:
    grown = replace(channel_map.grown, polygons=polygons, names=tuple(f"p{k}" for k in range(len(polygons))))
    return replace(channel_map, grown=grown)


def inner_bay_node(channel_map: ChannelMap) -> int:
    bay = channel_map.bays[0]
    outline = shapely.coverage_union_all(shapely.polygons(bay.corners_m())).boundary
    return int(np.argmax(shapely.distance(outline, shapely.points(bay.xy_m))))


def fold_cell(channel_map: ChannelMap) -> ChannelMap:
    def swap(xy: np.ndarray) -> None:
        xy[[8, 9], 3] = xy[[9, 8], 3]

    return with_channel(channel_map, 1, swap)


def fold_by_a_hair(channel_map: ChannelMap) -> ChannelMap:
    """A node moved just beyond the diagonal of one of its cells."""

    def dent(xy: np.ndarray) -> None:
        a, b = xy[9, 3].copy(), xy[8, 2].copy()
        middle = (xy[8, 3] + xy[9, 2]) / 2
        xy[9, 3] = middle + 1e-6 * (b - a)

    return with_channel(channel_map, 0, dent)


def fold_bay_cell(channel_map: ChannelMap) -> ChannelMap:
    node = inner_bay_node(channel_map)

    def push(xy: np.ndarray) -> None:
        xy[node] += (2.5, 0.0)

    return with_bay(channel_map, 0, push)


def obstacle_in_channel(channel_map: ChannelMap) -> ChannelMap:
    x, y = channel_map.xy_m[0][5:7, 2:4].reshape(-1, 2).mean(axis=0)
    return with_polygons(channel_map, *channel_map.grown.polygons, box(x - 1e-3, y - 1e-3, x + 1e-3, y + 1e-3))


def obstacle_in_bay(channel_map: ChannelMap) -> ChannelMap:
    x, y = channel_map.bays[0].corners_m()[3].mean(axis=0)
    return with_polygons(channel_map, *channel_map.grown.polygons, box(x - 1e-3, y - 1e-3, x + 1e-3, y + 1e-3))


def obstacle_moved(channel_map: ChannelMap) -> ChannelMap:
    first, *others = channel_map.grown.polygons
    return with_polygons(channel_map, translate(first, 1e-5, 0), *others)


def bay_dropped(channel_map: ChannelMap) -> ChannelMap:
    return replace(channel_map, bays=channel_map.bays[1:], lid_places=channel_map.lid_places[1:])


def obstacle_gone(channel_map: ChannelMap) -> ChannelMap:
    """Ground that no cell covers, where an obstacle was."""
    return with_polygons(channel_map, *channel_map.grown.polygons[1:])


def columns_dropped(channel_map: ChannelMap) -> ChannelMap:
    gridded = channel_map.gridded.copy()
    gridded[1, 10:14] = False
    return replace(channel_map, gridded=gridded)


def shared_node_moved(channel_map: ChannelMap) -> ChannelMap:
    i = int(np.flatnonzero(~channel_map.barred[0])[4])

    def move(xy: np.ndarray) -> None:
        xy[i, 0] += (0.0, 1e-9)

    return with_channel(channel_map, 1, move)


def lid_node_moved(channel_map: ChannelMap) -> ChannelMap:
    node = int(channel_map.bays[0].lid_nodes[1])

    def move(xy: np.ndarray) -> None:
        xy[node] += (0.0, 1e-6)

    return with_bay(channel_map, 0, move)


def lid_place_wrong(channel_map: ChannelMap) -> ChannelMap:
    places = channel_map.lid_places[0].copy()
    places[1, 1] += 1
    return replace(channel_map, lid_places=(places, *channel_map.lid_places[1:]))


def free_node_barred(channel_map: ChannelMap) -> ChannelMap:
    return with_barred(channel_map, 0, int(np.flatnonzero(~channel_map.barred[0])[4]), True)


def wall_node_not_barred(channel_map: ChannelMap) -> ChannelMap:
    return with_barred(channel_map, 0, int(np.flatnonzero(channel_map.barred[0])[4]), False)


def channel_over_another(channel_map: ChannelMap) -> ChannelMap:
    """The dividing streamline's two copies cross over: each channel takes a strip of the other."""

    def lift(xy: np.ndarray) -> None:
        xy[:, -1] += (0.0, 0.05)

    return with_channel(channel_map, 0, lift)


def bay_twice(channel_map: ChannelMap) -> ChannelMap:
    return replace(
        channel_map,
        bays=(*channel_map.bays, channel_map.bays[0]),
        lid_places=(*channel_map.lid_places, channel_map.lid_places[0]),
    )


BROKEN: dict[str, tuple[Callable[[ChannelMap], ChannelMap], str]] = {
    "cell folded": (fold_cell, "folded"),
    "cell folded by a hair": (fold_by_a_hair, "folded"),
    "bay cell folded": (fold_bay_cell, "folded"),
    "obstacle in a channel": (obstacle_in_channel, "meet an obstacle"),
    "obstacle in a bay": (obstacle_in_bay, "meet an obstacle"),
    "obstacle moved": (obstacle_moved, "meet an obstacle"),
    "bay dropped": (bay_dropped, "of the free ground is mapped"),
    "obstacle gone": (obstacle_gone, "of the free ground is mapped"),
    "columns dropped": (columns_dropped, "of the free ground is mapped"),
    "shared node moved": (shared_node_moved, "differ between neighbouring"),
    "lid node moved": (lid_node_moved, "differ between neighbouring"),
    "lid place wrong": (lid_place_wrong, "differ between neighbouring"),
    "free node barred": (free_node_barred, "off every wall"),
    "wall node not barred": (wall_node_not_barred, "differ between neighbouring"),
    "channel over another": (channel_over_another, "mapped twice"),
    "bay twice": (bay_twice, "mapped twice"),
}


def test_sound_map_passes() -> None:
    channel_map = sound_map()
    assert channel_map.channels == 2
    assert channel_map.bays
    found = check_map(channel_map)
    assert found.failures == ()
    assert found.coverage == pytest.approx(channel_map.quality.coverage, abs=1e-12)
    check_laws(channel_map)


@pytest.mark.parametrize("name", BROKEN)
def test_broken_law_is_found_and_the_map_refused(name: str) -> None:
    broken, phrase = BROKEN[name][0](sound_map()), BROKEN[name][1]
    assert any(phrase in failure for failure in examine(broken).failures)
    with pytest.raises(MapError, match=f"channel map: .*{phrase}.*the map is refused"):
        check_map(broken)
    with pytest.raises(AssertionError):
        check_laws(broken)


def test_counts_are_those_of_what_was_broken() -> None:
    channel_map = sound_map()
    assert examine(shared_node_moved(channel_map)).unshared_nodes == 1
    assert examine(lid_node_moved(channel_map)).unshared_nodes == 1
    assert examine(free_node_barred(channel_map)).stray_nodes == 2
    assert examine(wall_node_not_barred(channel_map)).unshared_nodes == 1
    assert examine(fold_by_a_hair(channel_map)).folded_cells == 1
    free = channel_map.grown.free_area_m2
    dropped = sum(shapely.area(shapely.polygons(channel_map.bays[0].corners_m())))
    assert examine(bay_dropped(channel_map)).coverage == pytest.approx(channel_map.quality.coverage - dropped / free)


def test_node_without_a_place_fails() -> None:
    """A nan among the nodes of cells is no sound map, whatever compares false with it."""

    def forget(xy: np.ndarray) -> None:
        xy[8, 3] = np.nan

    assert examine(with_channel(sound_map(), 0, forget)).failures
