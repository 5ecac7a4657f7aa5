"""Boundary nodes: which column each tip and corner gets, and Algorithm 1 between them.

Source: paper, section III-C; notes N1-N4.
All streamlines share the columns 0 .. m_phi - 1. A tip wants the column of its x; a corner the column of its advance
along its wall. Integers that keep the order and leave room for the corners, nearest to those wishes, come from
isotonic regression. Between two neighbouring fixed nodes Algorithm 1 spreads nodes uniformly along the arc. Both
sides of a piece get the same number.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from sandwich_sitl.channels.dividers import Piece

Array = NDArray[np.float64]

_ARC_SHARE = 0.3  # of a wall's arc length that counts beside its advance in x: steep faces get columns too


@dataclass(frozen=True)
class Streamline:
    """Nodes of one streamline: `lower` and `upper` (m_phi, 2) are its two sides, equal where it is free.

    `barrier` (m_phi,) is the obstacle's index where the two sides are different nodes, -1 where they are one.
    """

    lower: Array
    upper: Array
    barrier: NDArray[np.int64]


def columns_needed(streamlines: Sequence[tuple[Piece, ...]]) -> int:
    """Least m_phi that gives every corner a node of its own."""
    return max(sum(_least_intervals(piece) for piece in pieces) for pieces in streamlines) + 1


def spread_nodes(pieces: tuple[Piece, ...], x_min: float, x_max: float, m_phi: int) -> Streamline:
    """Nodes of one streamline on `m_phi` columns."""
    last = m_phi - 1
    wishes = (_progress(pieces) - x_min) / (x_max - x_min) * last
    columns = integer_columns(wishes, [_least_intervals(piece) for piece in pieces], last)
    lower, upper = np.empty((m_phi, 2)), np.empty((m_phi, 2))
    barrier = np.full(m_phi, -1)
    for piece, start, end in zip(pieces, columns[:-1], columns[1:], strict=True):
        span = slice(int(start), int(end) + 1)
        lower[span] = _side_nodes(piece.lower, int(end - start))
        if piece.barrier is None:
            upper[span] = lower[span]
            continue
        upper[span] = _side_nodes(piece.upper, int(end - start))
        apart = np.flatnonzero((lower[span] != upper[span]).any(axis=1)) + int(start)
        barrier[apart] = piece.barrier.index
    return Streamline(lower, upper, barrier)


def along_arc(path: Array, nodes: int) -> Array:
    """Algorithm 1: `nodes` points (nodes, 2) at equal arc length along a polyline (V, 2), both ends included."""
    arc = _arc_length(path)
    at = np.linspace(0.0, arc[-1], nodes)
    points = np.column_stack([np.interp(at, arc, path[:, 0]), np.interp(at, arc, path[:, 1])])
    points[0], points[-1] = path[0], path[-1]
    return points


def integer_columns(wishes: Array, least: Sequence[int], last: int) -> NDArray[np.int64]:
    """Integers c nearest to `wishes` (least squares, rounded): c[0] = 0, c[-1] = last, c[k + 1] - c[k] >= least[k]."""
    used = np.concatenate([[0], np.cumsum(least)])
    slack = last - used[-1]
    relaxed = isotonic_regression(np.clip(wishes - used, 0.0, slack)).x
    columns = np.rint(relaxed).astype(np.int64) + used
    columns[0], columns[-1] = 0, last
    return np.asarray(columns, dtype=np.int64)


def _progress(pieces: tuple[Piece, ...]) -> Array:
    """x of the ends of the pieces (len + 1,), made monotone: only a barrier that overhangs its border needs that."""
    sizes = np.cumsum([len(piece.lower) for piece in pieces])
    x = _monotone(np.concatenate([piece.lower[:, 0] for piece in pieces]))
    return np.concatenate([x[:1], x[sizes - 1]])


def _monotone(x: Array) -> Array:
    """x along a path (n,), made monotone: the mean of the furthest x so far and the least x to come."""
    to_come = np.minimum.accumulate(x[::-1])[::-1]
    return np.asarray((np.maximum.accumulate(x) + to_come) / 2)


def _least_intervals(piece: Piece) -> int:
    return max(len(piece.lower), len(piece.upper)) - 1


def _side_nodes(path: Array, intervals: int) -> Array:
    advance = _ARC_SHARE * _arc_length(path) + _monotone(path[:, 0])
    advance = advance - advance[0]
    columns = integer_columns(advance / advance[-1] * intervals, [1] * (len(path) - 1), intervals)
    parts = [
        along_arc(path[k : k + 2], int(columns[k + 1] - columns[k]) + 1)[: -1 if k < len(path) - 2 else None]
        for k in range(len(path) - 1)
    ]
    return np.concatenate(parts)


def _arc_length(path: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
