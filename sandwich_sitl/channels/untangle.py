"""Mending folded cells: a patch of interior nodes moves until every corner Jacobian in it is positive.

Source: the regularised Jacobian energy of Garanzha et al., "Foldover-free maps in 50 lines of code" (2021; notes N8).
Each corner of each quad is a triangle with Jacobian J = [e_phi / h_phi, e_psi / h_psi] against a wanted edge length,
D = det J, and costs

    E = (|J|^2 + lambda (D^2 + 1)) / chi(D),    chi(D) = (D + sqrt(eps^2 + D^2)) / 2,

which grows without bound as D falls to zero once eps is small; eps follows the worst D. Four positive corners make a
quad convex, and convex quads whose outer edges are the channel's boundary tile the channel: that is why the check of
corners suffices.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label
from scipy.optimize import minimize

Array = NDArray[np.float64]

_LAMBDA = 1.0
_RINGS = (3, 8, 20, 1000)  # how many cells a patch reaches beyond the bad ones, tried in turn
_AROUND = np.ones((3, 3), dtype=bool)
_OUTER_STEPS = 25
_PATIENCE = 4  # rounds in which the worst determinant may stay where it is while eps shrinks

# Corner (i, j) of a quad with its neighbours along phi and psi, and the sign of its turn.
_CORNERS = (
    ((0, 0), (1, 0), (0, 1), 1.0),
    ((1, 0), (0, 0), (1, 1), -1.0),
    ((1, 1), (0, 1), (1, 0), 1.0),
    ((0, 1), (1, 1), (0, 0), -1.0),
)


@dataclass(frozen=True)
class Untangled:
    """Grid (m_phi, m_j, 2) and the cells (m_phi - 1, m_j - 1) whose nodes were moved."""

    xy_m: Array
    repaired: NDArray[np.bool_]


def corner_sines(xy: Array) -> Array:
    """Corner Jacobian over the product of its edge lengths, (m_phi - 1, m_j - 1, 4): the sine of the corner's angle."""
    values = []
    for corner, along_phi, along_psi, sign in _CORNERS:
        p, e, f = (_corner(xy, at) for at in (corner, along_phi, along_psi))
        u, v = e - p, f - p
        length = np.hypot(u[..., 0], u[..., 1]) * np.hypot(v[..., 0], v[..., 1])
        values.append(sign * (u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]) / np.maximum(length, 1e-300))
    return np.stack(values, axis=-1)


def untangle(xy: Array, least_sine: float) -> Untangled:
    """Move interior nodes near cells with a corner sine below `least_sine` until none is left.

    Patches grow until their own boundary leaves room for the mend; the last one is the whole channel. What cannot be
    mended stays as it was: the caller checks.
    """
    xy = xy.copy()
    repaired = np.zeros((xy.shape[0] - 1, xy.shape[1] - 1), dtype=bool)
    for rings in _RINGS:
        bad = np.asarray((corner_sines(xy) < least_sine).any(axis=-1))
        if not bad.any():
            break
        patches, count = label(binary_dilation(bad, structure=_AROUND, iterations=rings), structure=_AROUND)
        for number in range(1, count + 1):
            patch = patches == number
            mended = _mend(xy, patch, least_sine)
            if (corner_sines(mended)[patch] >= least_sine).all():
                xy, repaired = mended, repaired | patch
    return Untangled(xy, repaired)


def _mend(xy: Array, patch: NDArray[np.bool_], least_sine: float) -> Array:
    """Minimise the energy over nodes all of whose cells lie in the patch."""
    m, n = xy.shape[:2]
    movable = np.zeros((m, n), dtype=bool)
    movable[1:-1, 1:-1] = patch[1:, 1:] & patch[1:, :-1] & patch[:-1, 1:] & patch[:-1, :-1]
    if not movable.any():
        return xy
    h_phi, h_psi = _wanted_lengths(xy)
    cells = np.argwhere(patch)
    number = np.arange(m * n).reshape(m, n)
    triangles, turns, sizes = [], [], []
    for corner, along_phi, along_psi, sign in _CORNERS:
        triangles.append(np.stack([number[tuple((cells + at).T)] for at in (corner, along_phi, along_psi)], axis=1))
        turns.append(np.full(len(cells), sign))
        sizes.append(np.stack([h_phi[tuple(cells.T)], h_psi[tuple(cells.T)]], axis=1))
    energy = _Energy(
        xy.reshape(-1, 2), np.concatenate(triangles), np.concatenate(turns), np.concatenate(sizes), movable.ravel()
    )
    moved = energy.minimise(least_sine)
    return moved.reshape(m, n, 2)


