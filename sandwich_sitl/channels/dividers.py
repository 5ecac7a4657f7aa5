"""Dividing streamlines: smooth, evenly spaced curves that carry each group of obstacles.

Source: paper, section III-A, which says that they are there and not how to draw them.
Streamline d is a function y = d(x) wherever it is free; it ends at the tips of the obstacles of its group. At every
column (a uniform grid and every x at which a hull has a vertex) the streamlines keep their order and stay off the
hulls of the other groups, by at least a share of the gap that equal spacing would give them. Between columns
everything is linear, so what holds at the columns holds everywhere. Among all such curves a convex QP takes the one
of least bending and least departure from equal spacing.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import piqp
import scipy.sparse as sp
from numpy.typing import NDArray

from sandwich_sitl.channels.barrier import Barrier
from sandwich_sitl.channels.classify import Classification
from sandwich_sitl.channels.thinning import thinned

Array = NDArray[np.float64]

_KEPT_SHARE = 0.35  # of the equal-spacing gap, kept free on each side of a streamline
_STIFFNESS = 0.15  # of the world's height: the length a bend spreads over
_OPENING = 0.5  # how fast, per metre along x, the kept gap may grow behind a narrow place
_GIVEN_SHARE = 0.25  # of the room to its neighbours a streamline may give when vertices are dropped: two give half
_ACCURACY = 1e-7  # of the spacing problem's residuals, metres: its typical diagonal entry is one
_MOST_ITERATIONS = 100
_COARSEST = 0.05  # of a column: what dropping vertices may move where there is room


@dataclass(frozen=True)
class Piece:
    """A stretch of a dividing streamline: free (`barrier` None, both sides equal) or the two walls of a barrier.

    `lower` is the top side of the channel below, `upper` the bottom side of the channel above; (V, 2), left to right.
    """

    barrier: Barrier | None
    lower: Array
    upper: Array


def lay_dividers(
    groups: Classification, bounds: tuple[float, float, float, float], column_m: float
) -> tuple[tuple[Piece, ...], ...]:
    """Pieces of the p + 1 streamlines: the bottom border (0), the dividing ones (1 .. p - 1), the top border (p)."""
    x = _columns(groups, bounds, column_m)
    low, high = _extents(groups, bounds, x)
    y = _smooth(x, low, high, groups.groups, bounds)
    give = np.minimum(_GIVEN_SHARE * _room(low, high, y), _COARSEST * column_m)
    inner = [_pieces(x, y[d], give[d], chain) for d, chain in enumerate(groups.groups)]
    return (_border(groups.bottom, bounds, top=False), *inner, _border(groups.top, bounds, top=True))


def _columns(groups: Classification, bounds: tuple[float, float, float, float], column_m: float) -> Array:
    x_min, _, x_max, _ = bounds
    uniform = np.linspace(x_min, x_max, max(8, int(np.ceil((x_max - x_min) / column_m))) + 1)
    hulls = [
        points[:, 0]
        for chain in (groups.bottom, groups.top, *groups.groups)
        for b in chain
        for points in b.fixed_points()
    ]
    # Uniform columns make way for the vertices close to them: slivers would only hurt the QP's conditioning.
    vertices = np.unique(np.concatenate([*hulls, [x_min, x_max]]))
    nearest = np.abs(uniform[:, None] - vertices[None, :]).min(axis=1)
    return np.union1d(vertices, uniform[nearest > 0.3 * column_m])


def _extents(groups: Classification, bounds: tuple[float, float, float, float], x: Array) -> tuple[Array, Array]:
    """(low, high) of shape (p + 1, n): y-extent of each streamline's barriers at each column, nan where it is free."""
    chains = [groups.bottom, *groups.groups, groups.top]
    low, high = np.full((len(chains), len(x)), np.nan), np.full((len(chains), len(x)), np.nan)
    low[0], high[0] = bounds[1], bounds[1]
    low[-1], high[-1] = bounds[3], bounds[3]
    for level, chain in enumerate(chains):
        for barrier in chain:
            inside = (x >= barrier.x_min) & (x <= barrier.x_max)
            a, b = barrier.extent(x[inside])
            low[level, inside] = np.fmin(low[level, inside], a)
            high[level, inside] = np.fmax(high[level, inside], b)
    return low, high


def _smooth(
    x: Array,
    low: Array,
    high: Array,
    chains: tuple[tuple[Barrier, ...], ...],
    bounds: tuple[float, float, float, float],
) -> Array:
    """y (p - 1, n) of the dividing streamlines; on barrier columns the value is that of the tip or without meaning."""
    levels = len(low)
    even, gap = _even_spacing(low, high)
    gap = _opening_slowly(x, gap)
    y = even.copy()
    if levels > 2:
        y[1:-1] = _solve_spacing(x, low, high, even, gap, chains, bounds)
    # The solver is accurate to its tolerance; one sweep up and one down make the kept gaps exact.
    kept = 0.5 * _KEPT_SHARE * gap
    top_of = np.where(np.isnan(high), y, high)
    for level in range(1, levels - 1):
        free = np.isnan(low[level])
        raised = np.maximum(y[level], top_of[level - 1] + kept[level - 1])
        y[level] = np.where(free, raised, y[level])
        top_of[level] = np.where(free, y[level], top_of[level])
    bottom_of = np.where(np.isnan(low), y, low)
    for level in range(levels - 2, 0, -1):
        free = np.isnan(low[level])
        y[level] = np.where(free, np.minimum(y[level], bottom_of[level + 1] - kept[level]), y[level])
        bottom_of[level] = np.where(free, y[level], bottom_of[level])
    return y[1:-1]


