"""The dual of a tick's problem over the rows that can bind, small enough for a first-order method.

With the Hessian the identity (`horizon`), multipliers lambda of rows i and the excess w of each step's sum over rho_1

    minimise    lambda' K lambda / 2 - d' lambda + sum_g w_g^2 / (2 rho_2)
    subject to  lambda >= 0,   w_g >= 0,   sum of lambda over the rows of g - w_g <= rho_1

    K_ij = (n_i . n_j) table[place_i, place_j],    d_i = n_i . q_free - bound_i

In play are the rows that bound the last tick and those that the optimum without rows breaks, the worst first, at most
`BESIDE` of a step and quantity group. Scaled so that every diagonal entry of K and every weight of w is one. Slots
without a row have K = 1, d = -1 and stay at zero, so the pattern never changes.
"""

from collections.abc import Callable
from math import sqrt

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

BESIDE = 3
_KNOWN = 1e6  # claim of a row that bound the last tick
_LEAST = 1e-16  # claim of a row that is broken by a hair
_SHORTEST = 1e-12  # square of a normal's length
_STIFFER = 1e-7  # on the diagonal, so that rows that say the same keep K positive definite


def _gather(
    free: Array,
    table: Array,
    normals: Array,
    offsets: Array,
    edges: Array,
    edge_count: Integers,
    known: Array,
    merit: Array,
    rows: Integers,
    target: Array,
) -> int:
    """Rows in play into `rows` (m, 3) = quantity, step, face, ordered by group, and their d into `target` (m,); how many.

    `free` (5 n, D), `normals` (n, F, D), `offsets` (n, F), `edges` (4, 8, D) with `edge_count` (4,) in use; `known`
    (5, n, 8) the last multipliers. `merit` (5, n, 8) is work space: a row's claim to a slot.
    """
    n, faces, axes = normals.shape
    cap = len(rows)
    count = 0
    for k in range(5):
        sides = faces if k == 0 else edge_count[k - 1]
        for h in range(n):
            size = table[k * n + h, k * n + h]
            for f in range(sides):
                value = -(offsets[h, f] if k == 0 else 1.0)
                for d in range(axes):
                    value += (normals[h, f, d] if k == 0 else edges[k - 1, f, d]) * free[k * n + h, d]
                claim = 0.0
                if size > 0.0:  # Euler's model moves no position in the first steps, and no row can be mended there
                    if value > 0.0:
                        claim = value * value / size
                    if known[k, h, f] > 0.0:
                        claim += _KNOWN + known[k, h, f]
                merit[k, h, f] = claim
                count += claim >= _LEAST
    least = _LEAST
    if count > cap:
        claims = np.sort(merit.ravel())
        least = max(claims[len(claims) - cap], _LEAST)
    count = 0
    for g in range(3 * n):  # regions of step g, motion limits of step g - n, input of step g - 2 n
        first, last, h = (0, 1, g) if g < n else ((1, 4, g - n) if g < 2 * n else (4, 5, g - 2 * n))
        beside = 0
        while beside < BESIDE and count < cap:
            best, best_k, best_f = 0.0, -1, 0
            for k in range(first, last):
                for f in range(faces if k == 0 else edge_count[k - 1]):
                    if merit[k, h, f] >= least and merit[k, h, f] > best:
                        best, best_k, best_f = merit[k, h, f], k, f
            if best_k < 0:
                break
            merit[best_k, h, best_f] = 0.0
            rows[count, 0], rows[count, 1], rows[count, 2] = best_k, h, best_f
            value = -(offsets[h, best_f] if best_k == 0 else 1.0)
            for d in range(axes):
                value += (normals[h, best_f, d] if best_k == 0 else edges[best_k - 1, best_f, d]) * free[
                    best_k * n + h, d
                ]
            target[count] = value
            count += 1
            beside += 1
    return count


def _assemble(
    table: Array,
    normals: Array,
    edges: Array,
    rho: Array,
    rows: Integers,
    target: Array,
    count: int,
    quadratic: Array,
    linear: Array,
    band: Array,
    high: Array,
    scale: Array,
) -> None:
    """The scaled problem: `quadratic` the upper triangle of K by columns, `linear` (2 m,), `band` (m, BESIDE) with entry
    (i, b) the place of row i in the sum that slot i - b keeps, `high` (m,) the bounds of the sums; `scale` (m,).
    """
    n, _, axes = normals.shape
    cap = len(scale)
    for i in range(cap):
        linear[i], linear[cap + i], scale[i], high[i] = 1.0, 0.0, 1.0, 1e30
        for b in range(BESIDE):
            band[i, b] = 0.0
    unit, place = np.zeros((count, axes)), np.zeros(count, np.int64)
    start, group = 0, -1
    for i in range(count):
        k, h, f = rows[i, 0], rows[i, 1], rows[i, 2]
        place[i] = k * n + h
        size = 0.0
        for d in range(axes):
            unit[i, d] = normals[h, f, d] if k == 0 else edges[k - 1, f, d]
            size += unit[i, d] * unit[i, d]
        scale[i] = 1.0 / sqrt(max(size, _SHORTEST) * table[place[i], place[i]])
        linear[i] = -target[i] * scale[i]
        own = h if k == 0 else (n + h if k < 4 else -1)
        if own < 0:
            continue
        if own != group:
            group, start = own, i
            high[i] = rho[own // n, 0] / sqrt(rho[own // n, 1])
        band[i, i - start] = scale[i] / sqrt(rho[own // n, 1])
    at = 0
    for j in range(cap):
        for i in range(j + 1):
            entry = 1.0 + _STIFFER if i == j else 0.0
            if i < j < count:
                dot = 0.0
                for d in range(axes):
                    dot += unit[i, d] * unit[j, d]
                entry = dot * table[place[i], place[j]] * scale[i] * scale[j]
            quadratic[at] = entry
            at += 1


gather: Callable[..., int] = numba.njit(cache=True)(_gather)
assemble: Callable[..., None] = numba.njit(cache=True)(_assemble)
