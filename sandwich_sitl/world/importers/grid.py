"""An occupancy grid to a `World`: outlines of its solid cells, the ground that can be reached, the bounds round it.

Cell (row, column) of a grid is the square [column, column + 1] x [row, row + 1] times the cell's edge, turned by yaw and
moved to the origin; row 0 is the southernmost. Two cells that meet at a corner alone leave no gap, neither between
obstacles nor for the vehicle: obstacles are outlined cell side by cell side and touch there, free ground is connected
over sides only.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.ndimage
import shapely
from numpy.typing import NDArray
from shapely import Polygon, affinity, box

from sandwich_sitl.errors import InputError, printable
from sandwich_sitl.world.grow import mitred
from sandwich_sitl.world.importers.limits import MAX_COORDINATE_M, MAX_GRID_CELLS
from sandwich_sitl.world.importers.notches import fill_notches
from sandwich_sitl.world.importers.outline import outlines, without_holes
from sandwich_sitl.world.importers.result import GridFacts, ImportedWorld, ImportReport, Note
from sandwich_sitl.world.world import Obstacle, World, matter
from sandwich_sitl.world_config import Box, ImportOptions

Cells = NDArray[np.bool_]

_SUB_CELL = 0.999  # of a cell: the default tolerance stays below one, so that a notch one cell deep stays
_HAIR_M = 0.01  # bounds keep this much inside the ground of a vehicle's middle


@dataclass(frozen=True)
class Grid:
    """`solid` and `unknown` cells (rows, columns), row 0 southernmost; origin is the lower left corner."""

    source: str
    solid: Cells
    unknown: Cells
    cell_m: float
    origin_m: tuple[float, float] = (0.0, 0.0)
    yaw_rad: float = 0.0
    remarks: tuple[str, ...] = ()

    def placed(self, polygon: Polygon) -> Polygon:
        """A polygon in cells as ENU metres."""
        c, s = self.cell_m * math.cos(self.yaw_rad), self.cell_m * math.sin(self.yaw_rad)
        moved = affinity.affine_transform(polygon, [c, -s, s, c, *self.origin_m])
        assert isinstance(moved, Polygon)
        return moved


def check_size(source: Path, columns: int, rows: int) -> None:
    """Raises `InputError` for a grid without cells or with more than `MAX_GRID_CELLS`."""
    if not (columns > 0 and rows > 0 and columns * rows <= MAX_GRID_CELLS):
        raise InputError(f"{source}: declares {columns} x {rows} cells; give 1 to {MAX_GRID_CELLS}, or coarser ones")


def grid_world(grid: Grid, file_format: str, options: ImportOptions) -> ImportedWorld:
    """Outline, simplify and bound the grid. Raises `InputError` when nothing is free or the grid is too ragged."""
    rows, columns = grid.solid.shape
    extent_m = max(map(abs, grid.origin_m)) + grid.cell_m * (rows + columns)
    if extent_m > MAX_COORDINATE_M:
        raise InputError(f"{grid.source}: reaches {extent_m:.3g} m from (0, 0); give resolution and origin in metres")
    obstructed = grid.solid if options.unknown_is_free else grid.solid | grid.unknown
    meant, enclosed = _reachable(grid, obstructed, options)
    pieces = [piece for outline in outlines(grid.source, obstructed | enclosed) for piece in without_holes(outline)]
    tolerance = _SUB_CELL if options.simplify_m is None else options.simplify_m / grid.cell_m
    corners = sum(len(piece.exterior.coords) - 1 for piece in pieces)
    simple = fill_notches(pieces, tolerance, options.kept_gap_m / grid.cell_m) if tolerance > 0 else pieces
    placed = [grid.placed(piece) for piece in simple]
    if not options.unknown_is_free:
        placed += _outside(grid, options.bounds_m)
    bounds = options.bounds_m or _bounds(grid, meant, placed, options.clearance_m or 0.0)
    inside = matter(placed, bounds, options.clearance_m or 0.0)
    kept = [polygon for polygon, keep in zip(placed, inside, strict=True) if keep]
    digits = len(str(len(kept)))
    remarks = [Note("grid", printable(text)) for text in grid.remarks]
    remarks.append(
        Note("outlines", f"{corners} corners of cells became {sum(len(p.exterior.coords) - 1 for p in simple)}")
    )
    report = ImportReport(
        source=grid.source,
        file_format=file_format,
        read=len(placed),
        outside=len(placed) - len(kept),
        vertices=sum(len(polygon.exterior.coords) - 1 for polygon in kept),
        courtyards=_enclosed_notes(grid, enclosed),
        remarks=tuple(remarks),
        grid=GridFacts(columns, rows, grid.cell_m, int(grid.solid.sum()), int(grid.unknown.sum()), int(enclosed.sum())),
    )
    obstacles = tuple(Obstacle(f"block{k:0{digits}}", polygon) for k, polygon in enumerate(kept, 1))
    return ImportedWorld(World(bounds, obstacles), report)


def _reachable(grid: Grid, obstructed: Cells, options: ImportOptions) -> tuple[Cells, Cells]:
    """The free cells that are meant, and the free cells that obstacles cut off from them and from the grid's edge."""
    label, count = scipy.ndimage.label(~obstructed)
    if not count:
        raise InputError(f"{grid.source}: has no free cell; check thresholds and negate, or take unknown cells as free")
    if options.inside_m is None:
        sizes = np.bincount(label.ravel())
        sizes[0] = 0
        chosen = int(sizes.argmax())
    else:
        chosen = _label_at(grid, label, options.inside_m)
    edge = np.unique(np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]]))
    return label == chosen, (label > 0) & ~np.isin(label, [*edge, chosen])


