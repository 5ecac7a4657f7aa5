"""Flow along y is flow along x of the world turned by a quarter, measured on maps built both ways."""

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate
from world_samples import BOUNDS, grown_world, random_shapes

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.flow import _back, _turned, flow_along, turned_world
from sandwich_sitl.world.grow import GrownWorld


def test_flow_follows_the_longer_leg() -> None:
    assert flow_along((0, 0), (10, 3)) == flow_along((10, 3), (0, 0)) == "x"
    assert flow_along((0, 0), (-3, -10)) == flow_along((5, 20), (5, 2)) == "y"


def test_turn_keeps_area_orientation_and_names_and_four_turns_are_none() -> None:
    grown = grown_world(*random_shapes(12))
    turned = grown
    for _ in range(4):
        turned = turned_world(turned, "y")
        assert turned.names == grown.names
        for before, after in zip(grown.polygons, turned.polygons, strict=True):
            assert after.exterior.is_ccw
            assert after.area == pytest.approx(before.area)
        assert shapely.box(*turned.bounds_m).covers(shapely.union_all(list(turned.polygons)))
    assert turned.bounds_m == grown.bounds_m
    assert all(a.equals(b) for a, b in zip(turned.polygons, grown.polygons, strict=True))
    assert turned_world(grown, "x") is grown


def test_turn_and_back_is_the_identity() -> None:
    points = np.random.default_rng(0).normal(size=(4, 5, 2))
    np.testing.assert_array_equal(_back(_turned(points)), points)
    np.testing.assert_array_equal(_turned(_back(points)), points)


@pytest.mark.parametrize("seed", [3, 12])
def test_map_along_y_is_the_map_along_x_of_the_turned_world(seed: int) -> None:
    grown = grown_world(*random_shapes(seed))
    x_min, y_min, x_max, y_max = BOUNDS
    turned = GrownWorld(
        (y_min, -x_max, y_max, -x_min),
        tuple(rotate(polygon, -90, origin=(0, 0)) for polygon in grown.polygons),
        grown.names,
    )
    along_y = build_channel_map(grown, 1.7, 5, "y")
    along_x = build_channel_map(turned, 1.7, 5, "x")
    assert along_y.flow == "y"
    assert along_y.grown.names == grown.names
    assert all(a.equals_exact(b, 1e-5) for a, b in zip(along_y.grown.polygons, grown.polygons, strict=True))
    assert along_y.channels == along_x.channels > 1
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    for here, there in zip(along_y.xy_m, along_x.xy_m, strict=True):
        np.testing.assert_allclose(here, there @ quarter.T, atol=1e-6)
        np.testing.assert_allclose(here[0, :, 1], y_min, atol=1e-9)
        np.testing.assert_allclose(here[-1, :, 1], y_max, atol=1e-9)
    for a, b in zip(along_y.bays, along_x.bays, strict=True):
        np.testing.assert_allclose(a.xy_m, b.xy_m @ quarter.T, atol=1e-6)
    np.testing.assert_array_equal(along_y.barred, along_x.barred)
