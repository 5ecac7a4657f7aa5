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
_VECTORS = (*_IN_DEGREES, "WKT", "CSV")
_GRIDS = ("ROS map", "MovingAI")
_FORMATS_OF = {
    "where": _IN_DEGREES, "origin": _IN_DEGREES, "window_deg": _IN_DEGREES, "storey_m": _IN_DEGREES, "repair": _VECTORS,
    "cell_m": ("MovingAI",), "passable": ("MovingAI",), "unknown_is_free": _GRIDS, "inside_m": _GRIDS,
}  # fmt: skip


def read_world(path: Path, options: ImportOptions | None = None) -> ImportedWorld:
    """Read a map of any known format. Raises `InputError` naming the file, the place in it and the fix."""
    options = options or ImportOptions()
    file_format = _format(path)
    _check_options(path, file_format, options)
    if file_format == "ROS map":
        return grid_world(read_ros_map(path), file_format, options)
    if file_format == "MovingAI":
        return grid_world(read_moving_ai(path, options), file_format, options)
    window = box(*options.window_deg) if options.window_deg else None
    found = ShapeList(str(path), file_format in _IN_DEGREES, window, options.repair or file_format == "OpenStreetMap")
    if file_format == "GeoJSON":
        read_geojson(path, options, found)
    elif file_format == "OpenStreetMap":
        read_osm(path, options, found)
    elif file_format == "WKT":
        read_wkt(path, found)
    else:
        read_csv(path, options, found)
    return to_world(found, file_format, options)


def _check_options(path: Path, file_format: str, options: ImportOptions) -> None:
    """Raise `InputError` for an option that means nothing to the format; a default says nothing."""
    unset = ImportOptions()
    for key, formats in _FORMATS_OF.items():
        if getattr(options, key) != getattr(unset, key) and file_format not in formats:
            instead = "give bounds_m instead, in metres" if key == "window_deg" else "remove it"
            raise InputError(
                f"{path}: {key}: is for {' and '.join(formats)} alone, and means nothing to a {file_format} file; {instead}"
            )


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
