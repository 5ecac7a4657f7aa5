"""Eq. (ellipticpde) on one channel by finite differences, boundary nodes given (Dirichlet; paper, section III).

    a x_phiphi - 2 b x_phipsi + c x_psipsi = 0,
    a = x_psi^2 + y_psi^2,   b = x_phi x_psi + y_phi y_psi,   c = x_phi^2 + y_phi^2

and the same for y. Unit spacing in phi and psi: each term carries 1 / (dphi^2 dpsi^2), so the spacing drops out.
Central differences, the coefficients frozen from the last iterate (Picard), one sparse LU for x and y together. The
start is linear interpolation between the bottom and the top side. `residual` measures how far a grid is from solving
the equation; `channels.untangle` mends what the discretisation folds (notes N8).
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]

_MOST_ITERATIONS = 60


@dataclass(frozen=True)
class EllipticGrid:
    """Solution (m_phi, m_j, 2) with the largest move of the last Picard step in metres."""

    xy_m: Array
    last_move_m: float


def interpolate(bottom: Array, top: Array, rows: int) -> Array:
    """Straight columns between bottom (m_phi, 2) and top (m_phi, 2): a grid (m_phi, rows, 2)."""
    share = np.linspace(0.0, 1.0, rows)[None, :, None]
    return (1 - share) * bottom[:, None, :] + share * top[:, None, :]


def solve_elliptic(start: Array, tolerance_m: float) -> EllipticGrid:
    """Iterate from `start` (m_phi, m_j, 2), whose outer nodes are the boundary values, until no node moves more."""
    xy, move, iterations = start, np.inf, 0
    while move >= tolerance_m and iterations < _MOST_ITERATIONS:
        solved = _picard_step(xy)
        move = float(np.abs(solved - xy).max())
        xy, iterations = solved, iterations + 1
    return EllipticGrid(xy, move)


def residual(xy: Array) -> Array:
    """Residual (m_phi - 2, m_j - 2) of Eq. (ellipticpde), as the displacement in metres of a Jacobi step."""
    a, b, c = _coefficients(xy)
    terms = (
        a[..., None] * (xy[2:, 1:-1] - 2 * xy[1:-1, 1:-1] + xy[:-2, 1:-1])
        - b[..., None] / 2 * (xy[2:, 2:] - xy[2:, :-2] - xy[:-2, 2:] + xy[:-2, :-2])
        + c[..., None] * (xy[1:-1, 2:] - 2 * xy[1:-1, 1:-1] + xy[1:-1, :-2])
    )
    return np.asarray(np.hypot(terms[..., 0], terms[..., 1]) / (2 * (a + c)))


def _coefficients(xy: Array) -> tuple[Array, Array, Array]:
    d_phi = (xy[2:, 1:-1] - xy[:-2, 1:-1]) / 2
    d_psi = (xy[1:-1, 2:] - xy[1:-1, :-2]) / 2
    a, b, c = (d_psi**2).sum(axis=-1), (d_phi * d_psi).sum(axis=-1), (d_phi**2).sum(axis=-1)
    return a, b, c


def _picard_step(xy: Array) -> Array:
    m, n = xy.shape[:2]
    a, b, c = (values.ravel() for values in _coefficients(xy))
    scale = 1.0 / (2 * (a + c))
    a, b, c = a * scale, b * scale, c * scale
    number = np.arange(m * n).reshape(m, n)
    rows = np.arange((m - 2) * (n - 2))
    # Offsets (di, dj) of the nine-point stencil and their weights.
    stencil = [
        (0, 0, -2 * (a + c)), (1, 0, a), (-1, 0, a), (0, 1, c), (0, -1, c),
        (1, 1, -b / 2), (-1, -1, -b / 2), (1, -1, b / 2), (-1, 1, b / 2),
    ]  # fmt: skip
    columns = np.concatenate([number[1 + i : m - 1 + i, 1 + j : n - 1 + j].ravel() for i, j, _ in stencil])
    values = np.concatenate([weight for _, _, weight in stencil])
    full = sp.csc_array((values, (np.tile(rows, len(stencil)), columns)), shape=(len(rows), m * n))
    inside = np.zeros((m, n), dtype=bool)
    inside[1:-1, 1:-1] = True
    unknown = inside.ravel()
    nodes = xy.reshape(-1, 2)
    right = -(full[:, ~unknown] @ nodes[~unknown])
    solved = xy.copy()
    solved[1:-1, 1:-1] = splu(sp.csc_matrix(full[:, unknown])).solve(right).reshape(m - 2, n - 2, 2)
    return solved
