"""Stretches of a channel that would not unfold, meshed as bays.

Where the two walls of a channel are too far out of step, a structured grid with the given boundary nodes may not exist
at this resolution. There the columns between the nearest sound ones give way to an unstructured mesh of the same ground
with the same boundary nodes, whose cells are convex by construction (`bays`).
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.bays import Bay, mesh_ground
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
    folded: NDArray[np.bool_] = np.asarray((corner_sines(xy) <= 0).any(axis=(1, 2)))
    gridded: NDArray[np.bool_] = np.logical_not(folded)
    if not folded.any():
        return Sound(xy, gridded, ())
    stretches = widened(xy, folded, 0, len(xy) - 1)
    xy = xy.copy()
    bays = []
    for start, end in stretches:
        outline = stretch_outline(xy, start, end)
        lid_points = {(x, y) for x, y in outline.tolist()}
        bays.append(mesh_ground(f"columns {start}-{end} of {name}", shapely.Polygon(outline), lid_points, cell_m))
    for start, end in stretches:
        gridded[start:end] = False
        xy[stretch_inside(len(xy), start, end), 1:-1] = np.nan
    return Sound(xy, gridded, tuple(bays))


def stretch_inside(m_phi: int, start: int, end: int) -> slice:
    """Columns of nodes with no cell left: up to the channel's end where the stretch reaches it."""
    return slice(start if start == 0 else start + 1, m_phi if end == m_phi - 1 else end)


def widened(xy: Array, hit: NDArray[np.bool_], first: int, last: int) -> list[tuple[int, int]]:
    """Stretches (start, end) of node columns round runs of hit cell columns, between node columns `first` and `last`.

    Each is a column wider than its run on both sides and as long as it takes for its outline to be simple; at worst it
    reaches from `first` to `last`, whose outline is.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], hit[first:last], [False]]).astype(int))) + first
    stretches: list[tuple[int, int]] = []
    for begin, beyond in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        start, end = _simple(xy, max(first, begin - _BESIDE), min(last, beyond + _BESIDE), first, last)
        while stretches and start <= stretches[-1][1]:
            start, end = _simple(xy, min(start, stretches.pop()[0]), end, first, last)
        stretches.append((start, end))
    return stretches


def _simple(xy: Array, start: int, end: int, first: int, last: int) -> tuple[int, int]:
    while not shapely.Polygon(stretch_outline(xy, start, end)).is_valid and (start > first or end < last):
        start, end = max(first, start - 1), min(last, end + 1)
    return start, end


def stretch_outline(xy: Array, start: int, end: int) -> Array:
    """Nodes (V, 2) round the columns start .. end, counter-clockwise; the ends of a channel are straight."""
    right = xy[end, 1:-1] if end < len(xy) - 1 else np.empty((0, 2))
    left = xy[start, 1:-1] if start > 0 else np.empty((0, 2))
    return np.concatenate([xy[start : end + 1, 0], right, xy[start : end + 1, -1][::-1], left[::-1]])
