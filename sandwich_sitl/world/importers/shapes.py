"""Shapes on their way from a file to a world: counted, checked, made simple, and measured out in ENU metres.

A `ShapeList` takes what a reader finds, in the map's own coordinates (degrees longitude, latitude or metres);
`to_world` projects, checks every outline and settles the bounds. An obstacle is an outline without holes: a courtyard
is ground that nothing can reach in plan, so it is noted and covered.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely import GeometryCollection, LinearRing, MultiPolygon, Polygon, box
from shapely.geometry.base import BaseGeometry
from shapely.validation import explain_validity

from sandwich_sitl.errors import InputError, printable
from sandwich_sitl.world.importers.limits import MAX_COORDINATE_M, MAX_SHAPES, MAX_SIMPLIFIED_VERTICES, MAX_VERTICES
from sandwich_sitl.world.importers.notches import fill_notches
from sandwich_sitl.world.importers.projection import configured_origin, origin_of, to_enu, window_m
from sandwich_sitl.world.importers.result import ImportedWorld, ImportReport, Note
from sandwich_sitl.world.world import GeoOrigin, Obstacle, World, matter
from sandwich_sitl.world_config import Box, ImportOptions

MAX_REPAIR_VERTICES = 300  # of one outline that crosses itself: crossings grow with the square
MAX_REPAIR_VERTICES_IN_ALL = 3_000
_BORDER_SHARE = 0.05  # free ground added on each side when no bounds are given
_SAME_AREA = 1e-9
_FLAT = 1e-9  # of the perimeter squared: less area than that is rounding
_NAME_LENGTH = 60
_NAMED = 100  # shapes outside the bounds that a report names


@dataclass(frozen=True)
class Shape:
    """One polygon in the coordinates of its file; `where` is its place there."""

    name: str
    where: str
    polygon: Polygon
    height_m: float | None


@dataclass
class ShapeList:
    """What a reader found so far. `add` and `drop` raise `InputError` when a limit is passed."""

    source: str
    in_degrees: bool
    window: Polygon | None = None
    repair: bool = False
    read: int = 0
    filtered: int = 0
    outside: int = 0
    vertices: int = 0
    shapes: list[Shape] = field(default_factory=list)
    repaired: list[Note] = field(default_factory=list)
    dropped: list[Note] = field(default_factory=list)
    courtyards: list[Note] = field(default_factory=list)
    remarks: list[Note] = field(default_factory=list)

    def add(self, name: str, where: str, geometry: BaseGeometry, height_m: float | None) -> None:
        """Take every polygon of a geometry; other parts are dropped with the reason."""
        parts = list(_flat(geometry))
        for number, part in enumerate(parts):
            part_name = _label(name) + ("" if len(parts) == 1 else f".{number + 1}")
            self.read += 1
            if part.is_empty:
                self.drop(part_name, "has no corners")
            elif not isinstance(part, Polygon):
                self.drop(part_name, f"is a {part.geom_type}, not an area")
            else:
                self._check(part, where)
                if self.window is not None and not self.window.intersects(box(*part.bounds)):
                    self.outside += 1
                else:
                    self._take(Shape(part_name, where, part, height_m))

    def drop(self, name: str, reason: str) -> None:
        """Note a shape that does not become an obstacle."""
        self.dropped.append(Note(_label(name), reason))
        self._limit(len(self.dropped), MAX_SHAPES, "unusable shapes")

    def remark(self, name: str, reason: str) -> None:
        """Note something odd about a shape that is used all the same."""
        self.remarks.append(Note(_label(name), printable(reason)))

    def _take(self, shape: Shape) -> None:
        self.shapes.append(shape)
        self.vertices += int(shapely.get_num_coordinates(shape.polygon))
        self._limit(len(self.shapes), MAX_SHAPES, "shapes")
        self._limit(self.vertices, MAX_VERTICES, "corners")

    def _limit(self, count: int, most: int, what: str) -> None:
        if count > most:
            raise InputError(f"{self.source}: has more than {most} {what}; cut out the part that is flown")

    def _check(self, polygon: Polygon, where: str) -> None:
        xy = shapely.get_coordinates(polygon)
        if not np.isfinite(xy).all():
            raise InputError(f"{where}: has a coordinate that is not a finite number; correct it")
        if self.in_degrees and (np.abs(xy) > (180, 90)).any():
            raise InputError(
                f"{where}: coordinates must be longitude, latitude in degrees (WGS84), got {xy[0].tolist()}; "
                "convert the map to EPSG:4326"
            )
        if not self.in_degrees and (np.abs(xy) > MAX_COORDINATE_M).any():
            raise InputError(
                f"{where}: lies more than {MAX_COORDINATE_M:.0e} m from (0, 0); give metres in a local frame"
            )


def to_world(found: ShapeList, file_format: str, options: ImportOptions) -> ImportedWorld:
    """Project, check, fill and bound the shapes. Raises `InputError` naming file, shape and fix."""
    if not found.shapes and (options.bounds_m is None or (found.in_degrees and options.origin is None)):
        raise InputError(f"{found.source}: has no usable polygon{_why_none(found)}; give a map with areas in it")
    origin = _origin(found, options) if found.in_degrees else None
    window = window_m(options.window_deg, origin) if options.window_deg and origin else None
    obstacles = list(_obstacles(found, origin))
    bounds = options.bounds_m or window or _extent(obstacles, found)
    inside = matter([o.polygon for o in obstacles], bounds, options.clearance_m or 0.0)
    kept = [o for o, keep in zip(obstacles, inside, strict=True) if keep]
    if options.simplify_m:
        if sum(len(o.polygon.exterior.coords) for o in kept) > MAX_SIMPLIFIED_VERTICES:
            raise InputError(
                f"{found.source}: has more than {MAX_SIMPLIFIED_VERTICES} corners to simplify; "
                "cut out the part that is flown, or leave out simplify_m"
            )
        polygons = fill_notches([o.polygon for o in kept], options.simplify_m, options.kept_gap_m)
        kept = [replace(o, polygon=polygon) for o, polygon in zip(kept, polygons, strict=True)]
    report = ImportReport(
        source=found.source,
        file_format=file_format,
        read=found.read,
        filtered=found.filtered,
        outside=found.outside + len(obstacles) - len(kept),
        outside_names=tuple(o.name for o, keep in zip(obstacles, inside, strict=True) if not keep)[:_NAMED],
        vertices=sum(len(o.polygon.exterior.coords) - 1 for o in kept),
        repaired=tuple(found.repaired),
        dropped=tuple(found.dropped),
        courtyards=tuple(found.courtyards),
        remarks=tuple(found.remarks),
    )
    return ImportedWorld(World(bounds, tuple(kept), origin), report)


def _label(name: str) -> str:
    return printable(name[:_NAME_LENGTH])


def _flat(geometry: BaseGeometry) -> Iterator[BaseGeometry]:
    if isinstance(geometry, MultiPolygon | GeometryCollection) and not geometry.is_empty:
        for part in geometry.geoms:
            yield from _flat(part)
    else:
        yield geometry


def _why_none(found: ShapeList) -> str:
    reasons = [f"{found.filtered} do not match the filter"] * bool(found.filtered)
    reasons += [f"{found.outside} lie outside the window"] * bool(found.outside)
    reasons += [f"{len(found.dropped)} dropped, the first, {n.name}, because it {n.reason}" for n in found.dropped[:1]]
    return f" ({', '.join(reasons)})" if reasons else ""


def _origin(found: ShapeList, options: ImportOptions) -> GeoOrigin | None:
    extent = options.window_deg
    if extent is None and found.shapes:
        west, south, east, north = map(float, shapely.total_bounds([shape.polygon for shape in found.shapes]))
        extent = (west, south, east, north)
    return origin_of(found.source, extent, options) if extent else configured_origin(options)


def _obstacles(found: ShapeList, origin: GeoOrigin | None) -> Iterator[Obstacle]:
    polygons = np.array([shape.polygon for shape in found.shapes], dtype=object)
    if origin is not None:
        polygons = shapely.transform(polygons, lambda lon_lat: to_enu(lon_lat, origin))
    budget = MAX_REPAIR_VERTICES_IN_ALL
    for shape, polygon in zip(found.shapes, shapely.force_2d(polygons), strict=True):
        if polygon.interiors:
            holes = sum(Polygon(ring).area for ring in polygon.interiors)
            found.courtyards.append(Note(shape.name, f"{len(polygon.interiors)} enclosed, {holes:.1f} m2, covered"))
        outline = Polygon(polygon.exterior)
        if _is_flat(shape.polygon):
            if not found.repair:
                raise InputError(
                    f"{shape.where}: '{shape.name}' is not a simple polygon: it has no area; list its corners in order, "
                    "or import with repair"
                )
            found.drop(shape.name, "has no area")
            continue
        if outline.is_valid:
            yield Obstacle(shape.name, outline, shape.height_m)
            continue
        corners = len(outline.exterior.coords)
        budget -= corners
        if corners <= MAX_REPAIR_VERTICES and budget >= 0:
            yield from _repaired(found, shape, outline)
        elif found.repair:
            hull = outline.convex_hull
            assert isinstance(hull, Polygon)
            found.repaired.append(Note(shape.name, "has too many corners to mend, its convex hull covered"))
            yield Obstacle(shape.name, hull, shape.height_m)
        else:
            raise InputError(
                f"{shape.where}: '{shape.name}' is not a simple polygon ({explain_validity(outline)}) and has too many "
                "corners to tell whether it crosses itself; list its corners in order, or import with repair"
            )


def _is_flat(polygon: Polygon) -> bool:
    """Whether all corners lie on a line; asked of the file's coordinates, since projecting bends a parallel."""
    ring = np.array(polygon.exterior.coords)[:, :2]
    hull = shapely.MultiPoint(ring).convex_hull
    return hull.area <= _FLAT * hull.length**2


