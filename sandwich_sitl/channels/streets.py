"""Lids across the flow: narrow ground between walls that face each other along x becomes a bay.

A channel that dips into a slot deeper than it is wide would have its columns bunched at the mouth and its cells drawn
out to the bottom. Two kinds of slot get horizontal lids: a *notch* in one outline (or between the walls of one), and
a *street* between two outlines side by side. Behind the lids the ground is meshed as a bay, with cells of even size,
and routes pass through it.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from sandwich_sitl.channels.outline import Bounds, Outline

Array = NDArray[np.float64]

_MOST_LEVELS = 16  # vertices, and even steps, of a street tried as its ends
_MOST_TRIED = 40  # of a street's possible ends, deepest first
_DEEP = 0.8  # depth over width from which a slot with one mouth is closed; twice that for one with two


@dataclass(frozen=True)
class Lids:
    """Horizontal segments (L, 2, 2) across a slot between outlines number `a` and `b` (equal for a notch)."""

    a: int
    b: int
    segments: Array


def find_lids(outlines: list[Outline], bounds: Bounds) -> list[Lids]:
    """Lids of every slot of disjoint vertically convex outlines that is deep for its width."""
    found = []
    for k, outline in enumerate(outlines):
        notches = [
            *_notches(outline.upper),
            *(segment * [1.0, -1.0] for segment in _notches(outline.lower * [1.0, -1.0])),
        ]
        if notches:
            found.append(Lids(k, k, np.array(notches)))
    return [*found, *_streets(outlines, bounds), *_border_streets(outlines, bounds)]


def _notches(path: Array) -> list[Array]:
    """Lids (2, 2) over the notches of an upper wall (V, 2)."""
    lids: list[Array] = []
    y = path[:, 1]
    covered = -np.inf
    for bottom in range(1, len(path) - 1):
        if not (y[bottom - 1] > y[bottom] <= y[bottom + 1]) or path[bottom, 0] <= covered:
            continue
        left_peaks, right_peaks = np.maximum.accumulate(y[bottom::-1]), np.maximum.accumulate(y[bottom:])
        highest = min(left_peaks[-1], right_peaks[-1])
        levels = np.unique(np.concatenate([left_peaks, right_peaks]))
        for level in levels[(levels > y[bottom]) & (levels <= highest)][::-1]:
            left, right = _crossing(path[bottom::-1], left_peaks, level), _crossing(path[bottom:], right_peaks, level)
            if level - y[bottom] >= _DEEP * (right[0] - left[0]):
                lids.append(np.array([left, right]))
                covered = right[0]
                break
    return lids


def _crossing(path: Array, peaks: Array, level: float) -> Array:
    """Where a path that starts below `level` first reaches it; `peaks` are its highest y so far."""
    k = int(np.searchsorted(peaks, level))
    (x0, y0), (x1, y1) = path[k - 1], path[k]
    return np.array([x0 + (level - y0) / (y1 - y0) * (x1 - x0), level])


def _streets(outlines: list[Outline], bounds: Bounds) -> list[Lids]:
    """Streets between two outlines side by side."""
    if len(outlines) < 2:
        return []
    polygons = [Polygon(outline.ring()) for outline in outlines]
    heights = np.array([polygon.bounds[3] - polygon.bounds[1] for polygon in polygons])
    tree = shapely.STRtree(polygons)
    pairs = tree.query(polygons, predicate="dwithin", distance=heights / _DEEP).T
    found = []
    for a, b in pairs[pairs[:, 0] != pairs[:, 1]].tolist():
        if outlines[a].upper[-1, 0] <= outlines[b].upper[0, 0]:
            left, right = outlines[a].right_profile(), outlines[b].left_profile()
            segments = _street(left, right, (bounds[1], bounds[3]), tree, {a, b})
            found += [] if segments is None else [Lids(a, b, segments)]
    return found


def _border_streets(outlines: list[Outline], bounds: Bounds) -> list[Lids]:
    """Streets between an outline and the border on its left or right, on either side of where it touches that."""
    x_min, y_min, x_max, y_max = bounds
    tree = shapely.STRtree([Polygon(outline.ring()) for outline in outlines])
    found = []
    for k, outline in enumerate(outlines):
        for border_x, mine in ((x_min, outline.left_profile()), (x_max, outline.right_profile())):
            if np.abs(mine[:, 0] - border_x).min() > np.ptp(mine[:, 1]) / _DEEP:
                continue
            contact = mine[mine[:, 0] == border_x, 1]
            spans = [(y_min, y_max)] if not contact.size else [(y_min, contact.min()), (contact.max(), y_max)]
            for span in spans:
                border = np.array([[border_x, y] for y in span])
                left, right = (border, mine) if border_x == x_min else (mine, border)
                closed = (y_min, y_max, *(float(y) for y in contact))
                segments = _street(left, right, closed, tree, {k})
                found += [] if segments is None else [Lids(k, k, segments)]
    return found


def _street(
    right_of_a: Array, left_of_b: Array, closed: tuple[float, ...], tree: shapely.STRtree, own: set[int]
) -> Array | None:
    """Lids of the street between two profiles (V, 2), left and right: at most two, None when none is deep.

    At the heights `closed` the street ends blindly and needs no lid. It holds no outline of the tree but its `own`.
    """
    low = max(right_of_a[:, 1].min(), left_of_b[:, 1].min())
    high = min(right_of_a[:, 1].max(), left_of_b[:, 1].max())
    if low >= high:
        return None
    levels = np.unique(np.concatenate([right_of_a[:, 1], left_of_b[:, 1]]))
    levels = levels[(levels > low) & (levels < high)]
    levels = (
        levels[np.unique(np.linspace(0, len(levels) - 1, _MOST_LEVELS).round().astype(int))] if len(levels) else levels
    )
    levels = np.unique(np.concatenate([levels, np.linspace(low, high, _MOST_LEVELS)]))
    left, right = _x_at(right_of_a, levels, furthest_right=True), _x_at(left_of_b, levels, furthest_right=False)
    c, d = np.triu_indices(len(levels), 1)
    width = right - left
    shut = ~np.isin(levels, closed)
    widest = np.maximum(np.where(shut[c], width[c], 0.0), np.where(shut[d], width[d], 0.0))
    mouths = shut[c].astype(int) + shut[d]
    depth = levels[d] - levels[c]
    deep = np.flatnonzero((mouths > 0) & (depth >= _DEEP * mouths * widest))
    for k in deep[np.argsort(-depth[deep], kind="stable")][:_MOST_TRIED]:
        ends = slice(int(c[k]), int(d[k]) + 1)
        sides = [np.column_stack([x, levels])[ends] for x in (left, right)]
        if set(tree.query(Polygon([*sides[0], *sides[1][::-1]]), predicate="intersects").tolist()) <= own:
            return np.array([[[left[m], levels[m]], [right[m], levels[m]]] for m in (c[k], d[k]) if shut[m]])
    return None


def _x_at(profile: Array, levels: Array, *, furthest_right: bool) -> Array:
    """Outermost x (n,) of a profile (V, 2), a path from its lowest to its highest point, at heights `levels`."""
    start, end = profile[:-1], profile[1:]
    low, high = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
    rise = end[:, 1] - start[:, 1]
    flat = rise == 0
    share = np.where(flat, 1.0, (levels[:, None] - start[:, 1]) / np.where(flat, 1.0, rise))
    x = start[:, 0] + share * (end[:, 0] - start[:, 0])
    outer = np.where(
        flat, np.maximum(start[:, 0], end[:, 0]) if furthest_right else np.minimum(start[:, 0], end[:, 0]), x
    )
    spans = (low <= levels[:, None]) & (levels[:, None] <= high)
    masked = np.where(spans, outer, -np.inf if furthest_right else np.inf)
    return np.asarray(masked.max(axis=1) if furthest_right else masked.min(axis=1))