def _label_at(grid: Grid, label: NDArray[np.integer], point_m: tuple[float, float]) -> int:
    dx, dy = point_m[0] - grid.origin_m[0], point_m[1] - grid.origin_m[1]
    c, s = math.cos(grid.yaw_rad), math.sin(grid.yaw_rad)
    column, row = (math.floor(value / grid.cell_m) for value in (c * dx + s * dy, c * dy - s * dx))
    rows, columns = label.shape
    found = int(label[row, column]) if 0 <= row < rows and 0 <= column < columns else 0
    if not found:
        raise InputError(f"{grid.source}: inside_m {list(point_m)} is not on free ground; give a point that is")
    return found


def _bounds(grid: Grid, meant: Cells, placed: list[Polygon], clearance_m: float) -> Box:
    """Extent of the meant ground; with a clearance, of where a vehicle's middle can be in its largest part."""
    row, column = np.flatnonzero(meant.any(axis=1)), np.flatnonzero(meant.any(axis=0))
    extent = grid.placed(box(column[0], row[0], column[-1] + 1, row[-1] + 1))
    if not clearance_m:
        return extent.bounds
    blocked = shapely.union_all([mitred(polygon, clearance_m + _HAIR_M) for polygon in placed])
    parts = [part for part in shapely.get_parts(extent.difference(blocked)) if part.area > 0]
    if not parts:
        raise InputError(f"{grid.source}: no free ground is {2 * clearance_m:g} m wide; lower clearance_m")
    x_min, y_min, x_max, y_max = max(parts, key=lambda part: part.area).bounds
    return (x_min, y_min, x_max, y_max)


def _outside(grid: Grid, bounds: Box | None) -> list[Polygon]:
    """What the image leaves uncovered of the bounds, or of the rectangle round a turned image: unknown ground."""
    rows, columns = grid.solid.shape
    image = grid.placed(box(0, 0, columns, rows))
    rest = shapely.get_parts(box(*(bounds or image.bounds)).difference(image))
    # Rounding leaves hairs beside an image that is not turned.
    wide = [part for part in rest if isinstance(part, Polygon) and not part.buffer(-1e-6 * grid.cell_m).is_empty]
    return [piece for part in wide for piece in without_holes(part)]


def _enclosed_notes(grid: Grid, enclosed: Cells) -> tuple[Note, ...]:
    _, count = scipy.ndimage.label(enclosed)
    area = float(enclosed.sum()) * grid.cell_m**2
    return (Note("grid", f"{count} enclosed, {area:.1f} m2, covered"),) if count else ()
