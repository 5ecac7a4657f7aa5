"""Polygons in text, metres: WKT (a geometry a line, or one over the whole file) and CSV with a header line.

CSV has columns name, x, y (a corner a line, lines of one name are one ring) or wkt (a geometry a line, name optional);
a column height gives metres.
"""

import csv
import io
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.limits import MAX_SHAPES, MAX_VERTICES, MAX_WKT_DEPTH, read_text
from sandwich_sitl.world.importers.shapes import ShapeList
from sandwich_sitl.world.importers.tags import height_m
from sandwich_sitl.world_config import ImportOptions

_SRID = re.compile(r"\s*SRID=(\d+);", re.IGNORECASE)


def read_wkt(path: Path, found: ShapeList) -> None:
    """Add the file's polygons to `found`. Raises `InputError` naming the line."""
    text = read_text(path)
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    if lines and text.count("(") != lines[0][1].count("(") and lines[0][1].count("(") != lines[0][1].count(")"):
        lines = [(lines[0][0], text)]
    for number, line in lines:
        where = f"{path}: line {number}"
        found.add(f"line{number}", where, _geometry(line, where), None)


def read_csv(path: Path, options: ImportOptions, found: ShapeList) -> None:
    """Add the file's polygons to `found`. Raises `InputError` naming the line."""
    rows = csv.DictReader(io.StringIO(read_text(path), newline=""), strict=True)
    try:
        columns = {(name or "").strip().lower() for name in rows.fieldnames or ()}
        if "wkt" in columns:
            _read_wkt_rows(path, rows, options, found)
        elif {"name", "x", "y"} <= columns:
            _read_corner_rows(path, rows, options, found)
        else:
            raise InputError(f"{path}: line 1: has columns {str(sorted(columns))[:80]}; give name,x,y or name,wkt")
    except csv.Error as error:
        raise InputError(
            f"{path}: line {rows.line_num + 1}: is not CSV ({error}); close quotes, or use .wkt"
        ) from error


def _read_wkt_rows(path: Path, rows: "csv.DictReader[str]", options: ImportOptions, found: ShapeList) -> None:
    for number, row in _clean(path, rows):
        where = f"{path}: line {number}"
        name = row.get("name") or f"line{number}"
        found.add(name, where, _geometry(row["wkt"], where), _height(name, row, options, found))


def _read_corner_rows(path: Path, rows: "csv.DictReader[str]", options: ImportOptions, found: ShapeList) -> None:
    rings: dict[str, list[tuple[float, float]]] = {}
    first: dict[str, tuple[int, dict[str, str]]] = {}
    for corners, (number, row) in enumerate(_clean(path, rows), 1):
        try:
            corner = (float(row["x"]), float(row["y"]))
        except ValueError as error:
            raise InputError(f"{path}: line {number}: x, y must be metres ({error})") from error
        if not all(map(math.isfinite, corner)):
            raise InputError(f"{path}: line {number}: x, y must be finite metres, got {corner}")
        first.setdefault(row["name"], (number, row))
        rings.setdefault(row["name"], []).append(corner)
        if corners > MAX_VERTICES or len(rings) > MAX_SHAPES:
            raise InputError(
                f"{path}: line {number}: has more than {MAX_VERTICES} corners or {MAX_SHAPES} shapes; "
                "cut out the part that is flown"
            )
    for name, ring in rings.items():
        number, row = first[name]
        where = f"{path}: line {number}"
        if len(set(ring)) < 3:
            raise InputError(f"{where}: '{name[:60]}' has {len(set(ring))} corners; list at least three")
        found.add(name, where, Polygon(ring), _height(name, row, options, found))


def _clean(path: Path, rows: "csv.DictReader[str]") -> Iterator[tuple[int, dict[str, str]]]:
    for row in rows:
        if None in row or None in row.values():
            raise InputError(f"{path}: line {rows.line_num}: has not as many fields as the header line; complete it")
        yield rows.line_num, {key.strip().lower(): value.strip() for key, value in row.items()}


def _height(name: str, row: dict[str, str], options: ImportOptions, found: ShapeList) -> float | None:
    height, remark = height_m({"height": row.get("height") or None}, options.storey_m)
    if remark:
        found.remark(name, remark)
    return height


def _geometry(text: str, where: str) -> BaseGeometry:
    if match := _SRID.match(text):
        raise InputError(
            f"{where}: is in the reference system SRID={match[1]}; give metres in a local frame, without SRID"
        )
    if _depth(text) > MAX_WKT_DEPTH:
        raise InputError(f"{where}: nests parentheses deeper than {MAX_WKT_DEPTH}; give a geometry a line")
    try:
        with np.errstate(invalid="ignore", over="ignore"):
            return shapely.from_wkt(text)
    except (shapely.errors.ShapelyError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{where}: is not WKT ({reason}); write POLYGON ((x y, x y, x y, x y))") from error


def _depth(text: str) -> int:
    depth = deepest = 0
    for bracket in re.findall(r"[()]", text):
        depth += 1 if bracket == "(" else -1
        deepest = max(deepest, depth)
    return deepest
