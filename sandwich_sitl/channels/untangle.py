"""Unfolding cells that the discrete elliptic equations fold: the continuous map is one-to-one, central differences are not.

Source: V. Garanzha, I. Kaporin, L. Kudryavtseva, F. Protais, N. Ray, D. Sokolov, "Foldover-free maps in 50 lines of
code" (2021). Round the bad cells, nodes move to lower, summed over the four corners of every cell,

    E_eps = (w |x_phi|^2 + |x_psi|^2 / w) / chi_eps(J),   chi_eps(J) = (J + sqrt(J^2 + eps^2)) / 2

with J the corner's Jacobian over the mean cell area and w the patch's mean aspect ratio. While a J is negative, eps
shrinks with it; once all are positive, eps = 0 and E is the discrete harmonic energy whose stationary points satisfy
Eq. (ellipticpde) (S. Ivanenko, A. Charakhch'yan, 1988), infinite at a fold: a step never folds a cell again. So the
repair solves the same problem as the equations, in the form that cannot fold.

Method: Gauss-Seidel over the patch's nodes; for one node J is linear and E without the curvature of chi is convex, so
each move is a damped Newton step in two unknowns. Patches grow ring by ring until no cell is bad. Nodes on the
channel's boundary never move.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sandwich_sitl.channels.cells import quad_sines

Array = NDArray[np.float64]

RINGS = (3, 6, 12)  # cells round the bad ones that may move, tried in turn
_MOST_SWEEPS = 120  # of a patch
_FOLDED = 0.01  # of the sine asked for: what counts as folded once a first repair was made
_SETTLING = 4  # sweeps after the last bad cell has gone
_SHRINK = 0.04  # eps^2 over the square of the most negative Jacobian
_FLOOR = 1e-20


@dataclass(frozen=True)
class Untangled:
    """`xy_m` (m_phi, m_j, 2), the nodes (m_phi, m_j) that may have moved and the cells with such a node."""

    xy_m: Array
    moved: NDArray[np.bool_]
    repaired: NDArray[np.bool_]


def untangle(xy: Array, least_sine: float) -> Untangled:
    """Move interior nodes until every corner's sine exceeds `least_sine`, as far as that is possible."""
    x, y = (np.ascontiguousarray(xy[..., axis]).copy() for axis in (0, 1))
    moved = _untangled(x, y, least_sine, np.array(RINGS))
    repaired = moved[1:, 1:] | moved[1:, :-1] | moved[:-1, 1:] | moved[:-1, :-1]
    return Untangled(np.stack([x, y], axis=-1), moved, repaired)


def corner_sines(xy: Array) -> Array:
    """Corner Jacobian over the product of its two edge lengths, (m_phi - 1, m_j - 1, 4); not positive: folded."""
    return quad_sines(np.stack([xy[:-1, :-1], xy[1:, :-1], xy[1:, 1:], xy[:-1, 1:]], axis=2))


