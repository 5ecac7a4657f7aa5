"""OpenStreetMap extracts (.osm, .osm.pbf): `building=*` ways and multipolygon relations, degrees on WGS84.

Areas are put together by libosmium, in a process of its own (`osm_extract`). What it refuses is not lost silently: a
closed way whose corners are all there is taken as it stands and mended, everything else is dropped with the reason.
"""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.limits import MAX_OSM_BYTES, MAX_OSM_OBJECTS, MAX_OSM_S, file_size, head
from sandwich_sitl.world.importers.shapes import ShapeList
from sandwich_sitl.world.importers.tags import height_m, matches
from sandwich_sitl.world.osm_extract import KEY
from sandwich_sitl.world_config import ImportOptions


def read_osm(path: Path, options: ImportOptions, found: ShapeList) -> None:
    """Add the extract's buildings to `found`. Raises `InputError` naming the file and the fix."""
    file_size(path, MAX_OSM_BYTES)
    pending: dict[str, tuple[dict[str, str], dict[str, Any]]] = {}
    for item in _buildings(path):
        name, tags = item["name"], item["tags"]
        is_area = "wkb" in item
        if tags[KEY] == "no" or not matches(tags, options.where):
            found.read += not is_area
            found.filtered += not is_area
        elif is_area:
            pending.pop(name, None)
            _add(found, name, shapely.from_wkb(item["wkb"]), tags, options)
        else:
            pending[name] = (tags, item)
    for name, (tags, item) in pending.items():
        if "unusable" in item:
            found.read += 1
            found.drop(name, item["unusable"])
        else:
            _add(found, name, Polygon(item["corners"]), tags, options)


def _buildings(path: Path) -> Iterator[dict[str, Any]]:
    file_format = "xml" if head(path).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<") else "pbf"
    arguments = [str(path), file_format, str(MAX_OSM_OBJECTS)]
    command = [sys.executable, "-P", "-m", "sandwich_sitl.world.osm_extract", *arguments]
    try:
        answer = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=MAX_OSM_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{path}: takes more than {MAX_OSM_S:g} s to read; cut out the part that is flown") from error
    *lines, last = answer.stdout.splitlines() or [b""]
    if answer.returncode != 0 or not last.startswith(b'{"end"'):
        raise InputError(f"{path}: is no OpenStreetMap extract ({_end(answer)}); export it again")
    refused = json.loads(last)["end"]
    if refused is not None:
        raise InputError(f"{path}: {refused}; export it again, or cut out the part that is flown")
    return map(json.loads, lines)


def _end(answer: "subprocess.CompletedProcess[bytes]") -> str:
    if answer.returncode < 0:
        return f"its reader ended with {signal.Signals(-answer.returncode).name}"
    words = answer.stderr.decode(errors="replace").split("\n")
    return f"its reader ended with: {' '.join(words[-2:]).strip()[:160]}"


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
