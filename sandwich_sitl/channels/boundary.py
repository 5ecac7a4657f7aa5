"""Boundary nodes: which column each tip and corner gets, and Algorithm 1 between them.

Source: paper, section III-C, read so: segment h is |p_{h+1} - p_h|, Omega compares cumulative arc lengths, and node i = 1..n
stands at arc length (i - 1) dL. It is applied piece by piece, so that both sides of an obstacle share a count, with tips and
corners as nodes: a uniform spread would cut the corners.
All streamlines share the columns 0 .. m_phi - 1. A tip or corner wants the column of its station (`stations`), so that
the two sides of a channel agree where it turns or narrows. Integers that keep the order and leave room for the
corners, nearest to those wishes, come from isotonic regression. Between two neighbouring fixed nodes Algorithm 1
spreads nodes along the arc, evenly half in arc length and half in station. Both sides of a piece get the same number.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from sandwich_sitl.channels.dividers import Piece
from sandwich_sitl.channels.stations import Stations

Array = NDArray[np.float64]

_FLOW_SHARE = 0.5  # of the columns that a stretch's advance along x asks for are kept from being drawn elsewhere
_ARC_SHARE = 0.1  # of a wall's arc length that counts beside its advance in station: still faces get columns too
_EVEN = 0.5  # of a stretch's spacing is even in arc length, the rest in station


@dataclass(frozen=True)
class Streamline:
    """Nodes of one streamline: `lower` and `upper` (m_phi, 2) are its two sides, equal where it is free.

    `barrier` (m_phi,) is the obstacle's index where the two sides are different nodes, -1 where they are one.
    """

    lower: Array
    upper: Array
    barrier: NDArray[np.int64]


def columns_needed(streamlines: Sequence[tuple[Piece, ...]], cell_m: float) -> int:
    """Least m_phi that gives every corner a node of its own and stretches along the flow their share of columns."""
    return max(sum(_least_intervals(piece, cell_m) for piece in pieces) for pieces in streamlines) + 1


def spread_nodes(pieces: tuple[Piece, ...], stations: Stations, m_phi: int, cell_m: float) -> Streamline:
    """Nodes of one streamline on `m_phi` columns."""
    last = m_phi - 1
    ends = np.array([pieces[0].lower[0], *(piece.lower[-1] for piece in pieces)])
    least = [_least_intervals(piece, cell_m) for piece in pieces]
    columns = integer_columns(stations.at(ends) * last, least, last)
    lower, upper = np.empty((m_phi, 2)), np.empty((m_phi, 2))
    barrier = np.full(m_phi, -1)
    for piece, start, end in zip(pieces, columns[:-1], columns[1:], strict=True):
        span = slice(int(start), int(end) + 1)
        lower[span] = _side_nodes(piece.lower, stations, int(end - start), cell_m)
        if piece.barrier is None:
            upper[span] = lower[span]
            continue
        upper[span] = _side_nodes(piece.upper, stations, int(end - start), cell_m)
        apart = np.flatnonzero((lower[span] != upper[span]).any(axis=1)) + int(start)
        barrier[apart] = piece.barrier.index
    return Streamline(lower, upper, barrier)


def integer_columns(wishes: Array, least: Sequence[int], last: int) -> NDArray[np.int64]:
    """Integers c nearest to `wishes` (least squares, rounded): c[0] = 0, c[-1] = last, c[k + 1] - c[k] >= least[k]."""
    used = np.concatenate([[0], np.cumsum(least)])
    slack = last - used[-1]
    relaxed = isotonic_regression(np.clip(wishes - used, 0.0, slack)).x
    columns = np.rint(relaxed).astype(np.int64) + used
    columns[0], columns[-1] = 0, last
    return np.asarray(columns, dtype=np.int64)


def _least_intervals(piece: Piece, cell_m: float) -> int:
    return max(sum(_least(piece.lower, cell_m)), sum(_least(piece.upper, cell_m)))


def _least(path: Array, cell_m: float) -> list[int]:
    """Intervals that each segment of a path has at least: one, or a share of those its advance along x asks for."""
    advance = np.abs(np.diff(path[:, 0]))
    return [max(1, int(columns)) for columns in np.rint(_FLOW_SHARE * advance / cell_m)]


def _side_nodes(path: Array, stations: Stations, intervals: int, cell_m: float) -> Array:
    """Nodes (intervals + 1, 2) on a path (V, 2) whose vertices are among them."""
    x_min, _, x_max, _ = stations.bounds
    advance = _ARC_SHARE * _arc_length(path) + (x_max - x_min) * _monotone(stations.at(path))
    advance = advance - advance[0]
    columns = integer_columns(advance / advance[-1] * intervals, _least(path, cell_m), intervals)
    parts = [
        _segment_nodes(path[k], path[k + 1], stations, int(columns[k + 1] - columns[k]))[:-1]
        for k in range(len(path) - 1)
    ]
    return np.concatenate([*parts, path[-1:]])


def along_arc(path: Array, nodes: int) -> Array:
    """Algorithm 1: `nodes` points (nodes, 2) at equal arc length along a polyline (V, 2), both ends included."""
    arc = _arc_length(path)
    at = np.linspace(0.0, arc[-1], nodes)
    points = np.column_stack([np.interp(at, arc, path[:, 0]), np.interp(at, arc, path[:, 1])])
    points[0], points[-1] = path[0], path[-1]
    return points


def _segment_nodes(start: Array, end: Array, stations: Stations, intervals: int) -> Array:
    """Algorithm 1 on a segment: nodes (intervals + 1, 2), both ends included."""
    share = np.linspace(0.0, 1.0, 2 * intervals + 1)
    station = _monotone(stations.at(start + share[:, None] * (end - start)))
    rise = station[-1] - station[0]
    progress = _EVEN * share + (1 - _EVEN) * ((station - station[0]) / rise if rise > 0 else share)
    at = np.interp(np.linspace(0.0, 1.0, intervals + 1), progress, share)
    nodes = start + at[:, None] * (end - start)
    nodes[0], nodes[-1] = start, end
    return np.asarray(nodes)


def _monotone(values: Array) -> Array:
    """Values along a path (n,), made monotone: the mean of the largest so far and the least to come."""
    to_come = np.minimum.accumulate(values[::-1])[::-1]
    return np.asarray((np.maximum.accumulate(values) + to_come) / 2)


def _arc_length(path: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
