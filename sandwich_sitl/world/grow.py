"""Obstacles grown by the vehicle: where a point may fly, the whole vehicle may.

The vehicle is a disc in plan. Growing is the Minkowski sum with that disc, rounded outwards: mitred corners, cut off no
nearer than 1.5 radii, keep the vertex count of the input and never leave out a point of the true sum. Shapes that then
touch are united; ground that they enclose cannot be reached and is filled.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, box
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from sandwich_sitl.world.simplify import simplify_outwards
from sandwich_sitl.world.world import World

_MITRE_LIMIT = 1.5
_SHORTEST_EDGE_M = 0.001  # shorter ones, left over from uniting shapes, are smoothed away; paid for by growing more
_SNAP = 1e-7  # of the extent: coordinates this near the border lie on it
_SEAL_M = 0.005  # gaps narrower than twice this between grown shapes are closed: they are thinner than any grid cell


@dataclass(frozen=True)
class GrownWorld:
    """Disjoint simple polygons without holes inside the bounds, counter-clockwise, with the names of their sources."""

    bounds_m: tuple[float, float, float, float]
    polygons: tuple[Polygon, ...]
    names: tuple[str, ...]

    @property
    def free_area_m2(self) -> float:
        """Area of the bounds less the grown obstacles."""
        x_min, y_min, x_max, y_max = self.bounds_m
        return (x_max - x_min) * (y_max - y_min) - sum(polygon.area for polygon in self.polygons)

    def rings_m(self) -> tuple[NDArray[np.float64], ...]:
        """Vertices (V, 2) of each polygon, counter-clockwise, without closing point."""
        return tuple(shapely.get_coordinates(polygon.exterior)[:-1] for polygon in self.polygons)

    def blocker(self, point_m: tuple[float, float]) -> str | None:
        """Name of the grown obstacle whose interior holds the point, or None."""
        point = shapely.Point(point_m)
        for polygon, name in zip(self.polygons, self.names, strict=True):
            if polygon.contains(point):
                return name
        return None


def grow(world: World, distance_m: float, detail_m: float) -> GrownWorld:
    """Grow every obstacle by `distance_m`; details below `detail_m` are smoothed, always outwards."""
    if not world.obstacles:
        return GrownWorld(world.bounds_m, (), ())
    reach = distance_m + 2 * _SHORTEST_EDGE_M
    shapes = [mitred(o.polygon, reach) for o in world.obstacles]
    frame = box(*world.bounds_m)
    filled = _filled(shapely.intersection(_united(shapes), frame))
    simple = _filled(shapely.intersection(_united([simplify_outwards(part, detail_m) for part in filled]), frame))
    sealed = mitred(mitred(shapely.union_all(simple), _SEAL_M), -_SEAL_M)
    clipped = _without_border_slivers(sealed & frame, frame, detail_m).simplify(_SHORTEST_EDGE_M)
    parts = [orient(part) for part in _filled(clipped) if not mitred(part, -_SHORTEST_EDGE_M).is_empty]
    return GrownWorld(
        bounds_m=world.bounds_m,
        polygons=tuple(parts),
        names=tuple(_names(part, world, shapes) for part in parts),
    )


def snapped(grown: GrownWorld) -> GrownWorld:
    """Coordinates within rounding of a border lie on it exactly."""
    x_min, y_min, x_max, y_max = grown.bounds_m
    tolerance = _SNAP * max(x_max - x_min, y_max - y_min)

    def snap(points: NDArray[np.float64]) -> NDArray[np.float64]:
        points = points.copy()
        for axis, value in ((0, x_min), (1, y_min), (0, x_max), (1, y_max)):
            points[np.abs(points[:, axis] - value) < tolerance, axis] = value
        return points

    return replace(grown, polygons=tuple(shapely.transform(polygon, snap) for polygon in grown.polygons))


def mitred(geometry: BaseGeometry, distance_m: float) -> BaseGeometry:
    """The geometry grown (or shrunk) by a distance, corners mitred up to `_MITRE_LIMIT` distances.

    GEOS now and then leaves a ring that touches itself, which no later step would take.
    """
    moved = geometry.buffer(distance_m, join_style="mitre", mitre_limit=_MITRE_LIMIT)
    return moved if moved.is_valid else shapely.make_valid(moved, method="structure", keep_collapsed=False)


def _without_border_slivers(obstacles: BaseGeometry, frame: Polygon, width_m: float) -> BaseGeometry:
    """Free slivers along the border narrower than twice `width_m` join the obstacle: no gap to fly through."""
    outside = frame.buffer(3 * width_m, join_style="mitre").difference(frame)
    solid = shapely.union_all([obstacles, outside])
    closed = mitred(mitred(solid, width_m), -width_m) & frame
    slivers = [part for part in _polygons(closed.difference(obstacles)) if part.intersection(frame.boundary).length > 0]
    return shapely.union_all([obstacles, *slivers], grid_size=1e-6)


def _united(shapes: Sequence[BaseGeometry]) -> MultiPolygon:
    """The union's area; what shapes share with the frame may be nothing, or a line."""
    return MultiPolygon(_polygons(shapely.union_all(shapes)))


def _polygons(geometry: shapely.Geometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(geometry) if isinstance(part, Polygon)]


def _filled(geometry: shapely.Geometry) -> list[Polygon]:
    """The parts without their holes; a part inside a filled hole is dropped."""
    return _polygons(shapely.union_all([Polygon(part.exterior) for part in _polygons(geometry)]))


def _names(part: Polygon, world: World, grown: Sequence[BaseGeometry]) -> str:
    """Sources of a part, those beside the border too."""
    near = shapely.intersects(np.array(grown), part)
    return "+".join(o.name for o, touches in zip(world.obstacles, near, strict=True) if touches) or "margin"
