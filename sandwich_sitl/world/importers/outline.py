"""Outlines of the solid cells of a grid, exactly along the cells' sides, in cells.

The sides between solid and free cells are joined to straight runs that end at corners, and GEOS polygonizes them; each
face is solid or free, as the cell at a point of it is. Cells that meet at a corner alone belong to two faces.
"""

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, box

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.limits import MAX_GRID_CORNERS

Cells = NDArray[np.bool_]


def outlines(source: str, solid: Cells) -> list[Polygon]:
    """Polygons (with holes) that cover exactly the True cells, south to north. Raises `InputError` when too ragged."""
    padded = np.pad(solid, 1)
    # across[r, c]: side between cells (r - 1, c) and (r, c); upright[r, c]: side between (r, c - 1) and (r, c).
    across = padded[1:, 1:-1] != padded[:-1, 1:-1]
    upright = padded[1:-1, 1:] != padded[1:-1, :-1]
    runs_x, runs_y = np.pad(across, ((0, 0), (1, 1))), np.pad(upright, ((1, 1), (0, 0)))
    corner = (runs_x[:, 1:] | runs_x[:, :-1]) & (runs_y[1:] | runs_y[:-1])
    if corner.sum() > MAX_GRID_CORNERS:
        raise InputError(
            f"{source}: its outlines have {int(corner.sum())} corners, more than {MAX_GRID_CORNERS}; "
            "filter the noise, or make the cells coarser"
        )
    if not corner.any():
        return []
    x_runs, y_runs = _runs(across, corner), _runs(upright.T, corner.T)
    lines = np.concatenate([x_runs, y_runs[:, :, ::-1]])
    faces = shapely.get_parts(shapely.polygonize([*shapely.linestrings(list(lines))]))
    inside = np.floor(shapely.get_coordinates(shapely.point_on_surface(faces))).astype(int)
    solid_faces = [face for face, (x, y) in zip(faces, inside, strict=True) if solid[y, x]]
    return sorted(solid_faces, key=lambda face: (face.bounds[1], face.bounds[0], face.bounds))


def without_holes(polygon: Polygon) -> list[Polygon]:
    """The polygon cut into pieces without holes, along lines through its holes that follow the cells."""
    if not polygon.interiors:
        return [Polygon(polygon.exterior)]
    x_min, y_min, x_max, y_max = polygon.bounds
    left, _, right, _ = polygon.interiors[0].bounds
    middle = float(np.floor((left + right) / 2)) if right - left > 1 else (left + right) / 2
    halves = [box(x_min, y_min, middle, y_max), box(middle, y_min, x_max, y_max)]
    parts = [part for half in halves for part in shapely.get_parts(polygon & half) if isinstance(part, Polygon)]
    return [piece for part in parts for piece in without_holes(part)]


def _runs(sides: Cells, corner: Cells) -> NDArray[np.float64]:
    """Straight runs of sides along axis 1, shape (n, 2, 2): ends as (along, across); they end at corners."""
    line, position = np.nonzero(sides)
    starts = corner[line, position]
    ends = corner[line, position + 1]
    return np.stack(
        [
            np.column_stack([position[starts], line[starts]]),
            np.column_stack([position[ends] + 1, line[ends]]),
        ],
        axis=1,
    ).astype(float)
