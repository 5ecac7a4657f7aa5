"""Routes on a map with one more obstacle are those on the map that is built anew with it."""

import numpy as np
import pytest
import shapely
from map_laws import check_lookup, check_reachability, free_points
from shapely import LineString
from world_samples import BOUNDS, convex, grown_world, random_shapes

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.channels.update import update_map
from sandwich_sitl.errors import NoRouteError
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.map_graph import build_map_graph
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.routes import find_route, shortened

CELL_M = 1.7


def lengths(channel_map: ChannelMap, start: np.ndarray, goal: np.ndarray) -> tuple[float, float]:
    """Of the A* path and of the tight route, infinite where there is no route."""
    map_graph = build_map_graph(channel_map)
    try:
        route = find_route(channel_map, map_graph, start, goal)
    except NoRouteError:
        return np.inf, np.inf
    solid = shapely.union_all([polygon.buffer(-1e-6) for polygon in channel_map.grown.polygons])
    assert not LineString(route.points_m).intersects(solid)
    tight = shortened(map_graph, build_nav_mesh(channel_map.grown), route, "tight")
    return path_length(route.points_m), path_length(tight.points_m)


@pytest.mark.parametrize("seed", [6, 8, 12, 14, 20, 24])
def test_routes_are_as_long_as_on_the_map_built_anew(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(BOUNDS[:2], BOUNDS[2:])
    obstacle = convex(rng, float(x), float(y), 14.0)
    channel_map = build_channel_map(grown_world(*random_shapes(seed)), CELL_M, 5)
    updated = update_map(channel_map, obstacle, "newcomer", CELL_M)
    anew = build_channel_map(updated.grown, CELL_M, 5)
    check_reachability(updated, build_map_graph(updated))
    points = free_points(updated, 12, seed)
    check_lookup(updated, points)
    for start, goal in zip(points[:6], points[6:], strict=True):
        walked, tight = lengths(updated, start, goal)
        _, tight_anew = lengths(anew, start, goal)
        assert tight == pytest.approx(tight_anew, rel=1e-3)
        # The bound that a path along a grid's edges keeps on every map.
        assert tight - 1e-3 <= walked <= 1.25 * tight + 2.0
