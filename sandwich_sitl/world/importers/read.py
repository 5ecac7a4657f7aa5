"""`read_world`: one map file in, one world and its report out; the suffix, else the content, tells the format."""

from pathlib import Path

from shapely import box

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.geojson import read_geojson
from sandwich_sitl.world.importers.grid import grid_world
from sandwich_sitl.world.importers.limits import head
from sandwich_sitl.world.importers.moving_ai import read_moving_ai
from sandwich_sitl.world.importers.osm import read_osm
from sandwich_sitl.world.importers.result import ImportedWorld
from sandwich_sitl.world.importers.ros_map import read_ros_map
from sandwich_sitl.world.importers.shapes import ShapeList, to_world
from sandwich_sitl.world.importers.text_shapes import read_csv, read_wkt
from sandwich_sitl.world_config import ImportOptions

_SUFFIXES = {
    ".geojson": "GeoJSON", ".json": "GeoJSON", ".osm": "OpenStreetMap", ".pbf": "OpenStreetMap",
    ".yaml": "ROS map", ".yml": "ROS map", ".map": "MovingAI", ".wkt": "WKT", ".csv": "CSV",
}  # fmt: skip
_BEGINNINGS = (
    (b"{", "GeoJSON"), (b"<", "OpenStreetMap"), (b"type ", "MovingAI"), (b"image:", "ROS map"),
    (b"POLYGON", "WKT"), (b"MULTIPOLYGON", "WKT"), (b"GEOMETRYCOLLECTION", "WKT"), (b"name,", "CSV"),
)  # fmt: skip
_IN_DEGREES = ("GeoJSON", "OpenStreetMap")


def read_world(path: Path, options: ImportOptions | None = None) -> ImportedWorld:
    """Read a map of any known format. Raises `InputError` naming the file, the place in it and the fix."""
    options = options or ImportOptions()
    file_format = _format(path)
    in_degrees = file_format in _IN_DEGREES
    if not in_degrees and (options.window_deg or options.origin):
        raise InputError(f"{path}: a {file_format} map is in metres; give bounds_m instead of window_deg and origin")
    if options.where and not in_degrees:
        raise InputError(f"{path}: a {file_format} map has no properties to filter by; remove the filter")
    if file_format == "ROS map":
        return grid_world(read_ros_map(path), file_format, options)
    if file_format == "MovingAI":
        return grid_world(read_moving_ai(path, options), file_format, options)
    window = box(*options.window_deg) if options.window_deg else None
    found = ShapeList(str(path), in_degrees, window, options.repair or file_format == "OpenStreetMap")
    if file_format == "GeoJSON":
        read_geojson(path, options, found)
    elif file_format == "OpenStreetMap":
        read_osm(path, options, found)
    elif file_format == "WKT":
        read_wkt(path, found)
    else:
        read_csv(path, options, found)
    return to_world(found, file_format, options)


def _format(path: Path) -> str:
    start = head(path).removeprefix(b"\xef\xbb\xbf").lstrip()
    if not start:
        raise InputError(f"{path}: is empty; give a map file")
    if known := _SUFFIXES.get(path.suffix.lower()):
        return known
    for beginning, name in _BEGINNINGS:
        if start.startswith(beginning):
            return name
    raise InputError(f"{path}: is no known map; give one of {', '.join(sorted(_SUFFIXES))}")
