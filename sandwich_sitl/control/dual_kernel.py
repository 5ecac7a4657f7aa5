"""Dual active-set method on the whitened problem, compiled (Goldfarb and Idnani 1983; state kept between ticks).

With the Hessian the identity, multipliers lambda of the working rows i in W move every quantity by

    q = q_free - sum_j lambda_j n_j table[:, place_j],      place = k n + h of quantity k at step h

and solve  (K + C) lambda = d,  K_ij = (n_i . n_j) table[place_i, place_j],  d_i = n_i . q_free - bound_i, with two
kinds of slack group: closed (s = 0, the sum of its multipliers is below rho_1) and open (s = (sum - rho_1) / rho_2,
which adds 1 / rho_2 to C among the group's rows and rho_1 / rho_2 to d). Each round goes from lambda towards the
solution for W and stops at the first multiplier that reaches zero (its row leaves) or sum that crosses rho_1 (its
group opens or closes); at the solution the most violated row of the whole problem enters. The dual value rises in
every round, so the method ends; rounds are capped all the same.

Idle rows cost one dot product of length one or two a round and no memory; nothing is factorised but K of the working
rows. A hair of compliance on the diagonal keeps K positive definite when working rows depend on each other.
"""

from collections.abc import Callable
from math import sqrt

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

COMPLIANCE = 1e-10  # m per unit of multiplier: below every tolerance, above rounding
TOLERANCE = 1e-8  # m, or share of a limit