def _room(low: Array, high: Array, y: Array) -> Array:
    """Vertical room (p - 1, n) between each dividing streamline and what lies next above and below."""
    inner_low, inner_high = (np.where(np.isnan(side[1:-1]), y, side[1:-1]) for side in (low, high))
    below, above = np.vstack([high[:1], inner_high[:-1]]), np.vstack([inner_low[1:], low[-1:]])
    return np.asarray(np.minimum(y - below, above - y))


def _even_spacing(low: Array, high: Array) -> tuple[Array, Array]:
    """Equal spacing between what is fixed above and below: y (p + 1, n), and the gap (p, n) between neighbours."""
    levels, n = low.shape
    y, gap = np.where(np.isnan(low), 0.0, low), np.zeros((levels - 1, n))
    for column in range(n):
        fixed = np.flatnonzero(~np.isnan(low[:, column]))
        for a, b in itertools.pairwise(fixed):
            share = (low[b, column] - high[a, column]) / (b - a)
            gap[a:b, column] = share
            y[a + 1 : b, column] = high[a, column] + share * np.arange(1, b - a)
    return y, gap


def _opening_slowly(x: Array, gap: Array) -> Array:
    """The largest gaps (p, n) not above the given ones that change along x by at most `_OPENING`."""
    slow, step = gap.copy(), _OPENING * np.diff(x)
    for k in range(1, len(x)):
        slow[:, k] = np.minimum(slow[:, k], slow[:, k - 1] + step[k - 1])
    for k in range(len(x) - 2, -1, -1):
        slow[:, k] = np.minimum(slow[:, k], slow[:, k + 1] + step[k])
    return slow


def _solve_spacing(
    x: Array,
    low: Array,
    high: Array,
    even: Array,
    gap: Array,
    chains: tuple[tuple[Barrier, ...], ...],
    bounds: tuple[float, float, float, float],
) -> Array:
    """minimise bending + departure from `even`, subject to kept gaps, tips fixed; returns y (p - 1, n)."""
    inner = len(low) - 2
    free = np.isnan(low[1:-1])
    y = np.where(free, 0.0, even[1:-1])
    for d, chain in enumerate(chains):
        for barrier in chain:
            for tip, x_end in ((barrier.left_tip, barrier.x_min), (barrier.right_tip, barrier.x_max)):
                if tip is not None:
                    y[d, np.searchsorted(x, x_end)] = tip[1]
    moving = np.flatnonzero(free)
    if len(moving) == 0:
        return y
    width = _STIFFNESS * (bounds[3] - bounds[1])
    bending = sp.block_diag([_bending(x, free[d]) for d in range(inner)], format="csr")
    slope = sp.block_diag([_slope(x, free[d]) for d in range(inner)], format="csr")
    weight = np.tile(np.gradient(x), inner)
    P = sp.csr_array(width**4 * bending + width**2 * slope + sp.diags_array(weight))
    q = P @ y.ravel() - weight * even[1:-1].ravel()
    rows, bound = _kept_gaps(low, high, gap)
    # Pinned values go out of the problem: no solver tried came near the optimum with them in.
    y[free] = _least(P[moving][:, moving], q[moving], rows[:, moving], bound, even[1:-1][free])
    return y


def _least(P: sp.csr_array, q: Array, rows: sp.csr_array, bound: Array, otherwise: Array) -> Array:
    """minimise 1/2 y'P y + q'y subject to rows y >= bound; `otherwise` where the solver gives up."""
    scale = 1.0 / float(np.median(P.diagonal()))
    solver = piqp.SparseSolver()
    solver.settings.eps_abs, solver.settings.eps_rel = _ACCURACY, 0.0
    solver.settings.max_iter = _MOST_ITERATIONS
    above = np.full(len(bound), np.inf)
    solver.setup(sp.csc_matrix(scale * P), scale * q, None, None, sp.csc_matrix(rows), bound, above)
    return np.asarray(solver.result.x) if solver.solve() == piqp.PIQP_SOLVED else otherwise


