"""Stretches of a channel that would not unfold, meshed as bays.

Where the two walls of a channel are too far out of step, a structured grid with the given boundary nodes may not exist
at this resolution. There the columns between the nearest sound ones give way to an unstructured mesh of the same ground
with the same boundary nodes, whose cells are convex by construction (`bays`).
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.bays import Bay, mesh_stretch
from sandwich_sitl.channels.untangle import corner_sines

Array = NDArray[np.float64]

_BESIDE = 1  # columns given up on each side of a folded one


@dataclass(frozen=True)
class Sound:
    """A channel's grid with nan at nodes that belong to no cell, its sound columns (m_phi - 1,), and the bays."""

    xy_m: Array
    gridded: NDArray[np.bool_]
    bays: tuple[Bay, ...]


def without_folds(xy: Array, name: str, cell_m: float) -> Sound:
    """The grid (m_phi, m_j, 2) with every stretch that has a folded cell replaced."""
    folded = (corner_sines(xy) <= 0).any(axis=(1, 2))
    gridded = ~folded
    if not folded.any():
        return Sound(xy, gridded, ())
    stretches: list[tuple[int, int]] = []
    for first, beyond in _runs(folded):
        start, end = _with_simple_outline(xy, first, beyond)
        while stretches and start <= stretches[-1][1]:
            start = min(start, stretches.pop()[0])
            start, end = _with_simple_outline(xy, start, end)
        stretches.append((start, end))
    xy = xy.copy()
    bays = []
    for start, end in stretches:
        bays.append(mesh_stretch(f"columns {start}-{end} of {name}", _outline(xy, start, end), cell_m))
    for start, end in stretches:
        gridded[start:end] = False
        xy[_inside(len(xy), start, end), 1:-1] = np.nan
    return Sound(xy, gridded, tuple(bays))


def _inside(m_phi: int, start: int, end: int) -> slice:
    """Columns of nodes with no cell left: up to the channel's end where the stretch reaches it."""
    return slice(start if start == 0 else start + 1, m_phi if end == m_phi - 1 else end)


def _runs(folded: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Columns of nodes (start, end) round each run of folded columns of cells."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], folded, [False]]).astype(int)))
    last = len(folded)
    return [
        (max(0, int(a) - _BESIDE), min(last, int(b) + _BESIDE)) for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def _with_simple_outline(xy: Array, start: int, end: int) -> tuple[int, int]:
    """The stretch, made longer until its outline is simple; at worst the whole channel, whose outline is."""
    last = len(xy) - 1
    while not shapely.Polygon(_outline(xy, start, end)).is_valid and (start > 0 or end < last):
        start, end = max(0, start - 1), min(last, end + 1)
    return start, end


def _outline(xy: Array, start: int, end: int) -> Array:
    """Nodes (V, 2) round the columns start .. end, counter-clockwise; the ends of a channel are straight."""
    right = xy[end, 1:-1] if end < len(xy) - 1 else np.empty((0, 2))
    left = xy[start, 1:-1] if start > 0 else np.empty((0, 2))
    return np.concatenate([xy[start : end + 1, 0], right, xy[start : end + 1, -1][::-1], left[::-1]])
