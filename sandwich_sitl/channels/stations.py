"""Stations: how far along the flow a point lies, for columns that meet both sides of a channel at the same place.

Source: steady potential flow through the world, div(sigma grad phi) = 0 with phi = 0 where the flow enters, 1 where it
leaves and no flow through the other two sides; sigma = 1 in free ground and `_SOLID` in obstacles. Its level lines
cross every channel, bend round no corner and squeeze through gaps as the columns should (for one channel they would be
the columns of a conformal map). Solved once on a coarse raster by finite volumes; the station mixes phi with x, which
keeps columns in still water.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import shapely
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Bounds = tuple[float, float, float, float]

_RASTER = 12_000  # points
_SOLID = 0.01
_POTENTIAL = 0.4  # of a station; the rest is x


@dataclass(frozen=True)
class Stations:
    """`values` (nx, ny) of the station on an even raster over `bounds`, 0 where the flow enters, 1 where it leaves."""

    bounds: Bounds
    values: Array

    def at(self, points: Array) -> Array:
        """Stations (n,) of points (n, 2), bilinear between raster points."""
        x_min, y_min, x_max, y_max = self.bounds
        share = (points - [x_min, y_min]) / [x_max - x_min, y_max - y_min]
        index = (np.clip(share, 0.0, 1.0) * (np.array(self.values.shape) - 1)).T
        return np.asarray(map_coordinates(self.values, index, order=1))


def lay_stations(solid: Sequence[shapely.Polygon], bounds: Bounds) -> Stations:
    """Stations of a world with the polygons `solid` in it."""
    x_min, y_min, x_max, y_max = bounds
    spacing = np.sqrt((x_max - x_min) * (y_max - y_min) / _RASTER)
    nx, ny = (max(3, round(extent / spacing)) for extent in (x_max - x_min, y_max - y_min))
    x, y = np.meshgrid(np.linspace(x_min, x_max, nx), np.linspace(y_min, y_max, ny), indexing="ij")
    straight = np.broadcast_to(np.linspace(0.0, 1.0, nx)[:, None], (nx, ny))
    if not solid:
        return Stations(bounds, np.array(straight))
    whole = shapely.union_all(list(solid))
    shapely.prepare(whole)
    sigma = np.where(shapely.contains_xy(whole, x, y), _SOLID, 1.0)
    aspect = ((y_max - y_min) / (ny - 1)) / ((x_max - x_min) / (nx - 1))
    potential = _potential(sigma, aspect)
    return Stations(bounds, _POTENTIAL * potential + (1 - _POTENTIAL) * straight)


def _potential(sigma: Array, aspect: float) -> Array:
    """phi (nx, ny) from the five-point finite volumes; a face's sigma is the harmonic mean of its two points'."""
    nx, ny = sigma.shape
    number = np.arange(nx * ny).reshape(nx, ny)
    along = 2 / (1 / sigma[1:] + 1 / sigma[:-1]) * aspect
    across = 2 / (1 / sigma[:, 1:] + 1 / sigma[:, :-1]) / aspect
    along[:, [0, -1]] /= 2  # faces of half a volume on the sides
    rows = np.concatenate([number[:-1].ravel(), number[:, :-1].ravel()])
    columns = np.concatenate([number[1:].ravel(), number[:, 1:].ravel()])
    values, size = np.concatenate([along.ravel(), across.ravel()]), nx * ny
    one_way = sp.coo_array((values, (rows, columns)), shape=(size, size))
    flow = sp.csr_array(one_way + one_way.T)
    laplacian = sp.csr_array(sp.diags_array(np.asarray(flow.sum(axis=1)).ravel()) - flow)
    inner, outlet = number[1:-1].ravel(), number[-1].ravel()
    given = -np.asarray(laplacian[inner][:, outlet].sum(axis=1)).ravel()
    factor = splu(
        sp.csc_matrix(laplacian[inner][:, inner]), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
    )
    potential = np.zeros((nx, ny))
    potential[-1] = 1.0
    potential[1:-1] = factor.solve(given).reshape(nx - 2, ny)
    return potential