@njit(cache=True, nogil=True)
def _untangled(x: Array, y: Array, least_sine: float, rings: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Repair in place; returns which nodes (m_phi, m_j) were allowed to move."""
    moved = np.zeros(x.shape, np.bool_)
    stamp = np.zeros(x.shape, np.int64)
    patch = 0
    for ring in rings:
        # A corner between two walls may be sharper than any repair can mend; folded ones are worth a larger patch.
        wanted = least_sine if ring == rings[0] else _FOLDED * least_sine
        cells, first = _bad_groups(x, y, wanted, ring)
        if len(cells) == 0:
            break
        for group in range(len(first) - 1):
            patch += 1
            nodes = _nodes_round(cells[first[group] : first[group + 1]], ring, stamp, patch)
            if len(nodes):
                _unfold_patch(x, y, nodes, wanted)
            for i, j in nodes:
                moved[i, j] = True
    return moved


@njit(cache=True, nogil=True)
def _unfold_patch(x: Array, y: Array, nodes: NDArray[np.int64], least_sine: float) -> None:
    area, aspect = _scales(x, y, nodes)
    settled = 0
    for sweep in range(_MOST_SWEEPS):
        least_jacobian, sine = _worst(x, y, nodes, area)
        if sine > least_sine:
            settled += 1
            if settled > _SETTLING:
                return
        eps2 = _SHRINK * least_jacobian**2 + _FLOOR if least_jacobian <= 0 else 0.0
        for k in range(len(nodes)):
            i, j = nodes[k] if sweep % 2 == 0 else nodes[len(nodes) - 1 - k]
            _move_node(x, y, i, j, eps2, area, aspect)


@njit(cache=True, nogil=True)
def _move_node(x: Array, y: Array, i: int, j: int, eps2: float, area: float, aspect: float) -> None:
    """One damped Newton step of node (i, j)."""
    at_x, at_y = x[i, j], y[i, j]
    energy, g_x, g_y, h_xx, h_xy, h_yy = _node_energy(x, y, i, j, at_x, at_y, eps2, area, aspect)
    determinant, trace = h_xx * h_yy - h_xy * h_xy, h_xx + h_yy
    if determinant > 1e-14 * trace * trace:
        step_x, step_y = -(h_yy * g_x - h_xy * g_y) / determinant, -(h_xx * g_y - h_xy * g_x) / determinant
    else:
        step_x, step_y = -g_x / trace, -g_y / trace
    slope = g_x * step_x + g_y * step_y
    share = 1.0
    for _ in range(12):
        to_x, to_y = at_x + share * step_x, at_y + share * step_y
        if _node_energy(x, y, i, j, to_x, to_y, eps2, area, aspect)[0] < energy + 1e-4 * share * slope:
            x[i, j], y[i, j] = to_x, to_y
            return
        share /= 2


@njit(cache=True, nogil=True)
def _node_energy(
    x: Array, y: Array, i: int, j: int, at_x: float, at_y: float, eps2: float, area: float, aspect: float
) -> tuple[float, float, float, float, float, float]:
    """E_eps of the twelve corners that node (i, j), placed at (at_x, at_y), is part of; gradient and convex Hessian."""
    energy, g_x, g_y, h_xx, h_xy, h_yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for cell_i in range(i - 1, i + 1):
        for cell_j in range(j - 1, j + 1):
            for corner in range(4):
                v_i, v_j, a_i, a_j, b_i, b_j = _corner(cell_i, cell_j, corner)
                v_x, v_y, a_x, a_y, b_x, b_y = (
                    x[v_i, v_j],
                    y[v_i, v_j],
                    x[a_i, a_j],
                    y[a_i, a_j],
                    x[b_i, b_j],
                    y[b_i, b_j],
                )
                # How the two edge vectors a, b follow the node: d a = rate_a d node, d b = rate_b d node.
                if v_i == i and v_j == j:
                    v_x, v_y, rate_a, rate_b = at_x, at_y, -1.0, -1.0
                elif a_i == i and a_j == j:
                    a_x, a_y, rate_a, rate_b = at_x, at_y, 1.0, 0.0
                elif b_i == i and b_j == j:
                    b_x, b_y, rate_a, rate_b = at_x, at_y, 0.0, 1.0
                else:
                    continue
                a_x, a_y, b_x, b_y = a_x - v_x, a_y - v_y, b_x - v_x, b_y - v_y
                weight_a = aspect if corner % 2 == 0 else 1.0 / aspect
                weight_b = 1.0 / weight_a
                jacobian = (a_x * b_y - a_y * b_x) / area
                j_x, j_y = (rate_a * b_y - rate_b * a_y) / area, (rate_b * a_x - rate_a * b_x) / area
                root = np.sqrt(eps2 + jacobian * jacobian)
                chi = (jacobian + root) / 2 if jacobian >= 0 else eps2 / (root - jacobian) / 2
                if chi <= 0.0:
                    return np.inf, 0.0, 0.0, 1.0, 0.0, 1.0
                size = (weight_a * (a_x * a_x + a_y * a_y) + weight_b * (b_x * b_x + b_y * b_y)) / area
                size_x = 2 * (weight_a * rate_a * a_x + weight_b * rate_b * b_x) / area
                size_y = 2 * (weight_a * rate_a * a_y + weight_b * rate_b * b_y) / area
                size_2 = 2 * (weight_a * rate_a * rate_a + weight_b * rate_b * rate_b) / area
                k_x, k_y = chi / root * j_x, chi / root * j_y
                energy += size / chi
                g_x += (size_x - size * k_x / chi) / chi
                g_y += (size_y - size * k_y / chi) / chi
                h_xx += (size_2 - 2 * (size_x - size * k_x / chi) * k_x / chi) / chi
                h_yy += (size_2 - 2 * (size_y - size * k_y / chi) * k_y / chi) / chi
                h_xy += (2 * size * k_x * k_y / chi - size_x * k_y - size_y * k_x) / chi / chi
    return energy, g_x, g_y, h_xx, h_xy, h_yy


@njit(cache=True, nogil=True)
def _corner(i: int, j: int, corner: int) -> tuple[int, int, int, int, int, int]:
    """Nodes of a corner of cell (i, j): its vertex, the next and the previous one, counter-clockwise."""
    if corner == 0:
        return i, j, i + 1, j, i, j + 1
    if corner == 1:
        return i + 1, j, i + 1, j + 1, i, j
    if corner == 2:
        return i + 1, j + 1, i, j + 1, i + 1, j
    return i, j + 1, i, j, i + 1, j + 1


@njit(cache=True, nogil=True)
def _cell_worst(x: Array, y: Array, i: int, j: int) -> tuple[float, float]:
    """Least corner Jacobian (m^2) and least sine of a corner's angle of cell (i, j)."""
    jacobian, sine = np.inf, np.inf
    for corner in range(4):
        v_i, v_j, a_i, a_j, b_i, b_j = _corner(i, j, corner)
        a_x, a_y = x[a_i, a_j] - x[v_i, v_j], y[a_i, a_j] - y[v_i, v_j]
        b_x, b_y = x[b_i, b_j] - x[v_i, v_j], y[b_i, b_j] - y[v_i, v_j]
        cross = a_x * b_y - a_y * b_x
        product = np.sqrt((a_x * a_x + a_y * a_y) * (b_x * b_x + b_y * b_y))
        jacobian = min(jacobian, cross)
        sine = min(sine, cross / product if product > 0.0 else -1.0)
    return jacobian, sine


@njit(cache=True, nogil=True)
def _worst(x: Array, y: Array, nodes: NDArray[np.int64], area: float) -> tuple[float, float]:
    """Least Jacobian over the mean area, and least sine, among the cells round the nodes."""
    jacobian, sine = np.inf, np.inf
    for i, j in nodes:
        for cell_i in range(i - 1, i + 1):
            for cell_j in range(j - 1, j + 1):
                cell_jacobian, cell_sine = _cell_worst(x, y, cell_i, cell_j)
                jacobian, sine = min(jacobian, cell_jacobian), min(sine, cell_sine)
    return jacobian / area, sine


@njit(cache=True, nogil=True)
def _scales(x: Array, y: Array, nodes: NDArray[np.int64]) -> tuple[float, float]:
    """Mean cell area and mean ratio |x_psi| / |x_phi| of a patch."""
    along, across = 0.0, 0.0
    for i, j in nodes:
        along += (x[i + 1, j] - x[i - 1, j]) ** 2 + (y[i + 1, j] - y[i - 1, j]) ** 2
        across += (x[i, j + 1] - x[i, j - 1]) ** 2 + (y[i, j + 1] - y[i, j - 1]) ** 2
    return np.sqrt(along * across) / len(nodes) / 4, np.sqrt(across / along)


@njit(cache=True, nogil=True)
def _bad_groups(x: Array, y: Array, least_sine: float, ring: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Bad cells (B, 2) sorted into groups whose rings touch; group k is cells[first[k] : first[k + 1]]."""
    m_phi, m_j = x.shape[0] - 1, x.shape[1] - 1
    bad = np.zeros((m_phi, m_j), np.bool_)
    count = 0
    for i in range(m_phi):
        for j in range(m_j):
            if _cell_worst(x, y, i, j)[1] <= least_sine:
                bad[i, j] = True
                count += 1
    cells = np.empty((count, 2), np.int64)
    first = [0]
    end = 0
    for i in range(m_phi):
        for j in range(m_j):
            if not bad[i, j]:
                continue
            cells[end, 0], cells[end, 1] = i, j
            bad[i, j] = False
            seen, end = end, end + 1
            while seen < end:
                near_i, near_j = cells[seen]
                seen += 1
                for k in range(max(0, near_i - 2 * ring), min(m_phi, near_i + 2 * ring + 1)):
                    for m in range(max(0, near_j - 2 * ring), min(m_j, near_j + 2 * ring + 1)):
                        if bad[k, m]:
                            bad[k, m] = False
                            cells[end, 0], cells[end, 1] = k, m
                            end += 1
            first.append(end)
    return cells, np.array(first)


@njit(cache=True, nogil=True)
def _nodes_round(cells: NDArray[np.int64], ring: int, stamp: NDArray[np.int64], patch: int) -> NDArray[np.int64]:
    """Interior nodes (n, 2) within `ring` of the cells, in grid order along phi."""
    m_phi, m_j = stamp.shape
    i_min, i_max = m_phi, 0
    count = 0
    for i, j in cells:
        low, high = max(1, i - ring + 1), min(m_phi - 1, i + ring + 1)
        i_min, i_max = min(i_min, low), max(i_max, high)
        for k in range(low, high):
            for m in range(max(1, j - ring + 1), min(m_j - 1, j + ring + 1)):
                if stamp[k, m] != patch:
                    stamp[k, m] = patch
                    count += 1
    nodes = np.empty((count, 2), np.int64)
    count = 0
    for k in range(i_min, i_max):
        for m in range(m_j):
            if stamp[k, m] == patch:
                nodes[count, 0], nodes[count, 1] = k, m
                count += 1
    return nodes