def _repaired(found: ShapeList, shape: Shape, outline: Polygon) -> Iterator[Obstacle]:
    """Only what leaves the enclosed area as it was is repaired without being asked."""
    why = explain_validity(outline)
    faces = shapely.get_parts(shapely.polygonize([shapely.node(LinearRing(outline.exterior.coords))]))
    solid = [part for part in shapely.get_parts(shapely.union_all(faces)) if part.area > 0]
    mended = shapely.make_valid(outline, method="structure", keep_collapsed=False)
    unchanged = abs(mended.area - outline.area) <= _SAME_AREA * outline.area
    if not unchanged and not found.repair:
        raise InputError(
            f"{shape.where}: '{shape.name}' is not a simple polygon ({why}); list its corners in order, or import with repair"
        )
    found.repaired.append(
        Note(shape.name, f"{why}: {'touches' if unchanged else 'crosses'} itself, all inside covered")
    )
    for number, part in enumerate(solid):
        name = shape.name if len(solid) == 1 else f"{shape.name}.{number + 1}"
        yield Obstacle(name, Polygon(part.exterior), shape.height_m)


def _extent(obstacles: list[Obstacle], found: ShapeList) -> Box:
    if not obstacles:
        raise InputError(f"{found.source}: has no usable polygon{_why_none(found)}; give a map with areas in it")
    x_min, y_min, x_max, y_max = (float(value) for value in shapely.total_bounds([o.polygon for o in obstacles]))
    dx, dy = _BORDER_SHARE * (x_max - x_min), _BORDER_SHARE * (y_max - y_min)
    return (x_min - dx, y_min - dy, x_max + dx, y_max + dy)