def _kept_gaps(low: Array, high: Array, gap: Array) -> tuple[sp.csr_array, Array]:
    """Rows and bounds of y_above - y_below >= kept gap, for neighbours of which at least one is free.

    Columns of the rows stand for y (p - 1, n), flattened; what is fixed has gone into the bound.
    """
    levels, n = low.shape
    inner = levels - 2
    index = np.arange(inner * n).reshape(inner, n)
    rows, lower = [], []
    for k in range(levels - 1):
        active = np.flatnonzero(np.isnan(low[k]) | np.isnan(low[k + 1]))
        below_free, above_free = np.isnan(low[k, active]), np.isnan(low[k + 1, active])
        bound = _KEPT_SHARE * gap[k, active]
        lower.append(bound + np.where(below_free, 0.0, high[k, active]) - np.where(above_free, 0.0, low[k + 1, active]))
        number = np.arange(len(active))
        above = index[k][active[above_free]] if k < inner else np.empty(0, int)
        below = index[k - 1][active[below_free]] if k > 0 else np.empty(0, int)
        values = np.concatenate([np.ones(len(above)), -np.ones(len(below))])
        at = np.concatenate([number[above_free], number[below_free]]), np.concatenate([above, below])
        rows.append(sp.csr_array((values, at), shape=(len(active), inner * n)))
    return sp.csr_array(sp.vstack(rows)), np.concatenate(lower)


def _bending(x: Array, free: NDArray[np.bool_]) -> sp.csc_array:
    """Integral of the squared second derivative as a matrix (n, n), over triples whose middle is free."""
    h0, h1 = np.diff(x)[:-1], np.diff(x)[1:]
    scale = np.sqrt((h0 + h1) / 2)
    smallest = 0.2 * float(np.median(np.diff(x)))
    h0, h1 = np.maximum(h0, smallest), np.maximum(h1, smallest)
    n = len(x)
    left, middle, right = 2 / (h0 * (h0 + h1)) * scale, -2 / (h0 * h1) * scale, 2 / (h1 * (h0 + h1)) * scale
    return _normal_matrix(_banded((left, middle, right), n), free[1:-1])


def _slope(x: Array, free: NDArray[np.bool_]) -> sp.csc_array:
    """Integral of the squared first derivative as a matrix (n, n), over intervals with a free end."""
    h = np.diff(x)
    return _normal_matrix(_banded((-1 / np.sqrt(h), 1 / np.sqrt(h)), len(x)), free[:-1] | free[1:])


def _banded(bands: tuple[Array, ...], columns: int) -> sp.csr_array:
    """Row k has bands[0][k], bands[1][k], ... from column k on."""
    rows = len(bands[0])
    row = np.tile(np.arange(rows), len(bands))
    column = row + np.repeat(np.arange(len(bands)), rows)
    return sp.csr_array((np.concatenate(bands), (row, column)), shape=(rows, columns))


def _normal_matrix(difference: sp.csr_array, rows: NDArray[np.bool_]) -> sp.csc_array:
    """D' D over the chosen rows of a difference operator D."""
    chosen = difference[np.flatnonzero(rows)]
    return sp.csc_array(chosen.T @ chosen)


def _pieces(x: Array, y: Array, give: Array, chain: tuple[Barrier, ...]) -> tuple[Piece, ...]:
    pieces: list[Piece] = []
    left: Array | None = None
    open_end = True
    for barrier in chain:
        arriving, leaving = _way(barrier.left_tip, barrier.x_min), _way(barrier.right_tip, barrier.x_max)
        if open_end and (arriving is not None or left is not None):
            path = _free_path(x, y, give, left, None if arriving is None else arriving[::-1])
            pieces.append(Piece(None, path, path))
        pieces.append(Piece(barrier, barrier.lower_wall(), barrier.upper_wall()))
        left, open_end = leaving, leaving is not None
    if open_end:
        path = _free_path(x, y, give, left, None)
        pieces.append(Piece(None, path, path))
    return tuple(pieces)


def _way(tip: Array | None, x_end: float) -> Array | None:
    """From a tip level to the x where its barrier ends (1 or 2, 2)."""
    if tip is None:
        return None
    return tip[None] if tip[0] == x_end else np.array([tip, [x_end, tip[1]]])


def _free_path(x: Array, y: Array, give: Array, left: Array | None, right: Array | None) -> Array:
    """The curve between two ways out (k, 2), as few vertices as it may have; None stands for the border."""
    start = 0 if left is None else int(np.searchsorted(x, left[-1, 0], side="right"))
    end = len(x) if right is None else int(np.searchsorted(x, right[0, 0], side="left"))
    before, after = (np.empty((0, 2)) if way is None else way for way in (left, right))
    path = np.concatenate([before, np.column_stack([x[start:end], y[start:end]]), after])
    stiff = [np.zeros(len(before)), give[start:end], np.zeros(len(after))]
    return thinned(path, np.concatenate(stiff))


def _border(chain: tuple[Barrier, ...], bounds: tuple[float, float, float, float], *, top: bool) -> tuple[Piece, ...]:
    border_y = bounds[3] if top else bounds[1]
    pieces: list[Piece] = []
    at = np.array([bounds[0], border_y])
    for barrier in chain:
        wall = barrier.border_wall()
        if wall[0, 0] > at[0]:
            pieces.append(Piece(None, np.stack([at, wall[0]]), np.stack([at, wall[0]])))
        pieces.append(Piece(barrier, wall, wall))
        at = wall[-1]
    end = np.array([bounds[2], border_y])
    if at[0] < end[0]:
        pieces.append(Piece(None, np.stack([at, end]), np.stack([at, end])))
    return tuple(pieces)