def _factorise(K: Array, start: int, count: int) -> bool:
    """Cholesky factor of the leading block in place (lower), rows before `start` being factored already.

    False when the block is not positive definite.
    """
    for i in range(start, count):
        for j in range(i + 1):
            total = K[i, j]
            for k in range(j):
                total -= K[i, k] * K[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                K[i, i] = sqrt(total)
            else:
                K[i, j] = total / K[j, j]
    return True


def _substitute(K: Array, b: Array, count: int) -> None:
    """Solve K K' x = b in place."""
    for i in range(count):
        total = b[i]
        for k in range(i):
            total -= K[i, k] * b[k]
        b[i] = total / K[i, i]
    for i in range(count - 1, -1, -1):
        total = b[i]
        for k in range(i + 1, count):
            total -= K[k, i] * b[k]
        b[i] = total / K[i, i]


factorise: Callable[[Array, int, int], bool] = numba.njit(cache=True)(_factorise)
substitute: Callable[[Array, Array, int], None] = numba.njit(cache=True)(_substitute)


def _dual_active_set(
    free: Array,
    table: Array,
    normals: Array,
    offsets: Array,
    edges: Array,
    edge_count: Integers,
    rho: Array,
    rows: Integers,
    multipliers: Array,
    opened: Integers,
    most_rounds: int,
    q: Array,
) -> tuple[int, int]:
    """Multipliers and quantities q (5 n, D) at the optimum; returns rounds and working rows, rounds < 0 on failure.

    `free` (5 n, D) without rows, `table` (5 n, 5 n), `normals` (n, F, D), `offsets` (n, F), `edges` (4, 8, D) of
    v, a, j, u with `edge_count` (4,) sides in use, `rho` (2, 2). `rows` (cap, 3) = quantity, step, face with
    `multipliers` (cap,) and `opened` (2 n,) are the working set of the last tick (quantity < 0 ends it) and of this.
    """
    n, faces, axes = normals.shape
    cap = len(multipliers)
    unit, bound, place, group = np.empty((cap, axes)), np.empty(cap), np.empty(cap, np.int64), np.empty(cap, np.int64)
    K, target = np.empty((cap, cap)), np.empty(cap)
    before, after = np.zeros(2 * n), np.zeros(2 * n)
    count, fresh, kept = 0, 0, 0
    while fresh < cap and rows[fresh, 0] >= 0:
        if multipliers[fresh] > 0.0:
            rows[count], multipliers[count] = rows[fresh], multipliers[fresh]
            count += 1
        fresh += 1
    for i in range(count):
        k, h, f = rows[i, 0], rows[i, 1], rows[i, 2]
        place[i] = k * n + h
        group[i] = h if k == 0 else (n + h if k < 4 else -1)
        bound[i] = offsets[h, f] if k == 0 else 1.0
        for d in range(axes):
            unit[i, d] = normals[h, f, d] if k == 0 else edges[k - 1, f, d]
    for rounds in range(most_rounds):
        if count > 0:
            for i in range(count):
                total = -bound[i]
                for d in range(axes):
                    total += unit[i, d] * free[place[i], d]
                g = group[i]
                if g >= 0 and opened[g]:
                    total += rho[g // n, 0] / rho[g // n, 1]
                target[i] = total
                if i < kept:
                    continue
                for j in range(i + 1):
                    dot = 0.0
                    for d in range(axes):
                        dot += unit[i, d] * unit[j, d]
                    entry = dot * table[place[i], place[j]]
                    if g >= 0 and g == group[j] and opened[g]:
                        entry += 1.0 / rho[g // n, 1]
                    K[i, j] = entry
                K[i, i] += COMPLIANCE
            if not factorise(K, kept, count):
                return -1 - rounds, count
            kept = count
            substitute(K, target, count)
            for i in range(count):
                g = group[i]
                if g >= 0:
                    before[g], after[g] = 0.0, 0.0
            step, leaves, turns = 1.0, -1, -1
            for i in range(count):
                g = group[i]
                if g >= 0:
                    before[g] += multipliers[i]
                    after[g] += target[i]
                if target[i] < 0.0:
                    share = multipliers[i] / (multipliers[i] - target[i])
                    if share < step:
                        step, leaves = share, i
            for i in range(count):
                g = group[i]
                if g < 0:
                    continue
                limit = rho[g // n, 0]
                if (opened[g] and after[g] < limit) or (not opened[g] and after[g] > limit):
                    share = max(0.0, (limit - before[g]) / (after[g] - before[g]))
                    if share < step:
                        step, leaves, turns = share, -1, g
            for i in range(count):
                multipliers[i] += step * (target[i] - multipliers[i])
            if turns >= 0:
                opened[turns] = 1 - opened[turns]
                kept = 0
                while kept < count and group[kept] != turns:
                    kept += 1
                continue
            if leaves >= 0:
                count -= 1
                kept = leaves
                for i in range(leaves, count):
                    rows[i], multipliers[i], unit[i] = rows[i + 1], multipliers[i + 1], unit[i + 1]
                    bound[i], place[i], group[i] = bound[i + 1], place[i + 1], group[i + 1]
                continue
        for p in range(5 * n):
            for d in range(axes):
                q[p, d] = free[p, d]
        for i in range(count):
            for d in range(axes):
                pull = multipliers[i] * unit[i, d]
                if pull != 0.0:
                    for p in range(5 * n):
                        q[p, d] -= pull * table[place[i], p]
        worst, enter_k, enter_h, enter_f = 0.0, -1, 0, 0
        for k in range(5):
            sides = faces if k == 0 else edge_count[k - 1]
            for h in range(n):
                slack = 0.0
                g = h if k == 0 else (n + h if k < 4 else -1)
                if g >= 0 and opened[g]:
                    total = 0.0
                    for i in range(count):
                        if group[i] == g:
                            total += multipliers[i]
                    slack = max(0.0, (total - rho[g // n, 0]) / rho[g // n, 1])
                for f in range(sides):
                    value = -slack - (offsets[h, f] if k == 0 else 1.0)
                    for d in range(axes):
                        value += (normals[h, f, d] if k == 0 else edges[k - 1, f, d]) * q[k * n + h, d]
                    if value > TOLERANCE and value * value > worst * (table[k * n + h, k * n + h] + COMPLIANCE):
                        known = False
                        for i in range(count):
                            known = known or (rows[i, 0] == k and rows[i, 1] == h and rows[i, 2] == f)
                        if not known:
                            worst = value * value / (table[k * n + h, k * n + h] + COMPLIANCE)
                            enter_k, enter_h, enter_f = k, h, f
        if enter_k < 0:
            for i in range(count, cap):
                rows[i, 0] = -1
            return rounds, count
        if count == cap:
            return -1 - rounds, count
        k, h, f = enter_k, enter_h, enter_f
        rows[count, 0], rows[count, 1], rows[count, 2] = k, h, f
        multipliers[count] = 0.0
        place[count] = k * n + h
        group[count] = h if k == 0 else (n + h if k < 4 else -1)
        bound[count] = offsets[h, f] if k == 0 else 1.0
        for d in range(axes):
            unit[count, d] = normals[h, f, d] if k == 0 else edges[k - 1, f, d]
        count += 1
    return -1 - most_rounds, count


dual_active_set: Callable[..., tuple[int, int]] = numba.njit(cache=True)(_dual_active_set)