def _wanted_lengths(xy: Array) -> tuple[Array, Array]:
    """Edge lengths (m - 1, n - 1) along phi and psi a cell should have: means over its neighbourhood, never zero."""
    phi = np.linalg.norm(np.diff(xy, axis=0), axis=-1)
    psi = np.linalg.norm(np.diff(xy, axis=1), axis=-1)
    phi, psi = (phi[:, 1:] + phi[:, :-1]) / 2, (psi[1:] + psi[:-1]) / 2
    return np.maximum(phi, 0.2 * phi.mean()), np.maximum(psi, 0.2 * psi.mean())


class _Energy:
    """The energy of the triangles of one patch as a function of its movable nodes."""

    def __init__(
        self, nodes: Array, triangles: NDArray[np.int64], turn: Array, size: Array, movable: NDArray[np.bool_]
    ):
        self._nodes, self._triangles, self._turn, self._size = nodes.copy(), triangles, turn, size
        self._movable = np.flatnonzero(movable)
        self._eps = 1.0

    def minimise(self, least_sine: float) -> Array:
        """Nodes (N, 2) after at most `_OUTER_STEPS` rounds of L-BFGS with shrinking eps."""
        eps, last_worst, waited = 1.0, -np.inf, 0
        for _ in range(_OUTER_STEPS):
            worst = float(self._determinants().min())
            waited = 0 if worst > 0.9 * last_worst else waited + 1
            if waited > _PATIENCE:
                break
            # A stationary point that still has folds: a smaller eps makes them dearer.
            eps = min(0.2 * abs(min(worst, 0.0)), eps * (0.5 if waited else 1.0))
            last_worst = max(last_worst, worst)
            self._eps = float(np.sqrt(1e-12 + eps**2))
            result = minimize(
                self._value, self._nodes[self._movable].ravel(), jac=True, method="L-BFGS-B",
                options={"maxiter": 300, "maxcor": 20, "maxfun": 600},
            )  # fmt: skip
            self._nodes[self._movable] = result.x.reshape(-1, 2)
            if self._least_sine() > least_sine:
                break
        return self._nodes

    def _edges(self) -> tuple[Array, Array]:
        p, e, f = (self._nodes[self._triangles[:, k]] for k in range(3))
        return (e - p) / self._size[:, :1], (f - p) / self._size[:, 1:]

    def _determinants(self) -> Array:
        u, v = self._edges()
        return self._turn * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])

    def _least_sine(self) -> float:
        u, v = self._edges()
        lengths = np.hypot(*(u * self._size[:, :1]).T) * np.hypot(*(v * self._size[:, 1:]).T)
        areas = self._determinants() * self._size[:, 0] * self._size[:, 1]
        return float((areas / np.maximum(lengths, 1e-300)).min())

    def _value(self, flat: Array) -> tuple[float, Array]:
        self._nodes[self._movable] = flat.reshape(-1, 2)
        u, v = self._edges()
        det = self._turn * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        root = np.sqrt(self._eps**2 + det**2)
        # (det + root) / 2 loses all digits for det << 0; this form keeps them.
        chi = np.where(det > 0, (det + root) / 2, self._eps**2 / 2 / np.maximum(root - det, 1e-300))
        d_chi = chi / root
        shape = (u**2).sum(axis=1) + (v**2).sum(axis=1)
        top = shape + _LAMBDA * (det**2 + 1)
        d_det = _LAMBDA * 2 * det / chi - top * d_chi / chi**2
        d_u = 2 * u / chi[:, None] + (d_det * self._turn)[:, None] * np.column_stack([v[:, 1], -v[:, 0]])
        d_v = 2 * v / chi[:, None] + (d_det * self._turn)[:, None] * np.column_stack([-u[:, 1], u[:, 0]])
        d_u, d_v = d_u / self._size[:, :1], d_v / self._size[:, 1:]
        gradient = np.zeros_like(self._nodes)
        for column, part in ((1, d_u), (2, d_v), (0, -d_u - d_v)):
            for axis in range(2):
                gradient[:, axis] += np.bincount(self._triangles[:, column], part[:, axis], len(self._nodes))
        return float((top / chi).sum()), gradient[self._movable].ravel()


def _corner(xy: Array, at: tuple[int, int]) -> Array:
    i, j = at
    return xy[i : xy.shape[0] - 1 + i, j : xy.shape[1] - 1 + j]
