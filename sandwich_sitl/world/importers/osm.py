"""OpenStreetMap extracts (.osm, .osm.pbf): `building=*` ways and multipolygon relations, degrees on WGS84.

Areas are put together by libosmium. What it refuses is not lost silently: a closed way whose corners are all there is
taken as it stands and mended, everything else is dropped with the reason.
"""

from collections.abc import Mapping
from pathlib import Path

import osmium
import shapely
from osmium.filter import KeyFilter
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.limits import MAX_OSM_BYTES, MAX_OSM_OBJECTS, file_size, head
from sandwich_sitl.world.importers.shapes import ShapeList
from sandwich_sitl.world.importers.tags import height_m, matches
from sandwich_sitl.world_config import ImportOptions

_KEY = "building"


def read_osm(path: Path, options: ImportOptions, found: ShapeList) -> None:
    """Add the extract's buildings to `found`. Raises `InputError` naming the file and the fix."""
    file_size(path, MAX_OSM_BYTES)
    file_format = "xml" if head(path).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<") else "pbf"
    pending: dict[str, tuple[dict[str, str], list[tuple[float, float]] | str]] = {}
    try:
        file = osmium.io.File(str(path), file_format)
        _check_size(file, path)
        _read_objects(file, options, found, pending)
    except (RuntimeError, osmium.InvalidLocationError) as error:
        reason = " ".join(str(error).split())[:160]
        raise InputError(f"{path}: is no complete OpenStreetMap extract ({reason}); export it again") from error
    for name, (tags, corners) in pending.items():
        if isinstance(corners, str):
            found.read += 1
            found.drop(name, corners)
        else:
            _add(found, name, Polygon(corners), tags, options)


def _check_size(file: osmium.io.File, path: Path) -> None:
    for count, _ in enumerate(osmium.FileProcessor(file), 1):
        if count > MAX_OSM_OBJECTS:
            raise InputError(f"{path}: has more than {MAX_OSM_OBJECTS} objects; cut out the part that is flown")


def _read_objects(
    file: osmium.io.File,
    options: ImportOptions,
    found: ShapeList,
    pending: dict[str, tuple[dict[str, str], list[tuple[float, float]] | str]],
) -> None:
    to_wkb = osmium.geom.WKBFactory()
    for item in osmium.FileProcessor(file).with_areas(KeyFilter(_KEY)).with_filter(KeyFilter(_KEY)):
        if not isinstance(item, osmium.osm.Way | osmium.osm.Relation | osmium.osm.Area):
            continue
        tags = dict(item.tags)
        if tags[_KEY] == "no" or not matches(tags, options.where):
            once = not isinstance(item, osmium.osm.Area)
            found.read += once
            found.filtered += once
        elif isinstance(item, osmium.osm.Area):
            if not item.num_rings()[0]:
                continue
            name = f"{'way' if item.from_way() else 'relation'} {item.orig_id()}"
            pending.pop(name, None)
            _add(found, name, shapely.from_wkb(to_wkb.create_multipolygon(item)), tags, options)
        elif isinstance(item, osmium.osm.Way):
            pending[f"way {item.id}"] = (tags, _corners(item))
        elif tags.get("type") == "multipolygon":
            pending[f"relation {item.id}"] = (tags, "is incomplete in the extract, or its ways do not close")


def _corners(way: osmium.osm.Way) -> list[tuple[float, float]] | str:
    if not way.is_closed():
        return "is not closed"
    if not all(node.location.valid() for node in way.nodes):
        return "has corners outside the extract"
    corners = [(node.lon, node.lat) for node in way.nodes]
    return corners if len(set(corners)) >= 3 else "has no area"


def _add(
    found: ShapeList,
    name: str,
    geometry: BaseGeometry,
    tags: Mapping[str, str],
    options: ImportOptions,
) -> None:
    height, remark = height_m(tags, options.storey_m)
    if remark:
        found.remark(name, remark)
    found.add(name, f"{found.source}: {name}", geometry, height)
