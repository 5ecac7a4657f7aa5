"""A convex QP over the control points of a plane B-spline, by a primal-dual interior-point method (numba).

    minimise  1/2 sum_axes P' H P   subject to  n_r . c(u_r) <= g_r,   c(u) = sum_j B_j(u) P_j

H is banded and every row touches only the K + 1 control points round its parameter, so the Newton matrix, x and y
interleaved, is banded too: an iteration costs O(n). Method: Mehrotra's predictor-corrector (Nocedal and Wright,
Numerical Optimization, chapter 16.6) with an infeasible start. Some control points may be fixed.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_ITERATIONS = 60
_TOLERANCE_M = 1e-7


@njit(cache=True)
def solve(
    H: Array, points: Array, free: NDArray[np.bool_], first: Indices, basis: Array, rows: Array, sample: Indices
) -> tuple[Array, float]:
    """Control points (n, 2), starting from `points`, and the largest violation left, metres.

    `H` (b, n) holds the diagonals H[d, i] = H_{i, i + d}; `free` (n,) marks the points that may move. Sample k of the
    curve has the basis values `basis` (m, K + 1) on control points `first[k]` and following; row r asks
    rows[r, 0] x + rows[r, 1] y <= rows[r, 2] of sample `sample[r]`.
    """
    n, order, count = len(points), basis.shape[1], len(rows)
    P = points.copy()
    width = 2 * max(order, H.shape[0])
    s, z = np.empty(count), np.empty(count)
    scale = H[0].max()
    value = _rows(P, first, basis, rows, sample)
    for r in range(count):
        s[r] = max(rows[r, 2] - value[r], 0.05)
        z[r] = 0.01 * scale
    for _ in range(MOST_ITERATIONS):
        dual = _times(H, P)
        _add_rows(dual, z, first, basis, rows, sample)
        r_p = value + s - rows[:, 2]
        mu = (s @ z) / max(count, 1)
        worst_dual = 0.0
        for i in range(n):
            if free[i]:
                worst_dual = max(worst_dual, abs(dual[i, 0]), abs(dual[i, 1]))
        worst = 0.0 if count == 0 else np.abs(r_p).max()
        if worst < _TOLERANCE_M and worst_dual < 1e-6 * scale and mu < 1e-8 * scale:
            break
        factor = _factor(H, free, z / s, first, basis, rows, sample, width)
        step, d_s, d_z = _step(factor, dual, r_p, s * z, s, z, free, first, basis, rows, sample)
        reach = min(_longest(s, d_s), _longest(z, d_z))
        after = ((s + reach * d_s) @ (z + reach * d_z)) / max(count, 1)
        target = mu * (after / mu) ** 3 if mu > 0.0 else 0.0
        step, d_s, d_z = _step(factor, dual, r_p, s * z + d_s * d_z - target, s, z, free, first, basis, rows, sample)
        reach = min(1.0, 0.995 * min(_longest(s, d_s), _longest(z, d_z)))
        P += reach * step
        s += reach * d_s
        z += reach * d_z
        value = _rows(P, first, basis, rows, sample)
    worst = 0.0
    for r in range(count):
        worst = max(worst, value[r] - rows[r, 2])
    return P, worst


@njit(cache=True)
def _step(
    factor: Array, dual: Array, r_p: Array, r_c: Array, s: Array, z: Array, free: NDArray[np.bool_], first: Indices,
    basis: Array, rows: Array, sample: Indices,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Newton step in P, s and z for the residuals of the dual, the rows and the complementarity."""
    right = -dual
    _add_rows(right, (r_c - z * r_p) / s, first, basis, rows, sample)
    for i in range(len(right)):
        if not free[i]:
            right[i] = 0.0
    step = _back(factor, right)
    d_s = -r_p - _rows(step, first, basis, rows, sample)
    return step, d_s, -(r_c + z * d_s) / s


