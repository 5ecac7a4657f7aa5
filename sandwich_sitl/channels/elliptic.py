"""The elliptic grid equations of one channel, by full-approximation multigrid.

Source: paper, Eq. (ellipticpde): a x_phiphi - 2 b x_phipsi + c x_psipsi = 0 and the same for y, with
a = x_psi^2 + y_psi^2, b = x_phi x_psi + y_phi y_psi, c = x_phi^2 + y_phi^2; central differences, all four sides given
(Dirichlet), which fixes their nodes: the result is smooth, not orthogonal. Spacing in phi and psi cancels, so indices
serve as coordinates. Both equations are divided by 2 (a + c), which makes a residual the displacement of a Jacobi step, in metres.

Method: V-cycles of the full approximation scheme (A. Brandt, 1977), the nonlinear problem itself on every level;
smoothing by Gauss-Seidel line relaxation across and along the channel, coefficients as they stand (tri-diagonal,
always diagonally dominant). A channel of N nodes costs O(N).

State: `x`, `y` (m_phi, m_j), boundary included. The result is smooth but may fold at re-entrant corners;
`untangle` mends that.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_CYCLES = 12
_COARSEST_SWEEPS = 12
_TINY = 1e-300


@dataclass(frozen=True)
class EllipticGrid:
    """`xy_m` (m_phi, m_j, 2) and the largest residual left, metres."""

    xy_m: Array
    residual_m: float
    cycles: int


def interpolate(bottom: Array, top: Array, m_j: int) -> Array:
    """Start grid (m_phi, m_j, 2): straight columns between bottom (m_phi, 2) and top (m_phi, 2)."""
    share = np.linspace(0.0, 1.0, m_j)[None, :, None]
    grid = (1 - share) * bottom[:, None, :] + share * top[:, None, :]
    grid[:, 0], grid[:, -1] = bottom, top
    return np.asarray(grid)


def solve_elliptic(start: Array, tolerance_m: float) -> EllipticGrid:
    """Solve Eq. (ellipticpde) from a start grid (m_phi, m_j, 2) whose boundary is kept.

    Cycles end when no residual exceeds `tolerance_m`, or after `MOST_CYCLES`.
    """
    x, y = (np.ascontiguousarray(start[..., axis]).copy() for axis in (0, 1))
    cycles, worst = _solve(x, y, tolerance_m)
    return EllipticGrid(np.stack([x, y], axis=-1), float(worst), int(cycles))


def residual(xy: Array) -> Array:
    """Residual (m_phi, m_j) of Eq. (ellipticpde) at every node as a displacement in metres, zero on the boundary."""
    x, y = (np.ascontiguousarray(xy[..., axis]) for axis in (0, 1))
    zero, in_x, in_y = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    _residual(x, y, zero, zero, in_x, in_y)
    return np.hypot(in_x, in_y)


@njit(cache=True, nogil=True)
def _solve(x: Array, y: Array, tolerance: float) -> tuple[int, float]:
    zero, in_x, in_y = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    worst = _residual(x, y, zero, zero, in_x, in_y)
    cycles = 0
    while worst > tolerance and cycles < MOST_CYCLES:
        _cycle(x, y, zero, zero)
        worst = _residual(x, y, zero, zero, in_x, in_y)
        cycles += 1
    return cycles, float(worst)


@njit(cache=True, nogil=True)
def _cycle(x: Array, y: Array, f_x: Array, f_y: Array) -> None:
    """One V-cycle for N(x) = f."""
    m_phi, m_j = x.shape
    if (m_phi - 1) % 2 or (m_j - 1) % 2 or m_j < 5 or m_phi < 7:
        for k in range(_COARSEST_SWEEPS):
            _relax_rows(x, y, f_x, f_y, k % 2 == 0)
            _relax_columns(x, y, f_x, f_y, k % 2 == 0)
        return
    _relax_columns(x, y, f_x, f_y, True)
    _relax_rows(x, y, f_x, f_y, True)
    r_x, r_y = np.zeros_like(x), np.zeros_like(x)
    _residual(x, y, f_x, f_y, r_x, r_y)
    coarse_x, coarse_y = x[::2, ::2].copy(), y[::2, ::2].copy()
    zero, own_x, own_y = np.zeros_like(coarse_x), np.zeros_like(coarse_x), np.zeros_like(coarse_x)
    _residual(coarse_x, coarse_y, zero, zero, own_x, own_y)
    # Twice the spacing makes the same second difference four times as large.
    g_x, g_y = 4.0 * _restricted(r_x) - own_x, 4.0 * _restricted(r_y) - own_y
    before_x, before_y = coarse_x.copy(), coarse_y.copy()
    _cycle(coarse_x, coarse_y, g_x, g_y)
    _add_prolonged(x, coarse_x - before_x)
    _add_prolonged(y, coarse_y - before_y)
    _relax_rows(x, y, f_x, f_y, False)
    _relax_columns(x, y, f_x, f_y, False)


@njit(cache=True, nogil=True)
def _coefficients(x: Array, y: Array, i: int, j: int) -> tuple[float, float, float]:
    x_phi, y_phi = (x[i + 1, j] - x[i - 1, j]) / 2, (y[i + 1, j] - y[i - 1, j]) / 2
    x_psi, y_psi = (x[i, j + 1] - x[i, j - 1]) / 2, (y[i, j + 1] - y[i, j - 1]) / 2
    return x_psi * x_psi + y_psi * y_psi, x_phi * x_psi + y_phi * y_psi, x_phi * x_phi + y_phi * y_phi


@njit(cache=True, nogil=True)
def _mixed(u: Array, i: int, j: int) -> float:
    """u_phipsi."""
    return float(u[i + 1, j + 1] - u[i - 1, j + 1] - u[i + 1, j - 1] + u[i - 1, j - 1]) / 4


@njit(cache=True, nogil=True)
def _residual(x: Array, y: Array, f_x: Array, f_y: Array, r_x: Array, r_y: Array) -> float:
    """r = f - N(x), written to r_x and r_y; returns the largest component."""
    worst = 0.0
    for i in range(1, x.shape[0] - 1):
        for j in range(1, x.shape[1] - 1):
            a, b, c = _coefficients(x, y, i, j)
            scale = 2 * (a + c) + _TINY
            n_x = a * (x[i + 1, j] - 2 * x[i, j] + x[i - 1, j]) + c * (x[i, j + 1] - 2 * x[i, j] + x[i, j - 1])
            n_y = a * (y[i + 1, j] - 2 * y[i, j] + y[i - 1, j]) + c * (y[i, j + 1] - 2 * y[i, j] + y[i, j - 1])
            r_x[i, j] = f_x[i, j] - (n_x - 2 * b * _mixed(x, i, j)) / scale
            r_y[i, j] = f_y[i, j] - (n_y - 2 * b * _mixed(y, i, j)) / scale
            worst = max(worst, abs(r_x[i, j]), abs(r_y[i, j]))
    return float(worst)


@njit(cache=True, nogil=True)
def _relax_columns(x: Array, y: Array, f_x: Array, f_y: Array, forward: bool) -> None:
    """Solve for each column across the channel in turn (Thomas algorithm)."""
    m_phi, m_j = x.shape
    diagonal, onward, t_x, t_y = np.empty(m_j), np.empty(m_j), np.empty(m_j), np.empty(m_j)
    for k in range(1, m_phi - 1):
        i = k if forward else m_phi - 1 - k
        t_x[0], t_y[0] = x[i, 0], y[i, 0]
        onward[0], diagonal[0] = 0.0, 1.0
        for j in range(1, m_j - 1):
            a, b, c = _coefficients(x, y, i, j)
            scale = 2 * (a + c) + _TINY
            share = c / diagonal[j - 1]
            diagonal[j] = scale - share * onward[j - 1]
            onward[j] = c
            s_x = a * (x[i + 1, j] + x[i - 1, j]) - 2 * b * _mixed(x, i, j) - scale * f_x[i, j]
            s_y = a * (y[i + 1, j] + y[i - 1, j]) - 2 * b * _mixed(y, i, j) - scale * f_y[i, j]
            t_x[j] = s_x + share * t_x[j - 1]
            t_y[j] = s_y + share * t_y[j - 1]
        for j in range(m_j - 2, 0, -1):
            x[i, j] = (t_x[j] + onward[j] * x[i, j + 1]) / diagonal[j]
            y[i, j] = (t_y[j] + onward[j] * y[i, j + 1]) / diagonal[j]


@njit(cache=True, nogil=True)
def _relax_rows(x: Array, y: Array, f_x: Array, f_y: Array, forward: bool) -> None:
    """Solve for each row along the channel in turn (Thomas algorithm)."""
    m_phi, m_j = x.shape
    diagonal, onward, t_x, t_y = np.empty(m_phi), np.empty(m_phi), np.empty(m_phi), np.empty(m_phi)
    for k in range(1, m_j - 1):
        j = k if forward else m_j - 1 - k
        t_x[0], t_y[0] = x[0, j], y[0, j]
        onward[0], diagonal[0] = 0.0, 1.0
        for i in range(1, m_phi - 1):
            a, b, c = _coefficients(x, y, i, j)
            scale = 2 * (a + c) + _TINY
            share = a / diagonal[i - 1]
            diagonal[i] = scale - share * onward[i - 1]
            onward[i] = a
            s_x = c * (x[i, j + 1] + x[i, j - 1]) - 2 * b * _mixed(x, i, j) - scale * f_x[i, j]
            s_y = c * (y[i, j + 1] + y[i, j - 1]) - 2 * b * _mixed(y, i, j) - scale * f_y[i, j]
            t_x[i] = s_x + share * t_x[i - 1]
            t_y[i] = s_y + share * t_y[i - 1]
        for i in range(m_phi - 2, 0, -1):
            x[i, j] = (t_x[i] + onward[i] * x[i + 1, j]) / diagonal[i]
            y[i, j] = (t_y[i] + onward[i] * y[i + 1, j]) / diagonal[i]


@njit(cache=True, nogil=True)
def _restricted(u: Array) -> Array:
    """Full weighting onto every second node; zero on the boundary."""
    coarse = np.zeros(((u.shape[0] + 1) // 2, (u.shape[1] + 1) // 2))
    for k in range(1, coarse.shape[0] - 1):
        for m in range(1, coarse.shape[1] - 1):
            i, j = 2 * k, 2 * m
            beside = u[i + 1, j] + u[i - 1, j] + u[i, j + 1] + u[i, j - 1]
            across = u[i + 1, j + 1] + u[i - 1, j + 1] + u[i + 1, j - 1] + u[i - 1, j - 1]
            coarse[k, m] = u[i, j] / 4 + beside / 8 + across / 16
    return coarse


@njit(cache=True, nogil=True)
def _add_prolonged(u: Array, e: Array) -> None:
    """Add a coarse correction, interpolated bilinearly, inside the boundary."""
    for i in range(1, u.shape[0] - 1):
        k, odd_i = i // 2, i % 2
        for j in range(1, u.shape[1] - 1):
            m, odd_j = j // 2, j % 2
            u[i, j] += (e[k, m] + e[k + odd_i, m] + e[k, m + odd_j] + e[k + odd_i, m + odd_j]) / 4
