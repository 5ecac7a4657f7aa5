"""The flow direction: a world turned so that its channels run along x, and the map turned back.

Flow along y is flow along x in axes (u, v) = (y, -x), a turn by -90 degrees: orientation is kept.
"""

from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap, Flow
from sandwich_sitl.world.grow import GrownWorld

Array = NDArray[np.float64]


def flow_along(start: tuple[float, float], goal: tuple[float, float]) -> Flow:
    """The axis along which the leg from start to goal is longer: there a route has the least to cross."""
    return "x" if abs(goal[0] - start[0]) >= abs(goal[1] - start[1]) else "y"


def turned_world(grown: GrownWorld, flow: Flow) -> GrownWorld:
    """The world in axes (u, v) in which the flow runs along u."""
    if flow == "x":
        return grown
    x_min, y_min, x_max, y_max = grown.bounds_m
    return replace(
        grown,
        bounds_m=(y_min, -x_max, y_max, -x_min),
        polygons=tuple(shapely.transform(polygon, _turned) for polygon in grown.polygons),
    )


def turned_back(channel_map: ChannelMap, grown: GrownWorld) -> ChannelMap:
    """A map made in axes (u, v) of its flow, in those of the world `grown` it was made from."""
    if channel_map.flow == "x":
        return replace(channel_map, grown=grown)
    return replace(
        channel_map,
        grown=grown,
        xy_m=tuple(_back(xy) for xy in channel_map.xy_m),
        bays=tuple(replace(bay, xy_m=_back(bay.xy_m)) for bay in channel_map.bays),
        lost=tuple(replace(lost, ring_m=_back(lost.ring_m)) for lost in channel_map.lost),
    )


def _turned(xy: Array) -> Array:
    return np.stack([xy[..., 1], -xy[..., 0]], axis=-1)


def _back(uv: Array) -> Array:
    return np.stack([-uv[..., 1], uv[..., 0]], axis=-1)