@njit(cache=True)
def _rows(P: Array, first: Indices, basis: Array, rows: Array, sample: Indices) -> Array:
    """n_r . c(u_r) of every row."""
    at = np.zeros((len(first), 2))
    for k in range(len(first)):
        for j in range(basis.shape[1]):
            at[k] += basis[k, j] * P[first[k] + j]
    value = np.empty(len(rows))
    for r in range(len(rows)):
        value[r] = rows[r, 0] * at[sample[r], 0] + rows[r, 1] * at[sample[r], 1]
    return value


@njit(cache=True)
def _add_rows(out: Array, weight: Array, first: Indices, basis: Array, rows: Array, sample: Indices) -> None:
    """Add G' weight to `out` (n, 2)."""
    for r in range(len(rows)):
        k = sample[r]
        for j in range(basis.shape[1]):
            out[first[k] + j, 0] += weight[r] * rows[r, 0] * basis[k, j]
            out[first[k] + j, 1] += weight[r] * rows[r, 1] * basis[k, j]


@njit(cache=True)
def _times(H: Array, P: Array) -> Array:
    """H P for a symmetric banded H."""
    out = np.zeros_like(P)
    n = len(P)
    for d in range(H.shape[0]):
        for i in range(n - d):
            out[i] += H[d, i] * P[i + d]
            if d > 0:
                out[i + d] += H[d, i] * P[i]
    return out


@njit(cache=True)
def _factor(
    H: Array, free: NDArray[np.bool_], weight: Array, first: Indices, basis: Array, rows: Array, sample: Indices,
    width: int,
) -> Array:  # fmt: skip
    """Banded Cholesky factor L[i, d] = L_{i, i - d} of H + G' diag(weight) G, x and y interleaved."""
    n = len(free)
    M = np.zeros((2 * n, width))
    for d in range(H.shape[0]):
        for i in range(n - d):
            if free[i] and free[i + d]:
                M[2 * (i + d), 2 * d] = H[d, i]
                M[2 * (i + d) + 1, 2 * d] = H[d, i]
    metric = np.zeros((len(first), 3))
    for r in range(len(rows)):
        k = sample[r]
        metric[k, 0] += weight[r] * rows[r, 0] * rows[r, 0]
        metric[k, 1] += weight[r] * rows[r, 0] * rows[r, 1]
        metric[k, 2] += weight[r] * rows[r, 1] * rows[r, 1]
    for k in range(len(first)):
        for j in range(basis.shape[1]):
            i = first[k] + j
            if not free[i]:
                continue
            for m in range(j + 1):
                other = first[k] + m
                if not free[other]:
                    continue
                share = basis[k, j] * basis[k, m]
                apart = 2 * (j - m)
                M[2 * i, apart] += share * metric[k, 0]
                M[2 * i + 1, apart] += share * metric[k, 2]
                M[2 * i + 1, apart + 1] += share * metric[k, 1]
                if j > m:
                    M[2 * i, apart - 1] += share * metric[k, 1]
    for i in range(n):
        if not free[i]:
            M[2 * i, 0] = M[2 * i + 1, 0] = 1.0
    for i in range(2 * n):
        low = max(0, i - width + 1)
        for j in range(low, i + 1):
            total = M[i, i - j]
            for k in range(max(low, j - width + 1), j):
                total -= M[i, i - k] * M[j, j - k]
            M[i, i - j] = np.sqrt(max(total, 1e-300)) if i == j else total / M[j, 0]
    return M


@njit(cache=True)
def _back(L: Array, right: Array) -> Array:
    """Solve L L' out = right (n, 2)."""
    out = right.copy().reshape(-1)
    size, width = L.shape
    for i in range(size):
        for d in range(1, min(width, i + 1)):
            out[i] -= L[i, d] * out[i - d]
        out[i] /= L[i, 0]
    for i in range(size - 1, -1, -1):
        for d in range(1, min(width, size - i)):
            out[i] -= L[i + d, d] * out[i + d]
        out[i] /= L[i, 0]
    return out.reshape(-1, 2)


@njit(cache=True)
def _longest(x: Array, d: Array) -> float:
    """Largest share in (0, 1] of step `d` that keeps x >= 0."""
    share = 1.0
    for k in range(len(x)):
        if d[k] < 0.0:
            share = min(share, -x[k] / d[k])
    return share
